"""Skybrush's binary show file, one drone: bytes to courses, lights, yaw, events.

Layout, little-endian: ``skyb``, version 1 or 2; version 2 has a byte of features, of
which bit 0 says that four bytes of CRC follow. Then blocks: type (u8), length (u16),
body. Type 1 is the trajectory: scale [mm], start (4 x i16), then segments of a header
(2 bits an axis: 0 constant, 1 linear, 2 cubic, 3 degree 7), a duration (u16, ms) and
the control points after the first (i16 each), x, y, z [scale] and yaw [0.1 deg].
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import DamagedFileError
from showc.foreign.show import Course, Stored, YawTrack
from showc.verify.kernel.bernstein import elevate

if TYPE_CHECKING:
    from showc.arrays import ByteArray, FloatArray, IntArray


MAGIC = b"skyb"
TRAJECTORY, LIGHTS, COMMENT, RETURN, YAW, EVENTS = 1, 2, 3, 4, 5, 6
"""Types of blocks."""

POINTS_AFTER = np.array([0, 1, 3, 7])
"""Control points after the first, by the two bits of an axis: also the degree."""

_HEAD = struct.Struct("<BH")
_START, _SEGMENT = 9, 3
"""Lengths of what comes first in a block of trajectories and in each of its segments
[bytes]: the scale and the first point; the header and the duration."""
_YAW_STEP = np.dtype([("duration", "<u2"), ("delta", "<i2")])

_SIZES = [
    _SEGMENT
    + 2 * int(sum(POINTS_AFTER[(header >> (2 * axis)) & 3] for axis in range(4)))
    for header in range(256)
]
"""Length of a segment by its header [bytes]."""


@dataclass(frozen=True, slots=True, eq=False)
class SkybFile:
    """What one file says."""

    course: Course
    """The flight; a single still piece where the file has no segments."""
    stored: Stored
    """How it is stored."""
    lights: bytes | None
    """Light program; None where there is none."""
    yaw: YawTrack | None
    """Yaw; None where there is none."""
    comment: str
    """Free text."""
    crc: bool
    """Whether the file has a CRC (it fits, then)."""


def checksum(content: bytes) -> int:
    """CRC of a whole file, its own four bytes taken for zeros.

    Reflected polynomial 0x04C11DB7, initial value 0, no final inversion.
    """
    return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF


def read_skyb(content: bytes, name: str) -> SkybFile:
    """Read one file.

    Raises
    ------
    DamagedFileError
        If the bytes are no such file, are cut, or do not have their CRC; the message
        names the byte.
    """
    every, crc = blocks_of(content, name)
    # Of blocks of one type the firmware reads the first.
    blocks = {kind: (at, body) for kind, at, body in reversed(every)}
    if TRAJECTORY not in blocks:
        raise DamagedFileError(
            f"{name}: has no trajectory block; wanted a block of type 1"
        )
    offset, body = blocks[TRAJECTORY]
    course, stored = _trajectory(body, offset, name)
    yaw = blocks.get(YAW)
    return SkybFile(
        course,
        stored,
        blocks[LIGHTS][1] if LIGHTS in blocks else None,
        None if yaw is None else _yaw(yaw[1], yaw[0], name),
        blocks[COMMENT][1].decode("utf-8", "replace") if COMMENT in blocks else "",
        crc,
    )


def read_compressed(content: bytes, name: str) -> SkybFile:
    """Read a Crazyflie's compressed trajectory: the same on a grid of 1 mm.

    Raises
    ------
    DamagedFileError
        If the bytes are cut.
    """
    course, stored = _trajectory(b"\x01" + content, -1, name)
    return SkybFile(course, stored, None, None, "", crc=False)


Block = tuple[int, int, bytes]
"""Type, where its body begins, the body."""


def blocks_of(content: bytes, name: str) -> tuple[list[Block], bool]:
    """Return all blocks in order, and whether the file has a CRC, which fits then.

    Raises
    ------
    DamagedFileError
        If the bytes are no such file, are cut, or do not have their CRC.
    """
    if content[:4] != MAGIC or len(content) < 5:
        raise DamagedFileError(f"{name}: byte 0: is no .skyb file; wanted {MAGIC!r}")
    version, crc, position = content[4], False, 5
    if version not in {1, 2}:
        raise DamagedFileError(f"{name}: byte 4: version {version}; wanted 1 or 2")
    if version == 2:
        if len(content) < 6:
            raise DamagedFileError(f"{name}: ends inside its header")
        crc, position = bool(content[5] & 1), 6
    if crc:
        stored = int.from_bytes(content[6:10], "little")
        found = checksum(content[:6] + bytes(4) + content[10:])
        if len(content) < 10 or found != stored:
            raise DamagedFileError(
                f"{name}: byte 6: the CRC is {stored:#010x}, the bytes have "
                f"{found:#010x}: the file was changed or cut"
            )
        position = 10
    blocks: list[Block] = []
    while position < len(content):
        if position + _HEAD.size > len(content):
            raise DamagedFileError(f"{name}: byte {position}: ends inside a block")
        kind, length = _HEAD.unpack_from(content, position)
        position += _HEAD.size
        if position + length > len(content):
            raise DamagedFileError(
                f"{name}: byte {position}: a block of {length} bytes, of which "
                f"{len(content) - position} are there"
            )
        blocks.append((kind, position, content[position : position + length]))
        position += length
    return blocks, crc


def _trajectory(body: bytes, offset: int, name: str) -> tuple[Course, Stored]:
    scale = body[0] & 0x7F if body else 0
    if len(body) < _START or scale == 0:
        raise DamagedFileError(
            f"{name}: byte {offset}: the trajectory has {len(body)} bytes and scale "
            f"{scale}; wanted {_START} bytes or more and a scale of 1 to 127"
        )
    places, position, end = [], _START, len(body)
    while position < end:
        places.append(position)
        position += _SIZES[body[position]]
    if position != end:
        raise DamagedFileError(
            f"{name}: byte {offset + places[-1]}: a segment that ends "
            f"{position - end} bytes after its block"
        )
    first = np.frombuffer(body, "<i2", 4, 1).astype(np.float64)
    if not places:
        still = first[None, None, :3] * scale / 1000.0
        stored = Stored(np.zeros((0, 4), dtype=np.int64), scale, len(body))
        return Course(np.array([0.0, 1e-3]), still), stored
    data = np.frombuffer(body, np.uint8)
    at = np.array(places)
    headers = data[at]
    durations = data[at + 1].astype(np.int64) + 256 * data[at + 2].astype(np.int64)
    degrees = POINTS_AFTER[(headers[:, None] >> np.array([0, 2, 4, 6])) & 3]
    points = _control_points(data, at + _SEGMENT, degrees, first)
    times = np.concatenate([[0], np.cumsum(durations)]) / 1000.0
    # Segments of no length are allowed; nothing is flown in them.
    flown = durations > 0
    course = Course(
        np.append(times[:-1][flown], times[-1]),
        points[flown][:, :, :3] * (scale / 1000.0),
    )
    if not flown.any():
        course = Course(np.array([0.0, 1e-3]), points[:1, :1, :3] * scale / 1000.0)
    return course, Stored(degrees[flown], scale, len(body))


def _control_points(
    data: ByteArray,
    at: IntArray,
    degrees: IntArray,
    first: FloatArray,
) -> FloatArray:
    """Control points of all segments in one common degree, (segments, n + 1, 4)."""
    top = max(1, int(degrees.max()))
    begins = at[:, None] + 2 * (np.cumsum(degrees, axis=1) - degrees)
    last = np.empty((at.size, 4))
    result = np.empty((at.size, top + 1, 4))
    for axis in range(4):
        stored = np.flatnonzero(degrees[:, axis])
        ends = begins[stored, axis] + 2 * (degrees[stored, axis] - 1)
        value = (data[ends] | data[ends + 1].astype(np.uint16) << 8).view(np.int16)
        # A constant axis stays where the last segment that stores it left it.
        left = np.append(first[axis], value.astype(np.float64))
        last[:, axis] = left[np.searchsorted(stored, np.arange(at.size), side="right")]
    before = np.concatenate([first[None], last[:-1]])
    for degree in np.unique(degrees).tolist():
        rows, axes = np.nonzero(degrees == degree)
        points = np.empty((rows.size, degree + 1, 1))
        points[:, 0, 0] = before[rows, axes]
        where = begins[rows, axes][:, None] + 2 * np.arange(degree)
        raw = (data[where] | data[where + 1].astype(np.uint16) << 8).view(np.int16)
        points[:, 1:, 0] = raw
        result[rows, :, axes] = elevate(points, top)[:, :, 0]
    return result


def _yaw(body: bytes, offset: int, name: str) -> YawTrack:
    if len(body) < 3 or (len(body) - 3) % _YAW_STEP.itemsize:
        raise DamagedFileError(
            f"{name}: byte {offset}: a yaw block of {len(body)} bytes; wanted 3 and "
            f"{_YAW_STEP.itemsize} for each step"
        )
    steps = np.frombuffer(body, _YAW_STEP, offset=3)
    first = int.from_bytes(body[1:3], "little", signed=True)
    deltas = np.concatenate([[first], steps["delta"].astype(np.int64)])
    durations = np.concatenate([[0], steps["duration"].astype(np.int64)])
    return YawTrack(np.cumsum(durations) / 1000.0, np.cumsum(deltas) / 10.0)
