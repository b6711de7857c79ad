"""The centre line of closed contours: where a pen would have gone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import ScriptError
from showc.script.formations.contours import bounds, winding
from showc.script.formations.skeleton import Pixel, thinned, traced
from showc.script.formations.wire import Wire, string

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.script.formations.contours import Contour


_PIXELS_ACROSS = 8
"""Pixels across a stroke of mean width."""
_MAX_PIXELS = 3_000_000
"""Pixels of a raster: bounds the time and the memory of the thinning."""


def centreline(contours: Sequence[Contour], count: int) -> FloatArray:
    """Place points along the centre line of what contours enclose.

    Ends and branching points of the line have a place first, so that letters keep
    their form with few drones; the others are spread evenly between them.

    Returns
    -------
    FloatArray
        Shape (count, 2).

    Raises
    ------
    ScriptError
        If the contours enclose nothing.
    """
    closed = [contour for contour in contours if contour.closed]
    width = _stroke_width(closed) if closed else 0.0
    if width <= 0.0:
        raise ScriptError(
            "SHW110",
            "the drawing encloses no area",
            key="draw",
            help_text="use `draw: outline`",
        )
    low, high = bounds(closed)
    least = float(np.sqrt(np.prod(high - low) / _MAX_PIXELS))
    pitch = max(width / _PIXELS_ACROSS, least)
    columns, rows = (np.ceil((high - low) / pitch) + 2).astype(int)
    across = low[0] + (np.arange(columns) - 0.5) * pitch
    up = low[1] + (np.arange(rows) - 0.5) * pitch
    thin = thinned(winding(closed, across, up) != 0)
    nodes, chains = traced(thin, width / pitch)

    def place(pixels: Sequence[Pixel]) -> FloatArray:
        row, column = np.array(pixels, dtype=np.int64).reshape(-1, 2).T
        return np.column_stack([across[column], up[row]])

    anchors = _apart(place(nodes), width)
    fixed = set(nodes)
    wires = [
        Wire(
            _smooth(place(chain)), ring=chain[0] == chain[-1] and chain[0] not in fixed
        )
        for chain in chains
        if len(chain) > 2
    ]
    return string(anchors, wires, count)


def _stroke_width(contours: Sequence[Contour]) -> float:
    """Return the mean width of what is enclosed: twice the area over the outline."""
    area = length = 0.0
    for contour in contours:
        x, y = contour.points.T
        area += float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) / 2.0
        length += float(contour.lengths[-1])
    return 2.0 * abs(area) / length if length > 0.0 else 0.0


def _apart(points: FloatArray, distance: float) -> FloatArray:
    """Leave out points nearer than a distance to one before them."""
    kept: list[FloatArray] = []
    for point in points:
        if all(float(np.hypot(*(point - other))) >= distance for other in kept):
            kept.append(point)
    return np.array(kept, dtype=np.float64).reshape(-1, 2)


def _smooth(points: FloatArray) -> FloatArray:
    """Take the steps out of a chain of pixels; its ends stay."""
    inner = points.copy()
    for _ in range(3):
        inner[1:-1] = (inner[:-2] + 2.0 * inner[1:-1] + inner[2:]) / 4.0
    return inner
