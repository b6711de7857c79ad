"""One sample: its fields in the bytes, and their values for a state and control."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField

from showc.verify.damage import Damage

if TYPE_CHECKING:
    from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
    from numpy.typing import NDArray


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
