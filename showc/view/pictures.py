"""Small drawings of every formation that is held, for the report."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.view.document import clock, text

if TYPE_CHECKING:
    from showc.arrays import ByteArray, FloatArray
    from showc.view.overview import Overview

WIDTH, HEIGHT, ROOM = 170.0, 110.0, 9.0
"""Of a drawing, and the room around what it shows."""
MOST = 60
"""Most drawings; a report of more is a book."""
DOTS = 1000
"""Most drones drawn of each formation."""
_FLAT = 0.3
"""Height over depth below which a formation is shown from above."""


def pictures_section(overview: Overview) -> str:
    """HTML of all formations that are held, in the order of their first hold."""
    held = overview.pictures
    figures = []
    for one in held[:MOST]:
        step = max(1, -(-len(one.places) // DOTS))
        figures.append(
            f"<figure>{_drawing(one.places[::step], one.colours[::step])}"
            f"<figcaption>{text(one.name)}, {clock(one.start)}</figcaption></figure>"
        )
    if not figures:
        return ""
    more = len(held) - len(figures)
    rest = f"<p>{more} more are not shown.</p>" if more > 0 else ""
    drawn = "".join(figures)
    return f"<h2>Pictures</h2><div class='pictures'>{drawn}</div>{rest}"


def _drawing(places: FloatArray, colours: ByteArray) -> str:
    """Draw places (n, 3) [m] from the front, or from above where they lie flat."""
    extent = np.ptp(places, axis=0)
    up = 1 if extent[2] < _FLAT * extent[1] else 2
    flat = places[:, [0, up]]
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = np.array([WIDTH, HEIGHT])
    scale = float(((size - 2.0 * ROOM) / np.maximum(high - low, 1.0)).min())
    shown = (flat - 0.5 * (low + high)) * scale * [1.0, -1.0] + 0.5 * size
    radius = float(np.clip(24.0 / np.sqrt(len(places)), 0.7, 2.4))
    dots = "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" '
        f'fill="rgb({red},{green},{blue})"/>'
        for (x, y), (red, green, blue) in zip(
            shown, np.maximum(colours, 70).tolist(), strict=True
        )
    )
    return (
        f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" role="img">'
        f'<rect width="{WIDTH:.0f}" height="{HEIGHT:.0f}" rx="5" fill="#0b101b"/>'
        f"{dots}</svg>"
    )
