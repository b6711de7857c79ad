"""The skeleton of a raster: thinned to lines, and the lines traced."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.arrays import BoolArray


Pixel = tuple[int, int]
"""Row and column."""

_RING = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Steps to the eight neighbours of a pixel, once around."""


def thinned(inside: BoolArray) -> BoolArray:
    """Thin a raster to lines one pixel wide that hang together as it did.

    Zhang and Suen 1984.
    """
    raster = np.pad(inside, 1).astype(np.int8)
    while True:
        before = int(raster.sum())
        for first in (True, False):
            raster[1:-1, 1:-1][_removable(raster, first_pass=first)] = 0
        if int(raster.sum()) == before:
            return np.asarray(raster[1:-1, 1:-1] > 0)


def _removable(raster: NDArray[np.int8], *, first_pass: bool) -> BoolArray:
    """Return the pixels one pass of Zhang and Suen takes away, padding left out."""
    rows, columns = raster.shape
    ring = [
        raster[1 + down : rows - 1 + down, 1 + right : columns - 1 + right]
        for down, right in _RING
    ]
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


def traced(thin: BoolArray, spur: float) -> tuple[list[Pixel], list[list[Pixel]]]:
    """Trace the lines of a thinned raster.

    Parameters
    ----------
    thin
        The raster, shape (rows, columns).
    spur
        Dead ends shorter than this, in pixels, are thinning's mistakes and left out.

    Returns
    -------
    tuple
        Ends and branching points; and the lines between them, as chains of pixels,
        both ends included. A ring without branching points ends where it begins.
    """
    rows, columns = np.nonzero(thin)
    pixels = set(zip(rows.tolist(), columns.tolist(), strict=True))
    for _ in range(3):
        links = _links(pixels)
        nodes, chains = _chains(links)
        spurs = [
            chain
            for chain in chains
            if len(chain) < spur
            and {len(links[chain[0]]), len(links[chain[-1]])} & {1}
            and max(len(links[chain[0]]), len(links[chain[-1]])) > 2
        ]
        if not spurs:
            break
        for chain in spurs:
            ends = chain if len(links[chain[0]]) == 1 else chain[::-1]
            pixels -= set(ends[:-1])
    return nodes, chains


def _links(pixels: set[Pixel]) -> dict[Pixel, list[Pixel]]:
    """Return the neighbours of each pixel; diagonals only where no corner joins."""
    links: dict[Pixel, list[Pixel]] = {}
    for row, column in sorted(pixels):
        near = []
        for down, right in _RING:
            other = (row + down, column + right)
            if other not in pixels:
                continue
            corner = down and right
            if corner and (
                (row + down, column) in pixels or (row, column + right) in pixels
            ):
                continue
            near.append(other)
        links[row, column] = near
    return links


def _chains(
    links: dict[Pixel, list[Pixel]],
) -> tuple[list[Pixel], list[list[Pixel]]]:
    nodes = [pixel for pixel, near in links.items() if len(near) != 2]
    chains: list[list[Pixel]] = []
    seen: set[Pixel] = set()
    known = set(nodes)
    for node in nodes:
        for step in links[node]:
            if step in seen or (step in known and step < node):
                continue
            chain = _walk(links, node, step, known)
            seen |= set(chain[1:-1])
            chains.append(chain)
    for pixel in links:
        if pixel not in seen and pixel not in known:
            ring = _walk(links, pixel, links[pixel][0], {pixel})
            seen |= set(ring)
            chains.append(ring)
    return nodes, chains


def _walk(
    links: dict[Pixel, list[Pixel]], start: Pixel, step: Pixel, stops: set[Pixel]
) -> list[Pixel]:
    """Follow a line from a pixel until a stop."""
    chain = [start, step]
    while chain[-1] not in stops:
        first, second = links[chain[-1]]
        chain.append(second if first == chain[-2] else first)
    return chain
