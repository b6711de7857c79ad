"""From the log's messages, and their types, to the show they describe."""

from __future__ import annotations

import re
from collections import Counter
from fractions import Fraction
from functools import partial
from io import BytesIO
from itertools import chain, groupby, islice
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from google.protobuf.message import DecodeError, Message
from google.protobuf.proto import parse_length_prefixed

from showc.codes import read_table
from showc.log import showc_pb2 as pb
from showc.log.facts import message_type
from showc.log.records import Damage, has_more_fields
from showc.log.schema import ABORT_HEAD, ABORT_NAME, RULES, SEGMENTS, descriptor_set
from showc.verify.kernel.show import LARGEST, WIDTHS, LoggedShow, PieceTable, Segment
from showc.verify.report import Check, agreement, checked

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from showc.log.container import LogFile
    from showc.log.container import Message as LoggedMessage

Parsed = TypeVar("Parsed", bound=Message)

FORMAT_VERSION = 1  # of the log's content that is known here

CAPS: dict[str, int] = read_table(__package__ or "", "caps.toml")  # sizes refused

_PARTS: Any = {b"\x22": pb.AbortRow, b"\x2a": pb.Segment, b"\x32": pb.Trajectory}

_MALFORMED = DecodeError, RecursionError, MemoryError

_AT_ONCE = 32  # flights whose coefficients are joined together

TOPIC = re.compile(r"/drone/(\d{4,5})/trajectory")


def check_container(log: LogFile) -> list[Check]:
    """Whether all bytes are read, topics have their types, and types their definitions.

    A definition must be the one in memory: with another one, a viewer would read other
    things out of the same bytes than this verifier.
    """
    messages = sum(chunk.time.size for chunk in log.chunks)
    whole = f"{messages:,} messages on {len(log.channels):,} channels in "
    whole += f"{len(log.chunks):,} chunks: CRCs, indexes, statistics, order, sequence"
    bytes_ = checked("VRF101", "pass", len(log.view), unit="bytes", notes=(whole,))
    bad = []
    for channel in log.channels.values():
        schema = log.schemas[channel.schema]
        wanted = message_type(channel.topic)
        name = "nothing" if wanted is None else wanted.DESCRIPTOR.full_name
        if wanted is None or schema[1:] != (name, "protobuf", descriptor_set(wanted)):
            text = f"{channel.topic} has {schema.name}, not {name} as this release of "
            bad.append(f"{text}showc has it; verify with the one that compiled it")
        if channel.encoding != "protobuf" or channel.metadata:
            bad.append(f"{channel.topic}: the channel says more, or another encoding")
    used = {channel.schema for channel in log.channels.values()}
    names = Counter(schema.name for schema in log.schemas.values())
    bad += [f"{log.schemas[n].name} is unused" for n in log.schemas.keys() - used]
    bad += [f"{name} is defined twice" for name in names if names[name] > 1]
    return [bytes_, agreement("VRF103", bad)]


def decoding(
    log: LogFile,
) -> tuple[list[Callable[[], PieceTable]], Callable[[list[PieceTable]], LoggedShow]]:
    """Return what decodes each segment, and what makes a show of all that they return.

    Raises
    ------
    Damage
        If they are missing, malformed or contradict each other; names the byte at
        which the data of the chunk begin.
    """
    topics = ((n, TOPIC.fullmatch(one.topic)) for n, one in log.channels.items())
    drones = {number: int(match[1]) - 1 for number, match in topics if match}
    sizes = log.sizes({*drones, *_on(log, SEGMENTS)})
    large = sizes.max(initial=0) > CAPS["message"]
    if large or sizes.sum() > CAPS["held"] + CAPS["packed"] * len(log.view):
        raise Damage(0, f"flights and segments have {sizes.sum():,} bytes, too many")
    rules, epoch = _rules(log)
    messages = _segments(log, rules, epoch)
    end = max(message.start + message.duration for message in messages)
    if not abs(end - rules.duration) <= 1e-6:
        raise Damage(0, f"segments end at {end} s, the show at {rules.duration} s")
    wanted = [*range(rules.drones)], rules.drones * len(messages)
    if (sorted(drones.values()), log.sizes({*drones}).size) != wanted:
        raise Damage(0, "there is not one trajectory of each drone in each segment")
    times = log.times(*_on(log, SEGMENTS)).tolist()

    def joined(tables: list[PieceTable]) -> LoggedShow:
        goals = (np.array(one.goals).reshape(-1, 3) for one in messages)
        return LoggedShow(rules, tuple(map(Segment, messages, tables, goals)), epoch)

    each = partial(_flown, log, times, drones)
    return [partial(each, k, one.duration) for k, one in enumerate(messages)], joined


def _on(log: LogFile, topic: str) -> set[int]:
    """Return the one channel of a topic that must be there."""
    found = {n for n, channel in log.channels.items() if channel.topic == topic}
    if len(found) != 1:
        raise Damage(0, f"there is not one {topic}; this is not a log of showc's")
    return found


def _parsed(kind: type[Parsed], message: LoggedMessage) -> Parsed:
    """Decode one message; damage if it does not decode."""
    name = kind.DESCRIPTOR.full_name
    if has_more_fields(message.data, CAPS["fields"]):
        raise Damage(message.offset, f"a {name} has more fields than any of showc's")
    try:
        found = kind.FromString(message.data)
    except _MALFORMED as error:
        raise Damage(message.offset, f"a {name} does not decode ({error})") from error
    # What is unknown, stands twice or is written in a longer way is lost by now.
    found.DiscardUnknownFields()
    if found.SerializeToString(deterministic=True) != message.data:
        raise Damage(message.offset, f"a {name} is not written as showc writes it")
    return found


def _rules(log: LogFile) -> tuple[pb.Rules, int]:
    """Return the rules of the show, and the time stamp of its begin [ns]."""
    found = [*islice(log.messages(_on(log, RULES)), 2)]
    if len(found) != 1:
        raise Damage(0, f"{RULES} does not hold one message")
    rules = _parsed(pb.Rules, found[0])
    # What else they say must be what the script says.
    version, steps = rules.format_version, rules.duration * rules.log_rate
    known = version == FORMAT_VERSION and 1 <= rules.drones <= CAPS["drones"]
    if not (known and 0.0 <= steps <= CAPS["samples"]):
        text = f"format version {version}, {rules.drones:,} drones, {steps:g} samples; "
        text += f"at most {FORMAT_VERSION}, {CAPS['drones']:,} and {CAPS['samples']:,}"
        raise Damage(found[0].offset, text)
    return rules, found[0].time


def _segments(log: LogFile, rules: pb.Rules, epoch: int) -> list[pb.Segment]:
    """Return what the log says of each segment, in order."""
    found, moves = list[pb.Segment](), 0
    for logged in log.messages(_on(log, SEGMENTS)):
        message, offset = _parsed(pb.Segment, logged), logged.offset
        if not _sound(message, rules):
            raise Damage(offset, f"segment {message.name!r} contradicts itself")
        time = epoch + round(Fraction(message.start) * 10**9)
        turn, moves = (message.index, logged.time), moves + len(message.moves)
        if turn != (len(found), time) or max(len(found) + 1, moves) > CAPS["segments"]:
            raise Damage(offset, f"segment {message.name!r} is not in its turn")
        found.append(message)
    if not found:
        raise Damage(0, "segments are missing")
    return found


def _sound(message: pb.Segment, rules: pb.Rules) -> bool:
    """Tell whether something can be calculated with a segment."""
    certificate = message.certificate
    claims = certificate.dual_bound, certificate.single_drone_minimum
    numbers = [message.start, message.duration, *claims, *message.goals]
    every = [certificate, *(move.certificate for move in message.moves)]
    knots = [max(len(one.witness.knots), len(one.statistics)) for one in every]
    return (
        list(message.drones) == list(range(rules.drones))
        and len(message.goals) == 3 * len(message.places) == 3 * rules.drones
        and len(message.moves) <= CAPS["segments"]
        and message.limits < len(rules.limits)
        and message.kind in pb.Segment.Kind.values()
        and all(abs(number) < LARGEST for number in numbers)
        and message.start >= 0.0 < message.duration
        and max(knots) <= CAPS["knots"]
    )


def read_aborts(
    log: LogFile, rules: pb.Rules
) -> tuple[pb.AbortTable, tuple[Segment, ...]]:
    """Decode the abort table of a log that has one; its legs keep ``rules``.

    Raises
    ------
    Damage
        If it is malformed.
    """
    one = next(one for one in log.attachments if one.name == ABORT_NAME)
    offset, content = one.position, log.attachment(ABORT_NAME) or b""
    try:
        table = _abort_table(content, rules)
    except (*_MALFORMED, ValueError, LookupError) as error:
        raise Damage(offset, "the abort table does not decode") from error
    said = ((row.time, row.rest, row.duration, *row.changes) for row in table.rows)
    numbers = [*chain(*said)]
    if not (
        table.SerializeToString(deterministic=True) == content
        and len(table.flights) == len(table.legs) * rules.drones
        and all(leg < len(table.legs) for row in table.rows for leg in row.legs)
        and all(abs(n) < LARGEST for n in numbers)
        and len(numbers) <= CAPS["samples"]
        and 0.0 < table.period < LARGEST
        and rules.duration / CAPS["samples"] <= table.every < LARGEST
    ):
        raise Damage(offset, "the abort table contradicts itself")
    flights = ((one, offset) for one in table.flights)
    tables = (_table(islice(flights, rules.drones), x.duration) for x in table.legs)
    goals = (np.array(one.goals).reshape(-1, 3) for one in table.legs)
    return table, tuple(map(Segment, table.legs, tables, goals))


def _abort_table(content: bytes, rules: pb.Rules) -> pb.AbortTable:
    """Decode an abort table by its tags, so that the first odd part ends it."""
    table, stream = pb.AbortTable.FromString(content[:ABORT_HEAD]), BytesIO(content)
    stream.seek(ABORT_HEAD)
    while tag := stream.read(1):
        part = parse_length_prefixed(_PARTS[tag], stream)
        if isinstance(part, pb.AbortRow):
            table.rows.append(part)
            known = len(table.rows) <= CAPS["rows"] and len(part.legs) <= CAPS["row"]
        elif isinstance(part, pb.Segment):
            table.legs.append(part)
            known = _sound(part, rules)
        else:
            turn = divmod(len(table.flights), rules.drones)
            table.flights.append(part)
            known = (part.segment, part.drone) == turn and turn[0] < len(table.legs)
        if not known:
            raise ValueError(tag)
    table.DiscardUnknownFields()
    return table


def _flown(
    log: LogFile, times: Sequence[int], drones: dict[int, int], which: int, lasts: float
) -> PieceTable:
    """Gather the flights of a segment that ``lasts`` [s]; drones are by channel."""

    def flights() -> Iterator[tuple[pb.Trajectory, int]]:
        for drone, logged in enumerate(log.messages({*drones}, which, len(times))):
            found = _parsed(pb.Trajectory, logged)
            said = found.segment, found.drone, drones[logged.channel], logged.time
            many = len(found.meshes) > CAPS["knots"]
            if many or said != (which, drone, drone, times[which]):
                raise Damage(logged.offset, "a trajectory is not in its turn")
            found.ClearField("meshes")  # of them nothing is proved
            yield found, logged.offset

    return _table(flights(), lasts)


def _table(flights: Iterator[tuple[pb.Trajectory, int]], lasts: float) -> PieceTable:
    """Join the flights of a segment, each with its offset; Damage if one is odd."""
    tables, most = [], min(CAPS["pieces"], CAPS["few"] + CAPS["pace"] * lasts)
    # Few at a time, for memory that was used before is the fastest.
    while some := [*islice(flights, _AT_ONCE)]:
        for one, offset in some:
            if not _whole(one, most):
                raise Damage(offset, "a trajectory contradicts itself")
        for _, run in groupby(some, lambda x: (x[0].state_degree, x[0].control_degree)):
            tables.append(_together([*run]))
    return PieceTable.joined(tables)


def _whole(one: pb.Trajectory, most: float) -> bool:
    """Tell whether a flight has as many numbers as it says, and ``most`` pieces."""
    pieces, (states, controls) = len(one.breaks) - 1, WIDTHS
    return (
        0 < pieces <= most
        and max(one.state_degree, one.control_degree) <= CAPS["degree"]
        and len(one.state) == pieces * (one.state_degree + 1) * states
        and len(one.control) == pieces * (one.control_degree + 1) * controls
    )


def _together(flights: Sequence[tuple[pb.Trajectory, int]]) -> PieceTable:
    """Join flights of equal degrees, each with its offset."""
    some, whole = [one for one, _ in flights], pb.Trajectory()
    for one in some:
        whole.MergeFrom(one)  # its numbers after those before
    first = np.append(0, np.cumsum([len(one.breaks) - 1 for one in some]))
    cuts = (some_ + np.arange(len(some)) for some_ in (first[1:], first[:-1]))
    start, end = (np.delete(whole.breaks, cut) for cut in cuts)
    both = zip((whole.state, whole.control), WIDTHS, strict=True)
    curves = [np.array(flat).reshape(first[-1], -1, width) for flat, width in both]
    # Numbers that are undefined make the comparisons false.
    sound = (start > -LARGEST) & (start < end) & (end < LARGEST)
    for numbers in curves:
        sound &= np.abs(numbers.reshape(sound.size, -1)).max(axis=1) < LARGEST
    if not sound.all():
        odd = np.searchsorted(first, sound.argmin(), side="right") - 1
        raise Damage(flights[int(odd)][1], "a trajectory contradicts itself")
    drones = np.array([one.drone for one in some])
    return PieceTable(drones, first, start, end, *curves)
