"""Positions of a fleet over one leg, cut into slots for the search of conflicts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.trajectory import (
    PiecewisePolynomial,
    combined,
    elevation_matrix,
    restrict,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.flight import Trajectory


_SLOTS_LEAST, _SLOTS_MOST = 8, 240
"""Slices of a leg in which pairs are sought: few enough to be cheap for two drones, and
many enough that a drone of a large fleet is near few others in one."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Positions of all drones, in groups that share their interval borders."""

    moving: int
    """Drones that are looked at; those from here on take no part."""
    count: int
    """Drones in all."""
    duration: float
    """Of the leg [s]."""
    groups: tuple[tuple[IntArray, FloatArray, FloatArray], ...]
    """Indices (n,), breaks (K + 1,) [s], coefficients (n, K, degree + 1, 3) [m]."""

    def at(self, time: float) -> FloatArray:
        """Return all positions at one instant, shape (count, 3) [m]."""
        points = np.empty((self.count, 3))
        for members, breaks, coefficients in self.groups:
            piece = int(
                np.clip(
                    np.searchsorted(breaks, time, side="right") - 1,
                    0,
                    breaks.size - 2,
                )
            )
            drones, _, size, _ = coefficients.shape
            merged = coefficients[:, piece].transpose(1, 0, 2).reshape(1, size, -1)
            one = PiecewisePolynomial(breaks[piece : piece + 2], merged)
            points[members] = one(time).reshape(drones, 3)
        return points


def tracks_of(
    trajectories: Sequence[Trajectory],
    parked: FloatArray | None = None,
    others: Sequence[PiecewisePolynomial] = (),
) -> Tracks:
    """Take the positions out of trajectories of one common duration.

    Parameters
    ----------
    parked
        Positions of drones that stand still and take no part, shape (m, 3) [m].
    others
        Flights, positions first, of drones that take no part; they count before those.
    """
    duration = max((t.state.end for t in trajectories), default=0.0)
    alike: dict[tuple[bytes, int], list[int]] = {}
    paths = [*(trajectory.state for trajectory in trajectories), *others]
    for index, path in enumerate(paths):
        alike.setdefault((path.breaks.tobytes(), path.degree), []).append(index)
    groups = [
        (
            np.array(members),
            paths[members[0]].breaks,
            np.stack([paths[index].coefficients[:, :, :3] for index in members]),
        )
        for members in alike.values()
    ]
    moving, count = len(trajectories), len(paths)
    if parked is not None and parked.shape[0] and moving:
        count += parked.shape[0]
        groups.append(
            (
                np.arange(len(paths), count),
                np.array([0.0, duration]),
                np.asarray(parked, dtype=np.float64)[:, None, None, :],
            )
        )
    return Tracks(moving, count, duration, tuple(groups))


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Pieces of tracks, none reaching beyond its slot, sorted by drone and time."""

    slots: int
    """Number of slots."""
    begin: FloatArray
    """Start of each piece, shape (p,) [s]."""
    end: FloatArray
    """End of each piece, shape (p,) [s]."""
    coefficients: FloatArray
    """Bernstein coefficients in metric coordinates, shape (p, degree + 1, 3)."""
    head: IntArray
    """First piece of each drone and slot, shape (count * slots + 1,)."""

    def boxes(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper corners of what drones sweep, (slots, count, 3)."""
        corners = []
        for extreme in (np.minimum, np.maximum):
            # One coefficient after the other: of a piece they are few.
            corner = self.coefficients[:, 0].copy()
            for index in range(1, self.coefficients.shape[1]):
                extreme(corner, self.coefficients[:, index], out=corner)
            swept = extreme.reduceat(corner, self.head[:-1], axis=0)
            corners.append(swept.reshape(-1, self.slots, 3).transpose(1, 0, 2).copy())
        return corners[0], corners[1]

    def relative(
        self, slot: IntArray, first: IntArray, second: IntArray
    ) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
        """Relative motion of pairs in slots, on intervals where both are polynomials.

        Returns
        -------
        tuple
            first, second (n,), begin, end (n,) [s], coefficients (n, degree + 1, 3).
        """
        a, b = first * self.slots + slot, second * self.slots + slot
        size_a, size_b = (
            self.head[a + 1] - self.head[a],
            self.head[b + 1] - self.head[b],
        )
        product = size_a * size_b
        origin = np.repeat(np.arange(a.size), product)
        within = np.arange(origin.size) - np.repeat(
            np.cumsum(product) - product, product
        )
        piece_a = self.head[a][origin] + within // size_b[origin]
        piece_b = self.head[b][origin] + within % size_b[origin]
        begin = np.maximum(self.begin[piece_a], self.begin[piece_b])
        end = np.minimum(self.end[piece_a], self.end[piece_b])
        # Breaks that differ by rounding alone leave slivers of no consequence: the
        # tracks are continuous and slower than 1e9 m/s.
        keep = end - begin > 1e-12
        origin, begin, end = origin[keep], begin[keep], end[keep]
        motion = self._part(piece_a[keep], begin, end) - self._part(
            piece_b[keep], begin, end
        )
        return first[origin], second[origin], begin, end, motion

    def _part(self, piece: IntArray, begin: FloatArray, end: FloatArray) -> FloatArray:
        coefficients = self.coefficients[piece]
        width = self.end[piece] - self.begin[piece]
        lower = (begin - self.begin[piece]) / width
        upper = (end - self.begin[piece]) / width
        partial = np.nonzero((lower > 1e-12) | (upper < 1.0 - 1e-12))[0]
        if partial.size:
            coefficients[partial] = restrict(
                coefficients[partial],
                lower[partial, None, None],
                upper[partial, None, None],
            )
        return coefficients


def cut(tracks: Tracks, scale: FloatArray, radius: float) -> Pieces:
    """Cut tracks into slots in which drones move about ``radius``.

    Parameters
    ----------
    scale
        Factors (3,) on the axes that give metric coordinates.
    radius
        How near pairs of interest come [m].
    """
    length = (
        max(
            float(np.abs(np.diff(coefficients, axis=2)).sum(axis=(1, 2)).max())
            for _, _, coefficients in tracks.groups
            if coefficients.shape[2] > 1
        )
        if any(c.shape[2] > 1 for _, _, c in tracks.groups)
        else 0.0
    )
    wanted = length / max(min(radius, 1e6), 1e-3)
    slots = int(np.clip(np.ceil(wanted), _SLOTS_LEAST, _SLOTS_MOST))
    edges = np.linspace(0.0, tracks.duration, slots + 1)
    degree = max(coefficients.shape[2] for _, _, coefficients in tracks.groups) - 1
    drone, begin, end, parts = [], [], [], []
    for members, breaks, coefficients in tracks.groups:
        inner = edges[1:-1]
        fine = np.unique(np.concatenate([breaks, inner]))
        fine = fine[np.concatenate([[True], np.diff(fine) > 1e-9 * tracks.duration])]
        fine[-1] = breaks[-1]
        left, right = fine[:-1], fine[1:]
        index = np.clip(
            np.searchsorted(breaks, 0.5 * (left + right), side="right") - 1,
            0,
            breaks.size - 2,
        )
        width = breaks[index + 1] - breaks[index]
        lower = np.clip((left - breaks[index]) / width, 0.0, 1.0)
        upper = np.clip((right - breaks[index]) / width, 0.0, 1.0)
        drones, size = members.size, coefficients.shape[2]
        whole = coefficients[:, index].reshape(-1, size, 3)
        part = restrict(
            whole,
            np.tile(lower, drones)[:, None, None],
            np.tile(upper, drones)[:, None, None],
        )
        part *= scale
        if size <= degree:
            part = combined(elevation_matrix(size - 1, degree), part)
        parts.append(part)
        drone.append(np.repeat(members, left.size))
        begin.append(np.tile(left, drones))
        end.append(np.tile(right, drones))
    drones_all, begins = np.concatenate(drone), np.concatenate(begin)
    order = np.lexsort((begins, drones_all))
    begins, ends = begins[order], np.concatenate(end)[order]
    slot = np.clip(
        np.searchsorted(edges, 0.5 * (begins + ends), side="right") - 1, 0, slots - 1
    )
    keys = drones_all[order] * slots + slot
    head = np.searchsorted(keys, np.arange(tracks.count * slots + 1))
    return Pieces(slots, begins, ends, np.concatenate(parts)[order], head)
