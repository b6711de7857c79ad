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
from showc.verify.kernel.show import (
    CONTROL_COMPONENTS,
    LARGEST,
    STATE_COMPONENTS,
    LoggedShow,
    PieceTable,
    Segment,
    xyz,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray
    from showc.verify.logfile import LogFile


Parsed = TypeVar("Parsed", bound=Message)

FORMAT_VERSION = 1
"""Version of the log's content that this verifier knows."""

RULES, SEGMENTS = "/show/rules", "/show/segments"

MOST_SAMPLES = 2_000_000
"""Steps from which a log is refused: a day at the usual rate."""

MOST_KNOTS = 1_000
"""Knots from which a witness is refused: twenty times what a compile writes."""

SMALLEST = 1e-15
"""Least number that what is positive can be (SI): below it quotients leave float64."""


def read_show(log: LogFile) -> LoggedShow:
    """Decode rules, segments and all polynomials.

    Raises
    ------
    Damage
        If they are missing, malformed or contradict each other; names the byte at
        which the data of the chunk begin.
    """
    topics = _channels(log)
    rules, epoch = _rules(log, topics[RULES])
    messages = _segments(log, topics[SEGMENTS], rules, epoch)
    end = max(message.start + message.duration for message in messages.values())
    if abs(end - rules.duration) > 1e-6:
        raise Damage(
            0, f"the last segment ends at {end} s, the show at {rules.duration} s"
        )
    segments = read_segments(log, rules, messages, epoch)
    return LoggedShow(
        rules, tuple(segment for _, segment in sorted(segments.items())), epoch
    )


def _channels(log: LogFile) -> dict[str, int]:
    """Channels by topic, those of the show among them."""
    topics = {channel.topic: number for number, channel in log.channels.items()}
    for topic in (RULES, SEGMENTS):
        if topic not in topics:
            raise Damage(0, f"there is no {topic}; this is not a log of showc's")
    return topics


def parse(kind: type[Parsed], data: bytes, offset: int) -> Parsed:
    """Decode one message; what does not decode is damage at ``offset``."""
    name = kind.DESCRIPTOR.full_name
    try:
        found = kind.FromString(data)
    except (DecodeError, RecursionError, MemoryError) as error:
        raise Damage(offset, f"a {name} does not decode ({error})") from error
    # Fields that are not known are written again as they came.
    size = found.ByteSize()
    found.DiscardUnknownFields()
    if found.ByteSize() != size:
        raise Damage(offset, f"a {name} holds fields that are not known")
    return found


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
    _check_fence(rules, offset)
    return rules, epoch


def _sane(values: FloatArray) -> bool:
    """Whether all values are numbers of a size with which one can calculate."""
    return bool(np.all(np.abs(values) < LARGEST))


def _check_fence(rules: pb.Rules, offset: int) -> None:
    fence = np.array(rules.site.fence)
    if fence.size % 2 or 0 < fence.size < 6 or not _sane(fence):
        raise Damage(offset, "the fence is no polygon")


def _numbers(message: Message) -> Iterator[float]:
    """All numbers of a message, to any depth."""
    for entry, value in message.ListFields():
        for one in value if entry.is_repeated else (value,):
            if isinstance(one, Message):
                yield from _numbers(one)
            elif isinstance(one, (int, float)):
                yield one


def _check_rules(rules: pb.Rules, offset: int) -> None:
    vehicle, separation = rules.vehicle, rules.separation
    positive = {
        "drones": rules.drones,
        "mass": vehicle.mass,
        "arm length": vehicle.arm_length,
        "thrust coefficient": vehicle.thrust_coefficient,
        "torque coefficient": vehicle.torque_coefficient,
        "moments of inertia": xyz(vehicle.inertia).min(),
        "rotor speed": vehicle.rotor_speed_max,
        "gravity": vehicle.gravity,
        "torque factor": vehicle.torque_factor,
        "separation": separation.distance,
        "vertical stretch": separation.vertical_stretch,
        "log rate": rules.log_rate,
    }
    if any(len(formation.points) % 3 for formation in rules.formations):
        raise Damage(offset, "the places of a formation are no list of points")
    numbers = _numbers(rules)
    if not all(abs(number) < LARGEST for number in numbers):
        raise Damage(offset, "the rules of the show hold a number beyond all measure")
    for name, value in positive.items():
        if value < SMALLEST:
            raise Damage(offset, f"the rules of the show say {value} for {name}")
    if rules.duration * rules.log_rate > MOST_SAMPLES:
        raise Damage(
            offset,
            f"the show lasts {rules.duration:g} s with {rules.log_rate:g} samples a "
            f"second; more than {MOST_SAMPLES:,} are refused",
        )
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
    goals = np.array(message.goals)
    certificate = message.certificate
    if not (
        list(message.drones) == list(range(rules.drones))
        and len(message.places) == rules.drones
        and goals.size == 3 * rules.drones
        and message.limits < len(rules.limits)
        and message.kind in pb.Segment.Kind.values()
        and abs(message.start) < LARGEST
        and abs(message.duration) < LARGEST
        and message.start >= 0.0
        and message.duration > 0.0
        and _sane(goals)
        and len(certificate.witness.knots) <= MOST_KNOTS
        and math.isfinite(certificate.dual_bound)
        and math.isfinite(certificate.single_drone_minimum)
    ):
        raise Damage(offset, f"segment {message.name!r} contradicts itself")


TOPIC = re.compile(r"/drone/(\d+)/trajectory")

_MOST_PIECES = 10_000
"""Mesh intervals from which a trajectory is refused: far more than are written."""

_LARGEST_DEGREE = 60
"""Beyond it binomials lose digits; no useful polynomial has it."""


class _Flight(NamedTuple):
    """One trajectory: breaks (K + 1,), coefficients (K, degree + 1, components)."""

    breaks: FloatArray
    state: FloatArray
    control: FloatArray


def read_segments(
    log: LogFile, rules: pb.Rules, messages: dict[int, pb.Segment], epoch: int
) -> dict[int, Segment]:
    """Gather the trajectories of all segments.

    Parameters
    ----------
    log
        The file.
    rules
        Rules of the show.
    messages
        What the log says of each segment, by its index.
    epoch
        Time stamp of show time zero [ns].

    Raises
    ------
    Damage
        If trajectories are missing, double, malformed or not where they belong.
    """
    channels = {
        number: int(match[1]) - 1
        for number, channel in log.channels.items()
        if (match := TOPIC.fullmatch(channel.topic))
    }
    if sorted(channels.values()) != list(range(rules.drones)):
        raise Damage(
            0,
            f"there are trajectories of {len(channels)} drones, not of {rules.drones}",
        )
    missing = {index: set(message.drones) for index, message in messages.items()}
    flights: dict[int, dict[int, _Flight]] = defaultdict(dict)
    whole: dict[int, Segment] = {}
    for data, m, offset in log.read(set(channels)):
        for start, size, time, channel in zip(
            m.payload.tolist(),
            m.size.tolist(),
            m.log_time.tolist(),
            m.channel.tolist(),
            strict=True,
        ):
            found = parse(pb.Trajectory, data[start : start + size], offset)
            index, drone = found.segment, found.drone
            if drone != channels[channel]:
                raise Damage(offset, "a trajectory is on another drone's channel")
            if drone not in missing.get(index, ()):
                raise Damage(
                    offset,
                    f"drone {drone + 1} flies segment {index} twice, or is not one of "
                    "its drones",
                )
            if abs(time - epoch - round(messages[index].start * 1e9)) > 1:
                raise Damage(offset, "a trajectory is not at its segment's start")
            missing[index].remove(drone)
            flights[index][drone] = _flight(found, offset)
            if not missing[index]:
                # Joined at once, so that the parts can go.
                whole[index] = _segment(messages[index], flights.pop(index))
    for index, message in messages.items():
        if index not in whole:
            raise Damage(
                0, f"segment {message.name!r} lacks the trajectories of its drones"
            )
    return whole


def _flight(found: pb.Trajectory, offset: int) -> _Flight:
    """Return a trajectory's numbers; damage if they contradict each other."""
    pieces = len(found.breaks) - 1
    parts = (
        (found.state, found.state_degree + 1, STATE_COMPONENTS),
        (found.control, found.control_degree + 1, CONTROL_COMPONENTS),
    )
    if not 0 < pieces <= _MOST_PIECES or any(
        terms > _LARGEST_DEGREE + 1 or len(numbers) != pieces * terms * components
        for numbers, terms, components in parts
    ):
        raise Damage(offset, "a trajectory contradicts itself")
    breaks = np.array(found.breaks)
    state, control = (
        np.array(numbers).reshape(pieces, terms, components)
        for numbers, terms, components in parts
    )
    # Numbers that are undefined make the comparisons false.
    if not (
        np.all(np.diff(breaks) > 0.0)
        and all(
            array.max() < LARGEST and array.min() > -LARGEST
            for array in (breaks, state, control)
        )
    ):
        raise Damage(offset, "a trajectory contradicts itself")
    return _Flight(breaks, state, control)


def _segment(message: pb.Segment, flights: dict[int, _Flight]) -> Segment:
    groups: dict[tuple[int, int], list[int]] = defaultdict(list)
    for drone in sorted(flights):
        flight = flights[drone]
        groups[flight.state.shape[1], flight.control.shape[1]].append(drone)
    return Segment(
        message,
        tuple(
            _table(drones, [flights[drone] for drone in drones])
            for _, drones in sorted(groups.items())
        ),
        np.array(message.goals).reshape(-1, 3),
    )


def _table(drones: list[int], flights: list[_Flight]) -> PieceTable:
    """Join flights of the same two degrees."""
    pieces = [len(flight.state) for flight in flights]
    return PieceTable(
        drones=np.array(drones, dtype=np.int64),
        first=np.concatenate([[0], np.cumsum(pieces)]).astype(np.int64),
        start=np.concatenate([flight.breaks[:-1] for flight in flights]),
        end=np.concatenate([flight.breaks[1:] for flight in flights]),
        state=np.concatenate([flight.state for flight in flights]),
        control=np.concatenate([flight.control for flight in flights]),
    )
