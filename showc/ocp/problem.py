"""An optimal control problem as a person states it; knows no mesh and no solver.

Symbols are CasADi ``SX`` scalars: expressions are written with Python's operators
and CasADi's functions (``casadi.sin``, ...). Units are the user's own.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi

from showc.ocp.coupling import GREATEST_DEGREE, polynomial_degree
from showc.ocp.quantity import (
    Bound,
    Control,
    Expression,
    HalfSpaces,
    Quantity,
    State,
    interval,
)


class Phase:
    """A stretch of time with its own states, controls and dynamics."""

    def __init__(
        self, name: str, start: tuple[Bound, Bound], duration: tuple[Bound, Bound]
    ) -> None:
        self.name = name
        self.start = start
        self.duration_bounds = duration
        self.time: Expression = casadi.SX.sym(f"{name}.time")
        """Symbol of the time t in dynamics and path constraints."""
        self.initial_time: Expression = casadi.SX.sym(f"{name}.initial_time")
        self.duration: Expression = casadi.SX.sym(f"{name}.duration")
        self.states: dict[str, State] = {}
        self.controls: dict[str, Control] = {}
        self.derivatives: dict[str, Expression] = {}
        self.path_constraints: list[Quantity] = []
        self.integrals: list[tuple[Expression, Expression]] = []
        self.half_spaces: list[HalfSpaces] = []
        self.rates: dict[str, tuple[str, ...]] = {}
        """Path constraints on how fast states change: the states of each."""
        self.couplings: list[Quantity] = []

    @property
    def final_time(self) -> Expression:
        """Expression of the time at the end of the phase."""
        return self.initial_time + self.duration

    def state(
        self,
        name: str,
        lower: Bound = None,
        upper: Bound = None,
        *,
        start: object = None,
        end: object = None,
        scale: float | None = None,
    ) -> Expression:
        """Add a state that keeps ``lower`` and ``upper`` at every instant.

        Parameters
        ----------
        name
            Unique within the phase.
        lower, upper
            Bounds at every instant; ``None`` for none.
        start, end
            Value at the start and the end of the phase: a number, a pair of bounds,
            or ``None`` for free.
        scale
            Typical magnitude; by default from bounds, ends and guess.

        Returns
        -------
        casadi.SX
            The symbol to write expressions with.
        """
        self._check_new(name)
        low, high = interval((lower, upper))
        symbol = casadi.SX.sym(name)
        self.states[name] = State(
            Quantity(name, symbol, low, high, scale),
            interval(start),
            interval(end),
            casadi.SX.sym(f"{name}(start)"),
            casadi.SX.sym(f"{name}(end)"),
        )
        return symbol

    def control(
        self,
        name: str,
        lower: Bound = None,
        upper: Bound = None,
        *,
        degree: int | None = None,
        continuous: bool = False,
        scale: float | None = None,
    ) -> Expression:
        """Add a control that keeps ``lower`` and ``upper`` at every instant.

        ``degree`` is that of its polynomial on each mesh interval: 0 (constant), 1
        (linear), higher, or ``None`` to leave it to the solver (one less than the
        state's degree on a plain transcription).
        """
        self._check_new(name)
        low, high = interval((lower, upper))
        symbol = casadi.SX.sym(name)
        self.controls[name] = Control(
            Quantity(name, symbol, low, high, scale),
            degree,
            continuous,
            casadi.SX.sym(f"{name}(start)"),
            casadi.SX.sym(f"{name}(end)"),
        )
        return symbol

    def derivative(self, state: Expression, expression: Expression) -> None:
        """Set the time derivative of ``state``."""
        self.derivatives[self._name_of(state)] = casadi.SX(expression)

    def constrain(
        self,
        expression: Expression,
        lower: Bound = None,
        upper: Bound = None,
        *,
        name: str | None = None,
        scale: float | None = None,
    ) -> None:
        """Bound ``expression`` of states, controls, time and statics at all times."""
        low, high = interval((lower, upper))
        title = name or f"path constraint {len(self.path_constraints) + 1}"
        if any(other.name == title for other in self.path_constraints):
            raise ValueError(
                f"phase {self.name!r} has two path constraints named {title!r}"
            )
        self.path_constraints.append(
            Quantity(title, casadi.SX(expression), low, high, scale)
        )

    def constrain_rate(
        self,
        states: list[Expression],
        lower: Bound = None,
        upper: Bound = None,
        *,
        name: str,
        scale: float | None = None,
    ) -> None:
        """Bound the rate of one state, or the squared length of that of several.

        The derivatives have to be stated before. A staged transcription bounds the
        Bernstein coefficients of the rate: the polynomials then keep the bound at
        every instant.
        """
        names = tuple(self._name_of(state) for state in states)
        found = [self.derivatives[state] for state in names]
        expression = found[0] if len(found) == 1 else sum(rate**2 for rate in found)
        self.constrain(expression, lower, upper, name=name, scale=scale)
        self.rates[name] = names

    def couple(
        self,
        expression: Expression,
        lower: Bound = None,
        upper: Bound = None,
        *,
        name: str | None = None,
        scale: float | None = None,
    ) -> None:
        """State a candidate constraint between subsystems, imposed where it is needed.

        :func:`showc.ocp.solve` leaves it out until an audit in continuous time finds
        it violated, and then imposes it where it is; see
        :mod:`showc.ocp.adaptive.constraint_generation`.

        Parameters
        ----------
        expression
            Polynomial in the states, of degree 4 at most; parameters may enter it
            in any way. A squared distance, for instance.
        lower, upper
            Bounds that hold at every instant of the answer.
        scale
            Typical magnitude; by default from the bounds.

        Raises
        ------
        ValueError
            If the expression is no such polynomial, or the name is taken.
        """
        low, high = interval((lower, upper))
        title = name or f"coupling {len(self.couplings) + 1}"
        if any(other.name == title for other in self.couplings):
            raise ValueError(f"phase {self.name!r} has two couplings named {title!r}")
        states = casadi.vertcat(*[s.quantity.symbol for s in self.states.values()])
        others = [c.quantity.symbol for c in self.controls.values()]
        others += [self.time, self.initial_time, self.duration]
        depends = casadi.depends_on(casadi.SX(expression), casadi.vertcat(*others))
        if depends or polynomial_degree(expression, states) is None:
            raise ValueError(
                f"coupling {title!r} of phase {self.name!r} is no polynomial of degree "
                f"{GREATEST_DEGREE} at most in the states; state it as one (a squared "
                "distance, say), or use constrain"
            )
        self.couplings.append(Quantity(title, casadi.SX(expression), low, high, scale))

    def integral(self, expression: Expression) -> Expression:
        """Symbol of the integral of ``expression`` over the phase."""
        symbol = casadi.SX.sym(f"{self.name}.integral{len(self.integrals)}")
        self.integrals.append((symbol, casadi.SX(expression)))
        return symbol

    def initial(self, quantity: Expression) -> Expression:
        """Symbol of a state's or control's value at the start of the phase."""
        return self._member(quantity).initial

    def final(self, quantity: Expression) -> Expression:
        """Symbol of a state's or control's value at the end of the phase."""
        return self._member(quantity).final

    def half_space(self, name: str, states: list[Expression], rows: int) -> None:
        """Add ``rows`` linear constraints per interval on Bernstein coefficients.

        Their normals and bounds are given per solve; see :class:`HalfSpaces`.
        """
        names = tuple(self._name_of(state) for state in states)
        self.half_spaces.append(HalfSpaces(name, names, rows))

    def _check_new(self, name: str) -> None:
        if name in self.states or name in self.controls:
            raise ValueError(f"phase {self.name!r} has two quantities named {name!r}")

    def _name_of(self, symbol: Expression) -> str:
        name = str(symbol)
        for table in (self.states, self.controls):
            if name in table and casadi.is_equal(
                table[name].quantity.symbol,
                symbol,
            ):
                return name
        raise ValueError(
            f"{name} is no state or control of phase {self.name!r}; wanted one of "
            f"{', '.join([*self.states, *self.controls])}"
        )

    def _member(self, symbol: Expression) -> State | Control:
        name = self._name_of(symbol)
        return self.states[name] if name in self.states else self.controls[name]


@dataclass(slots=True)
class Problem:
    """An optimal control problem of one or more phases.

    Examples
    --------
    >>> problem = Problem("double integrator")
    >>> phase = problem.phase("flight", duration=(0.1, 10.0))
    >>> x = phase.state("x", start=0.0, end=1.0)
    >>> v = phase.state("v", start=0.0, end=0.0)
    >>> u = phase.control("u", -1.0, 1.0)
    >>> phase.derivative(x, v)
    >>> phase.derivative(v, u)
    >>> problem.minimise(phase.duration)
    """

    name: str
    phases: list[Phase] = field(default_factory=list)
    parameters: dict[str, tuple[Expression, float | None]] = field(default_factory=dict)
    statics: list[Quantity] = field(default_factory=list)
    boundary_constraints: list[Quantity] = field(default_factory=list)
    links: list[tuple[int, int, tuple[str, ...]]] = field(default_factory=list)
    objective: Expression = field(default_factory=lambda: casadi.SX(0))
    maximises: bool = False

    def parameter(self, name: str, default: float | None = None) -> Expression:
        """Add a number that is given anew for each solve."""
        symbol = casadi.SX.sym(name)
        self.parameters[name] = (symbol, default)
        return symbol

    def static(
        self,
        name: str,
        lower: Bound = None,
        upper: Bound = None,
        *,
        scale: float | None = None,
    ) -> Expression:
        """Add an unknown that does not change with time."""
        low, high = interval((lower, upper))
        symbol = casadi.SX.sym(name)
        self.statics.append(Quantity(name, symbol, low, high, scale))
        return symbol

    def phase(
        self,
        name: str = "phase",
        *,
        duration: object = (0.0, None),
        start: object = 0.0,
    ) -> Phase:
        """Add a phase.

        Parameters
        ----------
        name
            Unique within the problem.
        duration
            A number, an expression in parameters, or a pair of bounds; never
            negative.
        start
            Time at the start of the phase: a number or a pair of bounds. The start
            of a linked phase is where the one before ends, whatever is said here.
        """
        if any(phase.name == name for phase in self.phases):
            raise ValueError(f"problem {self.name!r} has two phases named {name!r}")
        low, high = interval(duration)
        if isinstance(low, (int, float)) and low < 0.0:
            low = 0.0
        phase = Phase(name, interval(start), (low, high))
        self.phases.append(phase)
        return phase

    def constrain_boundary(
        self,
        expression: Expression,
        lower: Bound = None,
        upper: Bound = None,
        *,
        name: str | None = None,
        scale: float | None = None,
    ) -> None:
        """Bound an expression of end values, times, integrals and statics."""
        low, high = interval((lower, upper))
        title = name or f"boundary constraint {len(self.boundary_constraints) + 1}"
        self.boundary_constraints.append(
            Quantity(title, casadi.SX(expression), low, high, scale)
        )

    def link(
        self, first: Phase, second: Phase, states: list[str] | None = None
    ) -> None:
        """Let ``second`` start when and where ``first`` ends.

        ``states`` names those that are continuous; by default all that both have.
        """
        names = states or [name for name in first.states if name in second.states]
        before, after = self.phases.index(first), self.phases.index(second)
        self.links.append((before, after, tuple(names)))

    def minimise(self, expression: Expression) -> None:
        """Set the objective, an expression of end values, times and integrals."""
        self.objective = casadi.SX(expression)
        self.maximises = False

    def maximise(self, expression: Expression) -> None:
        """Set an objective to be made as large as possible."""
        self.objective = casadi.SX(expression)
        self.maximises = True

    def check(self) -> None:
        """Raise ``ValueError`` where the problem is not completely stated."""
        if not self.phases:
            raise ValueError(f"problem {self.name!r} has no phase; add one")
        for phase in self.phases:
            missing = [name for name in phase.states if name not in phase.derivatives]
            if missing:
                raise ValueError(
                    f"phase {phase.name!r} has no derivative for state "
                    f"{', '.join(missing)}; call phase.derivative"
                )
