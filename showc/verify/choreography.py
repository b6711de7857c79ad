"""How the show joins up: hover at joints, formations reached, no gap, no jump.

Each statement below holds of the logged polynomials as they stand: it
compares single coefficients with each other and with what is asked for, so that no
error but one rounding of a difference enters (u of the greater number, far below every
tolerance). Of what is flown it holds with the tolerances of VRF301 to VRF304 besides
(:mod:`showc.verify.kernel.dynamics`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb
from showc.verify.kernel.statement import Statement

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.verify.kernel.show import LoggedShow, Segment


REACHED = 1e-3
"""Distance from its place at which a drone has reached it [m]."""

JOINT = 1e-6
"""Jump of any state at a joint, and speed, rate or tilt left at a hover (SI): what a
solver calls equal."""

MOMENT = 1e-6
"""Gap in time between two segments of a drone [s]: rounding of times."""

_AT_REST = [3, 4, 5, 6, 7, 9, 10, 11]
"""States that are zero at a hover: all but position and yaw."""


@dataclass(slots=True)
class _Worst:
    """The worst of many findings of one kind."""

    value: float = -1.0
    drone: int = 0
    segment: str | None = None
    time: float | None = None
    count: int = 0

    def see(
        self,
        values: FloatArray,
        drones: IntArray,
        limit: float,
        *,
        segment: str,
        time: float | FloatArray,
    ) -> None:
        """Look at the values (n,) of some drones at one show time, or at one each."""
        if values.size == 0:
            return
        values = np.where(np.isnan(values), np.inf, values)
        index = int(np.argmax(values))
        self.count += int(np.sum(values > limit))
        if values[index] > self.value:
            self.value, self.drone = float(values[index]), int(drones[index])
            self.segment = segment
            self.time = float(np.broadcast_to(time, values.shape)[index])

    def statement(self, code: str, title: str, limit: float, unit: str) -> Statement:
        """Say whether all of them keep the limit."""
        more = (f"{self.count:,} findings of this kind",) if self.count > 1 else ()
        return Statement(
            code,
            title,
            self.value <= limit,
            max(self.value, 0.0),
            limit,
            unit,
            (self.drone,),
            self.segment,
            self.time,
            more,
        )


def joined_up(show: LoggedShow) -> list[Statement]:
    """State everything about how the show joins up."""
    return [
        _hover(show),
        _heading(show),
        _reached(show),
        _goals(show),
        _continuity(show),
        *_joints(show),
        _ground(show),
    ]


def _hover(show: LoggedShow) -> Statement:
    worst = _Worst()
    for segment in show.segments:
        times = segment.start, segment.end
        for time, state in zip(times, segment.ends(), strict=True):
            restless = np.abs(state[:, _AT_REST]).max(axis=1)
            name = segment.message.name
            worst.see(restless, segment.drones, JOINT, segment=name, time=time)
    return worst.statement("VRF331", "hover at both ends of every segment", JOINT, "SI")


def _heading(show: LoggedShow) -> Statement:
    """Yaw at hovers, and always if it is held, by the hull of its coefficients."""
    worst = _Worst()
    heading, held = show.rules.heading, show.rules.yaw_held
    for segment in show.segments:
        name = segment.message.name
        for table in segment.tables if held else ():
            off = np.abs(table.state[:, :, 8] - heading).max(axis=1)
            begin = segment.start + table.start
            worst.see(off, table.owner, JOINT, segment=name, time=begin)
        times = () if held else (segment.start, segment.end)
        for time, state in zip(times, segment.ends(), strict=False):
            off = _turn(state[:, 8] - heading)
            worst.see(off, segment.drones, JOINT, segment=name, time=time)
    when = "at every instant" if held else "at every hover"
    title = f"yaw at the show's heading {when}"
    return worst.statement("VRF332", title, JOINT, "rad")


def _turn(angle: FloatArray) -> FloatArray:
    """Size of angles but for whole circles, 0 to pi [rad]."""
    return np.abs(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)


def _distances(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.sum((first - second) ** 2, axis=1)))


def _reached(show: LoggedShow) -> Statement:
    worst = _Worst()
    for segment in show.segments:
        off = _distances(segment.ends()[1][:, :3], segment.goals)
        name, time = segment.message.name, segment.end
        worst.see(off, segment.drones, REACHED, segment=name, time=time)
    title = "every drone ends where its segment asks"
    return worst.statement("VRF333", title, REACHED, "m")


def _formations(show: LoggedShow) -> dict[str, FloatArray]:
    return {
        one.name: np.array(one.points).reshape(-1, 3) for one in show.rules.formations
    }


def _goals(show: LoggedShow) -> Statement:
    """Hold the ends of segments against the formations by place."""
    code, title = "VRF334", "every formation is reached"
    formations = _formations(show)
    worst = _Worst()
    for segment in show.segments:
        message, wrong = segment.message, ""
        points = formations.get(message.to_formation)
        places = np.array(message.places)
        given = places >= 0
        chosen = places[given]
        if points is None or np.any(chosen >= points.shape[0]):
            wrong = f"there is no such formation or place: {message.to_formation!r}"
        elif np.unique(chosen).size != chosen.size:
            wrong = "two drones have one place"
        if points is None or wrong:
            name, time = message.name, segment.end
            return Statement(
                code, title, False, segment=name, time=time, notes=(wrong,)
            )
        off = _distances(segment.ends()[1][given, :3], points[chosen])
        drones, name = segment.drones[given], message.name
        worst.see(off, drones, REACHED, segment=name, time=segment.end)
    return worst.statement(code, title, REACHED, "m")


def _continuity(show: LoggedShow) -> Statement:
    """State across the mesh intervals of each segment, and their cover of its time."""
    worst = _Worst()
    for segment in show.segments:
        name = segment.message.name
        for table in segment.tables:
            first, last = table.first[:-1], table.first[1:] - 1
            inner = np.ones(table.start.size, dtype=bool)
            inner[first] = False
            later = np.flatnonzero(inner)
            jump = np.abs(table.state[later, 0] - table.state[later - 1, -1])
            time = segment.start + table.start
            worst.see(
                jump.max(axis=1, initial=0.0),
                table.owner[later],
                JOINT,
                segment=name,
                time=time[later],
            )
            edge = np.abs(table.end[last] - segment.duration)
            edge = np.maximum(np.abs(table.start[first]), edge)
            worst.see(edge, table.drones, JOINT, segment=name, time=time[first])
    title = "state continuous inside every segment"
    return worst.statement("VRF335", title, JOINT, "SI")


def _joints(show: LoggedShow) -> list[Statement]:
    """Follow each drone from segment to segment."""
    end = np.full(show.drones, np.nan)
    state = np.zeros((show.drones, 12))
    gap, jump = _Worst(), _Worst()
    flown = sorted(show.segments, key=lambda one: one.start)
    for segment in flown:
        drones, name, start = segment.drones, segment.message.name, segment.start
        first, last = segment.ends()
        known = ~np.isnan(end[drones])
        late = np.abs(start - end[drones[known]])
        gap.see(late, drones[known], MOMENT, segment=name, time=start)
        leap = np.abs(first[known] - state[drones[known]])
        # Yaw may have turned by whole circles.
        leap[:, 8] = _turn(leap[:, 8])
        leaps = leap.max(axis=1, initial=0.0)
        jump.see(leaps, drones[known], JOINT, segment=name, time=start)
        if not known.all() and segment.message.kind != pb.Segment.LAUNCH:
            begin = np.full(int(np.sum(~known)), start)
            gap.see(begin, drones[~known], MOMENT, segment=name, time=start)
        end[drones], state[drones] = segment.end, last
    landed = _last_kind(flown, show.drones) == pb.Segment.LAND
    rest = np.abs(show.duration - end)
    rest[landed] = np.maximum(end[landed] - show.duration, 0.0)
    rest[np.isnan(end)] = np.inf
    everyone = np.arange(show.drones)
    gap.see(rest, everyone, MOMENT, segment="the end", time=show.duration)
    covered = "every drone covered from launch to landing"
    return [
        gap.statement("VRF336", covered, MOMENT, "s"),
        jump.statement("VRF337", "segments joined without a jump", JOINT, "SI"),
    ]


def _last_kind(flown: list[Segment], drones: int) -> IntArray:
    kind = np.full(drones, -1)
    for segment in flown:
        kind[segment.drones] = segment.message.kind
    return kind


def _ground(show: LoggedShow) -> Statement:
    """First segment from a pad, last segment to a pad, both on the ground."""
    code, title = "VRF338", "from the pads on the ground, and back to them"
    formations = _formations(show)
    flown = sorted(show.segments, key=lambda one: one.start)
    start, end = np.full((2, show.drones, 3), np.nan)
    pads = np.full(show.drones, "", dtype=object)

    def broken(drone: int, note: str) -> Statement:
        return Statement(code, title, False, drones=(drone,), notes=(note,))

    for segment in flown:
        first, last = segment.ends()
        fresh = np.isnan(start[segment.drones, 0])
        drones = segment.drones[fresh]
        if drones.size and segment.message.kind != pb.Segment.LAUNCH:
            return broken(int(drones[0]), "a drone's first segment is not a launch")
        start[drones] = first[fresh, :3]
        pads[drones] = segment.message.from_formation
        end[segment.drones] = last[:, :3]
    aloft = np.flatnonzero(_last_kind(flown, show.drones) != pb.Segment.LAND)
    if aloft.size:
        return broken(int(aloft[0]), "a drone's last segment is not a landing")
    worst = _Worst()
    for pad in np.unique(pads.astype(str)):
        points, mine = formations.get(str(pad)), np.flatnonzero(pads == pad)
        if points is None:
            note = f"the pads {str(pad)!r} are not among the formations"
            return broken(int(mine[0]), note)
        for places, time, name in (
            (start, 0.0, "launch"),
            (end, show.duration, "landing"),
        ):
            near = [_distances(points, places[drone][None]).min() for drone in mine]
            worst.see(np.array(near), mine, REACHED, segment=name, time=time)
    return worst.statement(code, title, REACHED, "m")
