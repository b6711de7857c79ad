"""The predicted fleet that the log draws, held against the missions' own legs.

A drawn flight is an estimate: where on its leg a drone most likely is. What is proved
of it is that it lies where the proof of the separation has the drone: on the part of
its line between the greatest and the least delay, overshoot included, no farther beside
it than drones were flown.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.missions.law import CLOCK_LAG
from showc.verify.missions.legs import UNTIMED

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.verify.missions.legs import FleetLegs


BESIDE, BESIDE_FAST = 0.3, 0.06
"""How far beside its part of a line a drone may be drawn [m], and by how much more for
each m/s of its speed [s]: lift comes sooner than lean, and drones settle sideways."""


class Tubes:
    """Where each drone of a fleet may be at any time."""

    def __init__(self, fleet: FleetLegs) -> None:
        self._table = fleet.profiles
        release = fleet.filled(fleet.release, np.inf)
        self._release = np.column_stack([release, np.full(fleet.drones, np.inf)])
        self._timed = np.diff(fleet.first) - UNTIMED
        # Where there is no timed leg, the landing stands for it.
        first, last = fleet.first[:-1], fleet.first[1:] - 1
        rank = first[:, None] + 2 + np.arange(release.shape[1])
        self._leg = np.minimum(rank, last[:, None])
        self._begin, self._end = (
            some[self._leg].transpose(2, 0, 1) for some in (fleet.begin, fleet.end)
        )
        # A drone is on its climb before its first timed leg, on its descent after the
        # last one: each a line that it may be on at any time.
        self._climb = np.stack([fleet.begin[first], fleet.begin[first + 2]], axis=1)
        self._descent = np.stack([fleet.begin[last], fleet.end[last]], axis=1)
        followed = self._table.followed(0.0)
        self._over = np.where(
            np.isfinite(self._release[:, :-1]), followed[self._leg], 0.0
        )
        ends = self._release[:, :-1] + self._over
        self.last = float(np.max(ends, initial=0.0, where=np.isfinite(ends)))
        """When the last timed leg has been flown [s]."""

    def outside(self, times: FloatArray, drawn: FloatArray) -> FloatArray:
        """How far off each drone is ``drawn`` (3, m, n) [m], over what is allowed.

        ``times`` (m,) [s]; the result (m, n), infinite where undefined.
        """
        shape = times.size, self._timed.size
        leg = (self._release[:, :-1] <= times[:, None, None]).sum(axis=2) - 1
        drone = np.broadcast_to(np.arange(self._timed.size), shape)
        leg, drone, place = leg.ravel(), drone.ravel(), drawn.reshape(3, -1)
        row = np.maximum(leg, 0)
        own = self._leg[drone, row]
        since = np.repeat(times, shape[1]) - self._release[drone, row]
        late = self._table.law_time(own, since - CLOCK_LAG) - self._table.spread[own]
        early = self._table.law_time(own, since) + self._table.spread[own]
        covered = self._table.covered(own, late, early)
        speed = covered.fast * self._table.length[own]
        # Beyond its end a drone swings for longer than it counts for the separation.
        front = covered.front * self._table.excess[own]
        begin, end = self._begin[:, drone, row], self._end[:, drone, row]
        along = end - begin
        off = _distance(place, begin + covered.rear * along, begin + front * along)
        # On the ground, on its climb or its descent a drone may be at any time.
        for some, lines in (
            (leg < 0, self._climb),
            (
                (leg == self._timed[drone] - 1) & (since > self._over[drone, row]),
                self._descent,
            ),
        ):
            rows = np.flatnonzero(some)
            one, other = lines[drone[rows]].transpose(1, 2, 0)
            there = _distance(place[:, rows], one, other)
            swings = there - self._table.overshoot[own[rows]]
            landing = np.minimum(swings, off[rows])
            off[rows] = np.where(leg[rows] < 0, there, landing)
        share = off / (BESIDE + BESIDE_FAST * speed)
        # Whatever is no number on the drawn side must not pass for a small gap.
        share = np.where(np.isnan(share), np.inf, share)
        return np.asarray(share.reshape(shape))


def _distance(point: FloatArray, one: FloatArray, other: FloatArray) -> FloatArray:
    """Distances (n,) of points from lines between two places, all (3, n) [m]."""
    along, way = other - one, point - one
    size = np.einsum("an,an->n", along, along)
    share = np.einsum("an,an->n", along, way) / np.where(size > 0.0, size, 1.0)
    gap = way - np.clip(share, 0.0, 1.0) * along
    return np.asarray(np.sqrt(np.einsum("an,an->n", gap, gap)))
