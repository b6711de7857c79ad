"""The meshes of a refinement as SVG: one band a mesh, coloured by what was done."""

from __future__ import annotations

from math import log10
from typing import TYPE_CHECKING

from showc.view.document import text
from showc.view.plot import ticks

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from showc.ocp.history import IntervalRecord, MeshRecord, PhaseRecord, Step

WIDTH, LEFT, RIGHT = 940.0, 52.0, 96.0
"""Of the drawing, and of its margins for words [px]."""
BAND, GAP, BOTTOM = 34.0, 7.0, 24.0
"""Heights of a mesh, between two, and of the axis [px]."""
COLOURS = {
    "KEPT": "#c9d3e3",
    "CUT": "#d9541e",
    "RAISED": "#2459c4",
    "MERGED": "#14804a",
    "CONSTRAINED": "#c99700",
    "SWITCH": "#8b3fb5",
    "GRADED": "#0f8b8d",
}
"""Of what was done to an interval, by the name of the :class:`~showc.ocp.Step`."""
UNKNOWN = "#eceff4"
"""Colour of meshes that were not audited."""
LOWEST, HIGHEST = -12.0, 0.0
"""Decades of the error between which bars grow from nothing to the whole band."""


def mesh_plot(name: str, history: Sequence[MeshRecord]) -> str:
    """Return a figure of the meshes of the phase ``name``, first mesh on top.

    Each interval is a bar: its width the interval's, its height the logarithm of its
    greatest error, its colour what the refinement did to it next. Borders of arcs
    stand out as triangles. Pointing at a bar tells the reason.
    """
    bands = [
        (number, record, phase)
        for number, record in enumerate(history, start=1)
        for phase in record.phases
        if phase.name == name
    ]
    begin = min(phase.intervals[0].start for _, _, phase in bands)
    end = max(phase.intervals[-1].end for _, _, phase in bands)
    span = max(end - begin, 1e-300)

    def x(time: float) -> float:
        return LEFT + (time - begin) / span * (WIDTH - LEFT - RIGHT)

    height = len(bands) * (BAND + GAP) + BOTTOM
    parts: list[str] = []
    used: dict[str, Step] = {}
    for at, (number, record, phase) in enumerate(bands):
        top = at * (BAND + GAP) + 4.0
        parts.append(
            f'<text x="{LEFT - 8}" y="{top + BAND / 2 + 4:.1f}" '
            f'text-anchor="end">mesh {number}</text>'
            f'<text x="{WIDTH - RIGHT + 8}" y="{top + BAND / 2 + 4:.1f}">'
            f"{len(phase.intervals)} intervals</text>"
        )
        audited = record.error is not None
        for interval in phase.intervals:
            if audited:
                used[interval.decision.step.name] = interval.decision.step
            parts.append(_bar(interval, x(interval.start), x(interval.end), top))
        parts += _borders(phase, x, top)
    parts += [
        f'<text x="{x(time):.1f}" y="{height - 6:.1f}" '
        f'text-anchor="middle">{time:.6g}</text>'
        for time in ticks(begin, begin + span, count=8)
    ]
    keys = [
        f'<span class="key"><i style="background:{colour}"></i>'
        f"{text(used[step].value)}</span>"
        for step, colour in COLOURS.items()
        if step in used
    ]
    keys.append("height: error of the interval, 1e-12 to 1; triangles: borders of arcs")
    title = text(f"Meshes of phase {name}")
    return (
        f'<figure class="meshes"><svg viewBox="0 0 {WIDTH:.0f} {height:.0f}" '
        f'role="img" aria-label="{title}" xmlns="http://www.w3.org/2000/svg">'
        f"{''.join(parts)}</svg><figcaption>{''.join(keys)}</figcaption></figure>"
    )


def _bar(interval: IntervalRecord, left: float, right: float, top: float) -> str:
    error, decision = interval.error, interval.decision
    wide = max(right - left - 0.6, 0.4)
    tall, colour, words = BAND, UNKNOWN, "not audited"
    if error is not None:
        share = (log10(max(error, 1e-300)) - LOWEST) / (HIGHEST - LOWEST)
        tall = BAND * min(max(share, 0.04), 1.0)
        colour = COLOURS[decision.step.name]
        words = f"error {error:.1e}: {decision.step.value}"
    reason = f" – {decision.reason}" if decision.reason else ""
    title = text(
        f"{interval.start:.6g} to {interval.end:.6g}, {interval.points} points, "
        f"{words}{reason}"
    )
    return (
        f'<rect x="{left + 0.3:.2f}" y="{top:.1f}" width="{wide:.2f}" '
        f'height="{BAND}" fill="{UNKNOWN}"/>'
        f'<rect x="{left + 0.3:.2f}" y="{top + BAND - tall:.1f}" width="{wide:.2f}" '
        f'height="{tall:.1f}" fill="{colour}"><title>{title}</title></rect>'
    )


def _borders(phase: PhaseRecord, x: Callable[[float], float], top: float) -> list[str]:
    """Triangles under the borders of arcs."""
    low = top + BAND
    return [
        f'<path d="M{x(time):.1f},{low:.1f}l-3.2,5.5h6.4z" fill="#161b26"/>'
        for time in phase.switches
    ]
