"""How the show joins up: hover at joints, formations reached, no gap, no jump."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb
from showc.verify.report import Check, Place, Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.verify.kernel.show import LoggedShow, Segment

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

REACHED = 1e-3
"""Distance from its place at which a drone has reached it [m]."""

JOINT = 1e-6
"""Jump of any state at a joint, and speed, rate or tilt left at a hover (SI)."""

MOMENT = 1e-6
"""Gap in time between two segments of a drone [s]."""

GROUP = "choreography"


@dataclass(slots=True)
class _Worst:
    """The worst of many findings of one kind."""

    value: float = -1.0
    where: Place = field(default_factory=Place)
    count: int = 0

    def see(
        self,
        values: FloatArray,
        drones: IntArray,
        limit: float,
        *,
        segment: str,
        time: float,
    ) -> None:
        """Look at the values (n,) of some drones at one show time."""
        if values.size == 0:
            return
        values = np.where(np.isnan(values), np.inf, values)
        index = int(np.argmax(values))
        self.count += int(np.sum(values > limit))
        if values[index] > self.value:
            self.value = float(values[index])
            self.where = Place(drone=int(drones[index]) + 1, segment=segment, time=time)

    def check(
        self, code: str, name: str, limit: float, unit: str, *notes: str
    ) -> Check:
        """Turn into a check."""
        verdict: Verdict = "pass" if self.value <= limit else "fail"
        more = (f"{self.count:,} findings of this kind",) if self.count > 1 else ()
        return Check(
            code,
            GROUP,
            name,
            verdict,
            max(self.value, 0.0),
            limit,
            unit,
            self.where,
            (*notes, *more),
        )


def check_choreography(show: LoggedShow) -> list[Check]:
    """Make all checks of how the show joins up."""
    return [
        _hover(show),
        _heading(show),
        _reached(show),
        _goals(show),
        _continuity(show),
        *_joined(show),
        _ground(show),
    ]


def _hover(show: LoggedShow) -> Check:
    worst = _Worst()
    for segment in show.segments:
        for time, state in zip(
            (segment.start, segment.end), segment.ends(), strict=True
        ):
            restless = np.abs(state[:, [3, 4, 5, 6, 7, 9, 10, 11]]).max(axis=1)
            worst.see(
                restless,
                segment.drones,
                JOINT,
                segment=segment.message.name,
                time=time,
            )
    return worst.check("VRF331", "hover at both ends of every segment", JOINT, "(SI)")


def _heading(show: LoggedShow) -> Check:
    """Yaw at hovers, and always if it is held, by the hull of its coefficients."""
    worst = _Worst()
    heading, held = show.rules.heading, show.rules.yaw_held
    for segment in show.segments:
        name = segment.message.name
        if held:
            for table in segment.tables:
                off = np.abs(table.state[:, :, 8] - heading).max(axis=1)
                row = int(np.argmax(off))
                worst.see(
                    off[row : row + 1],
                    table.owner[row : row + 1],
                    JOINT,
                    segment=name,
                    time=segment.start + float(table.start[row]),
                )
            continue
        for time, state in zip(
            (segment.start, segment.end), segment.ends(), strict=True
        ):
            off = np.abs(np.remainder(state[:, 8] - heading + np.pi, 2 * np.pi) - np.pi)
            worst.see(off, segment.drones, JOINT, segment=name, time=time)
    when = "at every instant" if held else "at every hover"
    return worst.check("VRF332", f"yaw at the show's heading {when}", JOINT, "rad")


def _distances(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.sum((first - second) ** 2, axis=1)))


def _reached(show: LoggedShow) -> Check:
    worst = _Worst()
    for segment in show.segments:
        _, last = segment.ends()
        worst.see(
            _distances(last[:, :3], segment.goals),
            segment.drones,
            REACHED,
            segment=segment.message.name,
            time=segment.end,
        )
    return worst.check(
        "VRF333", "every drone ends where its segment asks", REACHED, "m"
    )


def _goals(show: LoggedShow) -> Check:
    """Hold the ends of segments against the formations by place."""
    name = "every formation is reached"
    formations = {
        formation.name: np.array(formation.points).reshape(-1, 3)
        for formation in show.rules.formations
    }
    worst = _Worst()
    for segment in show.segments:
        message = segment.message
        points = formations.get(message.to_formation)
        places = np.array(message.places)
        given = places >= 0
        chosen = places[given]
        if points is None or np.any(chosen >= points.shape[0]):
            place = Place(segment=message.name, time=segment.end)
            note = f"there is no such formation or place: {message.to_formation!r}"
            return Check("VRF334", GROUP, name, "fail", where=place, notes=(note,))
        if np.unique(chosen).size != chosen.size:
            place = Place(segment=message.name, time=segment.end)
            note = "two drones have one place"
            return Check("VRF334", GROUP, name, "fail", where=place, notes=(note,))
        _, last = segment.ends()
        worst.see(
            _distances(last[given, :3], points[chosen]),
            segment.drones[given],
            REACHED,
            segment=message.name,
            time=segment.end,
        )
    return worst.check("VRF334", name, REACHED, "m")


def _continuity(show: LoggedShow) -> Check:
    """State across the mesh intervals of each segment, and their cover of its time."""
    worst = _Worst()
    for segment in show.segments:
        for table in segment.tables:
            starts = np.zeros(table.start.size, dtype=bool)
            starts[table.first[:-1]] = True
            later = np.flatnonzero(~starts)
            jump = np.abs(table.state[later, 0] - table.state[later - 1, -1])
            off = jump.max(axis=1, initial=0.0)
            rows, values = later, off
            edge = np.maximum(
                np.abs(table.start[table.first[:-1]]),
                np.abs(table.end[table.first[1:] - 1] - segment.duration),
            )
            rows = np.concatenate([rows, table.first[:-1]])
            values = np.concatenate([values, edge])
            row = int(np.argmax(values))
            worst.see(
                values[row : row + 1],
                table.owner[rows[row : row + 1]],
                JOINT,
                segment=segment.message.name,
                time=segment.start + float(table.start[rows[row]]),
            )
    return worst.check("VRF335", "state continuous inside every segment", JOINT, "(SI)")


def _joined(show: LoggedShow) -> list[Check]:
    """Follow each drone from segment to segment."""
    end = np.full(show.drones, np.nan)
    state = np.zeros((show.drones, 12))
    gap, jump = _Worst(), _Worst()
    flown = sorted(show.segments, key=lambda one: one.start)
    for segment in flown:
        drones = segment.drones
        first, last = segment.ends()
        known = ~np.isnan(end[drones])
        name = segment.message.name
        late = np.abs(segment.start - end[drones[known]])
        gap.see(late, drones[known], MOMENT, segment=name, time=segment.start)
        leap = np.abs(first[known] - state[drones[known]])
        # Yaw may have turned by whole circles.
        turn = np.remainder(leap[:, 8] + np.pi, 2.0 * np.pi) - np.pi
        leap[:, 8] = np.abs(turn)
        jump.see(
            leap.max(axis=1, initial=0.0),
            drones[known],
            JOINT,
            segment=name,
            time=segment.start,
        )
        if not known.all() and segment.message.kind != pb.Segment.LAUNCH:
            begin = np.full(int(np.sum(~known)), segment.start)
            gap.see(begin, drones[~known], MOMENT, segment=name, time=segment.start)
        end[drones], state[drones] = segment.end, last
    landed = _last_kind(flown, show.drones) == pb.Segment.LAND
    rest = np.abs(show.duration - end)
    rest[landed] = np.maximum(end[landed] - show.duration, 0.0)
    missing = np.flatnonzero(np.isnan(end))
    rest[missing] = np.inf
    gap.see(rest, np.arange(show.drones), MOMENT, segment="the end", time=show.duration)
    return [
        gap.check("VRF336", "every drone covered from launch to landing", MOMENT, "s"),
        jump.check("VRF337", "segments joined without a jump", JOINT, "(SI)"),
    ]


def _last_kind(flown: list[Segment], drones: int) -> IntArray:
    kind = np.full(drones, -1)
    for segment in flown:
        kind[segment.drones] = segment.message.kind
    return kind


def _ground(show: LoggedShow) -> Check:
    """First segment from a pad, last segment to a pad, both on the ground."""
    name = "from the pads on the ground, and back to them"
    formations = {
        formation.name: np.array(formation.points).reshape(-1, 3)
        for formation in show.rules.formations
    }
    flown = sorted(show.segments, key=lambda one: one.start)
    start = np.full((show.drones, 3), np.nan)
    pads = np.full(show.drones, "", dtype=object)
    end = np.full((show.drones, 3), np.nan)
    kinds = _last_kind(flown, show.drones)
    for segment in flown:
        first, last = segment.ends()
        fresh = np.isnan(start[segment.drones, 0])
        drones = segment.drones[fresh]
        if drones.size and segment.message.kind != pb.Segment.LAUNCH:
            return Check(
                "VRF338",
                GROUP,
                name,
                "fail",
                where=Place(int(drones[0]) + 1, segment=segment.message.name),
                notes=("a drone's first segment is not a launch",),
            )
        start[drones] = first[fresh, :3]
        pads[drones] = segment.message.from_formation
        end[segment.drones] = last[:, :3]
    if np.any(kinds != pb.Segment.LAND):
        drone = int(np.flatnonzero(kinds != pb.Segment.LAND)[0]) + 1
        note = "a drone's last segment is not a landing"
        return Check("VRF338", GROUP, name, "fail", where=Place(drone), notes=(note,))
    worst = _Worst()
    for pad in np.unique(pads.astype(str)):
        points = formations.get(str(pad))
        mine = np.flatnonzero(pads == pad)
        if points is None:
            note = f"the pads {str(pad)!r} are not among the formations"
            return Check(
                "VRF338",
                GROUP,
                name,
                "fail",
                where=Place(int(mine[0]) + 1),
                notes=(note,),
            )
        for places, time, label in (
            (start, 0.0, "launch"),
            (end, show.duration, "landing"),
        ):
            gap = np.array(
                [_distances(points, places[drone][None]).min() for drone in mine]
            )
            worst.see(gap, mine, REACHED, segment=label, time=time)
    return worst.check("VRF338", name, REACHED, "m")
