"""Animated glTF 2.0: nodes whose translations move, as drones.

Samplers are LINEAR, STEP or CUBICSPLINE (a cubic Hermite: in-tangent, value,
out-tangent for every key). glTF has y up: (x, y, z) of the show frame is (x, z, -y).
A drone's place is that of its node in the world: nodes above it may shift, turn and
scale it, but not move themselves, for what moves twice is no polynomial any more.
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
from showc.foreign.numbers import array, number, places, rising
from showc.foreign.show import Course, Courses, ForeignShow, fleet, polyline

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from showc.arrays import FloatArray, IntArray


MAGIC = b"glTF"
FLOAT = 5126
"""Component type of float32."""

MOST_KEYS = 50_000
"""Keys of one node."""

MOST_DRONES = 5000
"""Animated nodes that are read."""

_SIZES = {"SCALAR": 1, "VEC3": 3}
_INDICES = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
"""Types of the numbers of entries that a sparse accessor replaces."""
_BAKE = "bake the animation onto the drones themselves, without parents"
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
MOST_NODES = 50_000
"""Nodes of a scene: ten for each drone."""

_DEEPEST = 64
"""Nodes above a node."""
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
        self._moved_by: dict[tuple[Any, bytes], int] = {}
        self._parents: dict[Any, int] = {}

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
        if not 1 <= count <= 3 * MOST_KEYS:
            raise self._damage(
                f"accessors[{index}] has {count:,} entries; wanted 1 to "
                f"{3 * MOST_KEYS:,}"
            )
        what = f"accessors[{index}]"
        sparse = accessor.get("sparse")
        if accessor.get("bufferView") is None and sparse is not None:
            found = np.zeros((count, width))
        else:
            found = self._view(accessor, (count, width), "<f4", what).astype(np.float64)
        if sparse is not None:
            rows, values = self._replaced(sparse, count, width, what)
            found[rows] = values
        return np.asarray(found)

    def _replaced(
        self,
        sparse: Any,  # noqa: ANN401
        count: int,
        width: int,
        what: str,
    ) -> tuple[IntArray, FloatArray]:
        """Entries that a sparse accessor replaces, and what by."""
        many = sparse.get("count") if isinstance(sparse, dict) else None
        parts = [
            sparse.get(key) if isinstance(sparse, dict) else None
            for key in ("indices", "values")
        ]
        if not isinstance(many, int) or not 1 <= many <= count:
            raise self._damage(f"{what}: its sparse part has no count within {count}")
        if not isinstance(parts[0], dict) or not isinstance(parts[1], dict):
            raise self._damage(f"{what}: its sparse part has no indices and values")
        kind = _INDICES.get(parts[0].get("componentType", 0))
        if kind is None:
            raise self._damage(f"{what}: its sparse indices are no whole numbers")
        rows = self._view(parts[0], (many, 1), kind, what)[:, 0].astype(np.int64)
        if rows.max() >= count or np.any(np.diff(rows) <= 0):
            raise self._damage(f"{what}: its sparse indices do not rise within {count}")
        return rows, self._view(parts[1], (many, width), "<f4", what).astype(float)

    def _view(
        self, described: dict[str, Any], shape: tuple[int, int], kind: str, what: str
    ) -> NDArray[Any]:
        """Return numbers as they lie in a buffer, (count, components)."""
        view = self.entry("bufferViews", described.get("bufferView"))
        if isinstance(view.get("extensions"), dict) and view["extensions"]:
            raise self._damage(
                f"{what} is packed ({', '.join(sorted(view['extensions']))[:80]}); "
                "wanted plain numbers: export without compression"
            )
        content = self.buffer(view.get("buffer"))
        (count, width), size = shape, np.dtype(kind).itemsize
        begin, stride = 0, size * width
        for part in (view, described):
            begin += int(number(part.get("byteOffset") or 0, what))
        stride = int(number(view.get("byteStride") or stride, what))
        if begin < 0 or stride < size * width:
            raise self._damage(f"the bufferView of {what} makes no sense")
        if begin + stride * (count - 1) + size * width > len(content):
            raise self._damage(f"{what} reaches beyond its buffer")
        return np.ndarray(shape, kind, content, begin, (stride, size))

    def _moved(self) -> tuple[list[tuple[dict[str, Any], Any, int]], set[int]]:
        """Find what moves nodes: (animation, sampler, node); and nodes that turn."""
        moves, turned = [], set()
        animations = self.top.get("animations")
        for animation in animations if isinstance(animations, list) else []:
            channels = (
                animation.get("channels") if isinstance(animation, dict) else None
            )
            for channel in channels if isinstance(channels, list) else []:
                target = channel.get("target") if isinstance(channel, dict) else None
                if not isinstance(target, dict) or target.get("node") is None:
                    continue
                node: Any = target["node"]
                if "camera" in self.entry("nodes", node):
                    continue
                if target.get("path") == "translation":
                    moves.append((animation, channel.get("sampler"), node))
                elif target.get("path") in {"rotation", "scale"}:
                    turned.add(node)
        return moves, turned

    def _family(self) -> None:
        """Note the parent of each node."""
        nodes = self.top.get("nodes")
        if isinstance(nodes, list) and len(nodes) > MOST_NODES:
            raise self._damage(f"has {len(nodes):,} nodes; wanted {MOST_NODES:,}")
        for parent, node in enumerate(nodes if isinstance(nodes, list) else []):
            children = node.get("children") if isinstance(node, dict) else None
            for child in children if isinstance(children, list) else []:
                self.entry("nodes", child)
                if self._parents.setdefault(child, parent) != parent:
                    raise self._damage(f"node {child} has two parents")

    def above(self, node: int) -> list[int]:
        """Return the nodes that carry a node, the nearest first."""
        found: list[int] = []
        while node in self._parents:
            node = self._parents[node]
            if node in found or len(found) >= _DEEPEST:
                raise self._damage(f"node {node} carries itself, or too deep a tree")
            found.append(node)
        return found

    def _placed(self, node: int, moving: set[int]) -> FloatArray:
        """Where nodes above put a node: an affine map (4, 4) in glTF's axes."""
        result = np.eye(4)
        for carrier in self.above(node):
            if carrier in moving:
                raise self._damage(
                    f"node {node} is carried by node {carrier}, which moves too; "
                    f"{_BAKE}"
                )
            result = self._local(carrier) @ result
        return result

    def _local(self, index: int) -> FloatArray:
        """Affine map of a node that stands still (4, 4)."""
        node, what = self.entry("nodes", index), f"{self.path}: node {index}"
        if node.get("matrix") is not None:
            # By columns.
            return array(node["matrix"], (16,), what).reshape(4, 4).T
        x, y, z, w = array(node.get("rotation", [0, 0, 0, 1]), (4,), what).tolist()
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        result = np.eye(4)
        result[:3, :3] = turn * array(node.get("scale", [1, 1, 1]), (3,), what)
        result[:3, 3] = array(node.get("translation", [0, 0, 0]), (3,), what)
        return result

    def _none_forgotten(self, found: set[int], turned: set[int]) -> None:
        """Refuse a scene in which something flies on a node that only turns."""
        nodes = self.top.get("nodes")
        for index, node in enumerate(nodes if isinstance(nodes, list) else []):
            if not isinstance(node, dict) or node.get("mesh") is None:
                continue
            above = self.above(index)
            if not found & {index, *above} and turned & set(above):
                raise self._damage(
                    f"node {index} is swung about by a node above it; {_BAKE}"
                )

    def courses(self) -> dict[int, Course]:
        """Courses of all nodes whose translation moves."""
        found: dict[int, Course] = {}
        counted = Courses(self.path)
        moves, turned = self._moved()
        self._family()
        moving = {node for _, _, node in moves} | turned
        for animation, sampler, node in moves:
            if node in found:
                raise self._damage(f"node {node} is moved by two channels")
            if len(found) >= MOST_DRONES:
                raise self._damage(f"moves more than {MOST_DRONES} nodes")
            put = self._placed(node, moving)
            found[node] = self._course(animation, sampler, node, put)
            counted.add(found[node])
        self._none_forgotten(set(found), turned)
        return found

    def _course(
        self,
        animation: dict[str, Any],
        index: Any,  # noqa: ANN401
        node: int,
        put: FloatArray,
    ) -> Course:
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
        values = self.numbers(sampler.get("output"), "VEC3") @ put[:3, :3].T
        key = sampler.get("output"), put.tobytes()
        other = self._moved_by.setdefault(key, node)
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
        # Tangents are turned and scaled, but not shifted.
        shift = np.broadcast_to(put[:3, 3], values.shape).copy()
        if way == "CUBICSPLINE":
            shift.reshape(-1, 3, 3)[:, ::2] = 0.0
        values = places(_show_frame(values + shift), what)
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
