"""Bounds of unknowns and rows for one solve, from the problem and its overrides."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp import scaling
from showc.ocp.fault import (
    StatementError,
    check_known,
    check_number,
    check_scale,
)
from showc.ocp.scaling import GOLDEN
from showc.ocp.transcription.collocation.builder import Scales

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray
    from showc.ocp.mesh import Mesh
    from showc.ocp.phase import Phase
    from showc.ocp.problem import Problem
    from showc.ocp.quantity import Control, Quantity, State
    from showc.ocp.transcription.collocation.builder import Discretisation, PhaseLayout


SHORTEST = 1e-6
"""Least duration of an arc over the scale of the phase's duration."""


@dataclass(frozen=True, slots=True)
class Overrides:
    """What differs from the problem's own statement in one solve.

    Names are ``"x"`` where only one phase has an x, else ``"phase.x"``.
    """

    bounds: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)
    """New (lower, upper) of a state or control: numbers or one for each interval."""
    starts: Mapping[str, float | tuple[float, float]] = field(default_factory=dict)
    """New value, or bounds, of a state at the start of its phase."""
    ends: Mapping[str, float | tuple[float, float]] = field(default_factory=dict)
    """New value, or bounds, of a state at the end of its phase."""
    durations: Mapping[str, float | tuple[float, float]] = field(default_factory=dict)
    """New duration, or bounds of it, by name of the phase."""
    half_spaces: Mapping[str, tuple[FloatArray, FloatArray, FloatArray]] = field(
        default_factory=dict
    )
    """For a group of half-spaces: normals (K, rows, states), lower (K, rows), upper
    (K, rows). Without an entry the group is switched off."""


_NO_MATTER = 100.0
"""Factor from one within which a constraint is left as stated: its unit does no harm,
and a scale from a few slopes would only lead the search elsewhere. A launch in four
phases failed by a scale of 3.2 on one inequality."""

_PLACES = 5
"""Places at which the slopes of constraints are looked at for their scales."""


def _changed(
    constraint: Quantity,
    bounds: tuple[float, float],
    inside: tuple[list[Any], list[float]],
    sizes: list[float],
    given: tuple[list[Any], list[float]],
) -> float:
    """By how much a constraint changes if what is in it moves by its ``sizes``.

    ``inside`` and ``given``: symbols with values, those that move and parameters.
    """
    if constraint.scale is not None:
        return float(constraint.scale)
    if any(np.isfinite(bound) and bound != 0.0 for bound in bounds):
        return 1.0
    x = casadi.vertcat(casadi.SX(0, 1), *inside[0])
    p = casadi.vertcat(casadi.SX(0, 1), *given[0])
    slopes = casadi.Function(
        "slopes", [x, p], [casadi.densify(casadi.jacobian(constraint.symbol, x))]
    )
    scale, at = np.array(sizes, dtype=np.float64), np.array(inside[1])
    pattern = np.arange(1, scale.size + 1) * GOLDEN
    found = []
    for number in range(_PLACES):
        aside = (pattern * (2 * number + 1)) % 1.0 - 0.5
        row = np.asarray(slopes(at + aside * scale, np.array(given[1]))).ravel()
        size = float(np.abs(row) @ scale)
        if np.isfinite(size) and size > 0.0:
            found.append(size)
    size = float(np.median(found)) if found else 1.0
    return 1.0 if 1.0 / _NO_MATTER <= size <= _NO_MATTER else size


def _moving(phase: Phase, j: int, sizes: FloatArray, time: float) -> float:
    """Least size of control ``j`` that moves a state by its scale in all the ``time``.

    1 where no rate has a constant slope by the control, or where that is enough: in a
    long phase a control may do much in a short while.
    """
    control = list(phase.controls.values())[j].quantity.symbol
    found = []
    for name, size in zip(phase.states, sizes, strict=True):
        slope = casadi.jacobian(phase.derivatives[name], control)
        if slope.nnz() and not casadi.symvar(slope):
            found.append(size / time / abs(float(slope)))
    size = min(found, default=1.0)
    return size if size > _NO_MATTER else 1.0


def _pair(value: object) -> tuple[float, float]:
    if isinstance(value, tuple):
        return float(value[0]), float(value[1])
    return float(value), float(value)  # type: ignore[arg-type]


class Statement:
    """The problem's bounds with numbers put in for its parameters.

    Parameters
    ----------
    problem
        Whose bounds.
    hints
        Typical magnitudes by name; those of constraints follow them where they are
        less than bounds tell.
    """

    def __init__(
        self, problem: Problem, hints: Mapping[str, float] | None = None
    ) -> None:
        problem.check()
        self.problem = problem
        self.names = list(problem.parameters)
        symbols = [symbol for symbol, _ in problem.parameters.values()]
        self.slots: dict[tuple[str, ...], int] = {}
        values: list[Any] = []

        def put(key: tuple[str, ...], lower: Any, upper: Any) -> None:  # noqa: ANN401
            self.slots[key] = len(values)
            values.extend([casadi.SX(lower), casadi.SX(upper)])

        for quantity in problem.statics:
            put(("static", quantity.name), quantity.lower, quantity.upper)
        for constraint in problem.boundary_constraints:
            put(("boundary", constraint.name), constraint.lower, constraint.upper)
        for phase in problem.phases:
            put(("time", phase.name), *phase.start)
            put(("duration", phase.name), *phase.duration_bounds)
            for name, state in phase.states.items():
                quantity = state.quantity
                put(("bounds", phase.name, name), quantity.lower, quantity.upper)
                put(("start", phase.name, name), *state.start)
                put(("end", phase.name, name), *state.end)
            for name, control in phase.controls.items():
                quantity = control.quantity
                put(("bounds", phase.name, name), quantity.lower, quantity.upper)
            for constraint in phase.path_constraints:
                key = ("path", phase.name, constraint.name)
                put(key, constraint.lower, constraint.upper)
            for coupling in phase.couplings:
                key = ("coupling", phase.name, coupling.name)
                put(key, coupling.lower, coupling.upper)
        self._function = casadi.Function(
            "bounds",
            [casadi.vertcat(casadi.SX(0, 1), *symbols)],
            [casadi.vertcat(casadi.SX(0, 1), *values)],
        )

        self.constraint_scales: dict[tuple[str, str], float] = {}
        self.constraint_scales = self._weighed(hints or {})
        """Scales of path constraints, by phase and name, and of boundary constraints
        (phase ``""``) whose bounds do not tell them."""

    def _weighed(self, hints: Mapping[str, float]) -> dict[tuple[str, str], float]:
        """Weigh constraints by bounds, and by what is known beside: by the lesser."""
        told = self._weigh_constraints(self.scales({}))
        if not hints:
            return told
        found = self._weigh_constraints(self.scales(hints))
        return {key: min(scale, found[key]) for key, scale in told.items()}

    def _weigh_constraints(self, scales: Scales) -> dict[tuple[str, str], float]:
        """Take scales that bounds do not tell from the constraints' slopes.

        The scale is by how much a constraint changes if all in it move by their scales,
        as the slopes at several places between the bounds tell. An inequality g <= 0
        then means the same in any unit of g.
        """
        weights: dict[tuple[str, str], float] = {}
        shared = [symbol for symbol, _ in self.problem.parameters.values()]
        values = [default or 0.0 for _, default in self.problem.parameters.values()]
        statics = [static.symbol for static in self.problem.statics]
        ends, sizes_of_ends = [*statics], [*scales.statics]
        table = self.table(np.array(values, dtype=np.float64))
        for p, phase in enumerate(self.problem.phases):
            members: list[State | Control] = [
                *phase.states.values(),
                *phase.controls.values(),
            ]
            sizes = [*scales.states[p], *scales.controls[p]]
            time = scales.durations[p]
            ends += [phase.initial_time, phase.duration]
            sizes_of_ends += [time, time]
            for member, size in zip(members, sizes, strict=True):
                ends += [member.initial, member.final]
                sizes_of_ends += [size, size]
            ends += [symbol for symbol, _ in phase.integrals]
            sizes_of_ends += [1.0] * len(phase.integrals)
            inside = [*(m.quantity.symbol for m in members), phase.time, *statics]
            middles = [
                scaling.middle(*table["bounds", phase.name, m.quantity.name])
                for m in members
            ]
            for constraint in phase.path_constraints:
                weights[phase.name, constraint.name] = _changed(
                    constraint,
                    table["path", phase.name, constraint.name],
                    (inside, [*middles, 0.0, *([0.0] * len(statics))]),
                    [*sizes, time, *scales.statics],
                    (shared, values),
                )
        for constraint in self.problem.boundary_constraints:
            weights["", constraint.name] = _changed(
                constraint,
                table["boundary", constraint.name],
                (ends, [0.0] * len(ends)),
                sizes_of_ends,
                (shared, values),
            )
        return weights

    def parameters(self, given: Mapping[str, float]) -> FloatArray:
        """Values of all parameters, in order.

        Raises
        ------
        ValueError
            If one is unknown or has neither a value nor a default.
        """
        check_known(given, self.names, "a value of a parameter")
        values = []
        for name in self.names:
            value = given.get(name, self.problem.parameters[name][1])
            if value is None:
                raise StatementError(f"parameter {name!r} has no value and no default")
            values.append(check_number(value, f"the value of parameter {name!r}"))
        return np.array(values)

    def table(self, parameters: FloatArray) -> Table:
        """Bounds as numbers."""
        values = np.asarray(self._function(parameters)).ravel()
        return Table(self.slots, values, self.constraint_scales)

    def scales(self, hints: Mapping[str, float]) -> Scales:
        """Scales from bounds, end values and ``hints`` by name.

        Raises
        ------
        StatementError
            If a hint is for nothing there is, or not above 0.
        """
        known = known_names(self.problem) | {s.name for s in self.problem.statics}
        known |= {f"{phase.name}.duration" for phase in self.problem.phases}
        check_known(hints, sorted({*known, "objective"}), "a scale")
        for name, hint in hints.items():
            check_scale(hint, repr(name))
        defaults = [
            np.nan if default is None else default
            for _, default in self.problem.parameters.values()
        ]
        table = self.table(np.array(defaults, dtype=np.float64))

        def scale(quantity: Quantity, phase: str, *ends: float) -> float:
            for key in (f"{phase}.{quantity.name}", quantity.name):
                if key in hints:
                    return float(hints[key])
            if quantity.scale is not None:
                return float(quantity.scale)
            kind = ("bounds", phase, quantity.name)
            key2 = kind if kind in table.slots else ("static", quantity.name)
            return scaling.from_bounds(*table[key2], *ends)

        states, controls, durations = [], [], []
        for phase in self.problem.phases:
            states.append(
                np.array(
                    [
                        scale(
                            state.quantity,
                            phase.name,
                            *table["start", phase.name, name],
                            *table["end", phase.name, name],
                        )
                        for name, state in phase.states.items()
                    ]
                )
            )
            controls.append(
                np.array(
                    [scale(c.quantity, phase.name) for c in phase.controls.values()]
                )
            )
            bounds = table["duration", phase.name]
            known_duration = hints.get(f"{phase.name}.duration")
            durations.append(known_duration or scaling.of_duration(*bounds))
            for j, (name, control) in enumerate(phase.controls.items()):
                named = {name, f"{phase.name}.{name}"} & set(hints)
                free = np.all(np.isinf(table["bounds", phase.name, name]))
                if free and control.quantity.scale is None and not named:
                    controls[-1][j] = _moving(phase, j, states[-1], durations[-1])
        statics = np.array([scale(s, "") for s in self.problem.statics])
        return Scales(
            tuple(states),
            tuple(controls),
            tuple(durations),
            statics,
            hints.get("objective"),
            self.constraint_scales,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Bounds by what they belong to."""

    slots: Mapping[tuple[str, ...], int]
    values: FloatArray
    constraint_scales: Mapping[tuple[str, str], float]

    def path_scale(self, phase: str, name: str) -> float:
        """Return the scale in which violations of a path constraint are measured."""
        return scaling.of_path(
            *self["path", phase, name], otherwise=self.constraint_scales[phase, name]
        )

    def __getitem__(self, key: tuple[str, ...]) -> tuple[float, float]:
        at = self.slots[key]
        return float(self.values[at]), float(self.values[at + 1])

    def with_bounds(self, problem: Problem, overrides: Overrides) -> Table:
        """Return the same table with the overridden bounds of states and controls.

        Raises
        ------
        ValueError
            If a bound is given interval by interval, which needs a mesh.
        """
        values = self.values.copy()
        for phase in problem.phases:
            for name in [*phase.states, *phase.controls]:
                new: Any = _lookup(overrides.bounds, phase.name, name)
                if new is None:
                    continue
                if any(np.ndim(bound) for bound in new):
                    raise ValueError(
                        f"bounds of {name!r} are given interval by interval; an "
                        "adaptive solve wants two numbers"
                    )
                at = self.slots["bounds", phase.name, name]
                values[at : at + 2] = new
        return Table(self.slots, values, self.constraint_scales)


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """Bounds of the unscaled unknowns and rows."""

    lower: FloatArray
    upper: FloatArray
    row_lower: FloatArray
    row_upper: FloatArray
    contradictions: tuple[str, ...]
    """Sentences on bounds that leave no value."""


def _lookup(overrides: Mapping[str, Any], phase: str, name: str) -> object:
    return overrides.get(f"{phase}.{name}", overrides.get(name))


def known_names(problem: Problem) -> set[str]:
    """Names by which a state or control may be called."""
    names: set[str] = set()
    for phase in problem.phases:
        for name in [*phase.states, *phase.controls]:
            names |= {name, f"{phase.name}.{name}"}
    return names


def _check_names(problem: Problem, overrides: Overrides) -> None:
    known = sorted(known_names(problem))
    check_known([*overrides.bounds], known, "an override of bounds")
    check_known([*overrides.starts], known, "an override of starts")
    check_known([*overrides.ends], known, "an override of ends")
    phases = [phase.name for phase in problem.phases]
    check_known([*overrides.durations], phases, "an override of durations")


def box(
    problem: Problem,
    mesh: Mesh,
    discretisation: Discretisation,
    table: Table,
    overrides: Overrides,
) -> Box:
    """Bounds of one solve."""
    _check_names(problem, overrides)
    size = discretisation.layout.size
    sides = _Sides(np.full(size, -np.inf), np.full(size, np.inf), [])
    linked = {after for _, after, _ in problem.links}
    for p, phase in enumerate(problem.phases):
        place = discretisation.layout.phases[p]
        if p not in linked:
            sides.narrow([place.start], table["time", phase.name])
        given = overrides.durations.get(phase.name)
        bounds = table["duration", phase.name] if given is None else _pair(given)
        if mesh.phases[p].arc_count > 1:
            # An arc may all but vanish, but its interval stays one.
            shortest = SHORTEST * discretisation.unknown_scale[place.durations[0]]
            bounds = shortest, np.inf
        sides.narrow([place.durations], bounds)
        sides.check(place.durations[0], f"the duration of phase {phase.name!r}")
        _bound_phase(phase, place, table, overrides, sides)
    for number, quantity in zip(
        discretisation.layout.statics, problem.statics, strict=True
    ):
        sides.narrow([number], table["static", quantity.name])
        sides.check(number, f"{quantity.name!r}")
    rows = _row_bounds(problem, mesh, discretisation, table, overrides)
    return Box(sides.lower, sides.upper, *rows, tuple(sides.words))


@dataclass(frozen=True, slots=True, eq=False)
class _Sides:
    """Bounds of the unknowns under construction."""

    lower: FloatArray
    upper: FloatArray
    words: list[str]

    def narrow(self, tables: list[Any], bounds: tuple[Any, Any]) -> None:
        """Intersect the bounds of coefficients with those given by interval."""
        lows, highs = (
            np.broadcast_to(np.asarray(b, dtype=np.float64), (len(tables),))
            for b in bounds
        )
        for k, numbers in enumerate(tables):
            self.lower[numbers] = np.maximum(self.lower[numbers], lows[k])
            self.upper[numbers] = np.minimum(self.upper[numbers], highs[k])

    def check(self, number: int, what: str) -> None:
        """Write a sentence if an unknown is left no value."""
        low, high = self.lower[number], self.upper[number]
        if low > high:
            self.words.append(f"{what} is to be at least {low:g} and at most {high:g}")


def _bound_phase(
    phase: Phase,
    place: PhaseLayout,
    table: Table,
    overrides: Overrides,
    sides: _Sides,
) -> None:
    """Bounds of the states and controls of one phase."""

    def bounds(name: str) -> tuple[Any, Any]:
        new: Any = _lookup(overrides.bounds, phase.name, name)
        return table["bounds", phase.name, name] if new is None else new

    for i, name in enumerate(phase.states):
        sides.narrow(place.state_row(i), bounds(name))
        for kind, changed, unknown in (
            ("start", overrides.starts, place.states[0][0, i]),
            ("end", overrides.ends, place.states[-1][-1, i]),
        ):
            other = _lookup(changed, phase.name, name)
            wanted = table[kind, phase.name, name] if other is None else _pair(other)
            sides.narrow([unknown], wanted)
            sides.check(unknown, f"{name!r} at the {kind} of phase {phase.name!r}")
    for j, name in enumerate(phase.controls):
        row = place.control_row(j)
        sides.narrow(row, bounds(name))
        sides.check(row[0][0], f"{name!r} in phase {phase.name!r}")


def _row_bounds(
    problem: Problem,
    mesh: Mesh,
    discretisation: Discretisation,
    table: Table,
    overrides: Overrides,
) -> tuple[FloatArray, FloatArray]:
    count = discretisation.row_scale.size
    lower, upper = np.zeros(count), np.zeros(count)
    at_points: set[tuple[int, str]] = set()
    for group in discretisation.groups:
        phase = problem.phases[group.phase].name
        if group.kind == "path":
            bounds = table["path", phase, group.name]
            margins = np.array(mesh.phases[group.phase].path_margins)
            margin = margins[group.interval] * table.path_scale(phase, group.name)
            equation = bounds[0] == bounds[1]
            low = bounds[0] + (0.0 if equation else margin)
            high = bounds[1] - (0.0 if equation else margin)
            held = np.array(
                mesh.phases[group.phase].path_held.get(group.name, (0,) * margins.size)
            )[group.interval]
            if (group.phase, group.name) in at_points:
                # At places besides the collocation points.
                free = (held != 0) | equation
                low = np.where(free, -np.inf, low)
                high = np.where(free, np.inf, high)
            else:
                low, high = np.where(held > 0, high, low), np.where(held < 0, low, high)
            at_points.add((group.phase, group.name))
            lower[group.rows], upper[group.rows] = low, high
            continue
        if group.kind == "coupling":
            bounds = table["coupling", phase, group.name]
            tighter = discretisation.coupling_margins[group.phase, group.name]
            bounds = bounds[0] + tighter, bounds[1] - tighter
        elif group.kind == "boundary":
            bounds = table["boundary", group.name]
        elif group.kind == "duration":
            given = overrides.durations.get(phase)
            bounds = table["duration", phase] if given is None else _pair(given)
        elif group.kind == "half-space":
            lower[group.rows], upper[group.rows] = -np.inf, np.inf
            if group.name in overrides.half_spaces:
                _, low, high = overrides.half_spaces[group.name]
                _, number, _ = discretisation.half_space_offsets[group.name]
                interval = group.interval.reshape(-1, number)[:, 0]
                lower[group.rows] = np.asarray(low)[interval].ravel()
                upper[group.rows] = np.asarray(high)[interval].ravel()
            continue
        else:
            continue
        lower[group.rows], upper[group.rows] = bounds
    return lower, upper


def parameter_vector(
    discretisation: Discretisation,
    parameters: FloatArray,
    overrides: Overrides,
    size: int,
) -> FloatArray:
    """Parameters of the program: the problem's, then the half-spaces' normals."""
    vector = np.zeros(size)
    vector[: parameters.size] = parameters
    for name, (normals, _, _) in overrides.half_spaces.items():
        first, rows, states = discretisation.half_space_offsets[name]
        flat = np.asarray(normals, dtype=np.float64).reshape(-1, rows * states)
        vector[first : first + flat.size] = flat.ravel()
    return vector
