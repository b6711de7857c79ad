"""Condensed transcription: a cascade on a mesh, one stage an interval.

The dynamics of a problem of one phase may form a cascade
(:mod:`showc.ocp.transcription.condensed.cascade`). Then the nonlinear program has no
unknowns inside the intervals, and neighbouring intervals meet in their states only.
fatrop (Vanroye, Sathya, De Schutter, Decre 2023, FATROP: a fast constrained optimal
control problem solver) factorises such programs stage by stage; IPOPT takes them as
they are. A program is built once and solved many times with other parameters, widths,
signals, half-spaces and guesses.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp.guess import Data, Guess, sample
from showc.ocp.mesh import Mesh, PhaseMesh
from showc.ocp.nodes import collocation
from showc.ocp.outcome import Result
from showc.ocp.solution import Multipliers, PhaseSolution, Solution
from showc.ocp.transcription.condensed.chain import Chain, Gaps, lay_out
from showc.ocp.transcription.condensed.guarded import AVAILABLE, Answer, Guarded
from showc.ocp.transcription.condensed.stages import (
    Row,
    Stage,
    TimeKind,
    build_stage,
    is_fixed,
    within,
)
from showc.ocp.transcription.solver import SolverOptions, make_condensed_solver
from showc.trajectory import PiecewisePolynomial, bernstein_basis_inverse

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.ocp.guess import Curve
    from showc.ocp.problem import Problem


USABLE = 1e-6
"""Greatest violation of a row over its scale with which a trajectory is of use although
the solver has not come to its end."""


END = 5e-4
"""By how much a control may miss the value it is to have at an end, over its scale:
an inequality has an interior, which the solver needs."""


@dataclass(frozen=True, slots=True)
class CondensedOptions:
    """How a condensed program is built and solved."""

    solver: SolverOptions = field(
        default_factory=lambda: SolverOptions(
            "fatrop", tolerance=1e-6, iterations=200, seconds=20.0, barrier=1e-2
        )
    )
    """How each program is solved; IPOPT does it where no process can be forked."""
    points: int = 4
    """Gauss points of derivatives that are no polynomials."""
    cost_points: int = 2
    """Gauss points of running costs."""
    inset: float = 1e-6
    """How far inside their bounds rows are kept, scaled, so that what the solver's
    tolerance leaves stays within."""
    width_range: tuple[float, float] = (0.1, 3.0)
    """Least and greatest ratio of a movable width to the one it starts from."""
    width_weight: float = 1e-4
    """Weight that keeps movable widths near those they start from."""


class CondensedTranscription:
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
        options: CondensedOptions | None = None,
    ) -> None:
        problem.check()
        self.problem = problem
        self.intervals = intervals
        self.time: TimeKind = time
        self.options = options or CondensedOptions()
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
        # Where no child can be forked, IPOPT does the work.
        self._forked = self.options.solver.solver == "fatrop" and AVAILABLE

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
        final = self.intervals - 1
        self._beside = {
            (kind, name): self._limiting(name, k)
            for name in phase.states
            for kind, k in (("start", 0), ("end", final))
        }
        self._ending = {
            (which, name): rows[last]
            for name in phase.controls
            for which, k, last in (("start", 0, 0), ("goal", final, -1))
            if (rows := self._limiting(name, k)).size
        }
        self._half = {
            (group.name, r): self._keyed("half", group.name, str(r))
            for group in phase.half_spaces
            for r in range(group.rows)
        }

    def _keyed(self, *key: str) -> IntArray:
        """Numbers of the rows that belong to something."""
        return np.flatnonzero([row.key == key for row in self._rows])

    def _limiting(self, name: str, interval: int) -> IntArray:
        """Numbers of the rows that bound a state or control in an interval."""
        rows = self._keyed("bounds", name)
        return np.asarray(rows[self._interval[rows] == interval])

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
        guess: Guess | Solution,
        parameters: Mapping[str, float] | None = None,
        signals: FloatArray | None = None,
        half_spaces: Mapping[str, tuple[FloatArray, FloatArray]] | None = None,
        bounds: Mapping[tuple[str, str], tuple[float, float]] | None = None,
        control_ends: Mapping[tuple[str, str], float] | None = None,
    ) -> Solution:
        """Solve once.

        Parameters
        ----------
        widths
            Widths of the intervals, shape (K,): kept, scaled in common, or moved,
            by the kind of time.
        guess
            Where to start: curves, or a solution on as many intervals.
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
        control_ends
            Values of bounded controls where the phase starts and where it ends, by
            ``("start" or "goal", control)``, met to ``END`` of their scale.
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
        for (which, name), value in (control_ends or {}).items():
            row = self._ending[which, name]
            lower[row], upper[row] = value / self._scale[row] + np.array([-END, END])
        lower += inset
        upper -= inset
        start = self._pack(guess, widths)
        given = np.concatenate([values, data.ravel()])
        answer = self._call({"x0": start, "p": given, "lbg": lower, "ubg": upper})
        unknowns, found = self._gaps.closed(
            answer.unknowns, answer.rows, given, lower[self._equal]
        )
        broken = np.maximum(lower - found, found - upper)
        return self._solution(unknowns, broken, answer, widths, (values, data))

    def _call(self, arguments: Mapping[str, Any]) -> Answer:
        if self._solver is None:
            self._solver = make_condensed_solver(
                self._chain,
                self._equal.tolist(),
                self.options.solver,
                forked=self._forked,
            )
        if not self._forked:
            answer = self._solver(**arguments)
            statistics = self._solver.stats()
            return Answer(
                np.array(answer["x"]).ravel(),
                np.array(answer["g"]).ravel(),
                float(answer["f"]),
                bool(statistics["success"]),
                int(statistics["iter_count"]),
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
        limit = self.options.solver.iterations
        if self._guarded is None:
            seconds = 0.5 + 4e-7 * size**2 * self.intervals * limit
            lengths = [value.size for value in values]
            self._guarded = Guarded(self._solver, names, lengths, sizes, seconds)
        found = self._guarded(values)
        if found is None:
            rows = np.full(sizes[1], np.nan)
            return Answer(values[0], rows, np.nan, success=False, iterations=limit)
        return found

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

    def _pack(self, guess: Guess | Solution, widths: FloatArray) -> FloatArray:
        """Scaled unknowns to start from."""
        stage, count = self.stage, self.intervals
        if isinstance(guess, Solution):
            part = guess.phases[0]
            states, controls = part.states.coefficients, part.controls.coefficients
            nodes = np.vstack([states[:, 0], states[-1:, -1]])
            tables = [
                controls[:, : stage.degrees[name] + 1, j]
                for j, name in enumerate(stage.control_names)
            ]
        else:
            borders = np.concatenate([[0.0], np.cumsum(widths)])
            nodes = np.stack(
                [
                    _sampled(self._curve(guess, name), borders)
                    for name in stage.state_names
                ],
                axis=1,
            )
            tables = [
                _fitted(self._curve(guess, name), borders, stage.degrees[name])
                for name in stage.control_names
            ]
        inputs = np.hstack(tables)
        if self.time == "free":
            nodes = np.hstack([nodes, np.full((count + 1, 1), float(widths.sum()))])
        if self.time == "movable":
            inputs = np.hstack([inputs, np.ones((count, 1))])
        nodes = nodes / np.array(stage.state_scales)
        inputs = inputs / np.array(stage.control_scales)
        return np.concatenate([np.hstack([nodes[:-1], inputs]).ravel(), nodes[-1]])

    def _curve(self, guess: Guess, name: str) -> Curve:
        phase = self.problem.phases[0].name
        return guess.curves.get(name, guess.curves.get(f"{phase}.{name}", 0.0))

    def _solution(
        self,
        unknowns: FloatArray,
        broken: FloatArray,
        answer: Answer,
        widths: FloatArray,
        given: tuple[FloatArray, FloatArray],
    ) -> Solution:
        """Read a point of the program.

        ``broken``: by how much each row exceeds its bounds; ``given``: values of the
        parameters, and the data of all stages.
        """
        stage, count = self.stage, self.intervals
        size = stage.states + stage.inputs
        table = unknowns[: count * size].reshape(count, size)
        nodes = np.vstack([table[:, : stage.states], unknowns[count * size :]])
        inputs = table[:, stage.states :]
        values, data = given
        columns = np.array(
            self._coefficients(
                nodes[:-1].T, inputs.T, data.T, np.tile(values[:, None], (1, count))
            )
        )
        fractions = (1.0,) * count
        arcs, durations = tuple(range(count)), widths
        if self.time != "movable":
            fractions = tuple((data[:, 0] / data[:, 0].sum()).tolist())
            arcs, durations = (0,) * count, np.array([widths.sum()])
        if self.time == "free":
            durations = np.abs(nodes[:1, -1])
            widths = data[:, 0] * durations
        elif self.time == "movable":
            durations = widths = data[:, 0] * inputs[:, -1]
        if not np.all(widths > 0.0):
            # A search that failed may end anywhere; what it gave has no other use.
            widths = np.maximum(np.nan_to_num(np.abs(widths)), 1e-12)
        breaks = np.concatenate([[0.0], np.cumsum(widths)])
        tables = {}
        first = 0
        for name, degree in stage.degrees.items():
            tables[name] = columns[first : first + degree + 1].T
            first += degree + 1
        for index, name in enumerate(stage.state_names):
            # The solver's tolerance leaves a gap between intervals; close it.
            tables[name][:, -1] = nodes[1:, index] * stage.state_scales[index]
        mesh = PhaseMesh(fractions, (self.options.points,) * count, arcs)
        part = PhaseSolution(
            self.problem.phases[0].name,
            mesh,
            durations,
            stage.state_names,
            stage.control_names,
            _joined([tables[name] for name in stage.state_names], breaks),
            _joined([tables[name] for name in stage.control_names], breaks),
            np.zeros(0),
            np.zeros((0, len(stage.state_names))),
        )
        result, message = self._outcome(broken, breaks, success=answer.success)
        sign = -1.0 if self.problem.maximises else 1.0
        return Solution(
            result,
            message,
            sign * answer.objective,
            (part,),
            {},
            Multipliers(unknowns, np.zeros(0), np.zeros(0)),
            answer.iterations,
            Mesh((mesh,)),
            dict(zip(self.problem.parameters, values.tolist(), strict=True)),
        )

    def _outcome(
        self, broken: FloatArray, breaks: FloatArray, *, success: bool
    ) -> tuple[Result, str]:
        """How the solve ended, and the constraint that is broken most, and where."""
        worst = int(np.argmax(np.where(np.isnan(broken), np.inf, broken)))
        violation = float(broken[worst])
        if not np.isfinite(violation):
            return Result.INVALID_NUMBER, "the solver came to no end"
        if success or violation < USABLE:
            result = Result.SOLVED if success else Result.ACCEPTABLE
            return result, result.value
        time = float(breaks[self._interval[worst]])
        return Result.INFEASIBLE, (
            f"{' of '.join(self._rows[worst].key)} is broken by "
            f"{violation * self._scale[worst]:.3g} near time {time:.3g}"
        )


def _sampled(curve: Curve, times: FloatArray) -> FloatArray:
    """Values of a guessed curve at times from the start of the phase."""
    if isinstance(curve, (Data, PiecewisePolynomial)):
        return sample(curve, times)
    return sample(curve, times / times[-1])


def _fitted(curve: Curve, borders: FloatArray, degree: int) -> FloatArray:
    """Bernstein coefficients (K, degree + 1) of a guessed curve on each interval."""
    count = borders.size - 1
    if isinstance(curve, PiecewisePolynomial) and curve.intervals == count:
        return curve.elevated(degree).coefficients[:, :, 0]
    nodes = collocation("gauss", degree + 1)[0]
    times = borders[:-1, None] + np.diff(borders)[:, None] * nodes
    values = _sampled(curve, np.append(times.ravel(), borders[-1]))[:-1]
    inverse = bernstein_basis_inverse(degree, tuple(nodes.tolist()))
    return np.asarray(values.reshape(count, -1) @ inverse.T)


def _joined(tables: list[FloatArray], breaks: FloatArray) -> PiecewisePolynomial:
    """One piecewise polynomial from coefficients (K, own degree + 1) of each member."""
    degree = max(table.shape[1] for table in tables) - 1
    same = np.empty((breaks.size - 1, degree + 1, len(tables)))
    for own in {table.shape[1] for table in tables}:
        chosen = [k for k, table in enumerate(tables) if table.shape[1] == own]
        part = np.stack([tables[k] for k in chosen], axis=2)
        same[:, :, chosen] = (
            PiecewisePolynomial(breaks, part).elevated(degree).coefficients
        )
    return PiecewisePolynomial(breaks, same)
