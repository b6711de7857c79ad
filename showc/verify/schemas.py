"""The message types in the file: the ones that this verifier decodes with."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, cast

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

_TYPES = {
    r"/show/rules": showc_pb2.Rules.DESCRIPTOR,
    r"/show/segments": showc_pb2.Segment.DESCRIPTOR,
    r"/show/scene": SceneUpdate_pb2.SceneUpdate.DESCRIPTOR,
    r"/fleet/(state|predicted)": PointCloud_pb2.PointCloud.DESCRIPTOR,
    r"/tf": FrameTransforms_pb2.FrameTransforms.DESCRIPTOR,
    r"/drone/\d+/trajectory": showc_pb2.Trajectory.DESCRIPTOR,
    r"/drone/\d+/state": showc_pb2.DroneState.DESCRIPTOR,
}
"""Type of the messages on each topic."""


def check_schemas(log: LogFile) -> Check:
    """Hold topics against their types, and types against their definitions.

    A definition must be the one in memory: with another one, a viewer would read other
    things out of the same bytes than this verifier.
    """
    bad = []
    for channel in log.channels.values():
        schema = log.schemas[channel.schema]
        wanted = next(
            (t for topic, t in _TYPES.items() if re.fullmatch(topic, channel.topic)),
            None,
        )
        if wanted is None:
            bad.append(f"{channel.topic}: showc writes no such topic")
        elif (schema.name, schema.encoding) != (wanted.full_name, "protobuf"):
            bad.append(f"{channel.topic}: {schema.name}, not {wanted.full_name}")
        elif not _same(schema.data, cast("FileDescriptor", wanted.file)):
            bad.append(
                f"{schema.name} is defined in another way; verify with the release of "
                "showc that compiled the show, or compile it again"
            )
        if channel.encoding != "protobuf" or channel.metadata:
            bad.append(f"{channel.topic}: the channel says more, or another encoding")
    used = {channel.schema for channel in log.channels.values()}
    bad += [
        f"{log.schemas[n].name} is used by nothing" for n in log.schemas.keys() - used
    ]
    return Check(
        "VRF103",
        "integrity",
        "message types are showc's and Foxglove's",
        "fail" if bad else "pass",
        where=Place(),
        notes=tuple(dict.fromkeys(bad))[:5],
    )


def _same(data: bytes, wanted: FileDescriptor) -> bool:
    """Whether a definition holds the same files as the one in memory."""
    try:
        found = FileDescriptorSet.FromString(data)
    except (DecodeError, RecursionError, MemoryError):
        return False
    files: dict[str, FileDescriptorProto] = {}
    _gather(wanted, files)
    return {file.name: file for file in found.file} == files and len(found.file) == len(
        files
    )


def _gather(file: FileDescriptor, found: dict[str, FileDescriptorProto]) -> None:
    if file.name not in found:
        found[file.name] = FileDescriptorProto()
        file.CopyToProto(found[file.name])
        for imported in file.dependencies:
            _gather(imported, found)
