"""Where controls switch and state constraints begin to bind: the arcs of a phase.

A control that is at a bound, or off it, over a stretch of time forms an arc. The
borders of all arcs become unknowns of the problem (their durations), and on each arc a
control at its bound is given the lowest degree. This is the idea of Agamawi, Hager, Rao
2019 (Mesh refinement method for solving bang-bang optimal control problems using direct
collocation). The structure is read off the controls and the active state bounds, so
that singular arcs and boundary arcs are covered as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.arrays import FloatArray
from showc.trajectory import bernstein_basis

if TYPE_CHECKING:
    from showc.arrays import BoolArray, IntArray
    from showc.ocp.solution import PhaseSolution
    from showc.trajectory import PiecewisePolynomial


PathValues = tuple[Callable[[FloatArray], FloatArray], Any]

_SAMPLES = 16
"""Cells of an interval in which a switch is looked for."""
SAMPLED = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
"""Middles of these cells as fractions of the interval."""
_CONTROL_CLOSE = 0.02
"""Fraction of a control's range within which it counts as at its bound."""
_CONTROL_TOUCHES = 1e-3
"""Fraction of its range within which a control comes somewhere on every interval of an
arc at its bound: a small control is no control at its bound."""
_STATE_CLOSE = 1e-4
"""Fraction of a state's range within which it counts as at its bound."""
_RESTS = 0.4
"""Mean distance of a state to its bound over the greatest one that counts as close, up
to which it rests on the bound or touches it."""
_PATH_CLOSE = 2e-3
"""Fraction of a path constraint's range within which it counts as active."""
_FOLLOWS = 0.5
"""Share of a state's stretch at its bound from which on it follows a control at its."""
_NEGLIGIBLE = 1e-5
"""Fraction of the phase below which an interval is no arc of its own."""


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """The arcs of a phase."""

    times: FloatArray
    """Inner borders of the arcs, increasing, shape (arcs - 1,)."""
    classes: IntArray
    """For each arc and control: -1 at the lower bound, 1 at the upper, 0 between;
    shape (arcs, controls)."""
    held: IntArray
    """The same for each arc and path constraint, shape (arcs, constraints)."""
    leaning: BoolArray
    """Where a control is at its bound while a state that it drives is at its own, shape
    (arcs, controls)."""

    @property
    def fixed(self) -> BoolArray:
        """Where a control is held at its bound, shape (arcs, controls)."""
        return np.asarray((self.classes != 0) & ~self.leaning)

    def same_as(self, other: Structure) -> bool:
        """Whether both have the same sequence of arcs."""
        return bool(
            np.array_equal(self.classes, other.classes)
            and np.array_equal(self.held, other.held)
        )


_WORDS = {-1: "its lower bound", 0: "no bound", 1: "its upper bound"}


def border_reasons(structure: Structure, names: Sequence[str]) -> list[str]:
    """Say for each border of two arcs what happens there.

    Parameters
    ----------
    structure
        The arcs.
    names
        Of the controls, in the order of the structure's columns.
    """
    reasons = []
    for before, after in pairwise(structure.classes):
        changed = [
            f"{name} goes from {_WORDS[int(a)]} to {_WORDS[int(b)]}"
            for name, a, b in zip(names, before, after, strict=True)
            if a != b
        ]
        reasons.append(
            ", ".join(changed) or "a state or path constraint binds or frees"
        )
    return reasons


@dataclass(slots=True)
class _Run:
    """A stretch of one kind: -1 at the lower bound, 1 at the upper, 0 between."""

    kind: int
    start: float
    end: float
    width: float
    """Greatest mesh interval in the run."""
    mean: float
    """Mean fraction of the range between the bounds."""


@dataclass(frozen=True, slots=True, eq=False)
class _Grid:
    times: FloatArray
    left: FloatArray
    right: FloatArray
    widths: FloatArray
    """Width of the mesh interval around each sample."""
    intervals: IntArray


def _grid(curve: PiecewisePolynomial) -> _Grid:
    breaks = curve.breaks
    widths = np.diff(breaks)
    chosen = np.flatnonzero(widths > _NEGLIGIBLE * (breaks[-1] - breaks[0]))
    cells = np.arange(_SAMPLES) / _SAMPLES
    step = widths[chosen, None] / _SAMPLES
    left = breaks[chosen, None] + cells * widths[chosen, None]
    return _Grid(
        (left + 0.5 * step).ravel(),
        left.ravel(),
        (left + step).ravel(),
        np.repeat(widths[chosen], _SAMPLES),
        chosen,
    )


def _sampled(curve: PiecewisePolynomial, grid: _Grid, component: int) -> FloatArray:
    basis = bernstein_basis(curve.degree, SAMPLED)
    return np.asarray(
        (curve.coefficients[grid.intervals, :, component] @ basis.T).ravel()
    )


def _runs(kinds: IntArray, grid: _Grid, fraction: FloatArray) -> list[_Run]:
    edges = np.flatnonzero(np.diff(kinds)) + 1
    runs = []
    for part in np.split(np.arange(kinds.size), edges):
        first, last = int(part[0]), int(part[-1])
        weights = grid.right[part] - grid.left[part]
        runs.append(
            _Run(
                int(kinds[first]),
                float(grid.left[first]),
                float(grid.right[last]),
                float(grid.widths[part].max()),
                float(np.average(fraction[part], weights=weights)),
            )
        )
    return runs


def _joined(first: _Run, second: _Run, kind: int) -> _Run:
    a, b = first.end - first.start, second.end - second.start
    mean = (a * first.mean + b * second.mean) / max(a + b, 1e-300)
    return _Run(kind, first.start, second.end, max(first.width, second.width), mean)


def _merge_equal(runs: list[_Run]) -> list[_Run]:
    merged = [runs[0]]
    for run in runs[1:]:
        if run.kind == merged[-1].kind:
            merged[-1] = _joined(merged[-1], run, run.kind)
        else:
            merged.append(run)
    return merged


def _simplify(runs: list[_Run]) -> list[_Run]:
    """Remove ramps that are artefacts of the mesh: shorter than one interval."""
    changed = True
    while changed and len(runs) > 1:
        changed = False
        for i, run in enumerate(runs):
            length = run.end - run.start
            before = runs[i - 1] if i > 0 else None
            after = runs[i + 1] if i + 1 < len(runs) else None
            if run.kind == 0 and length < 1.3 * run.width:
                if before is None or after is None:
                    near = (before or after or run).kind
                    if near and abs(run.mean - 0.5 * (1 + near)) > 0.1:
                        continue
                    run.kind = near
                elif before.kind != after.kind and before.kind and after.kind:
                    # Same impulse: where would a jump have to lie?
                    low = 0.5 * (1 + before.kind)
                    high = 0.5 * (1 + after.kind)
                    share = (run.mean - high) / (low - high)
                    border = run.start + min(max(share, 0.0), 1.0) * length
                    before.end = after.start = border
                    del runs[i]
                    changed = True
                    break
                elif (
                    before.kind == after.kind
                    and abs(run.mean - 0.5 * (1 + before.kind)) < 0.1
                ):
                    run.kind = before.kind
                else:
                    continue
            elif run.kind != 0 and length < 0.6 * run.width and len(runs) > 2:
                neighbours = [r.kind for r in (before, after) if r is not None]
                if any(neighbours) and 0 not in neighbours:
                    continue
                run.kind = 0
            else:
                continue
            runs = _merge_equal(runs)
            changed = True
            break
    return runs


def _balance(runs: list[_Run], grid: _Grid, fraction: FloatArray) -> None:
    """Move the border of a bang arc and an inner arc to where the impulse is right.

    On a coarse mesh the control leaves its bound at the start of an interval and
    ramps; a jump of the same impulse lies where the ramp's mean says.
    """
    for before, after in pairwise(runs):
        if (before.kind == 0) == (after.kind == 0):
            continue
        inner, bang = (after, before) if after.kind == 0 else (before, after)
        border = after.start
        inside = (grid.times > inner.start) & (grid.times < inner.end)
        if not inside.any():
            continue
        order = np.flatnonzero(inside)
        order = order if inner is after else order[::-1]
        width = min(grid.widths[order[0]], 0.5 * (inner.end - inner.start))
        ramp = order[np.abs(grid.times[order] - border) < width]
        if not ramp.size or ramp.size == order.size:
            continue
        level = 0.5 * (1 + bang.kind)
        settled = float(fraction[order[ramp.size : ramp.size + _SAMPLES // 2]].mean())
        if abs(level - settled) < 0.05:
            continue
        share = float((fraction[ramp].mean() - settled) / (level - settled))
        move = min(max(share, 0.0), 1.0) * width
        border += move if inner is after else -move
        before.end = after.start = border


def detect(
    phase: PhaseSolution,
    control_bounds: tuple[FloatArray, FloatArray],
    state_bounds: tuple[FloatArray, FloatArray],
    path: PathValues | None = None,
    *,
    drives: BoolArray | None = None,
    preferred: IntArray | None = None,
) -> Structure:
    """Read the arcs off a solution.

    ``drives``: which control reaches which state by the dynamics, shape (states,
    controls). A state that is at its bound while such a control is at its own follows
    it: no border of an arc is its own.
    ``path`` gives the values of path constraints, shape (constraints, n), at times
    (n,), and their bounds, shape (constraints, 2).
    ``preferred``: the bound at which each control should be, whatever it is, at
    :data:`SAMPLED` of each interval: -1, 1, or 0 to leave it as it is; shape (controls,
    K, places).
    """
    grid = _grid(phase.states)
    histories: list[list[_Run]] = []
    events: list[float] = []
    for j in range(len(phase.control_names)):
        values = _sampled(phase.controls, grid, j)
        lower, upper = control_bounds[0][j], control_bounds[1][j]
        kinds, fraction = _classify(values, lower, upper, _CONTROL_CLOSE)
        if preferred is not None:
            wanted = preferred[j, grid.intervals].ravel()
            kinds = np.where(wanted != 0, wanted, kinds)
            fraction = np.where(wanted != 0, 0.5 * (1 + wanted), fraction)
        kinds = _touching(kinds, fraction)
        runs = _simplify(_merge_equal(_runs(kinds, grid, fraction)))
        _balance(runs, grid, fraction)
        histories.append(runs)
        events += [run.start for run in runs[1:]]
    reach = np.zeros((len(phase.state_names), len(histories)), dtype=bool)
    if drives is not None:
        reach |= drives
    idle = _idle(grid, histories, reach)
    bound: list[list[_Run]] = []
    at_bound: list[list[_Run]] = []
    own = list(events)
    for i in range(len(phase.state_names)):
        pair = state_bounds[0][i], state_bounds[1][i]
        values = _sampled(phase.states, grid, i)
        runs = _resting(_runs_of(values, pair, _STATE_CLOSE, grid))
        at_bound.append(runs)
        events += _border_times([r for r in runs if not idle(i, r)], grid, own)
    if path is not None:
        for values, pair in zip(path[0](grid.times), path[1], strict=True):
            bound.append(_runs_of(values, pair, _PATH_CLOSE, grid))
            events += _border_times(bound[-1], grid, own)
    span = phase.end - phase.start
    times = np.array(sorted(events))
    if times.size:
        apart = np.concatenate([[True], np.diff(times) > 1e-7 * span])
        times = times[apart]
    borders = np.concatenate([[phase.start], times, [phase.end]])
    middle = 0.5 * (borders[:-1] + borders[1:])
    classes = _kinds(histories, middle)
    arcs = np.searchsorted(times, grid.times)
    along = np.stack(
        [
            # The middle too: an arc may lie between two samples.
            np.mean(
                _kinds(at_bound, np.append(grid.times[arcs == arc], at)) != 0, axis=0
            )
            for arc, at in enumerate(middle)
        ]
    )
    leaning = ((along > _FOLLOWS) @ reach) & (classes != 0)
    return Structure(times, classes, _kinds(bound, middle), leaning)


def _runs_of(
    values: FloatArray, pair: tuple[float, float], close: float, grid: _Grid
) -> list[_Run]:
    """Stretches of a state or path constraint at its bounds and off them."""
    kinds, fraction = _classify(values, *pair, close)
    return _merge_equal(_runs(kinds, grid, fraction))


def _resting(runs: list[_Run]) -> list[_Run]:
    """Take stretches on which a state only passes near its bound for none.

    Its mean distance over the greatest one is nought where it rests on the bound, a
    third where it touches it, a half where it comes or goes straight, more where it
    stays near it.
    """
    for run in runs:
        away = run.mean if run.kind < 0 else 1.0 - run.mean
        if run.kind and away > _RESTS * _STATE_CLOSE:
            run.kind = 0
    return _merge_equal(runs)


def _idle(
    grid: _Grid, histories: Sequence[Sequence[_Run]], reach: BoolArray
) -> Callable[[int, _Run], bool]:
    """Tell whether a state, in a stretch at its bound, only follows a control at its.

    See :func:`detect`; a control may drive a state through others.
    """
    held = _kinds(histories, grid.times) != 0

    def idle(state: int, run: _Run) -> bool:
        inside = (grid.times > run.start) & (grid.times < run.end)
        follows = held[inside][:, reach[state]].any(axis=1)
        return bool(follows.size) and bool(follows.mean() > _FOLLOWS)

    return idle


def _border_times(
    runs: Sequence[_Run], grid: _Grid, others: Sequence[float]
) -> list[float]:
    """Give the ends of stretches at a bound that are near none of the ``others``."""
    begin, end = grid.left[0], grid.right[-1]
    margin = 1e-3 * (end - begin)
    found = []
    for run in runs:
        if run.kind == 0 or run.end - run.start < 0.6 * run.width:
            continue
        for time in (run.start, run.end):
            here = int(np.argmin(np.abs(grid.times - time)))
            near = 1.01 * grid.widths[max(here - 1, 0) : here + 2].max()
            far = all(abs(time - other) > near for other in others)
            if begin + margin < time < end - margin and far:
                found.append(time)
    return found


def _touching(kinds: IntArray, fraction: FloatArray) -> IntArray:
    """Take intervals near a bound that do not touch it for intervals off the bounds."""
    away = np.where(kinds > 0, 1.0 - fraction, fraction)
    nearest = np.repeat(away.reshape(-1, _SAMPLES).min(axis=1), _SAMPLES)
    return np.where(nearest > _CONTROL_TOUCHES, 0, kinds)


def _kinds(histories: Sequence[Sequence[_Run]], times: FloatArray) -> IntArray:
    """Kind of the run of each history at ``times``, shape (times, histories)."""
    kinds = np.zeros((times.size, len(histories)), dtype=np.int64)
    for j, runs in enumerate(histories):
        starts = np.array([run.start for run in runs])
        at = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        kinds[:, j] = np.array([run.kind for run in runs])[at]
    return kinds


def _classify(
    values: FloatArray, lower: float, upper: float, close: float
) -> tuple[IntArray, FloatArray]:
    """Kind of each sample, and its fraction of the range between the bounds."""
    span = upper - lower
    if not np.isfinite(span):
        span = float(values.max() - values.min())
    kinds = np.zeros(values.size, dtype=np.int64)
    if span <= 0.0:
        return kinds, np.full(values.size, 0.5)
    if np.isfinite(lower):
        kinds[values < lower + close * span] = -1
    if np.isfinite(upper):
        kinds[values > upper - close * span] = 1
    base = lower if np.isfinite(lower) else upper - span
    if not np.isfinite(base):
        return kinds, np.full(values.size, 0.5)
    return kinds, (values - base) / span
