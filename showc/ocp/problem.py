"""An optimal control problem as a person states it; knows no mesh and no solver.

Symbols are CasADi ``SX`` scalars: expressions are written with Python's operators
and CasADi's functions (``casadi.sin``, ...). Units are the user's own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import casadi

from showc.ocp.fault import (
    StatementError,
    check_known,
    check_name,
    check_number,
    check_scale,
    limited,
    scalar,
    users_line,
)
from showc.ocp.phase import Phase
from showc.ocp.quantity import (
    Bound,
    Control,
    Expression,
    Quantity,
    State,
    column,
    interval,
    limits,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["Phase", "Problem"]


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
    objective: Expression = None
    """``None``: not stated yet."""
    maximises: bool = False

    @property
    def given(self) -> Expression:
        """Column of the symbols of parameters and statics, in their order."""
        parameters = [symbol for symbol, _ in self.parameters.values()]
        return column([*parameters, *(static.symbol for static in self.statics)])

    @property
    def aimless(self) -> bool:
        """Whether the objective is a mere number: any trajectory will do."""
        return not casadi.symvar(casadi.SX(self.objective))

    @property
    def kinks(self) -> list[str]:
        """Names of functions in the statement whose slope jumps."""
        stated = [self.objective, *(c.symbol for c in self.boundary_constraints)]
        for phase in self.phases:
            stated += [*phase.derivatives.values(), *(e for _, e in phase.integrals)]
            stated += [c.symbol for c in phase.path_constraints]
        found = casadi.vertcat(*stated)
        function = casadi.Function("stated", casadi.symvar(found), [found])
        numbers = {function.instruction_id(k) for k in range(function.n_instructions())}
        known = {"fabs": casadi.OP_FABS, "fmin": casadi.OP_FMIN, "fmax": casadi.OP_FMAX}
        return [name for name, number in known.items() if number in numbers]

    def parameter(self, name: str, default: float | None = None) -> Expression:
        """Add a number that is given anew for each solve."""
        self._check_new(name, "parameter")
        if default is not None:
            default = check_number(default, f"the default of parameter {name!r}")
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
        self._check_new(name, "static")
        check_scale(scale, f"static {name!r}")
        low, high = interval((lower, upper), f"static {name!r}")
        symbol = casadi.SX.sym(name)
        self.statics.append(Quantity(name, symbol, low, high, scale, users_line()))
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
            raise StatementError(f"problem {self.name!r} has two phases named {name!r}")
        check_name(name, f"a phase of problem {self.name!r}")
        low, high = interval(duration, f"the duration of phase {name!r}")
        if isinstance(high, (int, float)) and high <= 0.0:
            raise StatementError(
                f"the duration of phase {name!r} is at most {high:g}; wanted above 0"
            )
        if isinstance(low, (int, float)) and low < 0.0:
            low = 0.0
        begin = interval(start, f"the start of phase {name!r}")
        phase = Phase(name, begin, (low, high))
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
        title = name or f"boundary constraint {len(self.boundary_constraints) + 1}"
        what = f"boundary constraint {title!r}"
        if any(title == other.name for other in self.boundary_constraints):
            raise StatementError(f"problem {self.name!r} has two of the name {title!r}")
        low, high = limits(lower, upper, what)
        check_scale(scale, what)
        self.boundary_constraints.append(
            Quantity(title, limited(expression, what), low, high, scale, users_line())
        )

    def link(
        self,
        first: Phase,
        second: Phase,
        states: Sequence[str] | None = None,
        *,
        jumps: Mapping[str, Expression] | None = None,
    ) -> None:
        """Let ``second`` start when, and as far as is said where, ``first`` ends.

        Parameters
        ----------
        first, second
            Phases of this problem.
        states
            Names of the states that are continuous; by default all that both have and
            that do not jump. An empty list links the times alone.
        jumps
            For states of ``second`` that start elsewhere: an expression of end values,
            such as ``{"v": -0.8 * first.final(v)}``.

        Raises
        ------
        StatementError
            If a phase is not this problem's, or a state is not in both.
        """
        for phase in (first, second):
            if not any(phase is own for own in self.phases):
                name = getattr(phase, "name", phase)
                raise StatementError(f"{name!r} is no phase of problem {self.name!r}")
        what = f"the link of phases {first.name!r} and {second.name!r}"
        before, after = self.phases.index(first), self.phases.index(second)
        if first is second:
            raise StatementError(f"{what} joins a phase to itself; wanted two")
        if any((before, after) == known[:2] for known in self.links):
            raise StatementError(f"{what} is stated twice")
        leaps = dict(jumps or {})
        check_known(leaps, second.states, f"a jump in {what}")
        shared = [name for name in first.states if name in second.states]
        if isinstance(states, str):
            raise StatementError(
                f"{what} has a text for states; wanted a list of names"
            )
        if states is None and not shared:
            raise StatementError(
                f"{what} finds no state that both have; link(a, b, []) joins the times"
            )
        names = [n for n in shared if n not in leaps] if states is None else states
        check_known(names, shared, what)
        if both := sorted(set(names) & set(leaps)):
            raise StatementError(f"{what} has {both[0]!r} both continuous and jumping")
        for name, value in leaps.items():
            self.constrain_boundary(
                second.states[name].initial - scalar(value, f"the jump of {name!r}"),
                0.0,
                0.0,
                name=f"jump of {name} to phase {second.name}",
            )
        self.links.append((before, after, tuple(names)))

    def minimise(self, expression: Expression) -> None:
        """Set the objective, an expression of end values, times and integrals."""
        self.objective = scalar(expression, "the objective")
        self.maximises = False

    def maximise(self, expression: Expression) -> None:
        """Set an objective to be made as large as possible."""
        self.minimise(expression)
        self.maximises = True

    def _check_new(self, name: str, kind: str) -> None:
        taken = [*self.parameters, *(static.name for static in self.statics)]
        check_name(name, f"a {kind} of problem {self.name!r}", taken)

    def check(self) -> None:
        """Raise :class:`StatementError` where the problem is not completely stated."""
        if not self.phases:
            raise StatementError(f"problem {self.name!r} has no phase; add one")
        for phase in self.phases:
            if not phase.states:
                raise StatementError(
                    f"phase {phase.name!r} has no state; add one", phase.line
                )
            missing = [name for name in phase.states if name not in phase.derivatives]
            if missing:
                raise StatementError(
                    f"phase {phase.name!r} has no derivative for state "
                    f"{', '.join(missing)}; call phase.derivative",
                    phase.states[missing[0]].quantity.line,
                )
        if self.objective is None:
            raise StatementError(
                f"problem {self.name!r} has no objective; call minimise or maximise "
                "(minimise(0) for any trajectory that keeps the constraints)",
                self.phases[0].line,
            )
        self._check_symbols()

    def _check_symbols(self) -> None:
        """Raise where an expression has a symbol that it may not have."""
        shared = [symbol for symbol, _ in self.parameters.values()]
        statics = [static.symbol for static in self.statics]
        ends: list[Expression] = [*shared, *statics]
        inside: dict[str, str] = {}
        for phase in self.phases:
            members: list[State | Control] = [
                *phase.states.values(),
                *phase.controls.values(),
            ]
            ends += [phase.initial_time, phase.duration]
            ends += [end for m in members for end in (m.initial, m.final)]
            ends += [symbol for symbol, _ in phase.integrals]
            known = [
                *shared,
                *statics,
                phase.time,
                *(m.quantity.symbol for m in members),
            ]
            inside |= {m.quantity.name: phase.name for m in members}
            inside[phase.time.name()] = phase.name
            named = [
                (f"the derivative of {name!r}", rate, phase.states[name].quantity.line)
                for name, rate in phase.derivatives.items()
            ]
            named += [
                (f"path constraint {c.name!r}", c.symbol, c.line)
                for c in phase.path_constraints
            ]
            named += [("an integrand", e, phase.line) for _, e in phase.integrals]
            for what, expression, line in named:
                for name in _foreign(expression, known):
                    raise StatementError(
                        f"{what} in phase {phase.name!r} contains {name!r}; it may "
                        "contain states, controls and time of that phase, parameters "
                        "and statics (a duration inside is a static equal to it)",
                        line,
                    )
        for what, expression, line in [
            ("the objective", self.objective, self.phases[0].line),
            *(
                (f"boundary constraint {c.name!r}", c.symbol, c.line)
                for c in self.boundary_constraints
            ),
        ]:
            for name in _foreign(expression, ends):
                home = inside.get(name)
                hint = (
                    f"write initial({name}), final({name}) or an integral over phase "
                    f"{home!r}"
                    if home
                    else "it may contain end values, times, integrals, parameters and "
                    "statics of this problem"
                )
                raise StatementError(f"{what} contains {name!r} itself; {hint}", line)


def _foreign(expression: Expression, known: Sequence[Expression]) -> list[str]:
    """Names of symbols in ``expression`` that are not among the ``known`` ones."""
    keys = {symbol.element_hash() for symbol in known}
    used = casadi.symvar(casadi.SX(expression))
    return [s.name() for s in used if s.element_hash() not in keys]
