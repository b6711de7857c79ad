"""What stands around the fleet: frames, ground, pads, fence, for 3-D viewers."""

from __future__ import annotations

from functools import cache
from math import cos, radians, sin
from typing import TYPE_CHECKING, Any

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from showc.log.schema import FRAME, ROOT_FRAME, drone_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from showc.arrays import FloatArray
    from showc.script.show import Show, Site


GRID_SPACING = 10.0
"""Distance between the lines on the ground [m]."""
PAD_SIZE = 0.5
"""Edge of the square that marks a pad [m]: about that of a show drone."""
FENCE_COLOUR, GROUND_COLOUR = (1.0, 0.45, 0.1, 0.9), (0.35, 0.4, 0.5, 0.35)
"""Red, green, blue and opacity, 0 to 1: distinct on dark and light ground."""
PAD_COLOUR, NORTH_COLOUR = (0.6, 0.65, 0.75, 0.6), (0.9, 0.2, 0.2, 0.9)
"""Pads stay behind drones; north is red, as on a compass needle."""


def stamp(ns: int) -> Timestamp:
    """Time since 1970 [ns] as a message."""
    return Timestamp(seconds=ns // 1_000_000_000, nanos=ns % 1_000_000_000)


def fence_corners(site: Site) -> FloatArray:
    """Corners (n, 2) [m] of the geofence; the volume's walls where there is none."""
    if site.fence is not None:
        return np.asarray(site.fence, dtype=np.float64)
    (x0, y0, _), (x1, y1, _) = site.volume_min, site.volume_max
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def point_cloud(ns: int, points: NDArray[np.void]) -> PointCloud:
    """One step of a fleet; ``points`` (drones,) is ``POINT`` or ``PLACE``."""
    return PointCloud(
        timestamp=stamp(ns),
        frame_id=FRAME,
        pose=_pose(0.0, 0.0, 0.0),
        point_stride=points.dtype.itemsize,
        fields=_fields(points.dtype),
        data=points.tobytes(),
    )


@cache
def _fields(layout: np.dtype[np.void]) -> Sequence[PackedElementField]:
    """Return what a point consists of: the same at every step."""
    kinds = {"f": PackedElementField.FLOAT32, "u": PackedElementField.UINT8}
    fields: Mapping[str, tuple[Any, ...]] = layout.fields or {}
    return [
        PackedElementField(name=name, offset=entry[1], type=kinds[entry[0].kind])
        for name, entry in fields.items()
    ]


def root_transform(ns: int, site: Site) -> FrameTransform:
    """From the show frame to east-north-up: a turn about z by minus the heading."""
    half = -0.5 * radians(site.heading)
    return FrameTransform(
        timestamp=stamp(ns),
        parent_frame_id=ROOT_FRAME,
        child_frame_id=FRAME,
        translation=Vector3(),
        rotation=Quaternion(z=sin(half), w=cos(half)),
    )


def fleet_transforms(
    ns: int, points: NDArray[np.void], drones: Iterable[int]
) -> FrameTransforms:
    """Frames of some drones; ``points`` (fleet,) of ``POINT``."""
    names = ["x", "y", "z", "qx", "qy", "qz", "qw"]
    time = stamp(ns)
    transforms = []
    chosen = list(drones)
    rows = points[chosen][names].tolist()
    for drone, (x, y, z, qx, qy, qz, qw) in zip(chosen, rows, strict=True):
        transforms.append(
            FrameTransform(
                timestamp=time,
                parent_frame_id=FRAME,
                child_frame_id=drone_name(drone),
                translation=Vector3(x=x, y=y, z=z),
                rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
            )
        )
    return FrameTransforms(transforms=transforms)


def scene_update(ns: int, show: Show) -> SceneUpdate:
    """Geofence, ground with a north arrow, pads and title, once for the whole show."""
    corners = fence_corners(show.site)
    low, high = show.site.volume_min[2], show.site.volume_max[2]
    after = np.roll(corners, -1, axis=0)
    edges = [
        *((*a, z, *b, z) for z in (low, high) for a, b in zip(corners, after)),  # noqa: B905
        *((*a, low, *a, high) for a in corners),
    ]
    pads = show.formations[show.pads].points
    x0, y0 = np.floor(corners.min(axis=0) / GRID_SPACING) * GRID_SPACING
    x1, y1 = np.ceil(corners.max(axis=0) / GRID_SPACING) * GRID_SPACING
    ground = float(pads[:, 2].min()) - 0.01
    lines = [
        *((x, y0, ground, x, y1, ground) for x in _steps(x0, x1)),
        *((x0, y, ground, x1, y, ground) for y in _steps(y0, y1)),
    ]
    north = radians(show.site.heading + 90.0)
    arrow = ArrowPrimitive(
        pose=_pose(float(x0), float(y0), 0.0, yaw=north),
        shaft_length=4.0,
        shaft_diameter=0.3,
        head_length=1.5,
        head_diameter=0.9,
        color=_colour(NORTH_COLOUR),
    )
    title = TextPrimitive(
        pose=_pose(float(x0 + x1) / 2.0, float(y1), 0.5),
        billboard=True,
        font_size=2.0,
        color=_colour((0.8, 0.85, 0.9, 0.9)),
        text=show.name,
    )
    cubes = [
        CubePrimitive(
            pose=_pose(*(float(value) for value in pad)),
            size=Vector3(x=PAD_SIZE, y=PAD_SIZE, z=0.02),
            color=_colour(PAD_COLOUR),
        )
        for pad in pads
    ]
    return SceneUpdate(
        entities=[
            _entity(ns, "fence", lines=[_lines(edges, FENCE_COLOUR, 2.0)]),
            _entity(ns, "ground", lines=[_lines(lines, GROUND_COLOUR, 1.0)]),
            _entity(ns, "pads", cubes=cubes),
            _entity(ns, "north", arrows=[arrow]),
            _entity(ns, "title", texts=[title]),
        ]
    )


def _steps(start: float, stop: float) -> list[float]:
    return [float(v) for v in np.arange(start, stop + 0.5 * GRID_SPACING, GRID_SPACING)]


def _pose(x: float, y: float, z: float, *, yaw: float = 0.0) -> Pose:
    return Pose(
        position=Vector3(x=x, y=y, z=z),
        orientation=Quaternion(z=sin(0.5 * yaw), w=cos(0.5 * yaw)),
    )


def _colour(rgba: tuple[float, float, float, float]) -> Color:
    red, green, blue, alpha = rgba
    return Color(r=red, g=green, b=blue, a=alpha)


def _lines(
    ends: Iterable[tuple[float, ...]],
    colour: tuple[float, float, float, float],
    width: float,
) -> LinePrimitive:
    """Separate lines, each from (x, y, z) to (x, y, z); ``width`` in pixels."""
    points = [
        Point3(x=float(x), y=float(y), z=float(z))
        for line in ends
        for x, y, z in (line[:3], line[3:])
    ]
    return LinePrimitive(
        type=LinePrimitive.LINE_LIST,
        pose=_pose(0.0, 0.0, 0.0),
        thickness=width,
        scale_invariant=True,
        points=points,
        color=_colour(colour),
    )


def _entity(ns: int, name: str, **shapes: Any) -> SceneEntity:  # noqa: ANN401 - lists of shapes
    return SceneEntity(
        timestamp=stamp(ns), frame_id=FRAME, id=name, frame_locked=True, **shapes
    )
