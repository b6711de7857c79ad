"""The next mesh: where to cut, where to raise the degree, where to merge.

The Legendre coefficients of states and controls on an interval whose error exceeds the
tolerance tell how smooth they are (Liu, Hager, Rao 2018, Adaptive mesh refinement
method for optimal control using decay rates of Legendre polynomial coefficients). Fast
decay: raise the degree by what the decay promises; slow, or no gain by the last degree:
cut.

Cuts are placed where the solution bends most, so that a boundary layer is reached
in a few meshes. Intervals far below the tolerance are merged with their neighbour
if one polynomial of the same degree represents both (mesh reduction).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre

from showc.ocp.history import Decision, Step
from showc.ocp.mesh import PhaseMesh
from showc.ocp.nodes import fitting_points
from showc.ocp.refinement.options import INNER_DEGREE
from showc.trajectory import bernstein_basis

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.ocp.refinement.switches import Structure
    from showc.ocp.solution import PhaseSolution


LEAST_POINTS, MOST_POINTS = 3, 12
"""Collocation points of an interval: fewer than three cannot tell how fast coefficients
decay; the most is a convention, for blocks of the program grow with its square."""
MORE_DEGREE = 2
"""By how much the degree of a control on a singular arc is raised at once."""
_BEYOND = 3
"""Points beyond the degree of such a control: with fewer it would oscillate."""
_HELPS = 0.3
"""Share of its error that an interval may keep if a higher degree helped: by two points
more, coefficients that fall as slowly as is called smooth leave a twentieth."""
_MOST_NEEDED = 8
"""Points that an interval may lack for its degree to be raised rather."""
_SWITCHES = 0.5
"""Share of its range by which a control moves on an interval with a switch in it; on a
singular arc it moves less between any two borders of a first mesh."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One interval of a mesh under change."""

    left: float
    """Start as a fraction of the arc."""
    right: float
    points: int
    arc: int
    degrees: tuple[tuple[str, int], ...]
    """Degrees of controls set by the mesh."""
    path_points: tuple[float, ...] = ()
    path_margin: float = 0.0
    held: tuple[tuple[str, int], ...] = ()
    """Path constraints that are equations."""


def cells_of(mesh: PhaseMesh) -> list[Cell]:
    """Take a mesh apart."""
    cells, position, arc = [], 0.0, 0
    for k in range(mesh.intervals):
        if mesh.arcs[k] != arc:
            position, arc = 0.0, mesh.arcs[k]
        degrees = tuple((name, d[k]) for name, d in mesh.control_degrees.items())
        right = position + mesh.fractions[k]
        cells.append(
            Cell(
                position,
                right,
                mesh.points[k],
                arc,
                degrees,
                mesh.path_points[k],
                mesh.path_margins[k],
                tuple((name, h[k]) for name, h in mesh.path_held.items()),
            )
        )
        position = right
    return cells


def mesh_of(cells: list[Cell]) -> PhaseMesh:
    """Put a mesh together."""
    arcs = np.array([cell.arc for cell in cells])
    widths = np.array([cell.right - cell.left for cell in cells])
    widths = widths / np.bincount(arcs, weights=widths)[arcs]
    names = [name for name, _ in cells[0].degrees]
    held = [name for name, _ in cells[0].held]
    return PhaseMesh(
        tuple(float(w) for w in widths),
        tuple(cell.points for cell in cells),
        tuple(int(a) for a in arcs),
        {name: tuple(dict(cell.degrees)[name] for cell in cells) for name in names},
        tuple(cell.path_points for cell in cells),
        tuple(cell.path_margin for cell in cells),
        {name: tuple(dict(cell.held)[name] for cell in cells) for name in held},
    )


def not_helped(
    mesh: PhaseMesh, errors: FloatArray, former: PhaseMesh, before: FloatArray
) -> BoolArray:
    """Mark intervals whose degree was raised and whose error hardly fell, shape (K,).

    ``errors`` and ``before`` are those on the intervals of ``mesh`` and of the one it
    was made from.
    """
    known = {
        (cell.arc, round(cell.left, 9), round(cell.right, 9)): (cell.points, error)
        for cell, error in zip(cells_of(former), before, strict=True)
    }
    found = np.zeros(mesh.intervals, dtype=bool)
    for k, cell in enumerate(cells_of(mesh)):
        key = cell.arc, round(cell.left, 9), round(cell.right, 9)
        points, error = known.get(key, (cell.points, 0.0))
        found[k] = cell.points > points and errors[k] > _HELPS * error
    return found


def _legendre(coefficients: FloatArray) -> FloatArray:
    """Legendre coefficients (degree + 1, components) from Bernstein's."""
    degree = coefficients.shape[0] - 1
    x = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    values = bernstein_basis(degree, 0.5 * (x + 1.0)) @ coefficients
    return np.asarray(np.linalg.solve(legendre.legvander(x, degree), values))


def decay_rate(coefficients: FloatArray, scale: FloatArray) -> float:
    """Decades by which the Legendre coefficients fall per degree; the slowest.

    ``coefficients``: Bernstein, shape (degree + 1, components). Components that are
    already represented to rounding count as smooth.
    """
    spectrum = np.abs(_legendre(coefficients)) / scale
    degree = spectrum.shape[0] - 1
    if degree < 2:
        return 0.0
    slowest = 4.0
    for c in range(spectrum.shape[1]):
        # A running maximum from the end: odd or even functions have gaps.
        envelope = np.maximum.accumulate(spectrum[::-1, c])[::-1]
        if envelope[-1] < 1e-9:
            continue
        n = np.arange(1, degree + 1)
        slope = np.polyfit(n, np.log10(envelope[1:] + 1e-300), 1)[0]
        slowest = min(slowest, -float(slope))
    return slowest


def cut_places(coefficients: FloatArray, scale: FloatArray, pieces: int) -> FloatArray:
    """Fractions at which to cut an interval so that each piece bends equally."""
    degree = coefficients.shape[0] - 1
    s = np.linspace(0.0, 1.0, 401)
    if degree < 2:
        return np.linspace(0.0, 1.0, pieces + 1)[1:-1]
    second = bernstein_basis(degree - 2, s) @ np.diff(coefficients / scale, n=2, axis=0)
    bend = np.sqrt(np.abs(second).max(axis=1))
    top = bend.max()
    if top <= 1e-5:
        return np.linspace(0.0, 1.0, pieces + 1)[1:-1]
    density = bend + 0.15 * bend.mean()
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    places = np.interp(np.arange(1, pieces) / pieces, total / total[-1], s)
    return np.asarray(np.clip(places, 0.02, 0.98))


@dataclass(frozen=True, slots=True, eq=False)
class IntervalErrors:
    """What an audit found on the intervals of one phase."""

    indicator: FloatArray
    """Error over tolerance, shape (K,)."""
    must_cut: BoolArray
    """Where a higher degree cannot help, because it is the control that errs and its
    degree is given, shape (K,)."""
    jumps: Sequence[tuple[float, ...]] = ()
    """Where rates jump, as shares of each interval; empty: nowhere."""
    contacts: Sequence[tuple[float, ...]] = ()
    """Where a path constraint is touched whose multiplier is spread over an interval,
    as a share of it; empty: nowhere."""
    stubborn: BoolArray | None = None
    """Where a higher degree did not help, shape (K,); ``None``: nowhere."""


def refine(
    mesh: PhaseMesh,
    phase: PhaseSolution,
    errors: IntervalErrors,
    *,
    scale: FloatArray,
    most: float = np.inf,
) -> tuple[PhaseMesh, tuple[Decision, ...]]:
    """Change the intervals by their errors.

    ``most`` is about the number of points that the new mesh may have: the intervals
    that err most come first, the others wait for the next mesh, when their errors will
    be known better.

    Returns
    -------
    tuple
        The new mesh, and for each interval of the old one what was done and why.
    """
    indicator = errors.indicator
    out: list[Cell] = []
    decisions: list[Decision] = []
    fine = -1
    waiting = _waiting(mesh, indicator, most)
    for k, cell in enumerate(cells_of(mesh)):
        if not indicator[k] > 1.0:
            alike = fine == k - 1 and k > 0 and _alike(cell, out[-1])
            small = max(indicator[k - 1], indicator[k]) < 1e-2
            if alike and small and _one_polynomial(phase, k, scale):
                points = max(cell.points, out[-1].points)
                out[-1] = replace(out[-1], right=cell.right, points=points)
                words = "one polynomial represents both to well below the tolerance"
                decisions.append(Decision(Step.MERGED, words))
            else:
                out.append(cell)
                decisions.append(Decision())
                fine = k
        elif waiting[k]:
            words = f"error {indicator[k]:.2g} times what is allowed; worse ones first"
            out.append(cell)
            decisions.append(Decision(reason=words))
        else:
            cells, decision = _mended(cell, k, phase, errors, scale)
            out += cells
            decisions.append(decision)
    return mesh_of(out), tuple(decisions)


def _mended(
    cell: Cell,
    k: int,
    phase: PhaseSolution,
    errors: IntervalErrors,
    scale: FloatArray,
) -> tuple[list[Cell], Decision]:
    """Cut interval k, or raise its degree."""
    error = f"error {errors.indicator[k]:.2g} times what is allowed"
    if errors.jumps and errors.jumps[k]:
        words = f"{error}; the rates jump: cut about the jump"
        cells = _cut(cell, [0.0, *errors.jumps[k], 1.0])
        return cells, Decision(Step.CUT, words)
    if errors.contacts and errors.contacts[k]:
        words = f"{error}; a path constraint is touched: cut there"
        cells = _cut(cell, [0.0, *errors.contacts[k], 1.0])
        return cells, Decision(Step.CUT, words)
    rate, smooth, found = _smoothness(phase, k, scale)
    stubborn = errors.stubborn is not None and bool(errors.stubborn[k])
    gentle = smooth and not stubborn and not _switches(phase, k)
    richer = _richer(cell) if errors.must_cut[k] and gentle else None
    if richer is not None:
        words = f"{error}; {found}: control's degree raised"
        return [richer], Decision(Step.RAISED, words)
    if errors.must_cut[k]:
        smooth, found = False, "the control errs, and its degree is given"
    elif stubborn:
        smooth, found = False, "a higher degree did not help"
    decades = float(np.log10(errors.indicator[k]))
    needed = max(2, int(np.ceil(decades / max(rate, 0.1))))
    points = cell.points + min(needed, 4)
    if smooth and points <= MOST_POINTS and needed <= _MOST_NEEDED:
        words = f"{error}; {found}: degree raised by {points - cell.points}"
        return [replace(cell, points=points)], Decision(Step.RAISED, words)
    pieces = _pieces(errors.indicator[k])
    places = cut_places(phase.states.coefficients[k], scale, pieces)
    words = f"{error}; {found}: cut in {pieces}"
    return _cut(cell, [0.0, *places, 1.0]), Decision(Step.CUT, words)


def _smoothness(
    phase: PhaseSolution, k: int, scale: FloatArray
) -> tuple[float, bool, str]:
    """Decades an interval gains by a degree, whether that is enough, and in words."""
    coefficients = phase.states.coefficients[k]
    rate = decay_rate(coefficients[: phase.mesh.points[k] + 1], scale)
    if phase.controls.degree >= 2:
        controls = phase.controls.coefficients
        control_scale = np.maximum(np.abs(controls).max(axis=(0, 1)), 1e-9)
        rate = min(rate + 0.25, 0.25 + decay_rate(controls[k], control_scale))
    return rate, rate > 0.6, f"coefficients fall by {rate:.1f} decades a degree"


def _switches(phase: PhaseSolution, k: int) -> bool:
    """Whether a control moves so far on interval k that it switches there."""
    values = phase.controls.coefficients
    least, most = values.min(axis=(0, 1)), values.max(axis=(0, 1))
    return bool(np.any(np.ptp(values[k], axis=0) > _SWITCHES * (most - least)))


def _richer(cell: Cell) -> Cell | None:
    """Give a cell whose controls have higher degrees, where its points allow them.

    A control that enters the Hamiltonian linearly is smooth on a singular arc, as the
    states are: its degree gains there what it gains for them.
    """
    degrees = tuple(
        (name, degree + MORE_DEGREE if degree > 0 else degree)
        for name, degree in cell.degrees
    )
    top = max((degree for _, degree in degrees), default=0)
    points = max(cell.points, top + _BEYOND)
    if degrees == cell.degrees or points > MOST_POINTS:
        return None
    return replace(cell, points=points, degrees=degrees)


def _cut(cell: Cell, edges: Sequence[float]) -> list[Cell]:
    """Cut a cell at fractions ``edges`` (0 and 1 included)."""
    width, points = cell.right - cell.left, min(cell.points, 6)
    # A control that was given more coefficients had the points for them.
    most = max(points - _BEYOND, INNER_DEGREE)
    degrees = tuple((name, min(degree, most)) for name, degree in cell.degrees)
    return [
        Cell(
            cell.left + a * width,
            cell.left + b * width,
            points,
            cell.arc,
            degrees,
            tuple((s - a) / (b - a) for s in cell.path_points if a <= s <= b),
            held=cell.held,
        )
        for a, b in pairwise(edges)
    ]


def halves(mesh: PhaseMesh) -> PhaseMesh:
    """Mesh with every interval halved."""
    halved = (_cut(cell, [0.0, 0.5, 1.0]) for cell in cells_of(mesh))
    return mesh_of([cell for pair in halved for cell in pair])


def _pieces(indicator: float) -> int:
    """Into how many intervals one is cut, by how much too large its error is."""
    return 2 if indicator < 30.0 else 3 if indicator < 1e4 else 4


def _waiting(mesh: PhaseMesh, indicator: FloatArray, most: float) -> BoolArray:
    """Mark flagged intervals that wait because others err more."""
    waiting = np.zeros(mesh.intervals, dtype=bool)
    points = float(mesh.point_count)
    for number, k in enumerate(np.argsort(-indicator, kind="stable")):
        if not indicator[k] > 1.0:
            break
        points += (_pieces(indicator[k]) - 1) * min(mesh.points[k], 6)
        waiting[k] = points > most and number > 0
    return waiting


def summary(decisions: Sequence[Decision]) -> str:
    """Say in a line what was done to the intervals of a phase."""
    steps = [decision.step for decision in decisions]
    return (
        f"cut {steps.count(Step.CUT)} intervals, raised the degree on "
        f"{steps.count(Step.RAISED)}, merged {steps.count(Step.MERGED)}"
    )


def _alike(cell: Cell, former: Cell) -> bool:
    """Whether two neighbours may become one interval."""
    plain = not cell.path_points and not former.path_points
    alike = cell.degrees == former.degrees and cell.held == former.held
    return plain and alike and cell.arc == former.arc


def _one_polynomial(phase: PhaseSolution, k: int, scale: FloatArray) -> bool:
    """Whether interval k continues the polynomial of interval k - 1."""
    breaks, states = phase.states.breaks, phase.states.coefficients
    left, right = breaks[k] - breaks[k - 1], breaks[k + 1] - breaks[k]
    s = np.array([0.5, 1.0])
    basis = bernstein_basis(phase.states.degree, 1.0 + s * right / left)
    continued = basis @ states[k - 1]
    actual = bernstein_basis(phase.states.degree, s) @ states[k]
    # A state that is small here compared with its range may matter at its own size.
    size = np.abs(states[k - 1 : k + 1]).max(axis=(0, 1))
    scale = np.clip(size, 1e-6 * scale, scale)
    return bool((np.abs(continued - actual) / scale).max() < 1e-4)


def _solvable(held: IntArray, free: BoolArray, entries: BoolArray) -> IntArray:
    """Return ``held`` where enough free controls are left to keep it, else nothing.

    An equation needs a control off its bounds to be solved for: one that enters it if
    any does, and no two equations the same.
    """
    equations = np.flatnonzero(held)
    mixed = entries[equations].any(axis=1)
    reach = (entries[equations] & free).any(axis=1)
    if equations.size <= free.sum() and np.all(reach | ~mixed):
        return held
    return np.zeros_like(held)


def arc_mesh(
    phase: PhaseSolution,
    structure: Structure,
    free_controls: list[tuple[int, str, int]],
    constraints: Sequence[str] = (),
    entries: BoolArray | None = None,
) -> tuple[PhaseMesh, FloatArray]:
    """Mesh whose arcs are those of ``structure``, and the arcs' durations.

    ``free_controls``: number, name and degree between the bounds of the controls
    whose degree the solver chooses; at a bound they become constant on each interval.
    ``constraints``: names of the path constraints; ``entries``: which control enters
    which of them.
    """
    smooth = any(degree < 0 for _, _, degree in free_controls)
    borders = np.concatenate([[phase.start], structure.times, [phase.end]])
    span = phase.end - phase.start
    breaks, points = phase.states.breaks, np.asarray(phase.mesh.points)
    cells: list[Cell] = []
    # Off the arcs on which it is held a constraint of controls is watched closely: a
    # border between arcs may move to where it is violated between its points. One of
    # states leaves its bound at a tangent, where close points would only repeat.
    if entries is None:
        entries = np.zeros((len(constraints), structure.classes.shape[1]), dtype=bool)
    held_at = [
        _solvable(held, classes == 0, entries)
        for held, classes in zip(structure.held, structure.classes, strict=True)
    ]
    mixed = entries.any(axis=1)
    watched = any(bool(held[mixed].any()) for held in held_at)
    for arc in range(borders.size - 1):
        left, right = borders[arc], borders[arc + 1]
        width = max(right - left, 1e-9 * span)
        inside = (breaks[:-1] < right) & (breaks[1:] > left)
        own = points[inside]
        inner = breaks[(breaks > left) & (breaks < right)]
        gaps = np.diff(breaks)[inside].min() if inside.any() else width
        inner = inner[(inner - left > 0.3 * gaps) & (right - inner > 0.3 * gaps)]
        # Few intervals where controls are linear in the Hamiltonian: each border is
        # a place for a false switch.
        inner = inner[1::2] if smooth else inner[3::4]
        count = max(LEAST_POINTS, int(own.max()) if own.size else 4)
        edges = np.concatenate([[left], inner, [left + width]])
        degrees = {}
        # A state that is held all along determines a control at every point.
        led = bool(held_at[arc][~mixed].any())
        for j, name, degree in free_controls:
            inner = -1 if led else degree
            degrees[name] = 0 if structure.classes[arc, j] != 0 else inner
        all_held = bool(held_at[arc].all())
        held = [(c, int(h)) for c, h in zip(constraints, held_at[arc], strict=True)]
        for a, b in pairwise(edges):
            n = min(max(count, 6), MOST_POINTS)
            cells.append(
                Cell(
                    (a - left) / width,
                    (b - left) / width,
                    n,
                    arc,
                    tuple(degrees.items()),
                    fitting_points(2 * n) if watched and not all_held else (),
                    held=tuple(held),
                )
            )
    return mesh_of(cells), np.maximum(np.diff(borders), 1e-9 * span)
