"""The message types in the file: the ones that this verifier decodes with."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from foxglove_schemas_protobuf import (
    FrameTransforms_pb2,
    PointCloud_pb2,
    SceneUpdate_pb2,
)
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.message import DecodeError

from showc.log import showc_pb2
from showc.verify.report import Check, Place

if TYPE_CHECKING:
    from google.protobuf.descriptor import FileDescriptor

    from showc.verify.logfile import LogFile
    from showc.verify.records import Schema

_TYPES = {
    r"/show/rules": "showc.Rules",
    r"/show/segments": "showc.Segment",
    r"/show/scene": "foxglove.SceneUpdate",
    r"/fleet/(state|predicted)": "foxglove.PointCloud",
    r"/tf": "foxglove.FrameTransforms",
    r"/drone/\d+/trajectory": "showc.Trajectory",
    r"/drone/\d+/state": "showc.DroneState",
}

_FILES: dict[str, FileDescriptor] = {
    "showc.Rules": showc_pb2.DESCRIPTOR,
    "showc.Segment": showc_pb2.DESCRIPTOR,
    "showc.Trajectory": showc_pb2.DESCRIPTOR,
    "showc.DroneState": showc_pb2.DESCRIPTOR,
    "foxglove.SceneUpdate": SceneUpdate_pb2.DESCRIPTOR,
    "foxglove.PointCloud": PointCloud_pb2.DESCRIPTOR,
    "foxglove.FrameTransforms": FrameTransforms_pb2.DESCRIPTOR,
}


def check_schemas(log: LogFile) -> list[Check]:
    """Hold topics against their types, and types against their definitions.

    A definition of showc's own must be the same to the byte. One of Foxglove's that
    differs is a warning: another release of its schemas wrote the file.
    """
    bad, other = [], []
    for channel in log.channels.values():
        wanted = next(
            (
                name
                for topic, name in _TYPES.items()
                if re.fullmatch(topic, channel.topic)
            ),
            None,
        )
        schema = log.schemas[channel.schema]
        if wanted is None:
            bad.append(f"{channel.topic}: showc writes no such topic")
        elif schema.name != wanted or channel.encoding != "protobuf":
            bad.append(f"{channel.topic}: {schema.name}, not {wanted}")
    for schema in log.schemas.values():
        if schema.name not in _FILES or _same(schema):
            continue
        if schema.name.startswith("showc."):
            bad.append(f"schema {schema.name} is not this verifier's")
        else:
            other.append(f"schema {schema.name} is of another release")
    checks = [
        Check(
            "VRF103",
            "integrity",
            "message types are showc's and Foxglove's",
            "fail" if bad else "pass",
            notes=tuple(bad[:5]),
        )
    ]
    checks += [
        Check(
            "VRF104",
            "integrity",
            "schema release",
            "warning",
            where=Place(),
            notes=(note,),
        )
        for note in other
    ]
    return checks


def _same(schema: Schema) -> bool:
    """Whether the schema holds the same files as the definition in memory."""
    if schema.encoding != "protobuf":
        return False
    try:
        found = FileDescriptorSet.FromString(schema.data)
    except (DecodeError, RecursionError, MemoryError):
        return False
    wanted: dict[str, bytes] = {}
    _gather(_FILES[schema.name], wanted)
    mine = {
        file.name: file.SerializeToString(deterministic=True) for file in found.file
    }
    return mine == wanted and len(found.file) == len(wanted)


def _gather(file: FileDescriptor, found: dict[str, bytes]) -> None:
    if file.name in found:
        return
    message = FileDescriptorProto()
    file.CopyToProto(message)
    found[file.name] = message.SerializeToString(deterministic=True)
    for imported in file.dependencies:
        _gather(imported, found)
