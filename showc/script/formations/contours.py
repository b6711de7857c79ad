"""Contours: closed and open curves in a plane, followed or filled with points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import ScriptError
from showc.script.formations.evenly import candidates_for, spread_evenly

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Contour:
    """One curve, as a chain of short straight pieces."""

    points: FloatArray
    """Shape (corners, 2); a closed curve ends where it begins."""
    colour: tuple[float, float, float] | None = None
    """sRGB, if the drawing says so."""

    @property
    def lengths(self) -> FloatArray:
        """Length from the start to each corner, shape (corners,)."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def closed(self) -> bool:
        """Whether it ends where it begins."""
        gap = float(np.linalg.norm(self.points[0] - self.points[-1]))
        return gap <= 1e-6 * max(float(self.lengths[-1]), 1e-300)


def bounds(contours: Sequence[Contour]) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper corner of the box around all contours."""
    every = np.concatenate([contour.points for contour in contours])
    return every.min(axis=0), every.max(axis=0)


def fitted(contours: Sequence[Contour], size: float, axis: int) -> tuple[Contour, ...]:
    """Scale contours to a size along an axis (0 width, 1 height) and centre them.

    Raises
    ------
    ScriptError
        If the drawing has no extent along that axis.
    """
    low, high = bounds(contours)
    extent = float((high - low)[axis])
    if extent <= 0.0:
        raise ScriptError(
            "SHW110",
            f"the drawing has no {('width', 'height')[axis]}, and cannot be scaled",
            key=("width", "height")[axis],
        )
    middle = (low + high) / 2.0
    scale = size / extent
    return tuple(
        Contour((contour.points - middle) * scale, contour.colour)
        for contour in contours
    )


def follow(contours: Sequence[Contour], count: int) -> tuple[FloatArray, IntArray]:
    """Place points along contours, evenly by length.

    Each contour gets points in proportion to its length; where there are fewer points
    than contours, the longest get one each.

    Returns
    -------
    tuple
        Points, shape (count, 2), and the contour each lies on, shape (count,).
    """
    lengths = np.array([float(contour.lengths[-1]) for contour in contours])
    shares = _shares(lengths, count)
    points, owners = [], []
    for index, (contour, share) in enumerate(zip(contours, shares, strict=True)):
        if share:
            points.append(_along(contour, int(share)))
            owners.append(np.full(int(share), index))
    return np.concatenate(points), np.concatenate(owners)


def _shares(lengths: FloatArray, count: int) -> IntArray:
    """Divide a number in proportion to lengths, by largest remainders."""
    wanted = lengths / lengths.sum() * count
    shares = np.floor(wanted).astype(np.int64)
    if count >= len(lengths):
        shares = np.maximum(shares, 1)
    order = np.argsort(shares - wanted, kind="stable")
    at = 0
    while shares.sum() < count:
        shares[order[at % len(order)]] += 1
        at += 1
    while shares.sum() > count:
        most = int(np.argmax(np.where(shares > 1, shares - wanted, -np.inf)))
        shares[most] -= 1
    return np.asarray(shares, dtype=np.int64)


def _along(contour: Contour, count: int) -> FloatArray:
    """Return points evenly along one contour, (count, 2)."""
    reach = contour.lengths
    total = float(reach[-1])
    if contour.closed:
        at = np.arange(count) * total / count
    elif count == 1:
        at = np.array([total / 2.0])
    else:
        at = np.linspace(0.0, total, count)
    return np.column_stack(
        [np.interp(at, reach, contour.points[:, axis]) for axis in range(2)]
    )


def fill(contours: Sequence[Contour], count: int) -> tuple[FloatArray, IntArray]:
    """Place points evenly inside closed contours (non-zero winding).

    Returns
    -------
    tuple
        Points, shape (count, 2), and the contour around each, shape (count,).

    Raises
    ------
    ScriptError
        If the contours enclose nothing.
    """
    closed = [contour for contour in contours if contour.closed]
    inside = _inside_points(closed, candidates_for(count)) if closed else None
    if inside is None or len(inside) < count:
        raise ScriptError(
            "SHW110",
            "the drawing encloses no area to fill",
            key="draw",
            help_text="use `draw: outline`",
        )
    points = inside[spread_evenly(inside, count)]
    owner = np.zeros(count, dtype=np.int64)
    for index, contour in enumerate(contours):
        # Later shapes of a drawing lie over earlier ones.
        owner[_inside(contour, points)] = index
    return points, owner


def _inside(contour: Contour, points: FloatArray) -> BoolArray:
    """Tell which points, shape (n, 2), a contour encloses (even-odd rule), (n,)."""
    start, stop = contour.points[:-1], contour.points[1:]
    x, y = points[:, 0, None], points[:, 1, None]
    crosses = (start[:, 1] > y) != (stop[:, 1] > y)
    rise = np.where(stop[:, 1] == start[:, 1], 1.0, stop[:, 1] - start[:, 1])
    at = start[:, 0] + (y - start[:, 1]) / rise * (stop[:, 0] - start[:, 0])
    return np.asarray(np.sum(crosses & (x < at), axis=1) % 2 == 1)


def _inside_points(contours: Sequence[Contour], wanted: int) -> FloatArray | None:
    """Return a lattice of at least ``wanted`` points inside, if there is an inside."""
    low, high = bounds(contours)
    box = float(np.prod(high - low))
    if box <= 0.0:
        return None
    pitch = float(np.sqrt(box / wanted))
    for _ in range(6):
        size = np.maximum(np.ceil((high - low) / pitch), 1).astype(int)
        across = (np.arange(size[0]) + 0.5) / size[0] * (high - low)[0] + low[0]
        up = (np.arange(size[1]) + 0.5) / size[1] * (high - low)[1] + low[1]
        inside = winding(contours, across, up) != 0
        if inside.sum() >= wanted:
            break
        pitch *= 0.9 * np.sqrt(max(float(inside.mean()), 0.02))
    rows, columns = np.nonzero(inside)
    return np.column_stack([across[columns], up[rows]])


def winding(
    contours: Sequence[Contour], across: FloatArray, up: FloatArray
) -> IntArray:
    """Return how often contours wind about lattice points, shape (up, across)."""
    number = np.zeros((len(up), len(across) + 1), dtype=np.int64)
    for contour in contours:
        start, stop = contour.points[:-1], contour.points[1:]
        for (ax, ay), (bx, by) in zip(start, stop, strict=True):
            first, last = np.searchsorted(up, sorted((ay, by)))
            if first == last:
                continue
            rows = np.arange(first, last)
            crossing = ax + (up[rows] - ay) / (by - ay) * (bx - ax)
            # Every lattice point left of the crossing is wound about once more.
            column = np.searchsorted(across, crossing)
            number[rows, column] += 1 if by > ay else -1
    after = np.cumsum(number[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(after[:, 1:], dtype=np.int64)
