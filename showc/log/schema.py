"""Names, topics and schemas of the trajectory log."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar, cast

from google.protobuf.descriptor_pb2 import FileDescriptorSet

if TYPE_CHECKING:
    from google.protobuf.descriptor import FileDescriptor
    from google.protobuf.message import Message

    Built = TypeVar("Built", bound=Message)

FORMAT_VERSION = 1
"""Version of the log's layout; in its metadata and in ``showc.Rules``."""
METADATA_NAME = "showc"
"""Name of the metadata record."""
FRAME = "map"
"""Frame of every position: the show frame."""
ROOT_FRAME = "enu"
"""East-north-up frame at the same origin, parent of ``FRAME``."""
MANIFEST_NAME = "manifest.json"
"""Attachment: hashes of the mission files."""
LAYOUT_NAME = "layout.json"
"""Attachment: layout for Foxglove and Lichtblick."""
ABORT_NAME = "showc:abort.pb"
"""Addition: how the stopped fleet comes down, a ``showc.AbortTable``."""
WIND_NAME = "showc:wind.json"
"""Addition: what simulated flights in wind gave."""
ABORT_HEAD = 84
"""Bytes of an abort table before its rows: the hash, and two numbers, with tags."""
ADDITIONS = (ABORT_NAME, WIND_NAME)
"""Attachments behind all other data, see :mod:`showc.log.additions`."""

FLEET = "/fleet/state"
PREDICTED = "/fleet/predicted"
TRANSFORMS = "/tf"
SCENE = "/show/scene"
RULES = "/show/rules"
SEGMENTS = "/show/segments"


def drone_name(drone: int) -> str:
    """Name of the drone's frame; ``drone`` counts from 0, names from 1."""
    return f"drone_{drone + 1:04d}"


def state_topic(drone: int) -> str:
    """Topic of the drone's samples; ``drone`` counts from 0, topics from 1."""
    return f"/drone/{drone + 1:04d}/state"


def trajectory_topic(drone: int) -> str:
    """Topic of the drone's exact flight; ``drone`` counts from 0, topics from 1."""
    return f"/drone/{drone + 1:04d}/trajectory"


def message_of(kind: type[Built], source: object, **given: Any) -> Built:  # noqa: ANN401
    """Fill a message: its fields have the names of the attributes of ``source``.

    Attributes are numbers, texts, tuples of them, or vectors of three numbers; what is
    ``given`` by name is taken from there.
    """
    values: dict[str, Any] = {}
    for entry in kind.DESCRIPTOR.fields:
        name = entry.name
        value = given[name] if name in given else getattr(source, name)
        if entry.message_type is not None and name not in given:
            value = dict(zip("xyz", map(float, value), strict=True))
        values[name] = value
    return kind(**values)


def descriptor_set(message: type[Message]) -> bytes:
    """Return the message's file and all it imports, as MCAP wants its schemas.

    Files come in the order in which a reader can load them: imports first.
    """
    result = FileDescriptorSet()
    seen: set[str] = set()

    def append(file: FileDescriptor) -> None:
        if file.name in seen:
            return
        seen.add(file.name)
        for imported in file.dependencies:
            append(imported)
        file.CopyToProto(result.file.add())

    append(cast("FileDescriptor", message.DESCRIPTOR.file))
    return result.SerializeToString(deterministic=True)
