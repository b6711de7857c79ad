"""The message types in the file: the ones that this verifier decodes with."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from foxglove_schemas_protobuf import (
    FrameTransforms_pb2,
    PointCloud_pb2,
    SceneUpdate_pb2,
)

from showc.log import showc_pb2
from showc.log.schema import descriptor_set
from showc.verify.report import agreement

if TYPE_CHECKING:
    from google.protobuf.message import Message

    from showc.verify.logfile import LogFile
    from showc.verify.report import Check

PROTOBUF = "protobuf"
"""Encoding of messages and of their types."""

_TYPES: dict[str, type[Message]] = {
    r"/show/rules": showc_pb2.Rules,
    r"/show/segments": showc_pb2.Segment,
    r"/show/scene": SceneUpdate_pb2.SceneUpdate,
    r"/fleet/(state|predicted)": PointCloud_pb2.PointCloud,
    r"/tf": FrameTransforms_pb2.FrameTransforms,
    r"/drone/\d+/trajectory": showc_pb2.Trajectory,
    r"/drone/\d+/state": showc_pb2.DroneState,
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
        elif (schema.name, schema.encoding) != (wanted.DESCRIPTOR.full_name, PROTOBUF):
            name = wanted.DESCRIPTOR.full_name
            bad.append(f"{channel.topic}: {schema.name}, not {name}")
        elif schema.data != descriptor_set(wanted):
            bad.append(
                f"{schema.name} is defined in another way; verify with the release of "
                "showc that compiled the show, or compile it again"
            )
        if channel.encoding != PROTOBUF or channel.metadata:
            bad.append(f"{channel.topic}: the channel says more, or another encoding")
    used = {channel.schema for channel in log.channels.values()}
    bad += [
        f"{log.schemas[n].name} is used by nothing" for n in log.schemas.keys() - used
    ]
    return agreement("VRF103", bad)
