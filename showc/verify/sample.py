"""One sample: its fields in the bytes, and their values for a state and control."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField

from showc.verify.damage import Damage

if TYPE_CHECKING:
    from collections.abc import Iterator

    from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
    from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

_FRAME = re.compile(r"drone_(\d+)")

POINT_FIELDS = (
    *("x", "y", "z", "vx", "vy", "vz", "qx", "qy", "qz", "qw"),
    *("wx", "wy", "wz", "u0", "u1", "u2", "u3"),
)
_NUMPY = {
    PackedElementField.FLOAT32: "<f4",
    PackedElementField.FLOAT64: "<f8",
    PackedElementField.UINT8: "u1",
}


def point_layout(
    cloud: PointCloud, offset: int, wanted: tuple[str, ...] = POINT_FIELDS
) -> np.dtype[np.void]:
    """Read the layout of a point from the message's own description.

    Damage at ``offset`` if it lacks one of the fields ``wanted``.
    """
    names = [field.name for field in cloud.fields]
    known = all(field.type in _NUMPY for field in cloud.fields)
    if not known or len(set(names)) != len(names) or not set(wanted) <= set(names):
        raise Damage(offset, "a point cloud does not describe its points")
    try:
        return np.dtype(
            {
                "names": names,
                "formats": [_NUMPY[field.type] for field in cloud.fields],
                "offsets": [field.offset for field in cloud.fields],
                "itemsize": cloud.point_stride,
            }
        )
    except (ValueError, TypeError) as error:
        raise Damage(offset, "a point cloud does not describe its points") from error


def points_of(
    cloud: PointCloud, layout: np.dtype[np.void], drones: int, offset: int
) -> NDArray[np.void]:
    """Points (drones,) of a message; damage at ``offset`` if they are not as many."""
    if (
        cloud.point_stride != layout.itemsize
        or len(cloud.data) != drones * layout.itemsize
    ):
        raise Damage(offset, f"a point cloud does not hold {drones} drones")
    return np.frombuffer(cloud.data, dtype=layout)


def frames(
    message: FrameTransforms, drones: int, offset: int
) -> tuple[IntArray, FloatArray]:
    """Drones and their x y z, qx qy qz qw; other frames are left aside."""
    found, rows = [], []
    for frame in _drone_frames(message):
        drone = int(frame.child_frame_id.removeprefix("drone_")) - 1
        if not 0 <= drone < drones:
            raise Damage(offset, f"/tf names {frame.child_frame_id!r}")
        t, q = frame.translation, frame.rotation
        found.append(drone)
        rows.append((t.x, t.y, t.z, q.x, q.y, q.z, q.w))
    return np.array(found, dtype=np.int64), np.array(rows).reshape(-1, 7)


def _drone_frames(message: FrameTransforms) -> Iterator[FrameTransform]:
    return (
        frame for frame in message.transforms if _FRAME.fullmatch(frame.child_frame_id)
    )


def expected_fields(flown: FloatArray, kind: str) -> FloatArray:
    """Fields (fields, ...) of a sample from states and controls (16, ...)."""
    if kind == "state":
        return flown.copy()
    turned = _quaternion(*flown[6:9])
    if kind == "transform":
        return np.concatenate([flown[:3], turned])
    return np.concatenate([flown[:6], turned, flown[9:]])


def _quaternion(roll: FloatArray, pitch: FloatArray, yaw: FloatArray) -> FloatArray:
    """Rotation by roll about x, then pitch about y, then yaw about z: x, y, z, w."""
    # Product of the three elementary quaternions qz qy qx.
    half = 0.5 * pitch
    pitched, level = np.sin(half), np.cos(half)
    half = 0.5 * roll
    rolled, upright = np.sin(half), np.cos(half)
    result = np.stack(
        [level * rolled, pitched * upright, -pitched * rolled, level * upright]
    )
    if not yaw.any():
        return result
    x, y, z, w = result.copy()
    half = 0.5 * yaw
    sine, cosine = np.sin(half), np.cos(half)
    result *= cosine
    result += np.stack([-sine * y, sine * x, sine * w, -sine * z])
    return result


def same_sign(values: FloatArray, expected: FloatArray, kind: str) -> FloatArray:
    """Turn quaternions to the expected sign: both signs are one rotation."""
    part = slice(3, 7) if kind == "transform" else slice(6, 10)
    product = np.einsum("k...,k...", values[part], expected[part])
    opposite = product < 0.0
    if not opposite.any():
        return values
    result = values.copy()
    result[part] = np.where(opposite, -result[part], result[part])
    return result
