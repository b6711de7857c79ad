"""The predicted fleet that the log draws, held against the missions' own legs.

A drawn flight is an estimate: where on its leg a drone most likely is. What is proved
of it is that it lies where the proof of the separation has the drone: on the part of
its line between the greatest and the least delay, overshoot included, no farther beside
it than drones were flown.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.log.sample import PLACE
from showc.verify.missions.law import CLOCK_LAG
from showc.verify.missions.legs import UNTIMED
from showc.verify.report import Place, checked
from showc.verify.samples import points_of

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.verify.kernel.show import LoggedShow
    from showc.verify.logfile import LogFile
    from showc.verify.missions.legs import FleetLegs
    from showc.verify.report import Check


TOPIC = "/fleet/predicted"

BESIDE, BESIDE_FAST = 0.3, 0.06
"""How far beside its part of a line a drone may be drawn [m], and by how much more for
each m/s of its speed [s]: lift comes sooner than lean, and drones settle sideways."""

BLOCK = 8192
"""Places that are looked at together: they fit the processor's cache."""


def check_drawn(log: LogFile, show: LoggedShow, fleet: FleetLegs) -> Check:
    """Hold every place on ``/fleet/predicted`` against the missions."""
    channels = {
        number for number, channel in log.channels.items() if channel.topic == TOPIC
    }
    tubes = _Tubes(fleet)
    worst, where, count, last = 0.0, Place(), 0, -np.inf
    for data, m, _ in log.read(channels):
        times = np.asarray((m.log_time - show.epoch) * 1e-9, dtype=np.float64)
        drawn = np.full((3, times.size, show.drones), np.nan)
        for row, (start, size) in enumerate(
            zip(m.payload.tolist(), m.size.tolist(), strict=True)
        ):
            points = points_of(data[start : start + size], PLACE)
            if points.size == show.drones:
                drawn[:, row] = [points[name] for name in ("x", "y", "z")]
        for first in range(0, times.size, max(1, BLOCK // show.drones)):
            rows = slice(first, first + max(1, BLOCK // show.drones))
            over = tubes.outside(times[rows], drawn[:, rows])
            # Whatever is no number on the drawn side must not pass for a small gap.
            over[np.isnan(over)] = np.inf
            count, last = count + over.size, max(last, float(times[rows].max()))
            if over.max(initial=0.0) > worst:
                row, drone = divmod(int(over.argmax()), show.drones)
                worst = float(over.max())
                where = Place(drone=drone + 1, time=float(times[first + row]))
    whole = last >= tubes.last
    note = (
        f"{count:,} places, each within {BESIDE:g} m + {BESIDE_FAST:g} s of its speed "
        "beside where the proof has the drone"
    )
    missing = () if whole else ("the log does not draw the missions to their end",)
    return checked(
        "VRF421",
        "pass" if worst <= 0.0 and whole else "fail",
        worst,
        0.0,
        "m outside",
        where=where,
        notes=(*missing, note),
    )


class _Tubes:
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
        """How far outside its tube each drone is ``drawn`` (3, m, n) [m], 0 inside.

        ``times`` (m,) [s]; the result (m, n).
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
        rear, slow = self._table.fraction(own, late)
        front, fast = self._table.fraction(own, early)
        # Between these the speed is greatest nearest to the leg's middle.
        between = np.clip(0.5 * self._table.duration[own], late, early)
        middle = self._table.fraction(own, between)[1]
        speed = np.maximum.reduce([slow, fast, middle]) * self._table.length[own]
        # Beyond its end a drone swings for longer than it counts for the separation.
        front *= self._table.excess[own]
        begin, end = self._begin[:, drone, row], self._end[:, drone, row]
        along = end - begin
        off = _distance(place, begin + rear * along, begin + front * along)
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
        over = off - BESIDE - BESIDE_FAST * speed
        return np.asarray(np.maximum(over, 0.0).reshape(shape))


def _distance(point: FloatArray, one: FloatArray, other: FloatArray) -> FloatArray:
    """Distances (n,) of points from lines between two places, all (3, n) [m]."""
    along, way = other - one, point - one
    size = np.einsum("an,an->n", along, along)
    share = np.einsum("an,an->n", along, way) / np.where(size > 0.0, size, 1.0)
    gap = way - np.clip(share, 0.0, 1.0) * along
    return np.asarray(np.sqrt(np.einsum("an,an->n", gap, gap)))
