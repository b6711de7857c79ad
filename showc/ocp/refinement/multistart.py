"""Several starts for one problem: which optima there are, and the best of them.

A nonlinear program ends in the optimum that its start leads to. Starts other than the
given one differ by slow waves in states and controls, within their bounds, and by the
duration; they follow the golden ratio, so that every run has the same. Where there are
no path constraints, the controls of every third one jump between their bounds, and
states that start from given values are integrated: a search that starts from what can
be flown ends in optima that one from waves does not find. Each is solved on a first
mesh. Those that end in different optima are then refined, best first.

A start with every symmetry of the problem leads to an extremum with the same symmetry,
which is often no minimum: the search cannot leave it, as all its steps are symmetric
too. What tells is a bounded control that ends where the guess had put it, in the middle
between its bounds, at every instant. So does one without bounds, or a static.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import casadi
import numpy as np

from showc.ocp.guess import Curve, Data, Guess, curves_of, sample
from showc.ocp.mesh import Mesh, PhaseMesh
from showc.ocp.scaling import GOLDEN, middle
from showc.ocp.solution import Optimum, Solution
from showc.ocp.transcription.collocation.statement import Statement
from showc.processes import side_by_side

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from showc.arrays import FloatArray
    from showc.ocp.phase import Phase
    from showc.ocp.problem import Problem
    from showc.ocp.transcription.collocation.statement import Table

SAME = 1e-3
"""Relative difference of objectives on a first mesh below which two optima are one."""
ONE = 1e-6
"""The same after refinement, to the usual tolerance."""
REFINED = 4
"""Greatest number of different optima that are refined."""
_WAVES = 3
"""Waves in a start: half a period, one, and one and a half."""
_JUMPS = 5
"""Waves whose sign controls that jump have: up to four switches, and more."""
_FLIGHTS = 3
"""One start in this many is flown: a convention, for waves find most optima sooner."""
_POINTS = 25
"""Values of a guessed curve."""
_LOST = 1e6
"""Size of a state that an integration from a start has lost."""
_ACCURATE = 1e-6
"""Relative tolerance of an integration from a start: as that of a default solve."""
_MOST_STEPS = 3000
"""Steps after which an integration is given up."""
_STEPS = 4
"""Steps of an integration that make an interval of a mesh."""
_INTERVALS = (10, 60)
"""Least and greatest number of intervals of such a mesh."""
_STRETCH = 3.0
"""Greatest ratio of a guessed duration to that of the first start."""
_STILL = 1e-6
"""Share of its range by which a control has moved that counts as moved."""
_VALUES = 41
"""Values of the curve that breaks a symmetry: as 40 intervals can tell apart."""


def solve_from_many(
    problem: Problem,
    first: Guess | Solution | None,
    parameters: Mapping[str, float],
    solve: Callable[[Guess | Solution | None, bool], Solution],
    *,
    starts: int,
    jobs: int,
) -> Solution:
    """Solve from ``starts`` different starts.

    Parameters
    ----------
    problem, first, parameters
        The problem, its first start, and values of its parameters.
    solve
        Solves from a start, on a first mesh alone if its second argument says so.
    starts, jobs
        Number of starts, and of processes.

    Returns
    -------
    Solution
        The best one, with all ``optima`` that were found.
    """
    guesses = [
        first,
        *(varied(problem, first, parameters, k) for k in range(1, starts)),
    ]
    quick = _each(lambda k: solve(guesses[k], True), starts, jobs)
    sign = -1.0 if problem.maximises else 1.0
    order = sorted(
        (k for k in range(starts) if quick[k].result.usable),
        key=lambda k: sign * quick[k].objective,
    )
    if not order:
        return quick[0]
    groups = _grouped([Optimum(quick[k].objective, None, (k,)) for k in order], SAME)
    chosen = groups[:REFINED]
    full = _each(lambda n: solve(quick[chosen[n].starts[0]], False), len(chosen), jobs)
    best = min(
        range(len(chosen)),
        key=lambda n: (not full[n].result.usable, sign * full[n].objective),
    )
    refined = [
        replace(group, objective=found.objective, result=found.result)
        for group, found in zip(chosen, full, strict=True)
    ]
    optima = _grouped(
        sorted([*refined, *groups[REFINED:]], key=lambda found: sign * found.objective),
        ONE,
    )
    return replace(full[best], optima=tuple(optima))


def _grouped(found: Sequence[Optimum], same: float) -> list[Optimum]:
    """Join neighbours whose objectives differ by no more than a relative ``same``."""
    groups: list[Optimum] = []
    for one in found:
        last = groups[-1] if groups else None
        size = abs(one.objective)
        if last is not None and abs(one.objective - last.objective) <= same * size:
            starts = tuple(sorted((*last.starts, *one.starts)))
            groups[-1] = replace(last, starts=starts)
        else:
            groups.append(one)
    return groups


def _each(task: Callable[[int], Solution], count: int, jobs: int) -> list[Solution]:
    """Do ``task`` for 0, 1, ..., in processes if there are several ``jobs``."""
    # Expressions cannot be sent to another process, but a copy of this one has them.
    return side_by_side([partial(task, number) for number in range(count)], jobs)


def varied(
    problem: Problem,
    first: Guess | Solution | None,
    parameters: Mapping[str, float],
    number: int,
) -> Guess:
    """Start ``number`` (1, 2, ...): the first one with waves in all its curves.

    Statics differ too.

    Parameters
    ----------
    problem, parameters
        Whose bounds and end values the start keeps.
    first
        The start that is varied.
    number
        Another one for each number, the same in every run.
    """
    statement = Statement(problem)
    table = statement.table(statement.parameters(parameters))
    scales = statement.scales({})
    given = first if isinstance(first, Guess) else Guess()
    s = np.linspace(0.0, 1.0, _POINTS)
    curves: dict[str, Curve] = dict(given.curves)
    durations: dict[str, float] = dict(given.durations)
    # What is flown blindly keeps bounds, but no path constraints.
    plain = not any(phase.path_constraints for phase in problem.phases)
    flies = plain and number % _FLIGHTS == 0
    # The waves are the same ones, however many starts are flown between them.
    drawn, seed = 0, number - number // _FLIGHTS if plain and not flies else number

    def draw() -> float:
        """Next number in [-1, 1]."""
        nonlocal drawn
        drawn += 1
        return float(2.0 * ((GOLDEN * (seed * (2 * drawn + 1))) % 1.0) - 1.0)

    for p, phase in enumerate(problem.phases):
        known = curves_of(first.phases[p]) if isinstance(first, Solution) else {}
        low, high = table["duration", phase.name]
        usual = durations.get(phase.name, scales.durations[p])
        if isinstance(first, Solution):
            usual = first.phases[p].duration
        durations[phase.name] = float(np.clip(usual * _STRETCH ** draw(), low, high))
        members = [(name, True, i) for i, name in enumerate(phase.states)]
        members += [(name, False, j) for j, name in enumerate(phase.controls)]
        for name, is_state, index in members:
            size = (scales.states if is_state else scales.controls)[p][index]
            low, high = table["bounds", phase.name, name]
            halves = np.arange(1, (_JUMPS if flies else _WAVES) + 1)
            sizes = np.array([draw() / k for k in halves])
            wave = sizes @ np.sin(np.pi * halves[:, None] * s)
            title = f"{phase.name}.{name}"
            base = known.get(name, curves.get(title, curves.get(name)))
            if base is None:
                base = _line(table, phase.name, name)
                if not is_state:
                    wave = wave + draw()
            start = table["time", phase.name][0]
            values = sample(base, s, start, durations[phase.name]) + 0.7 * size * wave
            if flies and not is_state and np.isfinite(low) and np.isfinite(high):
                values = np.where(wave > 0.0, high, low)
            curves[title] = np.clip(values, low, high)
    statics = dict(given.statics)
    for static, size in zip(problem.statics, scales.statics, strict=True):
        low, high = table["static", static.name]
        usual = statics.get(static.name, middle(low, high))
        if isinstance(first, Solution):
            usual = first.statics[static.name]
        statics[static.name] = float(np.clip(usual + 0.7 * size * draw(), low, high))
    waves = replace(given, curves=curves, durations=durations, statics=statics)
    found = flown(problem, waves, table, parameters) if flies else None
    return found[1] if found else waves


def flown(
    problem: Problem,
    guess: Guess,
    table: Table,
    parameters: Mapping[str, float],
) -> tuple[Mesh, Guess] | None:
    """Fly the guessed controls from the states that are given at the start.

    Parameters
    ----------
    problem, table, parameters
        What is flown, its bounds as numbers, and values of its parameters.
    guess
        Controls, durations and statics.

    Returns
    -------
    tuple or None
        A mesh whose intervals are as many steps of the integrator each, and where it
        flew, within the states' bounds. ``None`` where a state starts from no given
        value and none is carried over, or where states leave all numbers.
    """
    statement = Statement(problem)
    scales = statement.scales({})
    numbers = statement.parameters(parameters)
    held = {s.name: table["static", s.name] for s in problem.statics}
    numbers = np.array(
        [*numbers, *(guess.statics.get(k, middle(*pair)) for k, pair in held.items())]
    )
    curves, durations = dict(guess.curves), dict(guess.durations)
    meshes: list[PhaseMesh] = []
    last: dict[str, float] = {}
    begin = table["time", problem.phases[0].name][0]
    for phase, scale in zip(problem.phases, scales.durations, strict=True):
        usual = durations.get(phase.name, scale)
        length = float(np.clip(usual, *table["duration", phase.name]))
        state = [_known_start(table, phase.name, name, last) for name in phase.states]
        if None in state or not phase.states:
            return None
        found = _integrated(
            problem,
            phase,
            [
                _control_curve(table, phase.name, name, curves, (begin, length))
                for name in phase.controls
            ],
            np.array(state),
            np.array([table["bounds", phase.name, name] for name in phase.states]),
            values=numbers,
            span=(begin, length),
        )
        if found is None:
            return None
        times, states = found
        shares = (times - begin) / length
        count = int(np.clip((times.size - 1) // _STEPS, *_INTERVALS))
        borders = np.linspace(0, times.size - 1, count + 1)
        breaks = np.interp(borders, np.arange(times.size), shares)
        meshes.append(PhaseMesh.from_breaks(breaks, [4] * count))
        for name, row in zip(phase.states, states, strict=True):
            curves[f"{phase.name}.{name}"] = Data(times, row)
        last = dict(zip(phase.states, states[:, -1].tolist(), strict=True))
        durations[phase.name] = length
        begin += length
    return Mesh(tuple(meshes)), replace(guess, curves=curves, durations=durations)


def _known_start(
    table: Table, phase: str, name: str, last: Mapping[str, float]
) -> float | None:
    """Value that a state starts from: given, or where the phase before ended."""
    low, high = table["start", phase, name]
    return low if low == high else last.get(name)


def _control_curve(
    table: Table,
    phase: str,
    name: str,
    curves: Mapping[str, Curve],
    span: tuple[float, float],
) -> FloatArray:
    """Guessed values of a control at equal steps; the middle of its bounds else."""
    low, high = table["bounds", phase, name]
    curve = curves.get(f"{phase}.{name}", curves.get(name))
    s = np.linspace(0.0, 1.0, _POINTS)
    values = (
        np.full(_POINTS, middle(low, high))
        if curve is None
        else sample(curve, s, *span)
    )
    return np.asarray(np.clip(values, low, high))


def _integrated(
    problem: Problem,
    phase: Phase,
    controls: list[FloatArray],
    state: FloatArray,
    bounds: FloatArray,
    *,
    values: FloatArray,
    span: tuple[float, float],
) -> tuple[FloatArray, FloatArray] | None:
    """Integrate a phase from ``state`` with given controls, stiff or not.

    Returns
    -------
    tuple or None
        Times of the integrator's steps (n,), and states within ``bounds`` (states, n).
    """
    # Loaded here alone: few problems need it.
    from scipy.integrate import LSODA  # noqa: PLC0415

    inputs = [*phase.members, phase.time, problem.given]
    f = casadi.Function("f", inputs, [phase.dynamics])
    begin, length = span
    places = np.linspace(0.0, 1.0, _POINTS)

    def rate(time: float, x: FloatArray) -> FloatArray:
        s = (time - begin) / length
        u = [np.interp(s, places, row) for row in controls]
        return np.asarray(f(np.clip(x, *bounds.T), u, time, values)).ravel()

    solver = LSODA(rate, begin, state, begin + length, rtol=_ACCURATE, atol=1e-9)
    times, rows = [begin], [state]
    for _ in range(_MOST_STEPS):
        solver.step()
        lost = not np.all(np.abs(solver.y) < _LOST)
        if solver.status == "failed" or lost:
            return None
        times.append(float(solver.t))
        rows.append(np.clip(solver.y, *bounds.T))
        if solver.status == "finished":
            return np.array(times), np.array(rows).T
    return None


def _line(table: Table, phase: str, name: str) -> Curve:
    """Straight line between known end values; else the middle of the bounds."""
    ends = [
        table[which, phase, name] if (which, phase, name) in table.slots else (0.0, 1.0)
        for which in ("start", "end")
    ]
    known = [low for low, high in ends if low == high]
    if not known:
        return middle(*table["bounds", phase, name])
    return np.array([known[0], known[-1]], dtype=np.float64)


def unmoved(
    problem: Problem, solution: Solution, table: Table
) -> list[tuple[str, int]]:
    """Return names of controls that stayed in the middle of their bounds throughout.

    Parameters
    ----------
    problem, solution
        What was solved from a guess that tells nothing of these controls.
    table
        The bounds of the solve.

    Returns
    -------
    list
        ``"phase.control"`` and a number for each, in the problem's order.
    """
    found: list[tuple[str, int]] = []
    for phase, part in zip(problem.phases, solution.phases, strict=True):
        for j, name in enumerate(phase.controls):
            low, high = table["bounds", phase.name, name]
            span = high - low
            if not np.isfinite(span) or span <= 0.0:
                continue
            values = part.controls.coefficients[:, :, j]
            if np.abs(values - 0.5 * (low + high)).max() < _STILL * span:
                found.append((f"{phase.name}.{name}", len(found)))
    return found


def stationary(problem: Problem, solution: Solution, table: Table) -> str:
    """Name a control without bounds, or a static, that stayed where its search began.

    Parameters
    ----------
    problem, solution, table
        As :func:`unmoved` takes them.

    Returns
    -------
    str
        Empty if there is none.
    """
    for static in problem.statics:
        bounds = table["static", static.name]
        if abs(solution.statics[static.name] - middle(*bounds)) < _STILL:
            return static.name
    for phase, part in zip(problem.phases, solution.phases, strict=True):
        for j, name in enumerate(phase.controls):
            bounds = table["bounds", phase.name, name]
            away = np.abs(part.controls.coefficients[:, :, j] - middle(*bounds))
            if not np.all(np.isfinite(bounds)) and away.max() < _STILL:
                return f"{phase.name}.{name}"
    return ""


def uneven(
    guess: Guess, names: list[tuple[str, int]], table: Table, share: float
) -> Guess:
    """Return a guess in which the controls ``names`` have no symmetry.

    They differ from the middle by up to half of ``share`` of their range, by the
    fractional parts of multiples of the golden ratio: the same in every run.
    """
    curves = dict(guess.curves)
    for name, number in names:
        phase, control = name.split(".", 1)
        low, high = table["bounds", phase, control]
        steps = np.arange(_VALUES) + 1.0 + _VALUES * number
        pattern = (steps * GOLDEN) % 1.0 - 0.5
        offset = share * (high - low) * pattern
        curves[name] = np.asarray(0.5 * (low + high) + offset, dtype=np.float64)
    return replace(guess, curves=curves)
