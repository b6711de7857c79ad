"""What to try next: switch times placed, or intervals refined."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.audit.optimality import objective_size, ranges
from showc.ocp.audit.residuals import given
from showc.ocp.guess import Curve, Data, Guess, curves_of
from showc.ocp.history import Decision, Step
from showc.ocp.mesh import Mesh, PhaseMesh
from showc.ocp.nodes import fitting_points
from showc.ocp.refinement.options import (
    BOUNDARY_SHARE,
    CHEAP,
    ELSEWHERE,
    FIRST_DEGREE,
    GROWTH,
    INNER_DEGREE,
    LITTLE_VIOLATION,
    MOSTLY_PLAIN,
    ROUGH,
    TOUCHED,
    VAGUE,
)
from showc.ocp.refinement.refine import (
    IntervalErrors,
    arc_mesh,
    halves,
    refine,
    summary,
)
from showc.ocp.refinement.switches import SAMPLED, border_reasons, detect

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.ocp.audit.residuals import PhaseAudit, PhaseAuditor
    from showc.ocp.problem import Problem
    from showc.ocp.refinement.judgement import Judgement
    from showc.ocp.refinement.options import Options
    from showc.ocp.refinement.switches import Structure
    from showc.ocp.solution import PhaseSolution, Solution
    from showc.ocp.transcription.collocation.statement import Table


_BESIDE = 0.05
"""Share of the least interval within which a switch is at a border of both."""


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """The next mesh to try."""

    mesh: Mesh
    arcs: tuple[FloatArray, ...] | None
    """First guess of the arcs' durations, phase by phase; ``None``: no arcs."""
    structures: tuple[Structure | None, ...]
    decisions: tuple[tuple[Decision, ...], ...]
    """What is done to each interval of the mesh before, and why, phase by phase."""
    words: str
    """What was done, and why."""
    places_switches: bool = False
    complete: bool = True
    """Whether every interval is refined whose error is too great."""


def inner_degree(auditor: PhaseAuditor, control: int) -> int:
    """Degree of a control between its bounds; -1 for the points' own."""
    principle = auditor.principle
    loose = principle.affine[control] and not principle.constrained.bound[control]
    return INNER_DEGREE if loose else -1


def _structure(
    judgement: Judgement,
    auditor: PhaseAuditor,
    table: Table,
    preferred: IntArray | None,
) -> Structure:
    """Arcs of one phase of a solution; ``preferred`` as :func:`detect` takes it."""
    return detect(
        judgement.solution.phases[auditor.index],
        auditor.control_bounds(table),
        auditor.state_bounds(table),
        (
            partial(auditor.path_values, judgement.solution),
            auditor.path_bounds(table),
        ),
        drives=auditor.drives,
        preferred=preferred,
    )


def _preferred(
    judgement: Judgement, auditor: PhaseAuditor, table: Table
) -> IntArray | None:
    """Bounds that controls held at others should be at, where that costs too much.

    A short arc that a coarse mesh did not show is found so: in a longer one, no finer
    mesh would.
    """
    number, solution = auditor.index, judgement.solution
    structure = judgement.structures[number]
    if structure is None:
        return None
    part = solution.phases[number]
    fixed = structure.fixed[list(part.mesh.arcs)].T & judgement.audits[number].clear
    fixed &= judgement.suspects[number]
    if not fixed.any():
        return None
    wanted = auditor.principle.preferred(part, given(solution), table, SAMPLED)
    wanted = wanted.reshape(*fixed.shape, SAMPLED.size)
    return np.asarray(wanted * fixed[:, :, None], dtype=np.int64)


def place_switches(
    judgement: Judgement,
    auditors: Sequence[PhaseAuditor],
    table: Table,
    refused: Sequence[Structure],
) -> Proposal | None:
    """Mesh whose arcs are those seen in the solution; ``None`` if nothing new.

    Arcs are believed only where dynamics and optimality are about right and the mesh
    has at least two intervals for each; ``refused`` are structures that did not help.
    """
    wrong = [_preferred(judgement, auditor, table) for auditor in auditors]
    found = [
        _structure(judgement, auditor, table, preferred)
        for auditor, preferred in zip(auditors, wrong, strict=True)
    ]
    if not _credible(judgement, found):
        return None
    meshes: list[PhaseMesh] = []
    arcs: list[FloatArray] = []
    structures: list[Structure | None] = []
    decisions: list[tuple[Decision, ...]] = []
    placed = 0
    for auditor, part, known, structure, preferred in zip(
        auditors,
        judgement.solution.phases,
        judgement.structures,
        found,
        wrong,
        strict=True,
    ):
        count = structure.times.size
        # An arc of no length is left out only if it is at the wrong bound.
        kept = 0 if known is None or preferred is not None else known.times.size
        least = max(kept, 1)
        believed = least <= count <= part.mesh.intervals // 2
        settled = known is not None and not _moved(part, structure)
        seen = [known, *refused] if known and settled else list(refused)
        if not believed or any(structure.same_as(former) for former in seen):
            meshes.append(part.mesh)
            arcs.append(part.arc_durations)
            structures.append(known)
            decisions.append((Decision(),) * part.mesh.intervals)
            continue
        free = [
            (j, name, inner_degree(auditor, j))
            for j, (name, control) in enumerate(auditor.phase.controls.items())
            if control.degree is None
        ]
        names = [constraint.name for constraint in auditor.phase.path_constraints]
        mesh, durations = arc_mesh(
            part, structure, free, names, auditor.principle.constrained.entries
        )
        meshes.append(mesh)
        arcs.append(durations)
        structures.append(structure)
        decisions.append(_borders(part, structure))
        placed += count
    if not placed:
        return None
    return Proposal(
        Mesh(tuple(meshes)),
        tuple(arcs),
        tuple(structures),
        tuple(decisions),
        f"{placed} switch times placed",
        places_switches=True,
    )


def _credible(judgement: Judgement, found: Sequence[Structure]) -> bool:
    """Whether dynamics and optimality are about right, but for what arcs will mend.

    On an interval with a switch in it the dynamics are missed whatever its degree.
    """
    dynamics, objective = 0.0, 0.0
    for audit, part, structure in zip(
        judgement.audits, judgement.solution.phases, found, strict=True
    ):
        plain = np.ones(part.mesh.intervals, dtype=bool)
        breaks = part.states.breaks
        margin = _BESIDE * np.diff(breaks).min()
        for way in (-1.0, 1.0):
            at = np.searchsorted(breaks, structure.times + way * margin) - 1
            plain[np.clip(at, 0, plain.size - 1)] = False
        if plain.mean() < MOSTLY_PLAIN:
            plain[:] = True
        dynamics = max(dynamics, float(audit.dynamics[plain].max(initial=0.0)))
        objective += float(audit.objective_control.sum() + part.bound_gaps.sum())
        objective += float(audit.objective_dynamics[plain].sum())
    vague = VAGUE * objective_size(judgement.solution)
    return dynamics <= ROUGH and objective <= vague


def _moved(part: PhaseSolution, structure: Structure) -> bool:
    """Whether as many arcs are seen as the mesh has, but elsewhere.

    An inner arc next to one at a bound may be at that bound too on its last interval:
    the border between the two could then be anywhere.
    """
    borders = part.start + np.cumsum(part.arc_durations)[:-1]
    if borders.size != structure.times.size:
        return False
    switches = np.any(np.diff(structure.classes, axis=0) != 0, axis=1)
    off = np.abs(borders - structure.times)[switches]
    return bool(off.max(initial=0.0) > ELSEWHERE * part.duration)


def _borders(part: PhaseSolution, structure: Structure) -> tuple[Decision, ...]:
    """Say for each interval which borders of arcs were placed in it."""
    breaks = part.states.breaks
    found: list[list[str]] = [[] for _ in range(part.mesh.intervals)]
    reasons = border_reasons(structure, part.control_names)
    for time, reason in zip(structure.times, reasons, strict=True):
        k = int(np.searchsorted(breaks, time, side="right")) - 1
        found[min(max(k, 0), len(found) - 1)].append(f"{reason} at {time:.6g}")
    return tuple(
        Decision(Step.SWITCH, "; ".join(words)) if words else Decision()
        for words in found
    )


def refined(judgement: Judgement, options: Options) -> Proposal:
    """Mesh with the intervals refined whose errors are too great."""
    meshes: list[PhaseMesh] = []
    decisions: list[tuple[Decision, ...]] = []
    words = []
    complete = True
    growth = _growth(judgement.solution, options)
    for i, part in enumerate(judgement.solution.phases):
        audit = judgement.audits[i]
        constrained, earlier = _with_path_points(part.mesh, audit, options.tolerance)
        mesh, chosen = refine(
            constrained,
            part,
            IntervalErrors(
                judgement.indicators[i],
                judgement.must_cut[i],
                audit.jumps,
                _contacts(audit, options.tolerance),
                judgement.stubborn[i] if judgement.stubborn else None,
            ),
            scale=ranges(part.states),
            most=growth * part.mesh.point_count,
        )
        complete &= not any(
            decision.step is Step.KEPT and suspect
            for decision, suspect in zip(chosen, judgement.suspects[i], strict=True)
        )
        if audit.path.max() > options.tolerance:
            words.append("path constraints added where they were violated")
        words.append(summary(chosen))
        decisions.append(
            tuple(new.after(old) for new, old in zip(chosen, earlier, strict=True))
        )
        meshes.append(mesh)
    return Proposal(
        Mesh(tuple(meshes)),
        tuple(part.arc_durations for part in judgement.solution.phases),
        judgement.structures,
        tuple(decisions),
        "; ".join(words),
        complete=complete,
    )


def halved(judgement: Judgement) -> Proposal:
    """Mesh with every interval halved, whatever its error."""
    parts = judgement.solution.phases
    return Proposal(
        Mesh(tuple(halves(part.mesh) for part in parts)),
        tuple(part.arc_durations for part in parts),
        judgement.structures,
        tuple(
            (Decision(Step.CUT, "all are halved"),) * part.mesh.intervals
            for part in parts
        ),
        "every interval halved",
    )


def better_guess(solution: Solution, audits: Sequence[PhaseAudit]) -> Guess:
    """Return a start with the states found and controls that audits found better."""
    curves: dict[str, Curve] = {}
    for part, audit in zip(solution.phases, audits, strict=True):
        for name, curve in curves_of(part).items():
            curves[f"{part.name}.{name}"] = curve
        times, *rows = audit.better
        for name, row in zip(part.control_names, rows, strict=True):
            curves[f"{part.name}.{name}"] = Data(times, row)
    durations = {part.name: part.duration for part in solution.phases}
    starts = {part.name: part.start for part in solution.phases}
    return Guess(curves, durations, starts, solution.statics)


def _contacts(audit: PhaseAudit, tolerance: float) -> tuple[tuple[float, ...], ...]:
    """Where to cut: at contacts of which more is lost than in all other ways.

    Not on intervals along which a constraint is active, nor before it is kept.
    """
    others = audit.objective_dynamics + audit.objective_control
    touched = (audit.beside > others) & (audit.path <= tolerance)
    touched &= audit.path_active < TOUCHED
    return tuple(
        contact if yes else ()
        for contact, yes in zip(audit.contacts, touched.tolist(), strict=True)
    )


def _growth(solution: Solution, options: Options) -> float:
    """Return by what factor the points of a mesh may grow.

    As far as programs cost next to nothing, or doubled; never beyond the points that
    the caller allows.
    """
    points = solution.mesh.point_count
    cheap = CHEAP * points / unknowns_of(solution)
    return min(max(cheap, GROWTH * points), options.points) / points


def unknowns_of(solution: Solution) -> int:
    """Return the number of unknowns of the program that was solved."""
    return int(solution.multipliers.unknowns.size)


def _with_path_points(
    mesh: PhaseMesh, audit: PhaseAudit, tolerance: float
) -> tuple[PhaseMesh, list[Decision]]:
    """Let path constraints hold where they are violated between the nodes too.

    A new place replaces old ones next to it. Where places have been added before
    and little is left, the constraint is tightened by what is left: chasing the
    place of the greatest violation would never end.
    """
    points = [list(places) for places in mesh.path_points]
    margins = list(mesh.path_margins)
    decisions = [Decision()] * mesh.intervals
    for k in range(mesh.intervals):
        violation = float(audit.path[k])
        if violation <= tolerance:
            continue
        name = audit.path_names[k]
        found = f"{name!r} violated by {violation:.1e} of its scale between the points"
        decisions[k] = Decision(Step.CONSTRAINED, f"{found}: held there too", name)
        if audit.path_active[k] > BOUNDARY_SHARE:
            words = f"{found}, where it is active all along"
            decisions[k] = Decision(Step.KEPT, words, name)
            continue
        dense = list(fitting_points(2 * mesh.points[k]))
        little = violation < LITTLE_VIOLATION and len(points[k]) > 2
        if little or len(points[k]) >= len(dense):
            margins[k] += 1.5 * violation
            words = f"{found}: tightened by {margins[k]:.1e}"
            decisions[k] = Decision(Step.CONSTRAINED, words, name)
            continue
        if len(points[k]) > 3:
            # The peak moves away from every single point: leave it no room.
            points[k] = dense
            continue
        for place in audit.path_places[k]:
            points[k] = [s for s in points[k] if abs(s - place) > 0.03]
            points[k].append(float(np.clip(place, 0.0, 1.0)))
    changed = replace(
        mesh,
        path_points=tuple(tuple(sorted(p)) for p in points),
        path_margins=tuple(margins),
    )
    return changed, decisions


def with_ends(problem: Problem, mesh: Mesh) -> Mesh:
    """Let path constraints hold at the ends of intervals, which Gauss points miss."""
    return Mesh(
        tuple(
            replace(
                part,
                path_points=tuple(
                    tuple(sorted({0.0, 1.0, *places})) for places in part.path_points
                ),
            )
            if phase.path_constraints
            else part
            for phase, part in zip(problem.phases, mesh.phases, strict=True)
        )
    )


def plain_mesh(
    auditors: Sequence[PhaseAuditor],
    intervals: int,
    points: int,
    *,
    degree: int = FIRST_DEGREE,
) -> Mesh:
    """Equal intervals; ``degree`` of the controls that enter linearly and are free."""
    phases = []
    for auditor in auditors:
        degrees = {
            name: (min(degree, points - 1),) * intervals
            for j, (name, control) in enumerate(auditor.phase.controls.items())
            if control.degree is None and inner_degree(auditor, j) > 0
        }
        mesh = PhaseMesh.uniform(intervals, points)
        phases.append(replace(mesh, control_degrees=degrees))
    return Mesh(tuple(phases))
