"""From the log's messages to the show they describe."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from google.protobuf.message import DecodeError, Message

from showc.log import showc_pb2 as pb
from showc.verify.damage import Damage
from showc.verify.show import (
    CONTROL_COMPONENTS,
    STATE_COMPONENTS,
    LoggedShow,
    PieceTable,
    Segment,
)
from showc.verify.wire import numbers_and_doubles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.verify.logfile import LogFile

    FloatArray = NDArray[np.float64]

Parsed = TypeVar("Parsed", bound=Message)

FORMAT_VERSION = 1
"""Version of the log's content that this verifier knows."""

RULES, SEGMENTS = "/show/rules", "/show/segments"
TRAJECTORY = re.compile(r"/drone/(\d+)/trajectory")

LARGEST, SMALLEST = 1e9, 1e-15
"""Range of numbers that a show can hold (SI): beyond it products leave float64."""

_LARGEST_DEGREE = 60
"""Beyond it binomials lose digits; no useful polynomial has it."""


class _Trajectory(NamedTuple):
    segment: int
    drone: int
    breaks: FloatArray
    state: FloatArray
    control: FloatArray


def read_show(log: LogFile) -> LoggedShow:
    """Decode rules, segments and all polynomials.

    Raises
    ------
    Damage
        If they are missing, malformed or contradict each other; names the byte at
        which the data of the chunk begin.
    """
    topics = {channel.topic: number for number, channel in log.channels.items()}
    for topic in (RULES, SEGMENTS):
        if topic not in topics:
            raise Damage(0, f"there is no {topic}; this is not a log of showc's")
    rules, epoch = _rules(log, topics[RULES])
    messages = _segments(log, topics[SEGMENTS], rules, epoch)
    end = max(message.start + message.duration for message in messages.values())
    if abs(end - rules.duration) > 1e-6:
        raise Damage(
            0, f"the last segment ends at {end} s, the show at {rules.duration} s"
        )
    segments = _trajectories(log, rules, messages, epoch)
    return LoggedShow(
        rules, tuple(segment for _, segment in sorted(segments.items())), epoch
    )


def parse(kind: type[Parsed], data: bytes, offset: int) -> Parsed:
    """Decode one message; what does not decode is damage at ``offset``."""
    try:
        return kind.FromString(data)
    except (DecodeError, RecursionError, MemoryError) as error:
        raise Damage(
            offset, f"a {kind.DESCRIPTOR.full_name} does not decode ({error})"
        ) from error


def _rules(log: LogFile, channel: int) -> tuple[pb.Rules, int]:
    found: list[tuple[pb.Rules, int, int]] = []
    for data, m, offset in log.read({channel}):
        for start, size, time in zip(m.payload, m.size, m.log_time, strict=True):
            message = parse(pb.Rules, data[start : start + size], offset)
            found.append((message, int(time), offset))
    if len(found) != 1:
        raise Damage(0, f"{RULES} holds {len(found)} messages, not one")
    rules, epoch, offset = found[0]
    if rules.format_version != FORMAT_VERSION:
        raise Damage(
            offset,
            f"the log has format version {rules.format_version}, this verifier knows "
            f"{FORMAT_VERSION}",
        )
    _check_rules(rules, offset)
    return rules, epoch


def _sane(values: FloatArray) -> bool:
    """Whether all values are numbers of a size with which one can calculate."""
    return bool(np.all(np.abs(values) < LARGEST))


def _vector(vector: pb.Vector3) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _check_rules(rules: pb.Rules, offset: int) -> None:
    vehicle, separation = rules.vehicle, rules.separation
    positive = {
        "drones": rules.drones,
        "mass": vehicle.mass,
        "arm length": vehicle.arm_length,
        "thrust coefficient": vehicle.thrust_coefficient,
        "torque coefficient": vehicle.torque_coefficient,
        "moments of inertia": min(_vector(vehicle.inertia)),
        "rotor speed": vehicle.rotor_speed_max,
        "gravity": vehicle.gravity,
        "torque factor": vehicle.torque_factor,
        "separation": separation.distance,
        "vertical stretch": separation.vertical_stretch,
        "log rate": rules.log_rate,
    }
    numbers = [*positive.values(), rules.duration, rules.heading, rules.site.heading]
    numbers += [rules.site.latitude, rules.site.longitude, rules.site.altitude]
    numbers += _vector(vehicle.inertia)
    numbers += _vector(rules.site.volume_min) + _vector(rules.site.volume_max)
    for limits in rules.limits:
        numbers += [limits.tilt, limits.thrust_min, limits.thrust_max]
        for vector in (
            limits.velocity_min,
            limits.velocity_max,
            limits.body_rate,
            limits.torque_max,
            limits.position_min,
            limits.position_max,
        ):
            numbers += _vector(vector)
    for formation in rules.formations:
        numbers += formation.points
        if len(formation.points) % 3:
            raise Damage(offset, f"formation {formation.name!r} is no list of points")
    if not all(abs(number) < LARGEST for number in numbers):
        raise Damage(offset, "the rules of the show hold a number beyond all measure")
    for name, value in positive.items():
        if value < SMALLEST:
            raise Damage(offset, f"the rules of the show say {value} for {name}")
    if rules.drones >= 1 << 16 or not rules.limits or rules.log_rate > 1e3:
        raise Damage(offset, "the rules of the show make no sense")


def _segments(
    log: LogFile, channel: int, rules: pb.Rules, epoch: int
) -> dict[int, pb.Segment]:
    segments: dict[int, pb.Segment] = {}
    for data, m, offset in log.read({channel}):
        for start, size, time in zip(m.payload, m.size, m.log_time, strict=True):
            message = parse(pb.Segment, data[start : start + size], offset)
            _check_segment(message, rules, offset)
            if message.index in segments:
                raise Damage(offset, f"segment {message.index} is there twice")
            if abs((int(time) - epoch) * 1e-9 - message.start) > 1e-6:
                raise Damage(offset, f"segment {message.name!r} is not at its start")
            segments[message.index] = message
    if sorted(segments) != list(range(len(segments))) or not segments:
        raise Damage(0, "segments are missing")
    return segments


def _check_segment(message: pb.Segment, rules: pb.Rules, offset: int) -> None:
    drones = np.array(message.drones, dtype=np.int64)
    goals = np.array(message.goals)
    certificate = message.certificate
    if not (
        drones.size
        and len(message.places) == drones.size
        and goals.size == 3 * drones.size
        and np.all(np.diff(drones) > 0)
        and drones[-1] < rules.drones
        and message.limits < len(rules.limits)
        and message.kind in pb.Segment.Kind.values()
        and abs(message.start) < LARGEST
        and abs(message.duration) < LARGEST
        and message.start >= 0.0
        and message.duration > 0.0
        and _sane(goals)
        and math.isfinite(certificate.dual_bound)
        and math.isfinite(certificate.single_drone_minimum)
    ):
        raise Damage(offset, f"segment {message.name!r} contradicts itself")


def _trajectories(
    log: LogFile, rules: pb.Rules, messages: dict[int, pb.Segment], epoch: int
) -> dict[int, Segment]:
    channels = {
        number: int(match[1]) - 1
        for number, channel in log.channels.items()
        if (match := TRAJECTORY.fullmatch(channel.topic))
    }
    if sorted(channels.values()) != list(range(rules.drones)):
        raise Damage(
            0,
            f"there are trajectories of {len(channels)} drones, not of {rules.drones}",
        )
    gathering = _Gathering(messages, epoch)
    for data, m, offset in log.read(set(channels)):
        for start, size, time, channel in zip(
            m.payload.tolist(),
            m.size.tolist(),
            m.log_time.tolist(),
            m.channel.tolist(),
            strict=True,
        ):
            trajectory = _trajectory(data, start, size, offset)
            if trajectory.drone != channels[channel]:
                raise Damage(offset, "a trajectory is on another drone's channel")
            gathering.add(trajectory, time, offset)
    for index, message in messages.items():
        if index not in gathering.whole:
            raise Damage(
                0, f"segment {message.name!r} lacks the trajectories of its drones"
            )
    return gathering.whole


class _Gathering:
    """Collects trajectories until a segment has all of its drones'."""

    def __init__(self, messages: dict[int, pb.Segment], epoch: int) -> None:
        self.whole: dict[int, Segment] = {}
        self._messages = messages
        self._waiting = {
            index: set(message.drones) for index, message in messages.items()
        }
        self._starts = {
            index: epoch + round(message.start * 1e9)
            for index, message in messages.items()
        }
        self._found: dict[int, list[_Trajectory]] = defaultdict(list)

    def add(self, trajectory: _Trajectory, time: int, offset: int) -> None:
        """Take the next trajectory of the file."""
        index = trajectory.segment
        if trajectory.drone not in self._waiting.get(index, ()):
            raise Damage(
                offset,
                f"drone {trajectory.drone + 1} flies segment {index} twice, or is not "
                "one of its drones",
            )
        if abs(time - self._starts[index]) > 1:
            raise Damage(offset, "a trajectory is not at its segment's start")
        self._waiting[index].remove(trajectory.drone)
        self._found[index].append(trajectory)
        if not self._waiting[index]:
            # Copied into tables at once, so that the chunk's bytes can go.
            found = self._found.pop(index)
            self.whole[index] = _segment(self._messages[index], found)


def _trajectory(data: bytes, start: int, size: int, offset: int) -> _Trajectory:
    try:
        integers, doubles = numbers_and_doubles(data, start, start + size)
    except Damage as damage:
        raise Damage(offset, damage.text) from damage
    empty = np.empty(0)
    breaks = doubles.get(3, empty)
    degrees = integers.get(4, 0), integers.get(6, 0)
    state, control = doubles.get(5, empty), doubles.get(7, empty)
    pieces = breaks.size - 1
    if not (
        pieces > 0
        and max(degrees) <= _LARGEST_DEGREE
        and state.size == pieces * (degrees[0] + 1) * STATE_COMPONENTS
        and control.size == pieces * (degrees[1] + 1) * CONTROL_COMPONENTS
        and _sane(state)
        and _sane(control)
        and _sane(breaks)
        and np.all(np.diff(breaks) > 0.0)
    ):
        raise Damage(offset, "a trajectory contradicts itself")
    return _Trajectory(
        integers.get(1, 0),
        integers.get(2, 0),
        breaks,
        state.reshape(pieces, degrees[0] + 1, STATE_COMPONENTS),
        control.reshape(pieces, degrees[1] + 1, CONTROL_COMPONENTS),
    )


def _segment(message: pb.Segment, trajectories: list[_Trajectory]) -> Segment:
    groups: dict[tuple[int, int], list[_Trajectory]] = defaultdict(list)
    for trajectory in sorted(trajectories, key=lambda one: one.drone):
        key = trajectory.state.shape[1], trajectory.control.shape[1]
        groups[key].append(trajectory)
    return Segment(
        message,
        tuple(_table(group) for _, group in sorted(groups.items())),
        np.array(message.drones, dtype=np.int64),
        np.array(message.goals).reshape(-1, 3),
    )


def _table(group: list[_Trajectory]) -> PieceTable:
    pieces = [trajectory.breaks.size - 1 for trajectory in group]
    return PieceTable(
        drones=np.array([trajectory.drone for trajectory in group], dtype=np.int64),
        first=np.concatenate([[0], np.cumsum(pieces)]).astype(np.int64),
        start=np.concatenate([trajectory.breaks[:-1] for trajectory in group]),
        end=np.concatenate([trajectory.breaks[1:] for trajectory in group]),
        state=np.concatenate([trajectory.state for trajectory in group]),
        control=np.concatenate([trajectory.control for trajectory in group]),
    )
