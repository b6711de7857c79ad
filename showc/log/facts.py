"""What a log says around its messages: metadata, attachments, facts of the manifest.

All of it follows from the script, the segments and the manifest's own bytes. So the
verifier works it out again, and compares.
"""

from __future__ import annotations

import hashlib
import json
import re
from importlib import resources
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import DecodeError

from showc.documents.values import read_json
from showc.log import showc_pb2 as pb
from showc.log.sample import GRID, nanoseconds
from showc.log.schema import (
    ABORT_HEAD,
    ABORT_NAME,
    FLEET,
    FORMAT_VERSION,
    LAYOUT_NAME,
    MANIFEST_NAME,
    PREDICTED,
    RULES,
    SCENE,
    SEGMENTS,
    TRANSFORMS,
    message_of,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from google.protobuf.message import Message

    from showc.arrays import FloatArray
    from showc.script.show import Show
    from showc.vehicle import Limits

_MEDIA = {
    ".yaml": "application/yaml",
    ".yml": "application/yaml",
    ".json": "application/json",
    ".csv": "text/csv",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
}

_MOST = 1 << 26
"""Bytes from which an addition in JSON is refused."""

TYPES: dict[str, type[Message]] = {
    RULES: pb.Rules,
    SCENE: SceneUpdate,
    TRANSFORMS: FrameTransforms,
    SEGMENTS: pb.Segment,
    FLEET: PointCloud,
    PREDICTED: PointCloud,
    r"/drone/\d+/trajectory": pb.Trajectory,
    r"/drone/\d+/state": pb.DroneState,
}
"""Types of messages, by patterns of topics."""

_SCENE = "3D!show"
"""Name of the layout's panel that draws the show."""


def sha256(content: bytes) -> str:
    """Hexadecimal SHA-256 of ``content``."""
    return hashlib.sha256(content).hexdigest()


def fleet_token(files: Mapping[str, bytes]) -> str:
    """Return the SHA-256 over names and bytes of all ``.waypoints`` files, sorted."""
    digest = hashlib.sha256()
    for name in sorted(files):
        if name.endswith(".waypoints"):
            digest.update(name.encode())
            digest.update(hashlib.sha256(files[name]).digest())
    return digest.hexdigest()


def media_type(name: str) -> str:
    """Type of an attachment by its suffix; others are plain bytes."""
    return _MEDIA.get(PurePath(name).suffix.lower(), "application/octet-stream")


def message_type(topic: str) -> type[Message] | None:
    """Type of the messages on a topic; None if no log of showc's has it."""
    some = (kind for like, kind in TYPES.items() if re.fullmatch(like, topic))
    return next(some, None)


def epoch_of(show: Show) -> int:
    """Time stamp of show time zero [ns]."""
    return nanoseconds(show.epoch.timestamp())


def metadata_of(
    show: Show, duration: float, version: str, manifest: bytes
) -> dict[str, str]:
    """Return the metadata of a log.

    Parameters
    ----------
    show
        What the script asks for.
    duration
        Of the flight [s].
    version
        Of showc.
    manifest
        Its bytes.
    """
    site = show.site
    return {
        "format_version": str(FORMAT_VERSION),
        "showc_version": version,
        "name": show.name,
        "drones": str(show.drones),
        "rate_hz": repr(float(show.log_rate)),
        "duration_s": repr(duration),
        "epoch_ns": str(epoch_of(show)),
        "frame": "map: origin at the site's origin, z up, +y along the heading",
        "body_frame": "forward, left, up; quaternion from body to map, x y z w",
        "origin_latitude": repr(float(site.latitude)),
        "origin_longitude": repr(float(site.longitude)),
        "origin_altitude": repr(float(site.altitude)),
        "heading": repr(float(site.heading)),
        "colours": "sRGB bytes on /fleet/state, linear on /drone/NNNN/state",
        "script": PurePath(show.source.path).name,
        "script_sha256": sha256(show.source.content),
        "manifest_sha256": sha256(manifest),
        **{f"grid_{name}": repr(step) for name, step in GRID.items()},
    }


def rules_of(
    show: Show,
    formations: Mapping[str, FloatArray],
    limits: Sequence[Limits],
    duration: float,
) -> pb.Rules:
    """Return the rules of a log: what its flights must keep, and what flies.

    Parameters
    ----------
    show
        What the script asks for.
    formations
        Their places (n, 3) in the show frame [m], by name.
    limits
        Those in use, in the order of their first use.
    duration
        Of the flight [s].
    """
    fence = [] if show.site.fence is None else np.ravel(show.site.fence).tolist()
    shape = show.separation.shape.upper().replace("-", "_")
    return message_of(
        pb.Rules,
        show,
        format_version=FORMAT_VERSION,
        duration=duration,
        site=message_of(pb.Site, show.site, fence=fence),
        vehicle=message_of(pb.Vehicle, show.vehicle),
        separation=message_of(pb.Separation, show.separation, shape=shape),
        yaw_held=show.yaw == "held",
        formations=[
            pb.Formation(name=name, points=np.ravel(points).tolist())
            for name, points in formations.items()
        ],
        limits=[message_of(pb.Limits, one) for one in limits],
    )


def named_digest(name: str, content: bytes) -> str:
    """Return the digest of the log that an addition names; empty where it is none.

    Parameters
    ----------
    name
        One of :data:`showc.log.schema.ADDITIONS`.
    content
        Of the addition; of a table of any size its begin is decoded, no more.
    """
    try:
        if name == ABORT_NAME:
            return str(pb.AbortTable.FromString(content[:ABORT_HEAD]).data_sha256)
        return str(read_json(content, _MOST)["data_sha256"])
    except (DecodeError, ValueError, LookupError, TypeError):
        return ""


def attachments_of(show: Show, manifest: bytes, *, plots: bool) -> dict[str, bytes]:
    """Return the attachments of a log by name, in order.

    ``plots`` says whether its layout has samples per drone to plot.
    """
    return {
        PurePath(show.source.path).name: show.source.content,
        **dict(sorted(show.source.inputs.items())),
        MANIFEST_NAME: manifest,
        LAYOUT_NAME: layout_json(show, plots=plots),
    }


def layout_json(show: Show, *, plots: bool) -> bytes:
    """Return a layout for Foxglove and Lichtblick: the show in 3-D, plots of a drone.

    With ``plots`` only where the log has samples per drone.
    """
    text = resources.files(__package__).joinpath("layout.json").read_text("utf-8")
    layout = json.loads(text)
    scene = layout["configById"][_SCENE]
    low, high = show.site.volume_min, show.site.volume_max
    size = max(b - a for a, b in zip(low, high, strict=True))
    middle = [(a + b) / 2.0 for a, b in zip(low, high, strict=True)]
    # From so far away the whole volume is seen at 45 degrees of view.
    scene["cameraState"] |= {"distance": 1.6 * size, "targetOffset": middle}
    if not plots:
        layout |= {"configById": {_SCENE: scene}, "layout": _SCENE}
    return (json.dumps(layout, indent=2) + "\n").encode()


def manifest_of(
    show: Show, segments: Sequence[pb.Segment], height: float, given: Sequence[str]
) -> dict[str, Any]:
    """Return what the manifest says of script and flight.

    Parameters
    ----------
    show
        What the script asks for.
    segments
        What the log says of each leg.
    height
        Greatest height of any drone at any instant, show frame [m].
    given
        How places were assigned to the drones of each leg, in words.
    """
    source = show.source
    return {
        "show": {
            "name": show.name,
            "script": PurePath(source.path).name,
            "sha256": sha256(source.content),
            "inputs": {
                name: sha256(content) for name, content in sorted(source.inputs.items())
            },
            "epoch": show.epoch.isoformat(),
        },
        "drones": show.drones,
        "duration": round(max(one.start + one.duration for one in segments), 3),
        "greatest_height": round(height, 3),
        "segments": [
            {
                "index": one.index,
                "name": one.name,
                "kind": pb.Segment.Kind.Name(one.kind).lower(),
                "start": round(one.start, 3),
                "duration": one.duration,
                "from": one.from_formation,
                "to": one.to_formation,
                "assignment": words,
                "certificate": _certificate(one.certificate, one.duration),
            }
            for one, words in zip(segments, given, strict=True)
        ],
    }


def _certificate(found: pb.Certificate, duration: float) -> dict[str, Any]:
    single, closest, witness = found.single_drone_minimum, found.closest, found.witness
    each = max(1, len(witness.multipliers) // max(1, len(witness.knots)))
    rows = range(0, each * len(witness.knots), each)
    return {
        "single_drone_minimum": single,
        "gap": duration / single - 1.0 if single > 0.0 else 0.0,
        "dual_bound": found.dual_bound,
        "witness": {
            "drone": witness.drone + 1,
            "time": witness.time,
            "beta": [witness.beta.x, witness.beta.y, witness.beta.z],
            "knots": list(witness.knots),
            "multipliers": [list(witness.multipliers[k : k + each]) for k in rows],
        }
        if found.HasField("witness")
        else None,
        "closest": {
            "drones": [closest.drone_a + 1, closest.drone_b + 1],
            "time": closest.time,
            "distance": closest.distance,
        }
        if found.HasField("closest")
        else None,
        "method": found.method,
        "statistics": dict(sorted(found.statistics.items())),
    }
