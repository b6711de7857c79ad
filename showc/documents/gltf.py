"""glTF 2.0 as a document: its lists, its buffers, the numbers in them."""

from __future__ import annotations

import base64
import binascii
import struct
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np

from showc.documents.numbers import number, rising
from showc.documents.values import parse_json
from showc.errors import DamagedFileError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from showc.arrays import FloatArray, IntArray


MAGIC = b"glTF"
FLOAT = 5126
"""Component type of float32 (glTF 2.0, 3.6.2.2)."""

MOST_KEYS = 50_000
"""Keys of one node: half an hour at 24 Hz, and some."""

_SIZES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_TYPES = {FLOAT: ("<f4", 1.0), 5121: ("<u1", 255.0), 5123: ("<u2", 65_535.0)}
"""Types of numbers, and what stands for one where they are normalized."""
_INDICES = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
"""Types of the numbers of entries that a sparse accessor replaces."""
_JSON, _BINARY = 0x4E4F534A, 0x004E4942
"""Kinds of chunks of a binary glTF: "JSON" and "BIN" in ASCII, read as numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """What an animation changes."""

    animation: dict[str, Any]
    """It has the samplers."""
    sampler: Any
    """Number of one of them, as written."""
    path: str
    """Which property; with KHR_animation_pointer, what it points at."""
    node: Any
    """Whose, as written; None: what it points at is no node's."""


@dataclass(frozen=True, slots=True, eq=False)
class Keys:
    """What a sampler says."""

    times: FloatArray
    """Increasing, shape (n,) [s]."""
    values: FloatArray
    """Shape (n, components); a spline has three rows a key: tangent, value, tangent."""
    way: str
    """LINEAR, STEP or CUBICSPLINE."""
    output: Any
    """Number of the accessor of the values."""


_WAYS = ("LINEAR", "STEP", "CUBICSPLINE")
"""How a sampler goes from key to key."""


class Document:
    """A file, and what it refers to.

    Parameters
    ----------
    name
        Of the file, for errors.
    content
        The file.
    read
        Gives the content of a file by its name, relative to this one's folder.

    Raises
    ------
    DamagedFileError
        If it is no glTF document.
    """

    def __init__(self, name: str, content: bytes, read: Callable[[str], bytes]) -> None:
        self.name = name
        self._read = read
        self.binary = b""
        text = self._chunks(content) if content[:4] == MAGIC else content
        top = parse_json(text, name)
        if not isinstance(top, dict):
            raise self.damage("is no glTF document")
        self.top = top
        self._buffers: dict[int, bytes] = {}

    def damage(self, text: str) -> DamagedFileError:
        """Return the error that says what is wrong."""
        return DamagedFileError(f"{self.name}: {text}")

    def _chunks(self, content: bytes) -> bytes:
        """Text of a binary glTF; its buffer is kept."""
        text, position = b"", 12
        while position + 8 <= len(content):
            size, kind = struct.unpack_from("<II", content, position)
            body = content[position + 8 : position + 8 + size]
            if len(body) < size:
                raise self.damage(f"a chunk of {size} bytes is cut")
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
            raise self.damage(f"{key}[{index!r}] is not there")
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
                raise self.damage(f"buffers[{index}] is no base64") from None
        elif isinstance(uri, str):
            beside = unquote(uri)
            name = PurePosixPath(beside.replace("\\", "/"))
            if name.is_absolute() or ".." in name.parts or ":" in uri:
                raise self.damage(f"buffers[{index}] leads to {uri[:60]!r}")
            content = self._read(beside)
        else:
            raise self.damage(f"buffers[{index}] has no content")
        self._buffers[index] = content
        return content

    def numbers(self, index: Any, kind: str) -> FloatArray:  # noqa: ANN401
        """Numbers of an accessor, (count, components): floats, or normalized."""
        accessor = self.entry("accessors", index)
        count, width = accessor.get("count"), _SIZES[kind]
        what = f"accessors[{index}]"
        coding, one = _TYPES.get(accessor.get("componentType", 0), ("", 0.0))
        whole = bool(coding) and (one == 1.0 or accessor.get("normalized") is True)
        if accessor.get("type") != kind or not whole:
            raise self.damage(f"{what} is no {kind} of float32")
        if isinstance(count, bool) or not isinstance(count, int):
            raise self.damage(f"{what} has no count")
        if not 1 <= count <= 3 * MOST_KEYS:
            raise self.damage(
                f"{what} has {count:,} entries; wanted 1 to {3 * MOST_KEYS:,}"
            )
        sparse = accessor.get("sparse")
        if accessor.get("bufferView") is None and sparse is not None:
            found = np.zeros((count, width))
        else:
            found = self._view(accessor, (count, width), coding, what)
            found = found.astype(np.float64) / one
        if sparse is not None:
            rows, values = self._replaced(sparse, count, (width, coding), what)
            found[rows] = values / one
        return np.asarray(found)

    def _replaced(
        self,
        sparse: Any,  # noqa: ANN401
        count: int,
        kind: tuple[int, str],
        what: str,
    ) -> tuple[IntArray, FloatArray]:
        """Entries that a sparse accessor replaces, and what by."""
        many = sparse.get("count") if isinstance(sparse, dict) else None
        parts = [
            sparse.get(key) if isinstance(sparse, dict) else None
            for key in ("indices", "values")
        ]
        if not isinstance(many, int) or not 1 <= many <= count:
            raise self.damage(f"{what}: its sparse part has no count within {count}")
        if not isinstance(parts[0], dict) or not isinstance(parts[1], dict):
            raise self.damage(f"{what}: its sparse part has no indices and values")
        coding = _INDICES.get(parts[0].get("componentType", 0))
        if coding is None:
            raise self.damage(f"{what}: its sparse indices are no whole numbers")
        rows = self._view(parts[0], (many, 1), coding, what)[:, 0].astype(np.int64)
        if rows.max() >= count or np.any(np.diff(rows) <= 0):
            raise self.damage(f"{what}: its sparse indices do not rise within {count}")
        width, numbers = kind
        return rows, self._view(parts[1], (many, width), numbers, what).astype(float)

    def _view(
        self, described: dict[str, Any], shape: tuple[int, int], kind: str, what: str
    ) -> NDArray[Any]:
        """Return numbers as they lie in a buffer, (count, components)."""
        view = self.entry("bufferViews", described.get("bufferView"))
        if isinstance(view.get("extensions"), dict) and view["extensions"]:
            raise self.damage(
                f"{what} is packed ({', '.join(sorted(view['extensions']))[:80]}); "
                "wanted plain numbers: export without compression"
            )
        content = self.buffer(view.get("buffer"))
        (count, width), size = shape, np.dtype(kind).itemsize
        first, within = (
            int(number(part.get("byteOffset") or 0, what)) for part in (view, described)
        )
        stride = int(number(view.get("byteStride") or size * width, what))
        length = int(number(view.get("byteLength") or 0, what))
        if min(first, within) < 0 or stride < size * width:
            raise self.damage(f"the bufferView of {what} makes no sense")
        end = within + stride * (count - 1) + size * width
        if end > length or first + end > len(content):
            raise self.damage(f"{what} reaches beyond its bufferView, or its buffer")
        return np.ndarray(shape, kind, content, first + within, (stride, size))

    def channels(self) -> Iterator[Channel]:
        """Yield what is animated."""
        animations = self.top.get("animations")
        for animation in animations if isinstance(animations, list) else []:
            found = animation.get("channels") if isinstance(animation, dict) else None
            for channel in found if isinstance(found, list) else []:
                target = channel.get("target") if isinstance(channel, dict) else None
                if not isinstance(target, dict):
                    continue
                path, node = str(target.get("path")), target.get("node")
                if path == "pointer":
                    path, node = _pointed(target.get("extensions"))
                if node is not None or path.startswith("/"):
                    yield Channel(animation, channel.get("sampler"), path, node)

    def keys(self, channel: Channel, kind: str, what: str) -> Keys:
        """Read a channel's sampler; ``what`` names what it moves."""
        samplers, index = channel.animation.get("samplers"), channel.sampler
        if (
            not isinstance(samplers, list)
            or not isinstance(index, int)
            or not 0 <= index < len(samplers)
            or not isinstance(samplers[index], dict)
        ):
            raise self.damage(f"sampler {index!r} of {what} is not there")
        sampler, name = samplers[index], f"{self.name}: {what}"
        times = rising(self.numbers(sampler.get("input"), "SCALAR")[:, 0], name)
        values = self.numbers(sampler.get("output"), kind)
        way = sampler.get("interpolation", "LINEAR")
        if way not in _WAYS:
            raise self.damage(f"{what} goes from key to key by {str(way)[:40]!r}")
        wanted = times.size * (3 if way == "CUBICSPLINE" else 1)
        if values.shape[0] != wanted:
            raise self.damage(
                f"{what} has {values.shape[0]} values for {times.size} keys"
            )
        return Keys(times, values, str(way), sampler.get("output"))


def _pointed(extensions: Any) -> tuple[str, int | None]:  # noqa: ANN401 - any JSON
    """Return what a pointer leads to: a node's property, or a path from the top."""
    held = extensions if isinstance(extensions, dict) else {}
    found = held.get("KHR_animation_pointer")
    path = str(found.get("pointer")) if isinstance(found, dict) else ""
    parts = path.split("/")
    if len(parts) == 4 and parts[1] == "nodes" and parts[2].isdecimal():
        return parts[3], int(parts[2])
    return path, None
