"""Lies with fitting checksums: each changes a whole log, and names the check for it.

A log is taken apart into its messages, attachments and metadata, one thing is changed,
and another library writes it again, with every CRC, index and hash made to fit. To add
lies, write a generator of ``Lie`` and name it in ``TABLE``.
"""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field, replace
from io import BytesIO
from itertools import product
from math import comb
from operator import attrgetter
from typing import TYPE_CHECKING
from unittest.mock import patch

import numpy as np
import zstandard
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

from showc.log import showc_pb2 as pb
from showc.log.sample import POINT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

DAMAGE = "damage"
"""Instead of a code: the log is refused as a whole."""


@dataclass
class Message:
    """One message, and when it was logged."""

    topic: str
    time: int
    data: bytes
    published: int | None = None
    """Instead of the time [ns]."""
    sequence: int | None = None
    """Instead of how many came before it on its topic."""


@dataclass
class Log:
    """A log in parts that can be changed."""

    library: str
    metadata: list[tuple[str, dict[str, str]]]
    attachments: list[list]
    """Name, media type, time [ns], content."""
    schemas: dict[str, tuple[str, str, bytes]]
    """Of each topic: name, encoding, definition."""
    messages: list[Message]
    channel_metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    encoding: str = "protobuf"
    tail: bytes = b""
    """What follows the packed data inside each chunk."""
    profile: str = ""
    options: dict[str, object] = field(default_factory=dict)
    """How the other library writes, where showc writes otherwise."""
    copies: set[str] = field(default_factory=set)
    """Topics that get a schema of their own, whatever it says."""
    idle: list[str] = field(default_factory=list)
    """Topics without a message, of the fleet's schema."""

    @classmethod
    def read(cls, data: bytes) -> Log:
        """Take a log apart."""
        reader = make_reader(BytesIO(data))
        schemas, messages = {}, []
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            schemas[channel.topic] = schema.name, schema.encoding, schema.data
            messages.append(Message(channel.topic, message.log_time, message.data))
        return cls(
            reader.get_header().library,
            [(one.name, dict(one.metadata)) for one in reader.iter_metadata()],
            [
                [one.name, one.media_type, one.log_time, one.data]
                for one in reader.iter_attachments()
            ],
            schemas,
            messages,
        )

    def bytes(self) -> bytes:
        """Write it with every checksum and index."""
        target = BytesIO()
        usual = {"compression": CompressionType.ZSTD, "enable_data_crcs": True}
        writer = Writer(target, chunk_size=1 << 20, **(usual | self.options))
        writer.start(profile=self.profile, library=self.library)
        for name, content in self.metadata:
            writer.add_metadata(name, content)
        for name, media, time, content in self.attachments:
            writer.add_attachment(time, time, name, media, content)
        numbers: dict[tuple, int] = {}
        channels: dict[str, int] = {}
        counts: dict[str, int] = {}
        for message in self.messages:
            schema = self.schemas[message.topic]
            key = (message.topic, *schema) if message.topic in self.copies else schema
            if key not in numbers:
                numbers[key] = writer.register_schema(*schema)
            if message.topic not in channels:
                channels[message.topic] = writer.register_channel(
                    message.topic,
                    self.encoding,
                    numbers[key],
                    self.channel_metadata.get(message.topic, {}),
                )
            count = counts.get(message.topic, 0)
            counts[message.topic] = count + 1
            published, number = message.published, message.sequence
            writer.add_message(
                channels[message.topic],
                message.time,
                message.data,
                message.time if published is None else published,
                count if number is None else number,
            )
        for topic in self.idle:
            number = numbers[self.schemas["/fleet/state"]]
            writer.register_channel(topic, self.encoding, number)
        packed = zstandard.compress
        with patch("mcap.writer.zstandard.compress", lambda b: packed(b) + self.tail):
            writer.finish()
        return target.getvalue()

    def of(self, topic: str) -> list[Message]:
        """Messages of a topic, in order."""
        return [message for message in self.messages if message.topic == topic]

    def edit(self, topic: str, number: int, kind: type, change: Callable) -> None:
        """Change one decoded message."""
        message = self.of(topic)[number]
        decoded = kind.FromString(message.data)
        change(decoded)
        message.data = decoded.SerializeToString(deterministic=True)

    def attachment(self, name: str) -> list:
        """Attachment of that name."""
        return next(one for one in self.attachments if one[0] == name)

    @property
    def facts(self) -> dict[str, str]:
        """The metadata of the show."""
        return self.metadata[0][1]

    def manifest(self, change: Callable) -> None:
        """Change the manifest, and the hash that the metadata give of it."""
        entry = self.attachment("manifest.json")
        content = json.loads(entry[3])
        change(content)
        entry[3] = (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()
        self.facts["manifest_sha256"] = hashlib.sha256(entry[3]).hexdigest()

    def script(self, change: Callable[[bytes], bytes]) -> None:
        """Change the script, and every hash of it."""
        entry = self.attachment(self.facts["script"])
        entry[3] = change(entry[3])
        digest = hashlib.sha256(entry[3]).hexdigest()
        self.facts["script_sha256"] = digest
        self.manifest(lambda content: content["show"].update(sha256=digest))


@dataclass(frozen=True)
class Lie:
    """One change of a log, and the check that must fail for it."""

    name: str
    code: str
    """Code of the check, or ``DAMAGE``."""
    plant: Callable[[Log], None]
    script: bool = False
    """Whether it shows only beside the true script."""

    def told(self, log: Log) -> bytes:
        """Return the bytes of the log with the lie in it."""
        changed = deepcopy(log)
        self.plant(changed)
        return changed.bytes()


# Leaves of messages -----------------------------------------------------------------


def leaves(message, path=()) -> Iterator[tuple]:
    """Paths of all scalar fields, and of first and last elements of lists."""
    for entry in message.DESCRIPTOR.fields:
        here = (*path, entry.name)
        value = getattr(message, entry.name)
        if entry.message_type and entry.message_type.GetOptions().map_entry:
            continue
        if entry.is_repeated:
            yield (*here, "more")
            if len(value):
                yield (*here, "fewer")
            for at in sorted({0, len(value) - 1} if len(value) else ()):
                if entry.message_type:
                    yield from leaves(value[at], (*here, at))
                else:
                    yield (*here, at)
        elif entry.message_type:
            yield from leaves(value, here)
        else:
            yield here


def other(value):
    """Return a value that is not this one."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return value + "x"
    if isinstance(value, bytes):
        return value + b"x"
    return value + 1 if isinstance(value, int) else value * 1.5 + 0.01


def _first(message) -> None:
    """Append something to an empty list."""
    if hasattr(message, "add"):
        message.add()
        return
    for value in (1.0, 1, "x"):
        with suppress(TypeError):
            message.append(value)
            return


def mutate(message, path) -> None:
    """Change the leaf at a path."""
    *way, last = path
    for step in way:
        message = message[step] if isinstance(step, int) else getattr(message, step)
    if last == "fewer":
        del message[-1]
    elif last == "more":
        if not len(message):
            _first(message)
        elif hasattr(message, "add"):
            message.add().CopyFrom(message[-1])
        else:
            message.append(message[-1])
    elif isinstance(last, int):
        message[last] = other(message[last])
    else:
        setattr(message, last, other(getattr(message, last)))


def every_leaf(
    log: Log, place: tuple[str, int], kind, codes, leave=()
) -> Iterator[Lie]:
    """Yield a lie for each leaf of a message; ``codes`` by the start of its path."""
    topic, number = place
    decoded = kind.FromString(log.of(topic)[number].data)
    for path in leaves(decoded):
        name = ".".join(map(str, path))
        if any(name.startswith(start) for start in leave):
            continue
        code = next(code for start, code in codes.items() if name.startswith(start))

        def plant(found: Log, path=path) -> None:
            found.edit(topic, number, kind, lambda message: mutate(message, path))

        yield Lie(f"{topic}[{number}].{name}", code, plant)


# The table --------------------------------------------------------------------------


def rules(log: Log) -> Iterator[Lie]:
    """Every number that the log claims to be judged by."""
    codes = {
        "format_version": DAMAGE,
        "drones": DAMAGE,
        "duration": DAMAGE,
        "": "VRF203|damage",
    }
    yield from every_leaf(log, ("/show/rules", 0), pb.Rules, codes)

    def scaled(what, factor):
        def plant(found):
            def change(message):
                for limits in message.limits:
                    vector = getattr(limits, what)
                    if isinstance(vector, float):
                        setattr(limits, what, vector * factor)
                    else:
                        vector.x, vector.y, vector.z = (
                            factor * v for v in (vector.x, vector.y, vector.z)
                        )

            found.edit("/show/rules", 0, pb.Rules, change)

        return plant

    for what in (
        *("velocity_min", "velocity_max", "tilt", "body_rate", "thrust_max"),
        *("torque_max", "position_min", "position_max"),
    ):
        yield Lie(f"limits x 3: {what}", "VRF203", scaled(what, 3.0))

    def volume(message):
        for corner in (message.site.volume_min, message.site.volume_max):
            corner.x, corner.y, corner.z = 10 * corner.x, 10 * corner.y, 10 * corner.z

    yield Lie(
        "volume x 10",
        "VRF203",
        lambda found: found.edit("/show/rules", 0, pb.Rules, volume),
    )

    def nearer(message):
        message.separation.distance = 0.3

    yield Lie(
        "separation 0.3 m",
        "VRF203",
        lambda found: found.edit("/show/rules", 0, pb.Rules, nearer),
    )


def segments(log: Log) -> Iterator[Lie]:
    """What each kind of leg says of itself."""
    codes = {
        "index": DAMAGE,
        "start": DAMAGE,
        "duration": "VRF204|VRF335|damage",
        "drones": DAMAGE,
        "places": "VRF205|damage",
        "goals": "VRF205|damage",
        "certificate.closest": "VRF343|VRF107",
        "certificate": "VRF107|damage",
        "": "VRF204|damage",
    }
    leave = ("certificate.witness",)
    for number in (0, 1, 2, 3, 6, 8):
        yield from every_leaf(log, ("/show/segments", number), pb.Segment, codes, leave)


def metadata(log: Log) -> Iterator[Lie]:
    """Every key of the metadata."""
    for key in log.facts:
        code = "VRF201|VRF105" if key == "script" else "VRF105"

        def change(found, key=key):
            value = found.facts[key]
            try:
                found.facts[key] = repr(float(value) * 1.5 + 1.0)
            except ValueError:
                found.facts[key] = value + "x"

        yield Lie(f"metadata {key} changed", code, change)
        yield Lie(
            f"metadata {key} left out",
            code,
            lambda found, key=key: found.facts.pop(key),
        )
    yield Lie(
        "metadata with a key more", "VRF105", lambda found: found.facts.update(more="x")
    )
    yield Lie(
        "a second metadata record",
        "VRF105",
        lambda found: found.metadata.append(("showc", dict(found.facts))),
    )
    yield Lie(
        "metadata of another name",
        "VRF105",
        lambda found: found.metadata.append(("other", {"a": "b"})),
    )


def attachments(log: Log) -> Iterator[Lie]:
    """Every attachment: content, name, type, time; more, fewer, twice."""
    for name, *_ in log.attachments:
        code = "VRF106|VRF201|VRF202|VRF107"
        at = [one[0] for one in log.attachments].index(name)

        def change(index, value, at=at):
            def plant(found):
                found.attachments[at][index] = value(found.attachments[at][index])

            return plant

        yield Lie(f"{name} renamed", code, change(0, lambda old: old + "x"))
        yield Lie(f"{name} of another type", "VRF106", change(1, lambda _: "text/html"))
        yield Lie(f"{name} from another time", "VRF106", change(2, lambda t: t + 1))
        yield Lie(f"{name} with a byte more", code + "|VRF105", change(3, _longer))
        yield Lie(
            f"{name} left out",
            code + "|VRF105",
            lambda found, at=at: found.attachments.pop(at),
        )
        yield Lie(
            f"{name} twice",
            "VRF106",
            lambda found, at=at: found.attachments.append(list(found.attachments[at])),
        )
        yield Lie(
            f"{name} twice, the second another",
            "VRF106",
            lambda found, at=at: found.attachments.append(
                [*found.attachments[at][:3], b"other"]
            ),
        )
    yield Lie(
        "a further attachment",
        "VRF106",
        lambda found: found.attachments.append(
            ["more.bin", "application/octet-stream", found.attachments[0][2], b"x"]
        ),
    )


def _longer(content: bytes) -> bytes:
    return content + b" "


def manifest(log: Log) -> Iterator[Lie]:  # noqa: C901 - a table
    """What the manifest says of the flight, with fitting hashes."""
    content = json.loads(log.attachment("manifest.json")[3])

    def paths(value, way=()):
        if isinstance(value, dict):
            for key, inner in value.items():
                yield from paths(inner, (*way, key))
        elif isinstance(value, list) and value:
            yield from paths(value[0], (*way, 0))
        else:
            yield way

    for way in paths({k: v for k, v in content.items() if k not in FREE_MANIFEST}):
        if way[-1] == "assignment":
            continue

        def change(found, way=way):
            def inner(whole):
                *steps, last = way
                for step in steps:
                    whole = whole[step]
                value = whole[last]
                whole[last] = (
                    other(value) if isinstance(value, (int, float, str)) else "x"
                )

            found.manifest(inner)

        yield Lie(f"manifest {'.'.join(map(str, way))}", "VRF107", change)
    yield Lie(
        "manifest with a key more",
        "VRF107",
        lambda found: found.manifest(lambda whole: whole.update(more=1)),
    )
    yield Lie(
        "manifest of another version",
        "VRF107",
        lambda found: found.manifest(lambda m: m["versions"].update(showc="9.9")),
    )
    for key in content:
        yield Lie(
            f"manifest without {key}",
            "VRF107",
            lambda found, key=key: found.manifest(lambda whole: whole.pop(key)),
        )


FREE_MANIFEST = ("fleet", "versions", "missions")
"""What the flight does not fix; documented as not covered, or the missions' matter."""


def fleet(log: Log) -> Iterator[Lie]:  # noqa: C901 - a table
    """What a viewer draws of the fleet."""
    topic = "/fleet/state"
    for path in leaves(PointCloud.FromString(log.of(topic)[50].data)):
        if path == ("data",):
            continue

        def plant(found, path=path):
            found.edit(topic, 50, PointCloud, lambda message: mutate(message, path))

        yield Lie(f"{topic} {'.'.join(map(str, path))}", "VRF122", plant)
    for name in POINT.names or ():
        colour = POINT[name].itemsize == 1

        def plant(found, name=name, colour=colour):
            def change(message):
                points = np.frombuffer(message.data, dtype=POINT).copy()
                points[name][1] = (
                    points[name][1] // 2 + 7 if colour else points[name][1] + 2e-3
                )
                message.data = points.tobytes()

            found.edit(topic, 99, PointCloud, change)

        yield Lie(f"{topic} {name} of a drone", "VRF125" if colour else "VRF122", plant)

    def nothing(found):
        def change(message):
            points = np.frombuffer(message.data, dtype=POINT).copy()
            points["x"][0] = np.nan
            message.data = points.tobytes()

        found.edit(topic, 10, PointCloud, change)

    yield Lie(f"{topic} undefined", "VRF122", nothing)

    def swapped(found):
        for message in found.of(topic):
            cloud = PointCloud.FromString(message.data)
            points = np.frombuffer(cloud.data, dtype=POINT)[::-1]
            cloud.data = points.tobytes()
            message.data = cloud.SerializeToString(deterministic=True)

    yield Lie(f"{topic} drones changed over", "VRF122", swapped)


def states(log: Log) -> Iterator[Lie]:
    """What is plotted of single drones."""
    topic = "/drone/0002/state"
    decoded = pb.DroneState.FromString(log.of(topic)[80].data)
    for path in leaves(decoded):

        def plant(found, path=path):
            found.edit(topic, 80, pb.DroneState, lambda m: mutate(m, path))

        yield Lie(f"{topic} {'.'.join(path)}", "VRF123|VRF125", plant)


def frames(log: Log) -> Iterator[Lie]:
    """Frames of drones and of the show."""
    codes = {"": "VRF124"}
    yield from every_leaf(log, ("/tf", 0), FrameTransforms, codes)
    yield from every_leaf(log, ("/tf", 9), FrameTransforms, codes)


def scene(log: Log) -> Iterator[Lie]:
    """Everything drawn around the fleet."""
    yield from every_leaf(log, ("/show/scene", 0), SceneUpdate, {"": "VRF126"})


def timing(log: Log) -> Iterator[Lie]:
    """Messages more, fewer, at other times, after the end."""
    every = {message.topic for message in log.messages}
    for topic in sorted(every):
        code = "damage|VRF120|VRF121|VRF123|VRF124"

        def gone(found, topic=topic):
            found.messages = [m for m in found.messages if m.topic != topic]

        def fewer(found, topic=topic):
            found.messages.remove(found.of(topic)[-1])

        def late(found, topic=topic):
            again = replace(found.of(topic)[-1])
            again.time = found.messages[-1].time + 50_000_000
            found.messages.append(again)

        def moved(found, topic=topic):
            found.of(topic)[-1].time += 1000
            found.messages.sort(key=lambda message: message.time)

        yield Lie(f"{topic} left out", code, gone)
        yield Lie(f"{topic} without its last message", code, fewer)
        yield Lie(f"{topic} again after the end", code, late)
        yield Lie(f"{topic} 1 us later", code, moved)

    def unknown(name):
        def plant(found):
            found.schemas[name] = found.schemas["/fleet/state"]
            found.messages.append(replace(found.of("/fleet/state")[-1], topic=name))

        return plant

    for name in ("/other", "/fleet/state2", "/drone/0003/state", "/drone/3/state"):
        yield Lie(f"a topic more: {name}", "VRF120|VRF103|damage", unknown(name))


def channels(_: Log) -> Iterator[Lie]:
    """Schemas and channels."""
    for topic in ("/show/rules", "/fleet/state", "/tf", "/show/scene"):

        def named(found, topic=topic):
            name, encoding, data = found.schemas[topic]
            found.schemas[topic] = name + "x", encoding, data

        def encoded(found, topic=topic):
            name, _, data = found.schemas[topic]
            found.schemas[topic] = name, "jsonschema", data

        def noted(found, topic=topic):
            found.channel_metadata[topic] = {"more": "x"}

        yield Lie(f"{topic} of another type", "VRF103", named)
        yield Lie(f"{topic} schema in another encoding", "VRF103|VRF104", encoded)
        yield Lie(f"{topic} channel with metadata", "VRF103", noted)

    def json_encoding(found):
        found.encoding = "json"

    yield Lie("messages in another encoding", "VRF103", json_encoding)

    def library(found):
        found.library = "showc 9.9.9"

    yield Lie("another version in the header", "VRF105", library)


def trajectories(log: Log) -> Iterator[Lie]:
    """The polynomials themselves: numbers, breaks, owners."""
    topic = "/drone/0001/trajectory"
    codes = {
        "segment": DAMAGE,
        "drone": DAMAGE,
        "breaks": "damage|VRF335",
        "state_degree": DAMAGE,
        "control_degree": DAMAGE,
        "": "damage|VRF331|VRF301|VRF302|VRF122",
    }
    # The solver's diary stands in the table of what is not covered.
    leave = ("meshes",)
    for number in (0, 2):
        yield from every_leaf(log, (topic, number), pb.Trajectory, codes, leave)

    def component(index, amount):
        def plant(found):
            def change(message):
                for row in range(len(message.state) // 12):
                    message.state[12 * row + index] += amount

            found.edit(topic, 2, pb.Trajectory, change)

        return plant

    for index, name in enumerate(
        ("x", "y", "z", "vx", "vy", "vz", "roll", "pitch", "yaw", "p", "q", "r")
    ):
        yield Lie(
            f"{name} of a leg off by 0.01",
            "VRF122|VRF301|VRF302|VRF331|VRF337",
            component(index, 0.01),
        )


def script(log: Log) -> Iterator[Lie]:
    """Another script attached, with every hash made to fit."""
    words = {
        "separation: 1": "separation: 0.3",
        "latitude: 48.1374": "latitude: 48.1375",
        "longitude: 11.5755": "longitude: 11.5756",
        "altitude: 520": "altitude: 521",
        "heading: 30": "heading: 31",
        "max: [40, 40, 60]": "max: [400, 400, 600]",
        "[45, 0]": "[46, 0]",
        "climb_speed: 3": "climb_speed: 9",
        "descent_speed: 3": "descent_speed: 9",
        "hold: 1.5": "hold: 1.6",
        "launch: {altitude: 6": "launch: {altitude: 7",
        "landing: {altitude: 6": "landing: {altitude: 7",
        "name: Proved": "name: Improved",
        "fade: end": "fade: start",
        "period: 1": "period: 2",
        "white, dodgerblue": "white, red",
        "vehicle: formation-625g": "vehicle: {preset: formation-625g, mass: 0.7}",
        "drones: 2": "drones: 3",
        "to: level, hold: 1": "to: level, duration: 9, hold: 1",
        "kind: pulse": "kind: rainbow",
        "showc: 1": "showc: 1\nseparation_shape: x",
    }
    code = "VRF202|VRF203|VRF204|VRF205|VRF125|VRF105|VRF106|VRF126"
    for old, new in words.items():
        assert old.encode() in log.attachment(log.facts["script"])[3], old

        def plant(found, old=old, new=new):
            found.script(lambda text: text.replace(old.encode(), new.encode()))

        yield Lie(f"the script says {new!r}", code, plant)
    yield Lie("no script at all", "VRF202", lambda found: found.script(lambda _: b""))

    def comment(found):
        found.script(lambda text: text + b"# the same in other bytes\n")

    yield Lie("another script that says the same", "VRF201", comment, script=True)

    def together(found):
        found.script(lambda text: text.replace(b"separation: 1", b"separation: 0.3"))

        def change(message):
            message.separation.distance = 0.3

        found.edit("/show/rules", 0, pb.Rules, change)

    yield Lie("script and rules of 0.3 m together", "VRF201", together, script=True)


def hostile(_: Log) -> Iterator[Lie]:  # noqa: C901 - a table
    """Sizes that would keep a verifier busy for ever."""

    def endless(found):
        legs = [pb.Segment.FromString(one.data) for one in found.of("/show/segments")]
        number = next(k for k, leg in enumerate(legs) if leg.kind == leg.HOLD)
        more = 1e6 - legs[number].duration

        def longer(message):
            message.duration += more

        found.edit("/show/rules", 0, pb.Rules, longer)
        epoch = found.messages[0].time
        for at, leg in enumerate(legs):
            if at == number:
                found.edit("/show/segments", at, pb.Segment, longer)
            if leg.start > legs[number].start:

                def later(message):
                    message.start += more

                found.edit("/show/segments", at, pb.Segment, later)
        for drone in range(1, 3):

            def held(message):
                message.breaks[-1] = 1e6

            found.edit(f"/drone/{drone:04d}/trajectory", number, pb.Trajectory, held)
        for message in found.messages:
            if message.time - epoch > legs[number].start * 1e9 + 1.0:
                message.time += round(more * 1e9)

    def witness(found):
        def change(message):
            certificate = message.certificate
            certificate.dual_bound = certificate.witness.time = 0.5
            certificate.witness.knots.extend(np.linspace(0.0, 1.0, 100_000))
            certificate.witness.multipliers.extend([0.001] * 300_000)

        found.edit("/show/segments", 0, pb.Segment, change)

    def pieces(found):
        def change(message):
            count, end = 100_000, message.breaks[-1]
            state, control = list(message.state[:12]), list(message.control[:4])
            del message.breaks[:], message.state[:], message.control[:]
            message.state_degree = message.control_degree = 0
            message.breaks.extend(np.linspace(0.0, end, count + 1))
            message.state.extend(state * count)
            message.control.extend(control * count)

        found.edit("/drone/0001/trajectory", 2, pb.Trajectory, change)

    def fast(found):
        def change(message):
            message.log_rate = 999.0

        found.edit("/show/rules", 0, pb.Rules, change)

    def wide(found):
        found.script(lambda _: b"showc: 1\na: [" + b"1," * 1_900_000 + b"1]\n")

    yield Lie("a hold of 1e6 s", DAMAGE, endless)
    yield Lie("a witness of 100,000 knots", DAMAGE, witness)
    yield Lie("a trajectory of 100,000 intervals", DAMAGE, pieces)
    yield Lie("999 samples a second", "VRF203", fast)
    yield Lie("a script of two million values", "VRF202", wide)


def crowds(_: Log) -> Iterator[Lie]:
    """Parts by the hundred thousand: few bytes of a file, and much memory."""

    def parts(topic, number, tag):
        def plant(found):
            found.of(topic)[number].data += 200_000 * tag

        return plant

    def heavy(found):
        for message in found.of("/fleet/state")[:20]:
            message.data = bytes(100_000)

    def digits(found):
        name = "/drone/" + "1" * 5000 + "/trajectory"
        found.schemas[name] = found.schemas["/drone/0001/trajectory"]
        for message in found.of("/drone/0001/trajectory"):
            message.topic = name

    def ages(found):
        found.schemas["/fleet/predicted"] = found.schemas["/fleet/state"]
        last = replace(found.of("/fleet/state")[-1], time=2**63 - 1)
        found.messages.append(replace(last, topic="/fleet/predicted"))
        found.manifest(lambda m: m["missions"].update(autopilot="ardupilot"))

    yield Lie("a drone of 5,000 digits", DAMAGE, digits)
    yield Lie("missions that last for centuries", "VRF127", ages)
    yield Lie("rules of many limits", DAMAGE, parts("/show/rules", 0, b"\x62\0"))
    yield Lie("a leg of many moves", DAMAGE, parts("/show/segments", 2, b"\x6a\0"))
    many = parts("/drone/0001/trajectory", 2, b"\x42\0")
    yield Lie("a flight found on many meshes", DAMAGE, many)
    yield Lie("samples of any size", "VRF122", heavy)


def tails(_: Log) -> Iterator[Lie]:
    """Bytes that no reader unpacks, beside the packed data of a chunk."""
    hidden = b"\x50\x2a\x4d\x18\x06\x00\x00\x00hidden"
    for name, tail in (
        ("bytes", b"evil"),
        ("a frame to be skipped", hidden),
        ("a second frame", zstandard.compress(b"evil")),
    ):

        def plant(found, tail=tail):
            found.tail = tail

        yield Lie(f"{name} behind the data of a chunk", DAMAGE, plant)


def claims(log: Log) -> Iterator[Lie]:
    """Claims of log and manifest that agree, and are not true."""
    topic = "/show/segments"
    leg = pb.Segment.FromString(log.of(topic)[2].data)
    breaks, state = {}, {}
    for drone in (1, 2):
        data = log.of(f"/drone/{drone:04d}/trajectory")[2].data
        flight = pb.Trajectory.FromString(data)
        breaks[drone] = flight.breaks[-1]
        state[drone] = np.array(flight.state).reshape(-1, 12)
    away = float(np.linalg.norm(state[1][-1, :3] - state[2][-1, :3]))
    nearest = leg.certificate.closest.distance

    def both(message, words):
        def plant(found):
            found.edit(topic, 2, pb.Segment, message)
            found.manifest(lambda whole: words(whole["segments"][2]["certificate"]))

        return plant

    def later(message):
        message.certificate.closest.time = breaks[1]
        message.certificate.closest.distance = away

    def later_in_words(certificate):
        certificate["closest"].update(time=breaks[1], distance=away)

    if abs(away - nearest) > 2e-3:
        yield Lie(
            "the closest encounter is another one",
            "VRF343",
            both(later, later_in_words),
        )
    yield Lie(
        "no closest encounter",
        "VRF343",
        both(
            lambda message: message.certificate.ClearField("closest"),
            lambda certificate: certificate.update(closest=None),
        ),
    )

    def further(found):
        nowhere = pb.Encounter(drone_a=0, drone_b=1, time=0.0, distance=99.0)
        found.edit(
            topic, 1, pb.Segment, lambda m: m.certificate.closest.CopyFrom(nowhere)
        )
        words = {"drones": [1, 2], "time": 0.0, "distance": 99.0}
        found.manifest(
            lambda whole: whole["segments"][1]["certificate"].update(closest=words)
        )

    yield Lie("a hold in which drones are further apart", "VRF343", further)

    def release(found, words="showc 1.0 (certified)\n::error::x"):
        found.library = words
        found.facts["showc_version"] = words.removeprefix("showc ")
        found.manifest(
            lambda whole: whole["versions"].update(showc=words.removeprefix("showc "))
        )

    yield Lie("a release of many words", "VRF107", release)


def documents(log: Log) -> Iterator[Lie]:
    """Manifests that two readers read in two ways, or that say more."""

    def rewritten(change):
        def plant(found):
            entry = found.attachment("manifest.json")
            entry[3] = change(entry[3])
            digest = hashlib.sha256(entry[3]).hexdigest()
            found.facts["manifest_sha256"] = digest

        return plant

    for name, change in (
        ("a key twice", lambda b: b.replace(b'"drones"', b'"drones": 9, "drones"', 1)),
        ("an inner key twice", lambda b: b.replace(b'"kind"', b'"kind": 1, "kind"', 1)),
        ("a number that is none", lambda b: b.replace(b'"gap": 0', b'"gap": NaN', 1)),
        ("a mark before it", lambda b: b"\xef\xbb\xbf" + b),
        ("another document behind it", lambda b: b + b"{}"),
    ):
        if (
            change(log.attachment("manifest.json")[3])
            != (log.attachment("manifest.json")[3])
        ):
            yield Lie(f"manifest with {name}", "VRF107", rewritten(change))
    for key in ("autopilot", "start", "warnings", "prediction", "files"):
        yield Lie(
            f"missions of the manifest without {key}",
            "VRF107",
            lambda found, key=key: found.manifest(lambda m: m["missions"].pop(key)),
        )
    yield Lie(
        "missions of the manifest say more",
        "VRF107",
        lambda found: found.manifest(lambda m: m["missions"].update(more=1)),
    )


def drawn(_: Log) -> Iterator[Lie]:  # noqa: C901 - a table
    """Messages that decode, and are not what showc writes."""
    unknown = b"\xfa\x3f\x03abc"
    for topic, code in (
        ("/show/rules", DAMAGE),
        ("/show/segments", DAMAGE),
        ("/drone/0001/trajectory", DAMAGE),
        ("/drone/0001/state", "VRF123"),
        ("/fleet/state", "VRF122"),
        ("/tf", "VRF124"),
        ("/show/scene", "VRF126"),
    ):

        def more(found, topic=topic):
            found.of(topic)[-1].data += unknown

        def twice(found, topic=topic):
            message = found.of(topic)[-1]
            message.data += message.data

        yield Lie(f"{topic} with a field that is not known", code, more)
        yield Lie(f"{topic} twice in a message", f"{code}|VRF203|damage", twice)

    def empty(found):
        for number in range(1, len(found.of("/tf"))):
            found.edit("/tf", number, FrameTransforms, lambda m: m.Clear())

    def exchanged(found):
        one, other = found.of("/drone/0001/state"), found.of("/drone/0002/state")
        for first, second in zip(one, other, strict=True):
            first.data, second.data = second.data, first.data

    def root(found):
        first, second = found.of("/tf")[:2]
        first.data, second.data = second.data, first.data

    def circle(found):
        for number in range(len(found.of("/drone/0001/trajectory"))):

            def turned(message):
                for row in range(len(message.state) // 12):
                    message.state[12 * row + 8] += 2.0 * np.pi

            found.edit("/drone/0001/trajectory", number, pb.Trajectory, turned)

    def late(found):
        for message in found.messages:
            message.time += 10**9

    def none(found):
        found.schemas["/fleet/predicted"] = found.schemas["/fleet/state"]
        last = found.of("/fleet/state")[-1]
        found.messages.append(replace(last, topic="/fleet/predicted"))

    yield Lie("frames of no drone", "VRF124", empty)
    yield Lie("samples of two drones exchanged", "VRF123", exchanged)
    yield Lie("the root in the place of the first frames", "VRF124", root)
    yield Lie("a drone turned by a whole circle", "VRF332", circle)
    yield Lie("all messages a second later", "VRF105", late)
    yield Lie("the fleet in the place of the predicted one", "VRF127|damage", none)


def small_numbers(_: Log) -> Iterator[Lie]:
    """Numbers of the vehicle off by less than a billionth, which is much of them."""

    def more(way):
        def plant(found):
            def change(message):
                *steps, last = way.split(".")
                for step in steps:
                    message = getattr(message, step)
                setattr(message, last, getattr(message, last) + 9e-10)

            found.edit("/show/rules", 0, pb.Rules, change)

        return plant

    for way in (
        *("thrust_coefficient", "torque_coefficient", "arm_length"),
        *("inertia.x", "inertia.y", "inertia.z"),
    ):
        yield Lie(f"{way} more by 9e-10", "VRF203", more(f"vehicle.{way}"))

    def torque(found):
        def change(message):
            for limits in message.limits:
                limits.torque_max.z += 9e-10

        found.edit("/show/rules", 0, pb.Rules, change)

    yield Lie("torque_max.z more by 9e-10", "VRF203", torque)


def wobbles(log: Log) -> Iterator[Lie]:
    """Holds in which drones fly exactly, keep every limit, and do not hold."""
    topic = "/drone/0001/trajectory"
    flights = [pb.Trajectory.FromString(one.data) for one in log.of(topic)]
    rules = pb.Rules.FromString(log.of("/show/rules")[0].data)
    for number, flight in enumerate(flights):
        if flight.state_degree == 0:

            def plant(found, number=number, size=0.02):
                def change(message):
                    _wobble(message, rules.vehicle, size)

                found.edit(topic, number, pb.Trajectory, change)

            yield Lie(f"hold {number} is flown up and down", "VRF331", plant)


def _wobble(message, vehicle, size: float) -> None:
    """Fly up and back over the time of a hover: z by a polynomial of degree 6."""
    time, state = message.breaks[-1], np.array(message.state)
    height = size * np.polynomial.Polynomial([0, 0, 0, 64, -192, 192, -64])
    climb, push = (height.deriv(k) / time**k for k in (1, 2))
    rows = np.tile(state, (7, 1))
    rows[:, 2] += _bernstein(height)
    rows[:, 5] += _bernstein(climb)
    control = np.zeros((7, 4))
    control[:, 0] = vehicle.mass * (vehicle.gravity + _bernstein(push))
    message.state_degree = message.control_degree = 6
    del message.state[:], message.control[:]
    message.state.extend(rows.ravel())
    message.control.extend(control.ravel())


def _bernstein(polynomial) -> np.ndarray:
    """Bernstein coefficients of degree 6."""
    power = np.zeros(7)
    power[: len(polynomial.coef)] = polynomial.coef
    return np.array(
        [
            sum(comb(j, k) / comb(6, k) * power[k] for k in range(j + 1))
            for j in range(7)
        ]
    )


def odd_claims(log: Log) -> Iterator[Lie]:
    """Certificates that log and manifest claim alike, and that cannot be."""
    legs = [pb.Segment.FromString(one.data) for one in log.of("/show/segments")]
    for (number, duration), (name, code, changes) in product(
        [(at, legs[at].duration) for at in (1, 2)],
        _odd_claims(legs[2].duration),
    ):

        def plant(found, changes=changes, number=number, duration=duration):
            def change(message):
                certificate = message.certificate
                certificate.single_drone_minimum = changes.get("single", 0.0)
                certificate.dual_bound = changes.get("bound", 0.0)
                if "drone" in changes:
                    certificate.witness.drone = changes["drone"]
                    certificate.witness.time = 1.0

            def words(whole):
                certificate = whole["segments"][number]["certificate"]
                single = changes.get("single", 0.0)
                gap = duration / single - 1.0 if single > 0.0 else 0.0
                certificate.update(single_drone_minimum=single, gap=gap)
                certificate.update(dual_bound=changes.get("bound", 0.0))
                if "drone" in changes:
                    certificate["witness"] = {
                        "drone": changes["drone"] + 1,
                        "time": 1.0,
                        "beta": [0.0, 0.0, 0.0],
                        "knots": [],
                        "multipliers": [],
                    }

            found.edit("/show/segments", number, pb.Segment, change)
            found.manifest(words)

        yield Lie(f"{name}, in the {legs[number].name}", code, plant)


def _odd_claims(duration):
    """Name, code, and what is claimed."""
    return (
        ("single drone slower than the fleet", "VRF342", {"single": 2.0 * duration}),
        ("a negative single-drone minimum", "VRF342", {"single": -1.0}),
        ("a negative bound", "VRF342", {"bound": -5.0}),
        ("a bound without a witness", "VRF341", {"bound": 0.1}),
        ("a witness of nothing", "VRF341", {"drone": 0}),
        ("a witness of no drone", "VRF341", {"drone": 99}),
    )


def _nested(depth: int) -> list:
    """A list in a list in a list, and so on."""
    found: list = []
    for _ in range(depth):
        found = [found]
    return found


def words(_: Log) -> Iterator[Lie]:
    """Words that nothing fixes, in forms that no compile writes."""
    for name, change in (
        ("an assignment of a number", lambda m: m["segments"][2].update(assignment=5)),
        ("an assignment of its own", lambda m: m["segments"][2].update(assignment={})),
        ("a version of words", lambda m: m["versions"].update({"proved by": "1.0"})),
        ("no version of numpy", lambda m: m["versions"].pop("numpy")),
        ("a version of escapes", lambda m: m["versions"].update(numpy="\x1b[2J")),
        ("a version of many", lambda m: m["versions"].update(numpy={"a": [1]})),
        ("a version of lists", lambda m: m["versions"].update(numpy=_nested(800))),
        ("a release of a number", lambda m: m["versions"].update(python=3.11)),
        ("drones of 400 digits", lambda m: m.update(drones=10**400)),
        ("drones beyond floats", lambda m: m.update(drones=-(10**4000))),
        ("drones in 800 lists", lambda m: m.update(drones=_nested(800))),
        ("a leg in 800 lists", lambda m: m.update(segments=_nested(800))),
        ("missions in 800 lists", lambda m: m.update(missions=_nested(800))),
        ("a start in 800 lists", lambda m: m["missions"].update(start=_nested(800))),
        ("an autopilot of a number", lambda m: m["missions"].update(autopilot=12)),
        ("a fleet in 800 lists", lambda m: m.update(fleet=_nested(800))),
        ("a fleet of a number", lambda m: m.update(fleet=5)),
        ("a fleet of a word", lambda m: m.update(fleet="PROVED")),
        ("warnings by name", lambda m: m["missions"].update(warnings={"a": 1})),
        ("warnings of numbers", lambda m: m["missions"].update(warnings=[1])),
        ("no missions, which start", lambda m: m["missions"].update(start="2030")),
        ("no missions in files", lambda m: m["missions"].update(files={"a": "b"})),
        (
            "no missions, foretold",
            lambda m: m["missions"].update(prediction={"nearest": 9}),
        ),
    ):
        yield Lie(
            f"manifest with {name}",
            "VRF107",
            lambda found, change=change: found.manifest(change),
        )

    def foretold(found):
        found.schemas["/fleet/predicted"] = found.schemas["/fleet/state"]
        for message in found.of("/fleet/state"):
            found.messages.append(replace(message, topic="/fleet/predicted"))
        found.messages.sort(key=lambda message: message.time)

    def unknown(found):
        foretold(found)
        found.manifest(lambda m: m["missions"].update(autopilot="px4"))

    yield Lie("no missions, whose fleet is drawn", "VRF107", foretold)
    yield Lie("missions whose flight is not known are drawn", "VRF107", unknown)


def codings(log: Log) -> Iterator[Lie]:
    """Messages that all readers decode alike, and that no compile writes so."""
    for topic, code in (
        ("/show/rules", DAMAGE),
        ("/show/segments", DAMAGE),
        ("/drone/0001/trajectory", DAMAGE),
        ("/drone/0001/state", "VRF123"),
        ("/fleet/state", "VRF122"),
        ("/tf", "VRF124"),
        ("/show/scene", "VRF126"),
    ):
        for name, before, after in (
            ("a number that is not known", b"", b"\xf8\x7f\x01"),
            ("an empty group", b"", b"\xfb\x7f\xfc\x7f"),
            ("a first field twice", log.of(topic)[0].data[:2], b""),
        ):

            def plant(found, topic=topic, before=before, after=after):
                message = found.of(topic)[0]
                message.data = before + message.data + after

            if name != "a first field twice" or before[:1] == b"\x08":
                yield Lie(f"{topic} with {name}", code, plant)

    def long(found):
        message = found.of("/drone/0001/trajectory")[3]
        assert message.data[0] == 0x08
        number = message.data[1]
        message.data = bytes([0x08, number | 0x80, 0]) + message.data[2:]

    yield Lie("a number in more bytes than it takes", DAMAGE, long)


def senses(_: Log) -> Iterator[Lie]:  # noqa: C901 - a table
    """Samples that another program would take for the same, or nearly so."""
    topic = "/fleet/state"

    def every(change):
        def plant(found):
            for message in found.of(topic):
                cloud = PointCloud.FromString(message.data)
                points = np.frombuffer(cloud.data, dtype=POINT).copy()
                change(points)
                cloud.data = points.tobytes()
                message.data = cloud.SerializeToString(deterministic=True)

        return plant

    def turned(points):
        for name in ("qx", "qy", "qz", "qw"):
            points[name] = -points[name]

    def exchanged(points):
        points[["red", "blue"]] = points[["blue", "red"]].tolist()

    def brighter(points):
        points["green"] = np.where(points["green"] < 254, points["green"] + 2, 0)

    def endless(points):
        points["u3"][0] = np.inf

    def nothing(points):
        points["qx"][0] = np.array([0x7FC12345], "<u4").view("<f4")[0]

    for name, change, code in (
        ("quaternions of the other sign", turned, "VRF122"),
        ("red for blue", exchanged, "VRF125"),
        ("green brighter by two", brighter, "VRF125"),
        ("an endless torque", endless, "VRF122"),
        ("a quaternion of no number", nothing, "VRF122"),
    ):
        yield Lie(f"{topic} with {name}", code, every(change))

    def hour(found):
        for message in found.messages:
            message.time += 3_600_000_000_000
        for entry in found.attachments:
            entry[2] += 3_600_000_000_000
        epoch = int(found.facts["epoch_ns"]) + 3_600_000_000_000
        found.facts["epoch_ns"] = str(epoch)

    yield Lie("all times an hour later", "VRF105", hour)


def containers(log: Log) -> Iterator[Lie]:  # noqa: C901 - a table
    """Files that other readers take for the same, and that no compile writes so."""
    every = IndexType.ALL

    def options(**chosen):
        def plant(found):
            found.options = chosen

        return plant

    for name, plant in (
        ("without chunks", options(use_chunking=False)),
        ("packed with lz4", options(compression=CompressionType.LZ4)),
        ("not packed", options(compression=CompressionType.NONE)),
        ("without indexes of messages", options(index_types=every ^ IndexType.MESSAGE)),
        ("without an index of chunks", options(index_types=every ^ IndexType.CHUNK)),
        (
            "without an index of attachments",
            options(index_types=every ^ IndexType.ATTACHMENT),
        ),
        (
            "without an index of metadata",
            options(index_types=every ^ IndexType.METADATA),
        ),
        ("without statistics", options(use_statistics=False)),
        ("without channels in the summary", options(repeat_channels=False)),
        ("without schemas in the summary", options(repeat_schemas=False)),
        ("without offsets in the summary", options(use_summary_offsets=False)),
    ):
        yield Lie(f"a file {name}", DAMAGE, plant)

    def profile(found):
        found.profile = "ros2"

    yield Lie("a profile of another program", DAMAGE, profile)
    for topic in ("/fleet/state2", "/drone/0003/state", "/fleet/predicted"):

        def idle(found, topic=topic):
            found.idle.append(topic)

        yield Lie(f"{topic} without a message", "VRF120|VRF103|VRF107", idle)
    for topic in ("/drone/0002/state", "/drone/0002/trajectory"):

        def copied(found, topic=topic):
            found.copies.add(topic)

        yield Lie(f"{topic} with a schema of its own", "VRF103", copied)

    def order(found):
        found.attachments.reverse()

    def keys(found):
        name, facts = found.metadata[0]
        found.metadata[0] = name, dict(reversed(facts.items()))

    yield Lie("attachments in another order", "VRF106", order)
    yield Lie("metadata in another order", "VRF105", keys)
    for topic in sorted({message.topic for message in log.messages}):

        def published(found, topic=topic):
            message = found.of(topic)[-1]
            message.published = message.time + 1

        def numbered(found, topic=topic):
            for number, message in enumerate(found.of(topic), start=1):
                message.sequence = number

        def later(found, topic=topic):
            found.of(topic)[-1].time += 1
            found.messages.sort(key=attrgetter("time"))

        def earlier(found, topic=topic):
            found.of(topic)[0].time -= 1
            found.messages.sort(key=attrgetter("time"))

        codes = "damage|VRF105|VRF120|VRF121|VRF122|VRF123|VRF124"
        yield Lie(f"{topic} published a nanosecond later", DAMAGE, published)
        yield Lie(f"{topic} numbered from one", DAMAGE, numbered)
        yield Lie(f"the last {topic} a nanosecond later", codes, later)
        yield Lie(f"the first {topic} a nanosecond earlier", codes, earlier)


def _edited(topic, number, kind, change) -> Callable[[Log], None]:
    return lambda found: found.edit(topic, number, kind, change)


def finest_flights(_: Log) -> Iterator[Lie]:
    """Polynomials at the ends of what numbers can be."""
    flight = "/drone/0001/trajectory"

    def broken(message, at, value):
        message.breaks[at] = value

    def empty(message):
        pieces = len(message.breaks) - 1
        state = len(message.state) // pieces
        control = len(message.control) // pieces
        message.breaks.insert(0, message.breaks[0])
        message.state[:] = [*message.state[:state], *message.state]
        message.control[:] = [*message.control[:control], *message.control]

    def lifted(message, degree):
        # The same polynomials, written in a degree that costs digits.
        pieces = len(message.breaks) - 1
        state = np.array(message.state).reshape(pieces, -1, 12)
        rows = np.repeat(state[:, :1], degree + 1, axis=1)
        message.state_degree = degree
        message.state[:] = rows.ravel().tolist()

    def away(message, amount):
        for row in range(len(message.state) // 12):
            message.state[12 * row + 8] += amount

    nowhere = float("nan")
    for name, number, change in (
        ("begins before its leg", 2, lambda m: broken(m, 0, -1e-3)),
        ("begins a denormal late", 2, lambda m: broken(m, 0, nowhere)),
        ("ends nowhere", 2, lambda m: broken(m, -1, float("inf"))),
        ("has an interval of no time", 2, empty),
        ("has polynomials of degree 61", 1, lambda m: lifted(m, 61)),
        ("has more of a degree than it says", 2, lambda m: m.state.append(0.0)),
        ("says no degree", 2, lambda m: setattr(m, "control_degree", 0)),
        ("is of a drone that is not", 2, lambda m: setattr(m, "drone", 2**32 - 1)),
        ("is of a leg that is not", 2, lambda m: setattr(m, "segment", 2**32 - 1)),
    ):
        plant = _edited(flight, number, pb.Trajectory, change)
        yield Lie(f"a trajectory {name}", "damage|VRF335", plant)
    for amount in (1e-5, -1e-5, 2.0 * np.pi):
        plant = _edited(flight, 1, pb.Trajectory, lambda m, a=amount: away(m, a))
        codes = "VRF332|VRF337|VRF122"
        yield Lie(f"a hold turned by {amount:g} rad", codes, plant)


def finest_claims(_: Log) -> Iterator[Lie]:
    """Words and numbers of legs at the ends of what they can be."""
    leg, nowhere = "/show/segments", float("nan")

    def certificate(**changes):
        def change(message):
            for key, value in changes.items():
                setattr(message.certificate, key, value)

        return change

    for name, change, code in (
        ("no number for a bound", certificate(dual_bound=nowhere), DAMAGE),
        ("an endless bound", certificate(dual_bound=float("inf")), DAMAGE),
        ("no number for a minimum", certificate(single_drone_minimum=nowhere), DAMAGE),
        (
            "a bound less than nothing",
            certificate(dual_bound=-5e-324),
            "VRF107|VRF341|VRF342",
        ),
        ("an encounter of no number", lambda m: _met(m, nowhere), "VRF343"),
        ("an encounter before the leg", lambda m: _met_at(m, -1e-6), "VRF343|VRF107"),
        ("a duration a denormal long", lambda m: setattr(m, "duration", 5e-324), ""),
        ("a start of no number", lambda m: setattr(m, "start", nowhere), DAMAGE),
        ("a place beyond all", lambda m: _placed(m, 2**31 - 1), "VRF205"),
        ("a place less than parked", lambda m: _placed(m, -2), "VRF205"),
        ("limits that are not", lambda m: setattr(m, "limits", 2**32 - 1), DAMAGE),
        ("a name in other letters", lambda m: setattr(m, "name", "lаunch"), "VRF204"),
        ("a name that ends it", lambda m: setattr(m, "name", m.name + "\0"), "VRF204"),
        ("a name of escapes", lambda m: setattr(m, "name", "\x1b[2J"), "VRF204"),
        ("moves of groups", lambda m: m.moves.add(name=m.name), "VRF204"),
        ("a group's witness of 100,000 knots", _many_knots, DAMAGE),
        ("a group's motion", lambda m: setattr(m, "kind", pb.Segment.MOTION), "VRF204"),
    ):
        plant = _edited(leg, 2, pb.Segment, change)
        yield Lie(f"a leg with {name}", code or "damage|VRF204", plant)


def finest_samples(_: Log) -> Iterator[Lie]:
    """Samples that are off by little, or seen through."""
    fleet = "/fleet/state"

    def points(change):
        def inner(message):
            table = np.frombuffer(message.data, dtype=POINT).copy()
            change(table)
            message.data = table.tobytes()

        return _edited(fleet, 30, PointCloud, inner)

    def through(table):
        table["alpha"] = 254

    def double(table):
        table[1] = table[0]

    yield Lie("a fleet that is hardly seen through", "VRF125|VRF122", points(through))
    yield Lie("a drone drawn in the place of another", "VRF122", points(double))
    for name in ("x", "vx", "qx", "wx", "u0", "u1"):

        def step(table, name=name):
            # Two steps of the finest number that a sample can have there.
            table[name][0] = np.nextafter(table[name][0] + 3e-3, np.float32(9))

        yield Lie(f"{fleet} {name} three thousandths off", "VRF122", points(step))


def finest_rules(_: Log) -> Iterator[Lie]:
    """Rules at the ends of what numbers can be."""
    nowhere = float("nan")

    def rules(name, change, code="VRF203|damage"):
        return Lie(
            f"rules with {name}", code, _edited("/show/rules", 0, pb.Rules, change)
        )

    yield rules("a heading of no number", lambda m: setattr(m, "heading", nowhere))
    yield rules("a heading a circle on", lambda m: setattr(m, "heading", 2 * np.pi))
    yield rules("a fence of one number", lambda m: m.site.fence.append(1.0))
    yield rules("a fence beyond all", lambda m: m.site.fence.extend([1e308, 1e308]))
    yield rules("no limits", lambda m: m.ClearField("limits"))
    yield rules("no formations", lambda m: m.ClearField("formations"))
    yield rules("a formation twice", lambda m: m.formations.append(m.formations[0]))
    yield rules("no drones", lambda m: setattr(m, "drones", 0), DAMAGE)
    yield rules("endless time", lambda m: setattr(m, "duration", float("inf")), DAMAGE)
    yield rules("a rate of nothing", lambda m: setattr(m, "log_rate", 0.0))
    yield rules("another shape", lambda m: setattr(m.separation, "shape", 2))
    yield rules(
        "a margin less than none", lambda m: setattr(m.site, "fence_margin", -1)
    )
    yield rules("a name that ends it", lambda m: setattr(m, "name", "Proved\0"))


def _met(message, distance) -> None:
    message.certificate.closest.distance = distance


def _met_at(message, time) -> None:
    message.certificate.closest.time = time


def _many_knots(message) -> None:
    message.moves.add().certificate.witness.knots.extend(np.linspace(0.0, 1.0, 100_000))


def _placed(message, place) -> None:
    message.places[0] = place


TABLE = (
    *(rules, segments, metadata, attachments, manifest, fleet, states, frames),
    *(scene, timing, channels, trajectories, script, hostile),
    *(crowds, tails, claims, documents, drawn, small_numbers, wobbles, odd_claims),
    *(words, codings, senses, containers, finest_flights, finest_claims),
    *(finest_samples, finest_rules),
)
"""Generators of lies."""


def all_lies(log: Log) -> list[Lie]:
    """Every lie about a log."""
    return [lie for tell in TABLE for lie in tell(log)]
