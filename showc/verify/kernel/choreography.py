"""How the show joins up: hover at joints, goals reached, no gap, no jump.

Each statement holds of the logged polynomials as they stand: it compares single
coefficients with each other and with what is asked for, so that no error but one
rounding of a difference enters (u of the greater number, far below every tolerance). Of
what is flown it holds with the tolerances of VRF301 to VRF304 besides
(:mod:`showc.verify.kernel.dynamics`). Between the ends of an interval a value lies in
the hull of its coefficients (Farouki 2012, section 4).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb
from showc.verify.kernel.show import LoggedShow, Seen, Statement, worst

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray

REACHED = 1e-3  # distance from its place at which a drone has reached it [m]

JOINT = 1e-6
"""Jump of any state at a joint, and speed, rate or tilt left at a hover (SI): what a
solver calls equal."""

MOMENT = 1e-6  # gap in time between two segments [s]: rounding of times

AT_REST = [3, 4, 5, 6, 7, 9, 10, 11]  # zero at a hover: all but position and yaw


def joined_up(show: LoggedShow) -> list[Statement]:
    """State everything about how the show joins up."""
    found = [
        ("VRF331", JOINT, "SI", _hover),
        ("VRF332", JOINT, "rad", _heading),
        ("VRF333", REACHED, "m", _goals),
        ("VRF335", JOINT, "SI", _inside),
        ("VRF336", MOMENT, "s", _gaps),
        ("VRF337", JOINT, "SI", _jumps),
    ]
    if any(one.jerk for one in show.rules.limits):
        found.append(("VRF334", JOINT, "N", _thrusts))
    stated = [worst(code, limit, unit, seen(show)) for code, limit, unit, seen in found]
    return [*stated, _ground(show)]


def _hover(show: LoggedShow) -> Iterator[Seen]:
    """At every joint but those with a formation that moves: see VRF204 to VRF207."""
    fleet = np.arange(show.drones)
    moves = [False, *(_moves(one.message) for one in show.segments), False]
    for index, one in enumerate(show.segments):
        name = one.message.name
        ends = zip((one.start, one.end), one.ends(), strict=True)
        for side, (time, state) in enumerate(ends):
            if not any(moves[index + side : index + side + 2]):
                yield Seen(name, time, fleet, np.abs(state[:, AT_REST]).max(axis=1))
        if one.holds:
            table = one.table
            restless = np.abs(table.state[:, :, AT_REST]).max(axis=(1, 2))
            yield Seen(name, one.start + table.start, table.owner, restless)


def _moves(leg: pb.Segment) -> bool:
    """Tell whether a formation moves, or a group may be left moving at the end."""
    end = leg.start + leg.duration - MOMENT
    late = [one.kind for one in leg.moves if one.start + one.duration >= end]
    return pb.Segment.MOTION in (leg.kind, *late)


def _heading(show: LoggedShow) -> Iterator[Seen]:
    """Yaw at hovers, through holds, and always if it is held, by its hull."""
    heading, held = show.rules.heading, show.rules.yaw_held
    for one in show.segments:
        name, table = one.message.name, one.table
        yaw = table.state[:, :, 8] - heading
        # Free yaw may have turned by whole circles.
        yaw -= 2.0 * np.pi * np.round(yaw[:, :1] / (2.0 * np.pi)) * (not held)
        off = np.abs(yaw).max(axis=1) * (held | one.holds)
        yield Seen(name, one.start + table.start, table.owner, off)
        for time, state in zip((one.start, one.end), one.ends(), strict=True):
            off = turn(state[:, 8] - heading)
            yield Seen(name, time, np.arange(show.drones), off)


def turn(angle: FloatArray) -> FloatArray:
    """Size of angles but for whole circles, 0 to pi [rad]."""
    return np.abs(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)


def _goals(show: LoggedShow) -> Iterator[Seen]:
    """Distances from goals at the end of each segment, in a hold at every instant."""
    for one in show.segments:
        table, last = one.table, one.table.first[1:] - 1
        rows = np.arange(table.start.size) if one.holds else last
        places = table.state[rows, :, :3] if one.holds else table.state[rows, -1:, :3]
        owner, time = table.owner[rows], one.start + table.end[rows]
        off = np.linalg.norm(places - one.goals[owner][:, None], axis=2)
        yield Seen(one.message.name, time, owner, off.max(axis=1))


def _inside(show: LoggedShow) -> Iterator[Seen]:
    """State across the mesh intervals of each segment, and their cover of its time."""
    for one in show.segments:
        table = one.table
        first, last = table.first[:-1], table.first[1:] - 1
        later = np.delete(np.arange(table.start.size), first)
        jump = np.abs(table.state[1:, 0] - table.state[:-1, -1])[later - 1]
        name, time = one.message.name, one.start + table.start
        yield Seen(name, time[later], table.owner[later], jump.max(axis=1))
        edge = np.abs(table.end[last] - one.duration)
        edge = np.maximum(np.abs(table.start[first]), edge)
        yield Seen(name, time[first], table.drones, edge)


def _thrusts(show: LoggedShow) -> Iterator[Seen]:
    """Jumps of the thrust where jerk is limited; at both ends the drone's weight."""
    weight = show.rules.vehicle.mass * show.rules.vehicle.gravity
    before = np.full(show.drones, weight)
    for one in show.segments:
        table = one.table
        earlier = np.roll(table.control[:, -1, 0], 1)
        earlier[table.first[:-1]] = before
        before = table.control[table.first[1:] - 1, -1, 0]
        jump = np.abs(table.control[:, 0, 0] - earlier)
        yield Seen(one.message.name, one.start + table.start, table.owner, jump)
    yield Seen("the end", show.duration, np.arange(before.size), abs(before - weight))


def _gaps(show: LoggedShow) -> Iterator[Seen]:
    """Segments follow each other: each holds the whole fleet."""
    ends = [0.0, *(one.end for one in show.segments)]
    starts = [*(one.start for one in show.segments), show.duration]
    names = [*(one.message.name for one in show.segments), "the end"]
    for name, end, start in zip(names, ends, starts, strict=True):
        yield Seen(name, start, np.array([0]), np.array([abs(start - end)]))


def _jumps(show: LoggedShow) -> Iterator[Seen]:
    ends = [one.ends() for one in show.segments]
    for one, before, after in zip(show.segments[1:], ends, ends[1:], strict=False):
        leap = np.abs(after[0] - before[1])
        # Yaw may have turned by whole circles.
        leap[:, 8] = turn(leap[:, 8])
        fleet = np.arange(show.drones)
        yield Seen(one.message.name, one.start, fleet, leap.max(axis=1))


def _ground(show: LoggedShow) -> Statement:
    """First segment from each drone's own pad, last segment to any of them."""
    first, last = show.segments[0], show.segments[-1]
    name = first.message.from_formation
    named = [one.points for one in show.rules.formations if one.name == name]
    pads = [np.array(points).reshape(-1, 3) for points in named if points]
    kinds = first.message.kind, last.message.kind
    if kinds != (pb.Segment.LAUNCH, pb.Segment.LAND) or not pads:
        note = "the show does not begin with a launch from pads, or ends in the air"
        return Statement("VRF338", False, notes=(note,))
    fleet, own = np.arange(show.drones), np.full((show.drones, 3), np.inf)
    own[: len(pads[0])] = pads[0][: show.drones]
    off = np.linalg.norm(first.ends()[0][:, :3] - own, axis=1)
    away = [np.linalg.norm(own - one[:3], axis=1).min() for one in last.ends()[1]]
    launch = Seen("launch", 0.0, fleet, off)
    landing = Seen("landing", show.duration, fleet, np.array(away))
    return worst("VRF338", REACHED, "m", (launch, landing))
