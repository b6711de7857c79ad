"""Write Skybrush's compiled shows: a zip of JSON documents, one trajectory a drone."""

from __future__ import annotations

import base64
import json
import struct
import zipfile
import zlib
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from showc.foreign.closed import drone_name
from showc.processes import side_by_side

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from showc.export.fit import FittedFleet
    from showc.export.solved import SolvedShow

STAMP = 1 << 5 | 1
"""Date of every entry, 1 January 1980: the oldest a zip knows, that equal shows have
equal bytes."""

LEVEL = 4
"""Of compression: beyond it the file shrinks by a twentieth, in 1.6 times the time."""

PARTS = 4
"""Parts of a fleet that are written side by side: lights are sought for many drones
together, so few parts, and evenly large ones."""

_DEGREES = 1e7
"""Steps of latitude and longitude in a degree."""


Setpoints = list[list[float]]
"""Of a drone's yaw: [time s, degrees clockwise from +x]."""


def skyc_file(
    show: SolvedShow,
    fitted: FittedFleet,
    beside: Callable[[Sequence[int]], list[tuple[bytes, Setpoints]]],
) -> bytes:
    """Return the whole archive, the same bytes for the same show.

    Parameters
    ----------
    show
        What was solved: rules, site, stages.
    fitted
        Its flights as cubics.
    beside
        From numbers of drones to their light programs and yaw.
    """
    strings = _Decimals()

    def written(drones: Sequence[int]) -> list[Entry]:
        entries = []
        for drone, (program, yaw) in zip(drones, beside(drones), strict=True):
            folder = f"drones/{drone_name(drone)}"
            lights = {"version": 1, "data": base64.b64encode(program).decode()}
            turns = {"version": 1, "setpoints": yaw}
            flight = _trajectory(fitted, drone, strings)
            entries += [
                Entry.of(f"{folder}/trajectory.json", flight),
                Entry.of(f"{folder}/lights.json", _json(lights)),
                Entry.of(f"{folder}/yaw.json", _json(turns)),
            ]
        return entries

    parts = [partial(written, some) for some in shared(fitted.drones)]
    entries = [
        Entry.of("show.json", _json(_top(show, fitted))),
        Entry.of("cues.json", _json(_cues(show, fitted))),
    ]
    for some in side_by_side(parts):
        entries += some
    return archive(entries)


def shared(drones: int) -> list[Sequence[int]]:
    """Cut a fleet into parts that are written side by side."""
    most = -(-drones // PARTS)
    return [range(drones)[low : low + most] for low in range(0, drones, most)]


@dataclass(frozen=True, slots=True)
class Entry:
    """A file in an archive, packed."""

    name: str
    """Its path in the archive, ASCII."""
    packed: bytes
    """Its content, deflated."""
    size: int
    """Length of its content [bytes]."""
    crc: int
    """CRC-32 of its content."""

    @classmethod
    def of(cls, name: str, content: bytes) -> Self:
        """Pack a text, the same bytes at any time of day."""
        deflate = zlib.compressobj(LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
        packed = deflate.compress(content) + deflate.flush()
        return cls(name, packed, len(content), zlib.crc32(content))


def archive(entries: Iterable[Entry]) -> bytes:
    """Return a zip of entries that were packed side by side (PKWARE's APPNOTE 6.3)."""
    out, index, count = bytearray(), bytearray(), 0
    for entry in entries:
        name = entry.name.encode("ascii")
        described = struct.pack(
            "<5H3I2H",
            *(20, 0, zipfile.ZIP_DEFLATED, 0, STAMP),
            *(entry.crc, len(entry.packed), entry.size, len(name), 0),
        )
        # Made on Unix: a file that its owner may write, and all may read.
        beside = struct.pack("<3H2I", 0, 0, 0, 0o100644 << 16, len(out))
        index += b"PK\x01\x02" + b"\x14\x03" + described + beside + name
        out += b"PK\x03\x04" + described + name + entry.packed
        count += 1
    end = struct.pack("<4H2IH", 0, 0, count, count, len(index), len(out), 0)
    return bytes(out + index + b"PK\x05\x06" + end)


def entries_of(content: bytes, most: float = float("inf")) -> list[tuple[str, bytes]]:
    """Return names and contents of an archive, in order.

    Raises
    ------
    ValueError
        If it is none that :func:`archive` makes of packed contents, or if these have
        more than ``most`` bytes.
    """
    found, packed = list[tuple[str, bytes]](), list[Entry]()
    try:
        with zipfile.ZipFile(BytesIO(content)) as opened:
            if sum(one.file_size for one in opened.infolist()) > most:
                raise ValueError(f"its entries have more than {most:,} bytes")
            for one in opened.infolist():
                # Behind a head of 30 bytes and the name.
                begin = one.header_offset + 30 + len(one.filename)
                bare = content[begin : begin + one.compress_size]
                stream = zlib.decompressobj(-zlib.MAX_WBITS)
                data = stream.decompress(bare, one.file_size + 1)
                if not stream.eof or stream.unused_data:
                    raise ValueError(f"{one.filename} is not one packed file")
                if (len(data), zlib.crc32(data)) != (one.file_size, one.CRC):
                    raise ValueError(f"{one.filename} is not what it says")
                packed.append(Entry(one.filename, bare, one.file_size, one.CRC))
                found.append((one.filename, data))
        whole = archive(packed)
    except (zipfile.BadZipFile, zlib.error, struct.error, EOFError) as error:
        raise ValueError(str(error)) from error
    if whole != content:
        raise ValueError("it holds more than its entries")
    return found


def _json(value: Any) -> bytes:  # noqa: ANN401 - any JSON
    return json.dumps(value, ensure_ascii=False, separators=(",", ":")).encode()


def _top(show: SolvedShow, fitted: FittedFleet) -> dict[str, Any]:
    site, rules = show.rules.site, show.rules
    lead = fitted.lead / 1000.0
    limits = show.speeds
    drones = []
    for drone in range(fitted.drones):
        folder = f"./drones/{drone_name(drone)}"
        grid = int(fitted.scale[drone]) / 1000.0
        points = fitted.points[fitted.rows(drone)]
        first, last = points[0, 0], points[-1, -1]
        drones.append(
            {
                "type": "generic",
                "settings": {
                    "name": drone_name(drone),
                    "home": [round(float(value) * grid, 3) for value in first],
                    "landAt": [round(float(value) * grid, 3) for value in last],
                    "trajectory": {"$ref": f"{folder}/trajectory.json#"},
                    "lights": {"$ref": f"{folder}/lights.json#"},
                    "yawControl": {"$ref": f"{folder}/yaw.json#"},
                },
            }
        )
    error = fitted.error.velocity.upper
    return {
        "version": 1,
        "environment": {
            "type": "outdoor",
            "location": {
                "origin": [
                    round(site.latitude * _DEGREES),
                    round(site.longitude * _DEGREES),
                    round(site.altitude * 1000.0),
                ],
                "orientation": (site.heading + 90.0) % 360.0,
            },
        },
        "meta": {
            "title": rules.name,
            "segments": {
                name: [round(begin + lead, 3), round(end + lead, 3)]
                for name, (begin, end) in show.phases.items()
            },
        },
        "settings": {
            "cues": {"$ref": "./cues.json#"},
            "validation": {
                "maxAltitude": site.volume_max.z,
                "maxVelocityXY": _above(limits.horizontal + error),
                "maxVelocityZ": _above(limits.down + error),
                "maxVelocityZUp": _above(limits.up + error),
                "minDistance": show.separation.distance,
            },
            "geofence": {
                "version": 1,
                "polygons": [{"isInclusion": True, "points": show.fence.tolist()}],
                "action": "return",
            },
        },
        "swarm": {"drones": drones},
    }


def _above(value: float) -> float:
    """Round up to whole centimetres a second [m/s]."""
    return float(np.ceil(value * 100.0 - 1e-9) / 100.0)


def _cues(show: SolvedShow, fitted: FittedFleet) -> dict[str, Any]:
    return {
        "version": 1,
        "items": [
            {"time": round(stage.start + fitted.lead / 1000.0, 3), "name": stage.name}
            for stage in show.stages
        ],
    }


class _Decimals:
    """Coordinates as text that a reader turns back into the same whole step."""

    def __init__(self) -> None:
        self._tables: dict[int, NDArray[np.object_]] = {}

    def table(self, scale: int) -> NDArray[np.object_]:
        """Text of every step of the grid; index 0 is step -32768."""
        if scale not in self._tables:
            steps = np.arange(-32_768, 32_768)
            metres = steps * scale / 1000.0
            factor = 1000.0 / scale
            # The server drops fractions: none may be left by the last bit of a float.
            short = np.trunc(metres * factor) != steps
            metres[short] = np.nextafter(metres[short], np.sign(steps[short]) * np.inf)
            self._tables[scale] = np.array([repr(value) for value in metres.tolist()])
            self._tables[scale] = self._tables[scale].astype(object)
        return self._tables[scale]


_STANDING, _MOVING = "[%s,[%s,%s,%s],[]]", "[%s,[%s,%s,%s],[[%s,%s,%s],[%s,%s,%s]]]"
"""A point of a trajectory: its time, its place, and the controls before it."""


def _trajectory(fitted: FittedFleet, drone: int, strings: _Decimals) -> bytes:
    rows = fitted.rows(drone)
    points = fitted.points[rows]
    moving = np.any(points != points[:, :1], axis=(1, 2))
    cells = strings.table(int(fitted.scale[drone]))[points + 32_768]
    # One formatting of all cells: a million rows of a fleet would take a while.
    sizes = np.where(moving, 10, 4)
    at = np.cumsum(sizes) - sizes
    text = np.empty(int(sizes.sum()), dtype=object)
    ends = fitted.starts[rows] + fitted.lengths[rows]
    text[at] = [_seconds(time) for time in ends.tolist()]
    text[at[:, None] + np.arange(1, 4)] = cells[:, 3]
    text[at[moving, None] + np.arange(4, 10)] = cells[moving, 1:3].reshape(-1, 6)
    shapes = [_STANDING, *np.where(moving, _MOVING, _STANDING).tolist()]
    written = ",".join(shapes) % ("0.0", *cells[0, 0], *text.tolist())
    return f'{{"version":1,"points":[{written}],"takeoffTime":0}}'.encode()


def _seconds(milliseconds: int) -> str:
    return repr(milliseconds / 1000.0)
