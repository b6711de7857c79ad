"""Bounds of unknowns and rows for one solve, from the problem and its overrides."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.ocp.fault import check_known
from showc.ocp.transcription.collocation.statement import Table, known_names

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray
    from showc.ocp.mesh import Mesh
    from showc.ocp.phase import Phase
    from showc.ocp.problem import Problem
    from showc.ocp.transcription.collocation.builder import Discretisation, PhaseLayout


SHORTEST = 1e-6
"""Least duration of an arc over the scale of the phase's duration."""

_TIGHTEST = 0.25
"""Share of its range by which a constraint is tightened at either end at most: half of
the range stays."""


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

    def in_place(self, table: Table, problem: Problem) -> Table:
        """Return the table with the overridden bounds of states and controls.

        Raises
        ------
        ValueError
            If a bound is given interval by interval, which needs a mesh.
        """
        values = table.values.copy()
        for phase in problem.phases:
            for name in [*phase.states, *phase.controls]:
                new: Any = _lookup(self.bounds, phase.name, name)
                if new is None:
                    continue
                if any(np.ndim(bound) for bound in new):
                    raise ValueError(
                        f"bounds of {name!r} are given interval by interval; an "
                        "adaptive solve wants two numbers"
                    )
                at = table.slots["bounds", phase.name, name]
                values[at : at + 2] = new
        return replace(table, values=values)


def _pair(value: object) -> tuple[float, float]:
    if isinstance(value, tuple):
        return float(value[0]), float(value[1])
    return float(value), float(value)  # type: ignore[arg-type]


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
            margin = np.minimum(margin, _TIGHTEST * (bounds[1] - bounds[0]))
            equation = bounds[0] == bounds[1]
            low, high = bounds[0] + margin, bounds[1] - margin
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
            tighter = min(tighter, _TIGHTEST * (bounds[1] - bounds[0]))
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
