"""The predicted fleet that the log draws, held against the missions' own legs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from showc.verify.autopilot import CLOCK_LAG, SPREAD
from showc.verify.decode import parse
from showc.verify.legs import joined
from showc.verify.report import Check, Place
from showc.verify.sample import point_layout, points_of
from showc.verify.tracked import AFTER, STEP, tracked

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from showc.verify.legs import MissionLegs
    from showc.verify.logfile import LogFile
    from showc.verify.show import LoggedShow

    FloatArray = NDArray[np.float64]

TOPIC = "/fleet/predicted"

NAME = "predicted fleet drawn where the missions fly"

TOLERANCE = 0.01
"""How far a drawn place may be off [m]: speeds, delays and places in the files are
rounded, and so is the drawing."""

UNCLOCKED = 0.02
"""How far the nominal releases of missions without a clock may be off [s]: they are
sums of legs and holds, and of a take-off that is timed to half a second."""

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
        most = max(mission.release.size for mission in missions)
        shape = len(missions), most
        flights, first = joined(missions)
        self.flown = missions[0].flown or tracked(flights, missions[0].lag)
        followed = flights.followed(SPREAD)
        # Row of each timed leg in the table of all legs.
        self.row = np.zeros(shape, dtype=np.int64)
        self.release = np.full(shape, np.inf)
        self.settled = np.full(shape, -np.inf)
        self.begin = np.zeros((len(missions), 3))
        self.along = np.zeros((*shape, 3))
        self.last = np.full(len(missions), -np.inf)
        for drone, mission in enumerate(missions):
            timed = np.flatnonzero(np.isfinite(mission.release))
            legs = np.arange(timed.size)
            self.row[drone, legs] = first[drone] + timed
            release = mission.release[timed] - (begin or 0.0)
            self.release[drone, legs] = release
            # A step more: what lies between the last two is interpolated.
            duration = mission.profiles.duration[timed]
            self.settled[drone, legs] = release + duration + AFTER + STEP
            self.along[drone, legs] = np.diff(mission.places, axis=0)[timed]
            if timed.size:
                self.begin[drone] = mission.places[timed[0]]
                ends = release + followed[first[drone] + timed]
                self.last[drone] = ends.max()

    def __call__(self, times: FloatArray) -> FloatArray:
        """Places (n, drones, 3) [m] at mission times (n,) [s]; NaN: not timed."""
        place = np.broadcast_to(self.begin, (times.size, *self.begin.shape)).copy()
        moment = times[:, None] - self.late
        for leg in range(self.row.shape[1]):
            # What a drone is off when its next leg begins, it takes along.
            if moment.max() <= self.release[:, leg].min():
                continue  # nobody has begun it
            if moment.min() >= self.settled[:, leg].max():
                place += self.along[:, leg]  # everybody is over it
                continue
            since = moment - self.release[:, leg]
            part = np.zeros((*since.shape, 2))
            part[moment >= self.settled[:, leg]] = 1.0
            flies = (since > 0.0) & (moment < self.settled[:, leg])
            drones = np.nonzero(flies)[1]
            part[flies] = np.stack(
                self.flown.covered(self.row[drones, leg], since[flies]), axis=-1
            )
            place += part[..., [0, 0, 1]] * self.along[:, leg]
        known = (times[:, None] >= self.release[:, 0]) & (times[:, None] <= self.last)
        place[~known] = np.nan
        return place
