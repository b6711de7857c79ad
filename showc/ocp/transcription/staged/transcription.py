"""Staged transcription: a cascade on a mesh, one stage an interval.

For problems of one phase whose dynamics form a cascade
(:mod:`showc.ocp.transcription.staged.cascade`) the nonlinear program has no
unknowns inside the
intervals, and neighbouring intervals meet in their states only. fatrop (Vanroye,
Sathya, De Schutter, Decre 2023, FATROP: a fast constrained optimal control problem
solver) factorises such programs stage by stage; IPOPT takes them as they are. A program
is built once and solved many times with other parameters, widths, signals, half-spaces
and guesses.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp.outcome import Result
from showc.ocp.transcription.staged.chain import Chain, lay_out
from showc.ocp.transcription.staged.ends import is_fixed, within
from showc.ocp.transcription.staged.gaps import Gaps
from showc.ocp.transcription.staged.guarded import Guarded
from showc.ocp.transcription.staged.solution import (
    Answer,
    StagedGuess,
    StagedOptions,
    StagedSolution,
    StagedSolver,
    result_of,
)
from showc.ocp.transcription.staged.solver import make_staged_solver
from showc.ocp.transcription.staged.stages import Row, Stage, TimeKind, build_stage

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import BoolArray, FloatArray
    from showc.ocp.problem import Problem


__all__ = [
    "StagedGuess",
    "StagedOptions",
    "StagedSolution",
    "StagedSolver",
    "StagedTranscription",
]


class StagedTranscription:
    """A problem on a mesh of a given size, built once, solved many times.

    Parameters
    ----------
    problem
        One phase, dynamics a cascade; see ``build_stage``.
    intervals
        Number K of mesh intervals.
    time
        Whether the widths of the intervals are given, scaled in common, or all free.
    signals
        Names of parameters that vary along the phase; given per solve at the
        ``cost_nodes`` of each interval.

    Raises
    ------
    ValueError
        If the problem has a form that stages cannot express.
    """

    def __init__(
        self,
        problem: Problem,
        intervals: int,
        *,
        time: TimeKind = "given",
        signals: Sequence[str] = (),
        options: StagedOptions | None = None,
    ) -> None:
        problem.check()
        self.problem = problem
        self.intervals = intervals
        self.time: TimeKind = time
        self.options = options or StagedOptions()
        self.signals = tuple(signals)
        self.stage: Stage = build_stage(
            problem,
            points=self.options.points,
            time=time,
            signals=signals,
            cost_points=self.options.cost_points,
            width_weight=self.options.width_weight,
        )
        self._coefficients = self.stage.coefficients.map(intervals)
        self._guarded: Guarded | None = None
        self._pattern = b""
        self._assemble()

    def _assemble(self) -> None:
        layout = lay_out(self.stage, self.intervals, self.time)
        self._chain = Chain(self.stage, layout, len(self.problem.parameters))
        self._rows, self._interval = layout.rows, layout.interval
        self._equal = np.array([self._is_equation(row) for row in layout.rows])
        self._scale = np.array([row.scale for row in layout.rows])
        self._gaps = Gaps(self._chain.slopes, self._equal)
        self._table()
        self._solver: Any = None
        self._forked = False

    def _is_equation(self, row: Row) -> bool:
        kind, name = row.key[0], row.key[-1]
        states = self.problem.phases[0].states
        if kind == "start":
            return is_fixed(states[name].start)
        if kind == "end":
            return is_fixed(states[name].end)
        return kind == "dynamics"

    def _table(self) -> None:
        """Index the bounds that rows refer to, as a function of the parameters."""
        phase = self.problem.phases[0]
        lower: list[Any] = [casadi.SX(0)]
        upper: list[Any] = [casadi.SX(0)]
        slots: dict[tuple[str, ...], int] = {}

        def put(key: tuple[str, ...], low: Any, high: Any) -> None:  # noqa: ANN401
            slots[key] = len(lower)
            lower.append(casadi.SX(low))
            upper.append(casadi.SX(high))

        for name, state in phase.states.items():
            put(("bounds", name), state.quantity.lower, state.quantity.upper)
            put(("start", name), *state.start)
            put(("end", name), *within(state.end, state.quantity))
        for name, control in phase.controls.items():
            put(("bounds", name), control.quantity.lower, control.quantity.upper)
        for constraint in phase.path_constraints:
            put(("path", constraint.name), constraint.lower, constraint.upper)
        put(("duration",), *phase.duration_bounds)
        put(("width",), *self.options.width_range)
        parameters = [symbol for symbol, _ in self.problem.parameters.values()]
        p = casadi.vertcat(*parameters) if parameters else casadi.SX(0, 1)
        self._bounds = casadi.Function(
            "bounds", [p], [casadi.vertcat(*lower), casadi.vertcat(*upper)]
        )
        self._slots = slots
        self._slot = np.array([slots.get(row.key, 0) for row in self._rows])
        self._beside = {
            (kind, name): np.array(
                [
                    i
                    for i, row in enumerate(self._rows)
                    if row.key == ("bounds", name) and self._interval[i] == k
                ],
                dtype=np.int64,
            )
            for name in phase.states
            for kind, k in (("start", 0), ("end", self.intervals - 1))
        }
        self._half = {
            (group.name, r): np.array(
                [
                    i
                    for i, row in enumerate(self._rows)
                    if row.key == ("half", group.name, str(r))
                ]
            )
            for group in phase.half_spaces
            for r in range(group.rows)
        }

    def _touching(self, low: FloatArray, high: FloatArray) -> BoolArray:
        """Find limits of states that stand on them at that end of the phase.

        Nothing in the interval beside could keep the inset from them: how far the state
        moves away there is for the controls to say.
        """
        touching = np.zeros(self._equal.size, dtype=bool)
        for (kind, name), rows in self._beside.items():
            fixed, bounds = self._slots[kind, name], self._slots["bounds", name]
            if low[fixed] != high[fixed]:
                continue
            room = min(low[fixed] - low[bounds], high[bounds] - high[fixed])
            if room < self.options.inset * self._scale[rows].max(initial=0.0):
                touching[rows] = True
        return touching

    def solve(
        self,
        *,
        widths: FloatArray,
        guess: StagedGuess,
        parameters: Mapping[str, float] | None = None,
        signals: FloatArray | None = None,
        half_spaces: Mapping[str, tuple[FloatArray, FloatArray]] | None = None,
        bounds: Mapping[tuple[str, str], tuple[float, float]] | None = None,
    ) -> StagedSolution:
        """Solve once.

        Parameters
        ----------
        widths
            Widths of the intervals, shape (K,): kept, scaled in common, or moved,
            by the kind of time.
        guess
            Where to start.
        parameters
            Values of the problem's parameters.
        signals
            Shape (K, cost points, signals).
        half_spaces
            For a group: normals (K, rows, states) and lower bounds (K, rows); a bound
            of minus infinity switches a row off, and so does a missing group.
        bounds
            Bounds that differ from the problem's: (lower, upper) of
            ``("bounds", state or control)`` or ``("path", constraint)``. What had no
            bounds when the program was built cannot get any.
        """
        stage, count = self.stage, self.intervals
        values = self._values(parameters or {})
        data = np.zeros((count, stage.data))
        fractions = widths / widths.sum() if self.time == "free" else widths
        data[:, 0] = fractions
        if signals is not None:
            data[:, stage.signal_slice] = signals.reshape(count, -1)
        low, high = (np.array(b).ravel() for b in self._bounds(values))
        for key, (least, greatest) in (bounds or {}).items():
            low[self._slots[key]], high[self._slots[key]] = least, greatest
        lower = low[self._slot] / self._scale
        upper = high[self._slot] / self._scale
        for (group, r), rows in self._half.items():
            # A row that is off is 0 >= -1: fatrop wants its infinities in place.
            lower[rows], upper[rows] = -1.0, np.inf
            if half_spaces is not None and group in half_spaces:
                normals, bound = half_spaces[group]
                wanted = bound[self._interval[rows], r] / self._scale[rows]
                lower[rows] = np.where(np.isfinite(wanted), wanted, -1.0)
                part = stage.half_space_slices[group]
                on = np.where(np.isfinite(bound)[:, :, None], normals, 0.0)
                data[:, part] = on.reshape(count, -1)
        inset = np.where(self._equal, 0.0, self.options.inset)
        inset[self._touching(low, high)] = 0.0
        lower += inset
        upper -= inset
        start = self._pack(guess, float(widths.sum()))
        solver = self._make_solver()
        given = np.concatenate([values, data.ravel()])
        arguments = {"x0": start, "p": given, "lbg": lower, "ubg": upper}
        answer = self._call(solver, arguments)
        wanted = lower[self._equal]
        unknowns, rows = self._gaps.closed(answer.unknowns, answer.rows, given, wanted)
        return self._unpack(
            replace(answer, unknowns=unknowns, rows=rows),
            fractions,
            values,
            data,
            (lower, upper),
        )

    def _call(self, solver: Any, arguments: Mapping[str, Any]) -> Answer:  # noqa: ANN401
        if not self._forked:
            answer = solver(**arguments)
            return Answer(
                np.array(answer["x"]).ravel(),
                np.array(answer["g"]).ravel(),
                float(answer["f"]),
                solver.stats(),
            )
        names = ("x0", "p", "lbg", "ubg")
        values = [arguments[name] for name in names]
        # fatrop keeps for good which bounds were infinite in its first call, and goes
        # astray when they change: another child then.
        pattern = np.isfinite(np.concatenate(values[2:])).tobytes()
        if pattern != self._pattern:
            self._pattern, self._guarded = pattern, None
        size = self.stage.states + self.stage.inputs
        sizes = values[0].size, self._scale.size
        if self._guarded is None:
            seconds = 0.5 + 4e-7 * size**2 * self.intervals * self.options.iterations
            lengths = [value.size for value in values]
            self._guarded = Guarded(solver, names, lengths, sizes, seconds)
        found = self._guarded(values)
        if found is None:
            rows = np.full(sizes[1], np.nan)
            statistics = {"success": False, "iter_count": self.options.iterations}
            return Answer(values[0], rows, np.nan, statistics)
        return Answer(*found)

    def _values(self, parameters: Mapping[str, float]) -> FloatArray:
        unknown = set(parameters) - set(self.problem.parameters)
        if unknown:
            raise ValueError(f"no parameter {sorted(unknown)} in the problem")
        return np.array(
            [
                parameters.get(name, 0.0 if default is None else default)
                for name, (_, default) in self.problem.parameters.items()
            ],
            dtype=np.float64,
        )

    def _pack(self, guess: StagedGuess, duration: float) -> FloatArray:
        stage, count = self.stage, self.intervals
        nodes, inputs = guess.states, guess.controls
        if self.time == "free":
            nodes = np.hstack([nodes, np.full((count + 1, 1), duration)])
        if self.time == "movable":
            inputs = np.hstack([inputs, np.ones((count, 1))])
        nodes = nodes / np.array(stage.state_scales)
        inputs = inputs / np.array(stage.control_scales)
        return np.concatenate([np.hstack([nodes[:-1], inputs]).ravel(), nodes[-1]])

    def _make_solver(self) -> Any:  # noqa: ANN401
        if self._solver is None:
            self._solver, self._forked = make_staged_solver(
                self._chain, self._equal.tolist(), self.options
            )
        return self._solver

    def _unpack(
        self,
        answer: Answer,
        fractions: FloatArray,
        values: FloatArray,
        data: FloatArray,
        bounds: tuple[FloatArray, FloatArray],
    ) -> StagedSolution:
        stage, count = self.stage, self.intervals
        flat, (lower, upper) = answer.unknowns, bounds
        size = stage.states + stage.inputs
        table = flat[: count * size].reshape(count, size)
        nodes = np.vstack([table[:, : stage.states], flat[count * size :]])
        inputs = table[:, stage.states :]
        columns = np.array(
            self._coefficients(
                nodes[:-1].T, inputs.T, data.T, np.tile(values[:, None], (1, count))
            )
        )
        coefficients: dict[str, FloatArray] = {}
        first = 0
        for name, degree in stage.degrees.items():
            coefficients[name] = columns[first : first + degree + 1].T
            first += degree + 1
        widths = fractions
        if self.time == "free":
            widths = fractions * nodes[0, -1]
        elif self.time == "movable":
            widths = fractions * inputs[:, -1]
        nodes = nodes * np.array(stage.state_scales)
        inputs = inputs * np.array(stage.control_scales)
        for index, name in enumerate(stage.state_names):
            # The solver's tolerance leaves a gap between intervals; close it.
            coefficients[name][:, -1] = nodes[1:, index]
        broken = np.maximum(lower - answer.rows, answer.rows - upper)
        worst = int(np.argmax(np.where(np.isnan(broken), np.inf, broken)))
        result = result_of(
            success=bool(answer.statistics["success"]), violation=float(broken[worst])
        )
        message = ""
        if result is Result.INVALID_NUMBER:
            message = "the solver came to no end"
        elif not result.usable:
            time = float(
                np.concatenate([[0.0], np.cumsum(widths)])[self._interval[worst]]
            )
            message = (
                f"{' of '.join(self._rows[worst].key)} is broken by "
                f"{broken[worst] * self._scale[worst]:.3g} near time {time:.3g}"
            )
        return StagedSolution(
            result,
            message,
            widths,
            nodes[:, : len(stage.state_names)],
            inputs[:, : sum(stage.degrees[n] + 1 for n in stage.control_names)],
            coefficients,
            answer.objective,
            int(answer.statistics["iter_count"]),
            float(broken[worst]),
        )
