"""Changes of a crowd's flights: splines at rest at both ends, and what they lack."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.single_drone.basis import DEGREE, LOCAL, spline_basis
from showc.trajectory import bernstein_basis

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.fleet.deconfliction.crowd import Crowd


_LAG = 0.35
"""Time in which a drone changes its acceleration [s]: weighs jerk in the energy."""
_JERK = 3
"""Order of jerk."""
_FOLLOWED, _EXCESS = 0.05, 0.15
"""Shares by which speeds and accelerations may lie beyond their limits in what is
followed as it is, and in what is followed nearly."""


@dataclass(frozen=True, slots=True, eq=False)
class Untangled:
    """Changes of flights by which a crowd keeps apart, as far as samples tell."""

    duration: float
    """[s]."""
    coefficients: FloatArray
    """Of the changes' splines, shape (n, coefficients, 3) [m]."""
    near: tuple[IntArray, IntArray]
    """Pairs that come near each other."""
    broken: float
    """Pairs that come too near all the same; of some that lack little, a part."""
    excess: FloatArray
    """Greatest share by which each drone passes a limit of speed or acceleration."""
    work: float
    """Products of numbers that it took."""

    @property
    def wrong(self) -> float:
        """What is wrong with it: pairs, and drones that use too much of limits."""
        share = (self.excess - _FOLLOWED) / (_EXCESS - _FOLLOWED)
        return self.broken + float(np.clip(share, 0.0, 1.0).sum())

    @property
    def strain(self) -> float:
        """Same, by how much: what little passes limits is followed nearly."""
        return self.broken + float(np.maximum(self.excess - _EXCESS, 0.0).sum())

    def among(self, rows: IntArray, drones: int) -> Untangled:
        """Return the same of a whole crowd, of which these were the ``rows``."""
        whole = np.zeros((drones, *self.coefficients.shape[1:]))
        excess = np.zeros(drones)
        whole[rows], excess[rows] = self.coefficients, self.excess
        near = rows[self.near[0]], rows[self.near[1]]
        return replace(self, coefficients=whole, excess=excess, near=near)

    def curves(self, rows: IntArray) -> FloatArray:
        """Return Bernstein coefficients of some drones' changes, (rows, K, 6, 3)."""
        intervals = self.coefficients.shape[1] + 8 - DEGREE
        whole = np.pad(self.coefficients[rows], ((0, 0), (4, 4), (0, 0)))
        local = whole[:, np.arange(intervals)[:, None] + np.arange(LOCAL)]
        basis = spline_basis(intervals, self.duration)
        return np.asarray(np.einsum("kij,nkja->nkia", basis.position, local))

    def aside(self, rows: IntArray, times: FloatArray) -> FloatArray:
        """Return changes of some drones at times (t,), shape (rows, t, 3) [m]."""
        values = spline_values(self.duration, self.coefficients.shape[1], times)[0]
        return np.asarray(values @ self.coefficients[rows])


@lru_cache(maxsize=8)
def energy_factor(duration: float, count: int) -> FloatArray:
    """Return the factor H of the inverse energy, H Hᵀ, of splines (count, count)."""
    intervals = count + 8 - DEGREE
    basis = spline_basis(intervals, duration)

    def mean(part: FloatArray) -> FloatArray:
        full = np.zeros((*part.shape[:2], intervals + DEGREE))
        for k in range(intervals):
            full[k, :, k : k + LOCAL] = part[k]
        rows = full.reshape(-1, intervals + DEGREE)[:, 4:-4]
        return np.asarray(rows.T @ rows * (duration / rows.shape[0]))

    gram = mean(basis.acceleration) + _LAG**2 * mean(basis.jerk)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(gram)).T)


def spline_values(duration: float, count: int, times: FloatArray) -> list[FloatArray]:
    """Return values, speeds, accelerations and jerks of splines, each (t, count).

    They have the coefficients that leave place, speed, pull and jerk zero at the ends.
    """
    intervals = count + 8 - DEGREE
    basis = spline_basis(intervals, duration)
    place = times / duration * intervals
    piece = np.clip(place.astype(np.int64), 0, intervals - 1)
    found = []
    for part in (basis.position, basis.velocity, basis.acceleration, basis.jerk):
        local = bernstein_basis(part.shape[1] - 1, place - piece)
        values = np.zeros((times.size, intervals + DEGREE))
        columns = piece[:, None] + np.arange(LOCAL)
        values[np.arange(times.size)[:, None], columns] = np.einsum(
            "tk,tkn->tn", local, part[piece]
        )
        found.append(values[:, 4:-4])
    return found


def excess(crowd: Crowd, used: FloatArray, flown: FloatArray) -> FloatArray:
    """By which share each drone passes limits that it does not pass alone, (n,).

    Parameters
    ----------
    used, flown
        Places, speeds and accelerations, perhaps jerks, at m instants, one below the
        other, as drones fly alone and with their changes, shape (n, 3 m, 3), SI.
    """
    samples = crowd.places.shape[1]
    most = np.ones(used.shape[0])
    before, allowed = most.copy(), crowd.allowed
    for whole, use in ((flown, most), (used, before)):
        parts = np.split(whole, whole.shape[1] // samples, axis=1)
        for order, values in enumerate(parts[1:], 1):
            mine = allowed.order == order
            shares = values @ allowed.normal[mine].T / allowed.offset[mine]
            level = np.hypot(values[..., 0], values[..., 1]) / allowed.level[order]
            np.maximum(use, shares.max(axis=(1, 2), initial=0.0), out=use)
            np.maximum(use, level.max(axis=1), out=use)
        for share, _, _ in allowed.turned(*parts[2:]) if len(parts) > _JERK else ():
            np.maximum(use, np.abs(share).max(axis=1), out=use)
    return np.asarray(most - before)
