"""The problem's statement in numbers: bounds of all quantities, and their scales."""

from __future__ import annotations

from dataclasses import dataclass
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
from showc.ocp.transcription.collocation.builder import Scales

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray
    from showc.ocp.phase import Phase
    from showc.ocp.problem import Problem
    from showc.ocp.quantity import Control, Quantity, State

_NO_MATTER = 100.0
"""Factor from one within which a constraint is left as stated: its unit does no harm,
and a scale from a few slopes would only lead the search elsewhere. A launch in four
phases failed by a scale of 3.2 on one inequality."""


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
    found = []
    for aside in scaling.places(scale.size):
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


def known_names(problem: Problem) -> set[str]:
    """Names by which a state or control may be called."""
    names: set[str] = set()
    for phase in problem.phases:
        for name in [*phase.states, *phase.controls]:
            names |= {name, f"{phase.name}.{name}"}
    return names


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
