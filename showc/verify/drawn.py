"""The predicted fleet that the log draws, held against the missions' own legs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from showc.verify.autopilot import CLOCK_LAG, SPREAD
from showc.verify.decode import parse
from showc.verify.legs import joined, stacked
from showc.verify.report import Check, Place
from showc.verify.sample import point_layout, points_of
from showc.verify.tracked import STEP, Fleet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from showc.verify.legs import MissionLegs
    from showc.verify.logfile import LogFile
    from showc.verify.show import LoggedShow
    from showc.verify.tracked import Tracked

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

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
    missions: Sequence[MissionLegs],
    begin: float | None,
) -> Check:
    """Compare the places on ``/fleet/predicted`` with the missions' timed legs.

    Take-off and landing are not timed, so nothing is compared before a drone's first
    timed leg and after its last.

    Parameters
    ----------
    log, show
        The log.
    missions
        What each drone flies, read from its mission.
    begin
        When the missions start, on the clock of their releases [s]; None: they have
        no clock, and start with their take-off.
    """
    channels = [
        number for number, channel in log.channels.items() if channel.topic == TOPIC
    ]
    if not channels:
        return Check("missions", NAME, "skipped", notes=("the log draws none",))
    fleet = _Fleet(missions, begin)
    limit = TOLERANCE
    if begin is None:
        fastest = max(float(m.profiles.speed.max(initial=0.0)) for m in missions)
        limit += UNCLOCKED * fastest
    worst, where, count = 0.0, Place(), 0
    layout: np.dtype[np.void] | None = None
    for data, m, offset in log.read(set(channels)):
        clouds = []
        for start, size in zip(m.payload.tolist(), m.size.tolist(), strict=True):
            cloud = parse(PointCloud, data[start : start + size], offset)
            layout = layout or point_layout(cloud, offset, PLACES)
            clouds.append(points_of(cloud, layout, show.drones, offset))
        points = np.stack(clouds)
        drawn = np.stack([points[name] for name in PLACES], axis=-1)
        times = np.asarray((m.log_time - show.epoch) * 1e-9, dtype=np.float64)
        flown = fleet(times)
        timed = np.isfinite(flown[..., 0])
        off = np.sqrt(np.sum((drawn - flown) ** 2, axis=-1))
        # Whatever is no number on the drawn side must not pass for untimed.
        off = np.where(timed, np.where(np.isnan(off), np.inf, off), 0.0)
        count += int(timed.sum())
        if off.max() > worst:
            row, drone = np.unravel_index(int(off.argmax()), off.shape)
            worst = float(off[row, drone])
            where = Place(drone=int(drone) + 1, time=float(times[row]))
    return Check(
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

    def __init__(self, missions: Sequence[MissionLegs], begin: float | None) -> None:
        # Without a clock there is none that could be late.
        self.late = 0.0 if begin is None else 0.5 * CLOCK_LAG
        flights, first = joined(missions)
        followed = flights.followed(SPREAD)
        timed = [np.flatnonzero(np.isfinite(one.release)) for one in missions]
        shape = len(missions), max((rows.size for rows in timed), default=0)
        self.release = np.full(shape, np.inf)
        self.along = np.zeros((*shape, 3))
        self.begin = np.zeros((len(missions), 3))
        self.last = np.full(len(missions), -np.inf)
        for drone, (mission, rows) in enumerate(zip(missions, timed, strict=True)):
            if rows.size:
                release = mission.release[rows] - (begin or 0.0)
                self.release[drone, : rows.size] = release
                self.along[drone, : rows.size] = np.diff(mission.places, axis=0)[rows]
                self.begin[drone] = mission.places[rows[0]]
                self.last[drone] = (release + followed[first[drone] + rows]).max()
        fleet = Fleet(len(missions), missions[0].lag)
        self.flown: list[tuple[IntArray, Tracked]] = []
        for leg in range(shape[1]):
            drones = np.flatnonzero(np.isfinite(self.release[:, leg]))
            until = np.full(drones.size, np.inf)
            if leg + 1 < shape[1]:
                until = self.release[drones, leg + 1] - self.release[drones, leg]
            parts = [
                missions[drone].profiles.part(row := int(timed[drone][leg]), row + 1)
                for drone in drones.tolist()
            ]
            flown = fleet.fly(drones, stacked(parts), self.along[drones, leg], until)
            self.flown.append((drones, flown))

    def __call__(self, times: FloatArray) -> FloatArray:
        """Places (n, drones, 3) [m] at mission times (n,) [s]; NaN: not timed."""
        place = np.broadcast_to(self.begin, (times.size, *self.begin.shape)).copy()
        for leg, (drones, flown) in enumerate(self.flown):
            since = times[:, None] - self.late - self.release[drones, leg]
            # From its next release on a drone is where that leg says.
            lasts = STEP * (flown.ways.shape[1] - 1)
            done = since >= np.minimum(flown.until, lasts) - SAME
            way = done[..., None] * self.along[drones, leg]
            flies = (since >= -SAME) & ~done
            way[flies] = flown.covered(np.nonzero(flies)[1], since[flies])
            place[:, drones] += way
        first = self.release[:, 0] if self.flown else np.inf
        known = (times[:, None] >= first) & (times[:, None] <= self.last)
        place[~known] = np.nan
        return place
