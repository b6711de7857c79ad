"""A phase of an optimal control problem: states, controls, dynamics, constraints.

Symbols are CasADi ``SX`` scalars: expressions are written with Python's operators
and CasADi's functions (``casadi.sin``, ...). Units are the user's own.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp.coupling import GREATEST_DEGREE, polynomial_degree
from showc.ocp.fault import (
    StatementError,
    check_known,
    check_name,
    check_scale,
    limited,
    scalar,
    users_line,
)
from showc.ocp.quantity import (
    Bound,
    Control,
    Expression,
    HalfSpaces,
    Quantity,
    State,
    column,
    interval,
    limits,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

GREATEST_INDEX = 5
"""Greatest differential index that is looked for."""


class Phase:
    """A stretch of time with its own states, controls and dynamics."""

    def __init__(
        self, name: str, start: tuple[Bound, Bound], duration: tuple[Bound, Bound]
    ) -> None:
        self.name = name
        self.line = users_line()
        """File and line where the phase is stated."""
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

    @property
    def members(self) -> tuple[Expression, Expression]:
        """Columns of the symbols of states and of controls, in their order."""
        states, controls = self.states.values(), self.controls.values()
        return (
            column(state.quantity.symbol for state in states),
            column(control.quantity.symbol for control in controls),
        )

    @property
    def dynamics(self) -> Expression:
        """Column of the states' derivatives."""
        return column(self.derivatives[name] for name in self.states)

    def state(
        self,
        name: str,
        lower: Bound = None,
        upper: Bound = None,
        *,
        start: object = None,
        end: object = None,
        scale: float | None = None,
        shape: int | tuple[int, int] | None = None,
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
        shape
            Length of a vector, or rows and columns of a matrix, whose elements are
            states named ``name[0]`` or ``name[0,1]``. Bounds and end values are then
            for all elements, or arrays (for ends also nested lists) of that shape.

        Returns
        -------
        casadi.SX
            The symbol to write expressions with, of the shape asked for.

        Raises
        ------
        StatementError
            If the name is taken, or a bound or end value makes no sense.
        """
        if shape is not None:
            return elements(
                name,
                shape,
                {"lower": lower, "upper": upper, "start": start, "end": end},
                partial(self.state, scale=scale),
            )
        self._check_new(name, "state", scale)
        what = f"state {name!r}"
        low, high = interval((lower, upper), what)
        symbol = casadi.SX.sym(name)
        self.states[name] = State(
            Quantity(name, symbol, low, high, scale, users_line()),
            interval(start, f"the start of {what}"),
            interval(end, f"the end of {what}"),
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
        shape: int | tuple[int, int] | None = None,
        rate: tuple[Bound, Bound] | None = None,
    ) -> Expression:
        """Add a control that keeps ``lower`` and ``upper`` at every instant.

        ``degree`` is that of its polynomial on each mesh interval: 0 (constant), 1
        (linear), higher, or ``None`` to leave it to the solver (one less than the
        state's degree on a plain transcription). ``continuous``: whether neighbouring
        intervals share the value at their border. ``shape``: of a vector or matrix, as
        :meth:`state` takes it. ``rate``: bounds of its time derivative; the control is
        then a state, and ``rate of`` it the control.
        """
        if shape is not None:
            make = partial(
                self.control,
                degree=degree,
                continuous=continuous,
                scale=scale,
                rate=rate,
            )
            return elements(name, shape, {"lower": lower, "upper": upper}, make)
        if rate is not None:
            if not isinstance(rate, (tuple, list)) or len(rate) != 2:
                raise StatementError(
                    f"the rate of control {name!r} is {rate!r}; wanted two bounds"
                )
            quantity = self.state(name, lower, upper, scale=scale)
            pace = self.control(f"rate of {name}", *rate, degree=degree)
            self.derivative(quantity, pace)
            return quantity
        self._check_new(name, "control", scale)
        if degree is not None and (not isinstance(degree, int) or degree < 0):
            raise StatementError(
                f"the degree of control {name!r} is {degree!r}; wanted 0, 1, ..."
            )
        low, high = interval((lower, upper), f"control {name!r}")
        symbol = casadi.SX.sym(name)
        self.controls[name] = Control(
            Quantity(name, symbol, low, high, scale, users_line()),
            degree,
            continuous,
            casadi.SX.sym(f"{name}(start)"),
            casadi.SX.sym(f"{name}(end)"),
        )
        return symbol

    def derivative(self, state: Expression, expression: Expression) -> None:
        """Set the time derivative of ``state``, a symbol or a vector or matrix of them.

        Raises
        ------
        StatementError
            If it is no state of this phase, or the shapes differ.
        """
        if not isinstance(state, casadi.SX):
            self._name_of(state)
        symbols = casadi.SX(state)
        if symbols.numel() != 1:
            parts = expression if isinstance(expression, (list, tuple)) else None
            rates = casadi.SX(expression if parts is None else casadi.vertcat(*parts))
            if rates.shape != symbols.shape:
                raise StatementError(
                    f"the derivative has the shape {rates.shape}, the state "
                    f"{symbols.shape}; wanted one rate for each element"
                )
            for symbol, rate in zip(_entries(symbols), _entries(rates), strict=True):
                self.derivative(symbol, rate)
            return
        name = self._name_of(state)
        if name not in self.states:
            raise StatementError(
                f"{name!r} is a control of phase {self.name!r}; only states have a "
                "derivative. To limit how fast a control changes, state it with "
                "rate=(lower, upper)"
            )
        self.derivatives[name] = scalar(expression, f"the derivative of {name!r}")

    def constrain(
        self,
        expression: Expression,
        lower: Bound = None,
        upper: Bound = None,
        *,
        name: str | None = None,
        scale: float | None = None,
    ) -> None:
        """Bound ``expression`` of states, controls, time and statics at all times.

        With ``lower`` equal to ``upper`` it is an equation, which determines a control
        (an algebraic variable); its index is
        :meth:`index_of`.
        """
        title = name or f"path constraint {len(self.path_constraints) + 1}"
        if any(other.name == title for other in self.path_constraints):
            raise StatementError(
                f"phase {self.name!r} has two path constraints named {title!r}"
            )
        low, high = limits(lower, upper, f"path constraint {title!r}")
        check_scale(scale, f"path constraint {title!r}")
        symbol = limited(expression, f"path constraint {title!r}")
        self.path_constraints.append(
            Quantity(title, symbol, low, high, scale, users_line())
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

        The derivatives have to be stated before. A condensed transcription bounds the
        Bernstein coefficients of the rate: the polynomials then keep the bound at
        every instant.
        """
        names = tuple(self._name_of(state) for state in states)
        missing = [state for state in names if state not in self.derivatives]
        if missing:
            raise StatementError(
                f"{', '.join(map(repr, missing))} of phase {self.name!r} has no "
                "derivative yet; call derivative before constrain_rate"
            )
        found = [self.derivatives[state] for state in names]
        expression = found[0] if len(found) == 1 else sum(rate**2 for rate in found)
        self.constrain(expression, lower, upper, name=name, scale=scale)
        self.rates[name] = names

    def index_of(self, name: str) -> int | None:
        """Return the differential index of the path equation ``name``.

        It is one more than the number of times that the equation must be differentiated
        by time until a control enters it. An index of 1 is an algebraic equation for a
        control; with a higher one the equation restricts the states themselves, and is
        better stated in its differentiated form with end conditions.

        Returns
        -------
        int or None
            ``None``: no control enters it at all, up to an index of 5.
        """
        known = {constraint.name: constraint for constraint in self.path_constraints}
        check_known([name], known, f"index_of of phase {self.name!r}")
        states = [state.quantity.symbol for state in self.states.values()]
        rates = [self.derivatives[key] for key in self.states]
        controls = casadi.vertcat(*[c.quantity.symbol for c in self.controls.values()])
        expression = known[name].symbol
        for index in range(1, GREATEST_INDEX + 1):
            if self.controls and casadi.depends_on(expression, controls):
                return index
            slopes = casadi.jacobian(expression, casadi.vertcat(*states))
            later = casadi.jacobian(expression, self.time)
            expression = casadi.mtimes(slopes, casadi.vertcat(*rates)) + later
        return None

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
        :mod:`showc.ocp.refinement.constraint_generation`.

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
        title = name or f"coupling {len(self.couplings) + 1}"
        if any(other.name == title for other in self.couplings):
            raise StatementError(
                f"phase {self.name!r} has two couplings named {title!r}"
            )
        low, high = limits(lower, upper, f"coupling {title!r}")
        expression = limited(expression, f"coupling {title!r}")
        states = casadi.vertcat(*[s.quantity.symbol for s in self.states.values()])
        others = [c.quantity.symbol for c in self.controls.values()]
        others += [self.time, self.initial_time, self.duration]
        depends = casadi.depends_on(casadi.SX(expression), casadi.vertcat(*others))
        if depends or polynomial_degree(expression, states) is None:
            raise StatementError(
                f"coupling {title!r} of phase {self.name!r} is no polynomial of degree "
                f"{GREATEST_DEGREE} at most in the states; state it as one (a squared "
                "distance, say), or use constrain"
            )
        line = users_line()
        self.couplings.append(Quantity(title, expression, low, high, scale, line))

    def integral(self, expression: Expression) -> Expression:
        """Symbol of the integral of ``expression`` over the phase."""
        symbol = casadi.SX.sym(f"{self.name}.integral{len(self.integrals)}")
        self.integrals.append((symbol, scalar(expression, "the integrand")))
        return symbol

    def initial(self, quantity: Expression) -> Expression:
        """Symbol of a state's or control's value at the start of the phase."""
        return self._ends(quantity, "initial")

    def final(self, quantity: Expression) -> Expression:
        """Symbol of a state's or control's value at the end of the phase."""
        return self._ends(quantity, "final")

    def _ends(self, quantity: Expression, which: str) -> Expression:
        if not isinstance(quantity, casadi.SX):
            self._name_of(quantity)
        symbols = casadi.SX(quantity)
        ends = [getattr(self._member(one), which) for one in _entries(symbols)]
        return casadi.reshape(casadi.vertcat(*ends), *symbols.shape)

    def half_space(self, name: str, states: list[Expression], rows: int) -> None:
        """Add ``rows`` linear constraints per interval on Bernstein coefficients.

        Their normals and bounds are given per solve; see :class:`HalfSpaces`.
        """
        names = tuple(self._name_of(state) for state in states)
        self.half_spaces.append(HalfSpaces(name, names, rows))

    def _check_new(self, name: str, kind: str, scale: float | None) -> None:
        check_name(name, f"a {kind} of phase {self.name!r}")
        if name in self.states or name in self.controls:
            raise StatementError(
                f"phase {self.name!r} has two quantities named {name!r}"
            )
        check_scale(scale, f"{kind} {name!r}")

    def _name_of(self, symbol: Expression) -> str:
        name = str(symbol)
        if not isinstance(symbol, casadi.SX):
            kind = "a CasADi MX" if isinstance(symbol, casadi.MX) else f"{symbol!r}"
            raise StatementError(f"{kind} is given; wanted a symbol of state()")
        for table in (self.states, self.controls):
            if name in table and casadi.is_equal(
                table[name].quantity.symbol,
                symbol,
            ):
                return name
        raise StatementError(
            f"{name} is no state or control of phase {self.name!r}; wanted one of "
            f"{', '.join([*self.states, *self.controls])}"
        )

    def _member(self, symbol: Expression) -> State | Control:
        name = self._name_of(symbol)
        return self.states[name] if name in self.states else self.controls[name]


def _entries(matrix: Expression) -> list[Expression]:
    """Elements of a matrix, column by column."""
    return list(casadi.vertsplit(casadi.vec(casadi.densify(matrix))))


def elements(
    name: str,
    shape: int | tuple[int, int],
    values: Mapping[str, object],
    make: Callable[..., Expression],
) -> Expression:
    """Make a quantity for each element of a vector or matrix.

    Parameters
    ----------
    name
        Of the whole; an element is called ``name[i]`` or ``name[i,j]``.
    shape
        Length, or rows and columns.
    values
        Settings by name: one for all elements, or an array of the shape.
    make
        Called with an element's name and settings; returns its symbol.

    Raises
    ------
    StatementError
        If the shape makes no sense, or a setting has another one.
    """
    check_name(name, "a vector")
    sides = shape if isinstance(shape, tuple) else (shape,)
    whole = all(isinstance(side, int) and side > 0 for side in sides)
    if not whole or len(sides) not in {1, 2}:
        raise StatementError(
            f"{name!r} has the shape {shape!r}; wanted a length, or rows and columns"
        )
    rows, columns = (*sides, 1)[:2]
    flat = len(sides) == 1

    def setting(key: str, i: int, j: int) -> object:
        value: Any = values[key]
        if value is None or np.ndim(value) == 0 or isinstance(value, tuple):
            return value
        array = np.asarray(value, dtype=object)
        wanted = (rows,) if flat else (rows, columns)
        if array.shape != wanted:
            raise StatementError(
                f"{key!r} of {name!r} has the shape {array.shape}; wanted {wanted}, or "
                "one value for all elements"
            )
        return array[i] if flat else array[i, j]

    table = [
        [
            make(
                f"{name}[{i}]" if flat else f"{name}[{i},{j}]",
                **{key: setting(key, i, j) for key in values},
            )
            for j in range(columns)
        ]
        for i in range(rows)
    ]
    return casadi.vertcat(*[casadi.horzcat(*row) for row in table])
