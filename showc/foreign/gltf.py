"""Animated glTF 2.0: nodes whose translations move, as drones.

Samplers are LINEAR, STEP or CUBICSPLINE (a cubic Hermite: in-tangent, value,
out-tangent for every key). glTF has y up: (x, y, z) of the show frame is (x, z, -y).
"""

from __future__ import annotations

import base64
import binascii
import struct
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.errors import DamagedFileError
from showc.files import read_file
from showc.foreign.document import LARGEST_ENTRY, parse_json
from showc.foreign.numbers import places, rising
from showc.foreign.show import Course, Courses, ForeignShow, fleet, polyline

if TYPE_CHECKING:
    from pathlib import Path

    from showc.arrays import FloatArray


MAGIC = b"glTF"
FLOAT = 5126
"""Component type of float32."""

MOST_KEYS = 50_000
"""Keys of one node."""

MOST_DRONES = 5000
"""Animated nodes that are read."""

_SIZES = {"SCALAR": 1, "VEC3": 3}
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_STEP_GAP = 1e-3
"""Time in which a STEP sampler changes here [s]: a jump is a very fast move."""


class _Reading:
    def __init__(self, path: Path) -> None:
        self.path = path
        content = read_file(path, LARGEST_ENTRY)
        self.binary = b""
        text = self._chunks(content) if content[:4] == MAGIC else content
        top = parse_json(text, str(path))
        if not isinstance(top, dict):
            raise self._damage("is no glTF document")
        self.top = top
        self._buffers: dict[int, bytes] = {}
        self._moved_by: dict[Any, int] = {}

    def _damage(self, text: str) -> DamagedFileError:
        return DamagedFileError(f"{self.path}: {text}")

    def _chunks(self, content: bytes) -> bytes:
        """Text of a binary glTF; its buffer is kept."""
        text, position = b"", 12
        while position + 8 <= len(content):
            size, kind = struct.unpack_from("<II", content, position)
            body = content[position + 8 : position + 8 + size]
            if len(body) < size:
                raise self._damage(f"a chunk of {size} bytes is cut")
            if kind == _JSON:
                text = body
            elif kind == _BINARY:
                self.binary = body
            position += 8 + size
        return text

    def entry(self, key: str, index: Any) -> dict[str, Any]:  # noqa: ANN401
        """Return one of the document's lists' objects."""
        found: Any = self.top.get(key)
        if (
            not isinstance(found, list)
            or isinstance(index, bool)
            or not isinstance(index, int)
            or not 0 <= index < len(found)
            or not isinstance(found[index], dict)
        ):
            raise self._damage(f"{key}[{index!r}] is not there")
        entry: dict[str, Any] = found[index]
        return entry

    def buffer(self, index: Any) -> bytes:  # noqa: ANN401
        """Bytes of a buffer: in the file, beside it, or in the document."""
        described = self.entry("buffers", index)
        if index in self._buffers:
            return self._buffers[index]
        uri = described.get("uri")
        if uri is None:
            content = self.binary
        elif isinstance(uri, str) and uri.startswith("data:"):
            try:
                content = base64.b64decode(uri.partition(",")[2], validate=True)
            except (ValueError, binascii.Error):
                raise self._damage(f"buffers[{index}] is no base64") from None
        elif isinstance(uri, str):
            name = PurePosixPath(uri)
            if name.is_absolute() or ".." in name.parts or ":" in uri:
                raise self._damage(f"buffers[{index}] leads to {uri[:60]!r}")
            content = read_file(self.path.parent / name, LARGEST_ENTRY)
        else:
            raise self._damage(f"buffers[{index}] has no content")
        self._buffers[index] = content
        return content

    def numbers(self, index: Any, kind: str) -> FloatArray:  # noqa: ANN401
        """Numbers of an accessor, (count, components); float32 only."""
        accessor = self.entry("accessors", index)
        count, width = accessor.get("count"), _SIZES[kind]
        if accessor.get("type") != kind or accessor.get("componentType") != FLOAT:
            raise self._damage(f"accessors[{index}] is no {kind} of float32")
        if isinstance(count, bool) or not isinstance(count, int):
            raise self._damage(f"accessors[{index}] has no count")
        if not 1 <= count <= 3 * MOST_KEYS or "sparse" in accessor:
            raise self._damage(
                f"accessors[{index}] has {count:,} entries; wanted 1 to "
                f"{3 * MOST_KEYS:,}, none of them left out"
            )
        view = self.entry("bufferViews", accessor.get("bufferView"))
        content = self.buffer(view.get("buffer"))
        begin = int(view.get("byteOffset", 0)) + int(accessor.get("byteOffset", 0))
        stride = int(view.get("byteStride") or 4 * width)
        if begin < 0 or stride < 4 * width:
            raise self._damage(f"bufferViews of accessors[{index}] make no sense")
        if begin + stride * (count - 1) + 4 * width > len(content):
            raise self._damage(f"accessors[{index}] reaches beyond its buffer")
        array = np.ndarray((count, width), "<f4", content, begin, (stride, 4)).astype(
            np.float64
        )
        return np.asarray(array)

    def courses(self) -> dict[int, Course]:
        """Courses of all nodes whose translation moves."""
        found: dict[int, Course] = {}
        counted = Courses(self.path)
        animations = self.top.get("animations")
        if not isinstance(animations, list):
            return found
        for animation in animations:
            channels = (
                animation.get("channels") if isinstance(animation, dict) else None
            )
            for channel in channels if isinstance(channels, list) else []:
                target = channel.get("target") if isinstance(channel, dict) else None
                if not isinstance(target, dict) or target.get("path") != "translation":
                    continue
                node: Any = target.get("node")
                self.entry("nodes", node)
                if node in found:
                    raise self._damage(f"node {node} is moved by two channels")
                if len(found) >= MOST_DRONES:
                    raise self._damage(f"moves more than {MOST_DRONES} nodes")
                found[node] = self._course(animation, channel.get("sampler"), node)
                counted.add(found[node])
        return found

    def _course(self, animation: dict[str, Any], index: Any, node: int) -> Course:  # noqa: ANN401
        samplers = animation.get("samplers")
        if (
            not isinstance(samplers, list)
            or not isinstance(index, int)
            or not 0 <= index < len(samplers)
        ):
            raise self._damage(f"sampler {index!r} of node {node} is not there")
        sampler = samplers[index]
        what = f"{self.path}: node {node}"
        times = rising(self.numbers(sampler.get("input"), "SCALAR")[:, 0], what)
        values = places(_show_frame(self.numbers(sampler.get("output"), "VEC3")), what)
        other = self._moved_by.setdefault(sampler.get("output"), node)
        if other != node:
            raise self._damage(
                f"nodes {other} and {node} have the same places; wanted for each drone "
                "some of its own"
            )
        way = sampler.get("interpolation", "LINEAR")
        wanted = times.size * (3 if way == "CUBICSPLINE" else 1)
        if values.shape[0] != wanted:
            raise self._damage(
                f"node {node} has {values.shape[0]} values for {times.size} keys"
            )
        if way == "CUBICSPLINE":
            return _hermite(times, values.reshape(-1, 3, 3))
        if way == "STEP" and times.size > 1:
            before = np.maximum(times[1:] - _STEP_GAP, 0.5 * (times[:-1] + times[1:]))
            moments = np.empty(2 * times.size - 1)
            moments[::2], moments[1::2] = times, before
            kept = np.repeat(values, 2, axis=0)[:-1]
            return polyline(moments, kept)
        return polyline(times, values)


def _show_frame(values: FloatArray) -> FloatArray:
    """From glTF's axes to those of the show frame."""
    return np.stack([values[:, 0], -values[:, 2], values[:, 1]], axis=1)


def _hermite(times: FloatArray, keys: FloatArray) -> Course:
    """Cubics through keys (n, 3, 3) of in-tangent, value, out-tangent."""
    if times.size == 1:
        return polyline(times, keys[:, 1])
    width = np.diff(times)[:, None] / 3.0
    begin, end = keys[:-1, 1], keys[1:, 1]
    body = np.stack(
        [begin, begin + width * keys[:-1, 2], end - width * keys[1:, 0], end], axis=1
    )
    return Course(times, body)


def read_gltf(path: Path) -> ForeignShow:
    """Read an animated scene: every node whose translation moves is a drone.

    Raises
    ------
    DamagedFileError
        If it is not what the format wants, or nothing in it moves.
    """
    reading = _Reading(path)
    found = reading.courses()
    if not found:
        raise DamagedFileError(f"{path}: no node's translation is animated")
    names = tuple(
        str(reading.entry("nodes", node).get("name") or f"node {node}")[:80]
        for node in sorted(found)
    )
    return ForeignShow(
        str(path),
        "glTF",
        path.stem,
        names,
        fleet([found[node] for node in sorted(found)]),
    )
