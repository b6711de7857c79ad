"""The centre line of closed contours: where a pen would have gone.

A raster of the inside is thinned until lines one pixel wide are left (Zhang and Suen
1984); places are spread evenly over them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.script.formations.contours import bounds, winding
from showc.script.formations.evenly import spread_evenly
from showc.script.formations.shape import FormationError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from showc.script.formations.contours import Contour

    FloatArray = NDArray[np.float64]
    BoolArray = NDArray[np.bool_]

_PIXELS_ACROSS = 9
"""Pixels across a stroke of mean width."""
_MAX_PIXELS = 3_000_000


def centreline(contours: Sequence[Contour], count: int) -> FloatArray:
    """Place points evenly along the centre line of what contours enclose.

    Returns
    -------
    FloatArray
        Shape (count, 2).

    Raises
    ------
    FormationError
        If the contours enclose nothing, or less line than there are points.
    """
    closed = [contour for contour in contours if contour.closed]
    width = _stroke_width(closed) if closed else 0.0
    pixels = np.empty((0, 2))
    if width > 0.0:
        low, high = bounds(closed)
        least = float(np.sqrt(np.prod(high - low) / _MAX_PIXELS))
        pitch = max(width / _PIXELS_ACROSS, least)
        for _ in range(3):
            pixels = _thin_pixels(closed, low, high, pitch)
            if len(pixels) >= 3 * count or pitch <= least:
                break
            pitch = max(pitch / 2.0, least)
    if len(pixels) < count:
        raise FormationError(
            "SHW110",
            f"the drawing has too little centre line for {count} places",
            "draw",
            help_text="use `draw: outline` or `draw: inside`",
        )
    return np.asarray(pixels[spread_evenly(pixels, count)])


def _stroke_width(contours: Sequence[Contour]) -> float:
    """Return the mean width of what is enclosed: twice the area over the outline."""
    area = length = 0.0
    for contour in contours:
        x, y = contour.points.T
        area += float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) / 2.0
        length += float(contour.lengths[-1])
    return 2.0 * abs(area) / length if length > 0.0 else 0.0


def _thin_pixels(
    contours: Sequence[Contour], low: FloatArray, high: FloatArray, pitch: float
) -> FloatArray:
    """Return the middles of the pixels that thinning leaves, (pixels, 2)."""
    columns, rows = (np.ceil((high - low) / pitch) + 2).astype(int)
    across = low[0] + (np.arange(columns) - 0.5) * pitch
    up = low[1] + (np.arange(rows) - 0.5) * pitch
    thin = thinned(winding(contours, across, up) != 0)
    row, column = np.nonzero(thin)
    return np.column_stack([across[column], up[row]])


def thinned(inside: BoolArray) -> BoolArray:
    """Thin a raster to lines one pixel wide that hang together as it did."""
    raster = np.pad(inside, 1).astype(np.int8)
    while True:
        before = int(raster.sum())
        for first in (True, False):
            raster[1:-1, 1:-1][_removable(raster, first_pass=first)] = 0
        if int(raster.sum()) == before:
            return np.asarray(raster[1:-1, 1:-1] > 0)


def _removable(raster: NDArray[np.int8], *, first_pass: bool) -> BoolArray:
    """Return the pixels one pass of Zhang and Suen takes away, padding left out."""
    ring = [
        raster[1 + dy : raster.shape[0] - 1 + dy, 1 + dx : raster.shape[1] - 1 + dx]
        for dy, dx in (
            (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1),
        )
    ]  # fmt: skip
    neighbours = np.zeros_like(ring[0])
    crossings = np.zeros_like(ring[0])
    for index, pixel in enumerate(ring):
        neighbours += pixel
        crossings += (pixel == 0) & (ring[(index + 1) % 8] == 1)
    north, east, south, west = ring[0], ring[2], ring[4], ring[6]
    if first_pass:
        open_side = (north * east * south == 0) & (east * south * west == 0)
    else:
        open_side = (north * east * west == 0) & (north * south * west == 0)
    border = (neighbours >= 2) & (neighbours <= 6) & (crossings == 1)
    return np.asarray((raster[1:-1, 1:-1] == 1) & border & open_side)
