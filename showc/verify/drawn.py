"""The predicted fleet that the log draws, held against the missions' own legs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from showc.verify.autopilot import CLOCK_LAG, SPREAD
from showc.verify.decode import parse
from showc.verify.legs import TimedLegs, joined
from showc.verify.report import Check, Place
from showc.verify.sample import point_layout, points_of
from showc.verify.tracked import STEP, Fleet

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from showc.verify.kernel.show import LoggedShow
    from showc.verify.legs import FleetLegs, MissionLegs
    from showc.verify.logfile import LogFile

    FloatArray = NDArray[np.float64]

TOPIC = "/fleet/predicted"

NAME = "predicted fleet drawn where the missions fly"

TOLERANCE = 0.01
"""How far a drawn place may be off [m]: speeds, delays and places in the files are
rounded, and so is the drawing."""

UNCLOCKED = 0.02
"""How far the nominal releases of missions without a clock may be off [s]: they are
sums of legs and holds, and of a take-off that is timed to half a second."""

SAME = 1e-9
"""Instants that are nearer are one [s]."""

PLACES = ("x", "y", "z")


def check_drawn(
    log: LogFile,
    show: LoggedShow,
    flown: FleetLegs,
    begin: float | None,
) -> Check:
    """Compare the places on ``/fleet/predicted`` with the missions' timed legs.

    Take-off and landing are not timed, so nothing is compared before a drone's first
    timed leg and after its last.

    Parameters
    ----------
    log, show
        The log.
    flown
        What each drone flies, read from its mission.
    begin
        When the missions start, on the clock of their releases [s]; None: they have
        no clock, and start with their take-off.
    """
    channels = [
        number for number, channel in log.channels.items() if channel.topic == TOPIC
    ]
    if not channels:
        return Check(
            "VRF421", "missions", NAME, "skipped", notes=("the log draws none",)
        )
    fleet = _Fleet(flown, begin)
    limit = TOLERANCE
    if begin is None:
        speeds = [one.profiles.speed.max(initial=0.0) for one in flown.missions]
        fastest = float(max(speeds))
        limit += UNCLOCKED * fastest
    worst, where, count = 0.0, Place(), 0
    layout: np.dtype[np.void] | None = None
    for data, m, offset in log.read(set(channels)):
        times = np.asarray((m.log_time - show.epoch) * 1e-9, dtype=np.float64)
        gap, timed = fleet(times)
        for places, start, size in zip(
            gap, m.payload.tolist(), m.size.tolist(), strict=True
        ):
            cloud = parse(PointCloud, data[start : start + size], offset)
            layout = layout or point_layout(cloud, offset, PLACES)
            points = points_of(cloud, layout, show.drones, offset)
            for axis, name in enumerate(PLACES):
                places[axis] -= points[name]
        np.square(gap, out=gap)
        off = gap[:, 0] + gap[:, 1] + gap[:, 2]
        # Whatever is no number on the drawn side must not pass for a small gap.
        off[np.isnan(off)] = np.inf
        off[~timed] = 0.0
        count += int(np.count_nonzero(timed))
        farthest = float(np.sqrt(off.max()))
        if farthest > worst:
            row, drone = np.unravel_index(int(off.argmax()), off.shape)
            worst = farthest
            where = Place(drone=int(drone) + 1, time=float(times[row]))
    return Check(
        "VRF421",
        "missions",
        NAME,
        "pass" if worst <= limit else "fail",
        worst,
        limit,
        "m",
        where,
        (f"{count:,} places of timed legs compared, on the missions' clock",),
    )


class _Fleet:
    """Places of all drones over mission time: where they most likely are."""

    def __init__(self, flown: FleetLegs, begin: float | None) -> None:
        missions = flown.missions
        # Without a clock there is none that could be late.
        self.late = 0.0 if begin is None else 0.5 * CLOCK_LAG
        table, first = joined(missions)
        followed = table.followed(SPREAD)
        self.begin = np.zeros((3, len(missions)))
        self.first = np.full(len(missions), np.inf)
        self.last = np.full(len(missions), -np.inf)
        for drone, mission in enumerate(missions):
            rows = np.flatnonzero(np.isfinite(mission.release))
            if rows.size:
                release = mission.release[rows] - (begin or 0.0)
                self.begin[:, drone] = mission.places[rows[0]]
                self.first[drone] = release[0]
                self.last[drone] = (release + followed[first[drone] + rows]).max()
        self._missions, self._start = missions, begin or 0.0
        self._known: list[_Flight] | None = None
        if flown.flights:
            self._known = [_Flight.of(one, self.late) for one in flown.flights]
        self._begin()

    def _begin(self) -> None:
        """Go to before the first flight."""
        self._seen = -np.inf
        self._place, self._flying = self.begin.copy(), list[_Flight]()
        if self._known is None:
            # They are flown when their time comes: all of them would take much memory.
            self._fleet = Fleet(len(self._missions), self._missions[0].lag)
            self._coming = self._by_the_clock()
        else:
            self._coming = iter(sorted(self._known, key=lambda one: one.begun))
        self._next = next(self._coming, None)

    def _by_the_clock(self) -> Iterator[_Flight]:
        legs = _by_the_clock(self._fleet, self._missions, self._start)
        return (_Flight.of(one, self.late) for one in legs)

    def _go_on(self, first: float, last: float) -> None:
        """Find the flights from time ``first`` up to ``last`` [s]."""
        if first < self._seen:
            # Who goes back once may do so often.
            if self._known is None:
                self._fleet = Fleet(len(self._missions), self._missions[0].lag)
                self._known = list(self._by_the_clock())
            self._begin()
        self._seen = first
        while self._next is not None and last >= self._next.begun:
            self._flying.append(self._next)
            self._next = next(self._coming, None)
        for flight in [one for one in self._flying if first >= one.done]:
            self._flying.remove(flight)
            self._place[:, flight.legs.drones] += flight.legs.along.T
            if self._known is None:
                self._fleet.reuse(flight.legs.tracked)

    def __call__(self, times: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Places (n, 3, drones) [m] at mission times (n,) [s], rising.

        And which of them are timed, (n, drones).
        """
        self._go_on(float(times[0]), float(times[-1]))
        place = np.repeat(self._place[None], times.size, axis=0)
        for flight in self._flying:
            if flight.legs.drones.size == place.shape[2]:
                place += flight.ways(times)
            else:
                place[..., flight.legs.drones] += flight.ways(times)
        known = (times[:, None] >= self.first) & (times[:, None] <= self.last)
        return place, known


@dataclass(frozen=True, slots=True, eq=False)
class _Flight:
    """The next timed leg of some drones, as a clock that is late sees it."""

    legs: TimedLegs
    release: FloatArray
    """When each is released, (n,) [s]."""
    counts: FloatArray
    """For how long each counts, (n,) [s]: from its next release on, a drone is where
    that leg says."""
    begun: float
    """Before, none is flown [s]."""
    done: float
    """From then on, all are [s]."""

    @classmethod
    def of(cls, legs: TimedLegs, late: float) -> _Flight:
        """Return the legs as a clock sees them that is ``late`` [s]."""
        lasts = STEP * (len(legs.tracked.ways) - 1)
        counts = np.minimum(legs.tracked.until, lasts)
        release = legs.release + late
        return cls(
            legs,
            release,
            counts,
            float(release.min() - 2.0 * SAME),
            float((release + counts).max() + 2.0 * SAME),
        )

    def ways(self, times: FloatArray) -> FloatArray:
        """Ways (m, 3, n) [m] since the legs' begins at mission times (m,) [s]."""
        since = times[:, None] - self.release
        waits, done = since < -SAME, since >= self.counts - SAME
        way = self.legs.tracked.covered(since)
        if waits.any():
            np.copyto(way, 0.0, where=waits[:, None])
        if done.any():
            np.copyto(way, self.legs.along.T, where=done[:, None])
        return way


def _by_the_clock(
    fleet: Fleet, missions: Sequence[MissionLegs], begin: float
) -> Iterator[TimedLegs]:
    """Yield timed legs, flown from their releases: the first of all, the second, ..."""
    table, first = joined(missions)
    timed = [np.flatnonzero(np.isfinite(one.release)) for one in missions]
    most = max((rows.size for rows in timed), default=0)
    release = np.full((len(missions), most + 1), np.inf)
    row = np.zeros((len(missions), most), dtype=np.int64)
    along = np.zeros((len(missions), most, 3))
    for drone, (mission, rows) in enumerate(zip(missions, timed, strict=True)):
        release[drone, : rows.size] = mission.release[rows] - begin
        row[drone, : rows.size] = first[drone] + rows
        along[drone, : rows.size] = np.diff(mission.places, axis=0)[rows]
    for leg in range(most):
        drones = np.flatnonzero(np.isfinite(release[:, leg]))
        until = release[drones, leg + 1] - release[drones, leg]
        legs, ways = table.chosen(row[drones, leg]), along[drones, leg]
        tracked = fleet.fly(drones, legs, ways, until=until)
        yield TimedLegs(drones, release[drones, leg], ways, tracked)
