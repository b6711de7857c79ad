"""From the log's messages to the show they describe."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from google.protobuf.message import DecodeError, Message

from showc.log import showc_pb2 as pb
from showc.verify.damage import Damage
from showc.verify.kernel.show import LARGEST, LoggedShow
from showc.verify.trajectories import read_segments

if TYPE_CHECKING:
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
    _check_fence(rules, offset)
    return rules, epoch


def _sane(values: FloatArray) -> bool:
    """Whether all values are numbers of a size with which one can calculate."""
    return bool(np.all(np.abs(values) < LARGEST))


def _vector(vector: pb.Vector3) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _check_fence(rules: pb.Rules, offset: int) -> None:
    fence = np.array(rules.site.fence)
    if fence.size % 2 or 0 < fence.size < 6 or not _sane(fence):
        raise Damage(offset, "the fence is no polygon")


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
