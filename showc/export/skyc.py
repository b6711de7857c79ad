"""Write Skybrush's compiled shows: a zip of JSON documents, one trajectory a drone."""

from __future__ import annotations

import base64
import io
import json
import zipfile
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.export.skyb import runs, waiting
from showc.processes import side_by_side

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from showc.export.fit import FittedFleet
    from showc.export.solved import SolvedShow

STAMP = (1980, 1, 1, 0, 0, 0)
"""Date of every entry: the oldest a zip knows, that equal shows have equal bytes."""

LEVEL = 4
"""Of compression: beyond it the file shrinks by a twentieth, in 1.6 times the time."""

PARTS = 4
"""Parts of a fleet that are written side by side: lights are sought for many drones
together, so few parts, and evenly large ones."""

_DEGREES = 1e7
"""Steps of latitude and longitude in a degree."""


def drone_name(drone: int) -> str:
    """Name of a drone, counting from 0, in files: ``drone_0001``."""
    return f"drone_{drone + 1:04d}"


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

    def written(drones: Sequence[int]) -> list[tuple[str, str]]:
        entries = []
        for drone, (program, yaw) in zip(drones, beside(drones), strict=True):
            folder = f"drones/{drone_name(drone)}"
            lights = {"version": 1, "data": base64.b64encode(program).decode()}
            turns = {"version": 1, "setpoints": yaw}
            flight = _trajectory(fitted, drone, strings)
            entries += [
                (f"{folder}/trajectory.json", flight),
                (f"{folder}/lights.json", _json(lights)),
                (f"{folder}/yaw.json", _json(turns)),
            ]
        return entries

    every = range(fitted.drones)
    most = -(-fitted.drones // PARTS)
    parts = [partial(written, every[low : low + most]) for low in every[::most]]
    entries = [
        ("show.json", _json(_top(show, fitted))),
        ("cues.json", _json(_cues(show, fitted))),
    ]
    for some in side_by_side(parts):
        entries += some
    return archive(entries)


def archive(entries: Iterable[tuple[str, str]]) -> bytes:
    """Return a zip of texts by name, the same bytes at any time of day."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=LEVEL) as out:
        for name, text in entries:
            entry = zipfile.ZipInfo(name, STAMP)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            out.writestr(entry, text)
    return stream.getvalue()


def _json(value: Any) -> str:  # noqa: ANN401 - any JSON
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def _top(show: SolvedShow, fitted: FittedFleet) -> dict[str, Any]:
    site, rules = show.rules.site, show.rules
    lead = fitted.lead / 1000.0
    limits = show.speeds
    drones = []
    for drone in range(fitted.drones):
        folder = f"./drones/{drone_name(drone)}"
        grid = int(fitted.scale[drone]) / 1000.0
        first, last = fitted.points[drone, 0, 0], fitted.points[drone, -1, -1]
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
        self._tables: dict[int, list[str]] = {}

    def table(self, scale: int) -> list[str]:
        """Text of every step of the grid; index 0 is step -32768."""
        if scale not in self._tables:
            steps = np.arange(-32_768, 32_768)
            metres = steps * scale / 1000.0
            factor = 1000.0 / scale
            # The server drops fractions: none may be left by the last bit of a float.
            short = np.trunc(metres * factor) != steps
            metres[short] = np.nextafter(metres[short], np.sign(steps[short]) * np.inf)
            self._tables[scale] = [repr(value) for value in metres.tolist()]
        return self._tables[scale]


def _trajectory(fitted: FittedFleet, drone: int, strings: _Decimals) -> str:
    table = strings.table(int(fitted.scale[drone]))
    points = fitted.points[drone]
    text = [table[value] for value in (points.ravel() + 32_768).tolist()]
    begin, step = int(fitted.begin[drone]), fitted.step
    rows = []
    place = f"[{text[0]},{text[1]},{text[2]}]"
    time = 0
    rows.append(f"[0.0,{place},[]]")
    for wait in waiting(begin):
        time += wait
        rows.append(f"[{_seconds(time)},{place},[]]")
    starts, lengths = runs(points, step)
    moving = np.any(points[starts] != points[starts, :1], axis=(1, 2)).tolist()
    for first, length, moves in zip(
        starts.tolist(), lengths.tolist(), moving, strict=True
    ):
        time = begin + step * (first + length)
        a, b, c, d, e, f, g, h, i = text[12 * first + 3 : 12 * first + 12]
        inner = f"[{a},{b},{c}],[{d},{e},{f}]" if moves else ""
        rows.append(f"[{_seconds(time)},[{g},{h},{i}],[{inner}]]")
    return f'{{"version":1,"points":[{",".join(rows)}],"takeoffTime":0}}'


def _seconds(milliseconds: int) -> str:
    return repr(milliseconds / 1000.0)
