"""The point from which the search starts: a guess, fitted and kept in bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.guess import Curve, Data, Guess, check_guess, curves_of, sample
from showc.ocp.mesh import alike
from showc.ocp.nodes import collocation, fitting_points
from showc.ocp.scaling import middle
from showc.ocp.solution import Solution
from showc.trajectory import bernstein_basis_inverse

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import FloatArray
    from showc.ocp.phase import Phase
    from showc.ocp.transcription.collocation.limits import Box, Overrides
    from showc.ocp.transcription.collocation.statement import Table
    from showc.ocp.transcription.collocation.transcription import Transcription


def starting_point(
    built: Transcription,
    guess: Guess | Solution | None,
    limits: Box,
    *,
    table: Table,
    changes: Overrides,
    arcs: Sequence[FloatArray | None] | None,
) -> FloatArray:
    """Unscaled unknowns to start from."""
    layout = built.discretisation.layout
    point = np.zeros(layout.size)
    given = Guess()
    if isinstance(guess, Guess):
        given = guess
    elif isinstance(guess, Solution):
        given = Guess(statics=guess.statics)
    time = 0.0
    check_guess(built.problem, guess)
    for p, phase in enumerate(built.problem.phases):
        place = layout.phases[p]
        curves: Mapping[str, Curve] = {}
        if isinstance(guess, Solution):
            former = guess.phases[p]
            curves, duration, begin = curves_of(former), former.duration, former.start
        else:
            begin = given.starts.get(phase.name, time)
            duration = given.durations.get(phase.name, 0.0)
            if duration <= 0.0 and len(built.problem.phases) == 1:
                duration = _spanned(given)
            if duration <= 0.0:
                scale = built.scales.durations[p]
                duration = _default_duration(phase, scale, table, changes)
        point[place.start] = np.clip(
            begin, limits.lower[place.start], limits.upper[place.start]
        )
        widths = _arc_durations(built, p, guess, duration, limits)
        if arcs is not None and arcs[p] is not None:
            widths = np.asarray(arcs[p], dtype=np.float64)
        point[place.durations] = widths
        if p > 0 and not isinstance(guess, Solution):
            curves = _carried(built, p, given, point)
        _place_curves(built, p, given, curves, limits=limits, point=point)
        time = float(point[place.start] + widths.sum())
    for number, static in zip(layout.statics, built.problem.statics, strict=True):
        low, high = limits.lower[number], limits.upper[number]
        value = given.statics.get(static.name, middle(low, high))
        point[number] = min(max(value, low), high)
    return point


def _spanned(given: Guess) -> float:
    """Time that the data of a guess span, 0 if it has none."""
    data = [curve for curve in given.curves.values() if isinstance(curve, Data)]
    return max((float(d.times[-1] - d.times[0]) for d in data), default=0.0)


def _carried(
    built: Transcription, index: int, given: Guess, point: FloatArray
) -> Mapping[str, Curve]:
    """Values at the end of the phase before, for states of the same name.

    Only for those of which neither a guess nor the ends in this phase tell anything.
    """
    before, phase = built.problem.phases[index - 1], built.problem.phases[index]
    place = built.discretisation.layout.phases[index - 1]
    known = {*given.curves}
    curves: dict[str, Curve] = {}
    for i, name in enumerate(before.states):
        state = phase.states.get(name)
        if state is None or {name, f"{phase.name}.{name}"} & known:
            continue
        free = all(
            isinstance(low, float) and isinstance(high, float) and low < high
            for low, high in (state.start, state.end)
        )
        if free:
            curves[name] = float(point[place.states[-1][-1, i]])
    return curves


def _arc_durations(
    built: Transcription,
    index: int,
    guess: Guess | Solution | None,
    duration: float,
    limits: Box,
) -> FloatArray:
    """Durations of the arcs: the former ones where the arcs are the same."""
    mesh, place = built.mesh.phases[index], built.discretisation.layout.phases[index]
    if isinstance(guess, Solution):
        former = guess.phases[index]
        if former.mesh.arcs == mesh.arcs:
            return former.arc_durations
    if mesh.arc_count > 1:
        return np.full(mesh.arc_count, duration / mesh.arc_count)
    number = place.durations
    clipped = np.clip(duration, limits.lower[number], limits.upper[number])
    return np.asarray(clipped, dtype=np.float64)


def _default_duration(
    phase: Phase, scale: float, table: Table, changes: Overrides
) -> float:
    low, high = table["duration", phase.name]
    if phase.name in changes.durations:
        new = changes.durations[phase.name]
        low, high = new if isinstance(new, tuple) else (new, new)
    return float(np.clip(scale, low, high))


def _place_curves(
    built: Transcription,
    index: int,
    given: Guess,
    curves: Mapping[str, Curve],
    *,
    limits: Box,
    point: FloatArray,
) -> None:
    """Fit Bernstein coefficients to curves, interval by interval."""
    phase, mesh = built.problem.phases[index], built.mesh.phases[index]
    place = built.discretisation.layout.phases[index]
    breaks = np.concatenate([[0.0], np.cumsum(mesh.widths(point[place.durations]))])
    span = float(breaks[-1])
    breaks = breaks / breaks[-1] if breaks[-1] > 0.0 else breaks
    rows = [(name, place.state_row(i)) for i, name in enumerate(phase.states)]
    states = len(rows)
    unit = built.discretisation.unknown_scale
    rows += [(name, place.control_row(j)) for j, name in enumerate(phase.controls)]
    for number, (name, row) in enumerate(rows):
        curve = curves.get(name)
        if curve is None:
            curve = given.curves.get(f"{phase.name}.{name}", given.curves.get(name))
        if curve is None and number < states:
            curve = _between(limits, row[0][0], row[-1][-1])
        if curve is None:
            for coefficients in row:
                lower, upper = limits.lower[coefficients], limits.upper[coefficients]
                pairs = zip(lower, upper, strict=True)
                point[coefficients] = [middle(a, b) for a, b in pairs]
                free = np.isinf(lower).all() and np.isinf(upper).all()
                if free and built.discretisation.layout.integrals[index].size:
                    # A root of the integral of a square has no finite slope at zero.
                    point[coefficients] = 0.1 * unit[coefficients]
            continue
        groups, places = [], []
        for size, chosen in alike(coefficients.size for coefficients in row):
            s = fitting_points(size - 1)
            if number >= states:
                s = tuple(collocation("gauss", size)[0].tolist())
            table = np.stack([row[k] for k in chosen])
            groups.append((table, bernstein_basis_inverse(size - 1, s)))
            left, right = breaks[chosen, None], breaks[chosen + 1, None]
            places.append((left + np.array(s) * (right - left)).ravel())
        # All intervals at once: curves take as long for one place as for hundreds.
        at = np.concatenate(places)
        order = np.argsort(at, kind="stable")
        values = np.empty(at.size)
        values[order] = sample(curve, at[order], float(point[place.start]), span)
        parts = np.split(values, np.cumsum([p.size for p in places])[:-1])
        for (table, inverse), wanted in zip(groups, parts, strict=True):
            fitted = (inverse @ wanted.reshape(*table.shape, 1))[..., 0]
            point[table] = np.clip(fitted, limits.lower[table], limits.upper[table])


def _between(limits: Box, first: int, last: int) -> Curve:
    """Straight line from the start value to the end value, where they are known."""
    ends = []
    for number in (first, last):
        low, high = limits.lower[number], limits.upper[number]
        ends.append(low if low == high else None)
    start, end = ends
    if start is None and end is None:
        start = end = middle(limits.lower[first], limits.upper[first])
    start = end if start is None else start
    end = start if end is None else end
    return np.array([start, end], dtype=np.float64)
