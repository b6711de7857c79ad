"""The solution of an optimal control problem, drawn for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.view.document import document, table, text
from showc.view.mesh import mesh_plot
from showc.view.plot import Curve, line_plot

if TYPE_CHECKING:
    from showc.ocp import Margin, MeshRecord, Overrides, PhaseSolution, Problem
    from showc.ocp import Solution as OcpSolution


MOST_MARGINS = 4
"""Margins drawn in one plot: more would not be distinct."""
PLACES = 16
"""Instants drawn on each mesh interval."""


def render_solution(
    problem: Problem, solution: OcpSolution, *, overrides: Overrides | None = None
) -> str:
    """Return one printable HTML page on a solution of the optimal control core.

    It shows states and controls with their bounds, how much room every limit leaves,
    and the mesh of each pass of the refinement: the error of every interval, what was
    done to it and why. Everything stands in the page itself; nothing is loaded.

    Parameters
    ----------
    problem, solution
        What was solved, and the answer.
    overrides
        What the solve was given besides the problem.
    """
    from showc.ocp import margins  # noqa: PLC0415 - loads casadi

    found = margins(problem, solution, overrides=overrides, places=PLACES)
    parts = [_head(problem, solution)]
    for part in solution.phases:
        own = [margin for margin in found if margin.phase == part.name]
        title = f"Phase {text(part.name)}" if len(solution.phases) > 1 else "Solution"
        note = f"{part.duration:.6g} long; grey borders: mesh intervals"
        plots = [*_curves(part, own), *_margins(part, own)]
        parts.append(
            f"<h2>{title}<small>{note}</small></h2>"
            f"<div class='plots'>{''.join(plots)}</div>"
        )
    parts.append(_refinement(solution.history))
    return document(problem.name, "".join(parts))


def _head(problem: Problem, solution: OcpSolution) -> str:
    error = solution.error
    facts = [
        ("Result", solution.message),
        ("Objective", f"{solution.objective:.10g}"),
        (
            "Mesh",
            (
                f"{solution.mesh.interval_count} intervals, "
                f"{solution.mesh.point_count} collocation points, after "
                f"{max(len(solution.history), 1)} meshes and {solution.iterations} "
                "iterations"
            ),
        ),
    ]
    if error is not None:
        facts += [
            ("Estimated error of the objective", f"{error.objective:.1e} of it"),
            (
                "States against their re-integration",
                (
                    f"{error.dynamics:.1e} of their range on an interval, "
                    f"{error.shooting:.1e} from start to end"
                ),
            ),
            ("Path constraints between points", f"exceeded by {error.path:.1e}"),
        ]
    facts += [(name, f"{value:.10g}") for name, value in solution.statics.items()]
    facts += [(name, f"{value:.10g}") for name, value in solution.parameters.items()]
    words = frozenset({0, 1})
    rows = [[text(name), text(value)] for name, value in facts]
    return (
        f"<header><div><h1>{text(problem.name)}</h1><p>optimal control problem with "
        f"{len(solution.phases)} phase{'s' if len(solution.phases) > 1 else ''}</p>"
        f"</div></header>{table(['', ''], rows, words=words, kind='facts')}"
    )


def _curves(part: PhaseSolution, own: list[Margin]) -> list[str]:
    """One plot for each state and control, with its bounds."""
    breaks = part.states.breaks
    share = np.linspace(1e-9, 1.0 - 1e-9, PLACES)
    times = (breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel()
    limits = {
        (margin.kind, margin.name): [
            bound for bound in (margin.lower, margin.upper) if np.isfinite(bound)
        ]
        for margin in own
    }
    drawn = [("state", name, part.states) for name in part.state_names]
    drawn += [("control", name, part.controls) for name in part.control_names]
    plots = []
    for number, (kind, name, curve) in enumerate(drawn):
        column = number if kind == "state" else number - len(part.state_names)
        plots.append(
            line_plot(
                f"{kind.capitalize()} {name}",
                times,
                [Curve("", curve(times)[:, column])],
                limits=limits.get((kind, name), []),
                breaks=breaks,
                unit="",
            )
        )
    plots += [
        line_plot(
            f"Path constraint {margin.name}",
            margin.times,
            [Curve("", margin.values)],
            limits=limits["path", margin.name],
            breaks=breaks,
            unit="",
        )
        for margin in own
        if margin.kind == "path"
    ]
    return plots


def _margins(part: PhaseSolution, own: list[Margin]) -> list[str]:
    """Room to the limits, a few in one plot."""
    own = [margin for margin in own if margin.lower < margin.upper]
    return [
        line_plot(
            "Margins: share of the range left [%]",
            own[first].times,
            [
                Curve(margin.name, 100.0 * margin.room)
                for margin in own[first : first + MOST_MARGINS]
            ],
            limits=[0.0],
            breaks=part.states.breaks,
            unit="",
        )
        for first in range(0, len(own), MOST_MARGINS)
    ]


def _refinement(history: tuple[MeshRecord, ...]) -> str:
    """Every mesh, and what was done to it."""
    if not history:
        return "<p class='note'>Solved on a mesh that was given; no refinement.</p>"
    heads = ["", "Intervals", "Points", "Objective", "Iterations", "Error", "Then"]
    words = frozenset({6})
    rows = []
    for number, record in enumerate(history, start=1):
        error = record.error
        worst = (
            record.result.name.lower().replace("_", " ")
            if error is None
            else f"{max(error.dynamics, error.path, error.objective):.1e}"
        )
        rows.append(
            [
                str(number),
                str(record.intervals),
                str(record.points),
                f"{record.objective:.9g}",
                str(record.iterations),
                text(worst),
                text(record.action),
            ]
        )
    names = dict.fromkeys(p.name for record in history for p in record.phases)
    plots = [mesh_plot(name, history) for name in names]
    summary = table(heads, rows, words=words, kind="meshes")
    return (
        "<h2>Refinement<small>each line one mesh; what was done to an interval is the "
        "colour, why is in the table</small></h2>"
        f"{''.join(plots)}{summary}{_reasons(history)}"
    )


def _reasons(history: tuple[MeshRecord, ...]) -> str:
    """Table of every decision with its reason."""
    words = frozenset({1, 4, 5})
    rows = []
    for number, record in enumerate(history, start=1):
        for phase in record.phases:
            for interval in phase.intervals:
                decision = interval.decision
                if not decision.reason:
                    continue
                rows.append(
                    [
                        str(number),
                        f"{interval.start:.6g} – {interval.end:.6g}",
                        str(interval.points),
                        "" if interval.error is None else f"{interval.error:.1e}",
                        text(decision.step.value),
                        text(decision.reason),
                    ]
                )
    if not rows:
        return ""
    heads = ["Mesh", "Interval", "Points", "Error", "Decision", "Why"]
    return (
        "<h2>Decisions<small>interval by interval</small></h2>"
        f"{table(heads, rows, words=words, kind='meshes')}"
    )
