"""Write Skybrush's binary show files, one a drone.

Segments are cubic where an axis moves and constant where it does not; a drone that
stands in every axis gets one long segment. Degree 7 is never written: the firmware
does not find the take-off height in it and refuses the show.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import ExportError
from showc.foreign.skyb import (
    COMMENT,
    LIGHTS,
    MAGIC,
    TRAJECTORY,
    YAW,
    checksum,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.export.fit import FittedFleet


LONGEST_BLOCK = 65_535
"""A block's length is 16 bits [bytes]."""

CUBIC = 2
"""What a header says of an axis with three control points after the first."""

YAW_RESOLUTION = 0.1
"""Step of the yaw block [deg]: the format counts tenths of a degree."""


def skyb_file(
    trajectory: bytes, lights: bytes | None, yaw: bytes | None, comment: str
) -> bytes:
    """Return a whole file, version 2 with its CRC.

    Raises
    ------
    ExportError
        If a block is longer than the format allows.
    """
    body = bytearray(MAGIC + bytes([2, 1]) + bytes(4))
    blocks = (
        (TRAJECTORY, trajectory),
        (LIGHTS, lights),
        (YAW, yaw),
        (COMMENT, comment.encode()),
    )
    for kind, content in blocks:
        if content is None:
            continue
        if len(content) > LONGEST_BLOCK:
            raise ExportError(
                f"a block of type {kind} has {len(content)} bytes; the format holds "
                f"{LONGEST_BLOCK}: a shorter show, or a greater --tolerance"
            )
        body += struct.pack("<BH", kind, len(content)) + content
    body[6:10] = checksum(bytes(body)).to_bytes(4, "little")
    return bytes(body)


def trajectory_block(fitted: FittedFleet, drone: int, yaw: int = 0) -> bytes:
    """Return the trajectory of one drone: scale, start, segments.

    ``yaw`` is that of the start [0.1 deg]; Skybrush's firmware does not read it.
    """
    rows = fitted.rows(drone)
    durations, segments = fitted.lengths[rows], fitted.points[rows]
    scale = int(fitted.scale[drone])
    head = struct.pack("<B4h", scale, *segments[0, 0].tolist(), yaw)
    moving = np.any(segments != segments[:, :1], axis=1)
    count = moving.sum(axis=1)
    sizes = 3 + 6 * count
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    data = np.zeros(int(offsets[-1]), dtype=np.uint8)
    header = (moving * (CUBIC << np.array([0, 2, 4]))).sum(axis=1)
    data[offsets[:-1]] = header
    data[offsets[:-1] + 1] = durations & 0xFF
    data[offsets[:-1] + 2] = durations >> 8
    before = np.cumsum(moving, axis=1) - moving
    row, axis = np.nonzero(moving)
    where = (offsets[:-1] + 3)[row] + 6 * before[row, axis]
    for index in range(3):
        value = segments[row, index + 1, axis].astype("<i2").view("<u2")
        data[where + 2 * index] = value & 0xFF
        data[where + 2 * index + 1] = value >> 8
    return head + data.tobytes()


def yaw_block(degrees: Sequence[float], times: Sequence[int]) -> bytes:
    """Return the block that turns a drone: ``degrees`` clockwise at ``times`` [ms].

    The first stands from the start; of a yaw that never changes there are no steps.
    """
    whole = np.rint(np.asarray(degrees) / YAW_RESOLUTION).astype(np.int64)
    # A yaw is an angle: full turns from the start on say nothing.
    turn = round(360.0 / YAW_RESOLUTION)
    whole -= turn * round(int(whole[0]) / turn)
    body = bytearray(struct.pack("<Bh", 0, int(whole[0])))
    changes = np.flatnonzero(np.diff(whole))
    if changes.size:
        for index in range(1, whole.size):
            duration = int(times[index]) - (int(times[index - 1]) if index > 1 else 0)
            delta = int(whole[index] - whole[index - 1])
            body += struct.pack("<Hh", duration, delta)
    return bytes(body)
