"""What an export of showc's may hold: what its exporter writes, and nothing else.

A folder with a manifest claims to be showc's own. So its files are a closed world: of
blocks, commands, keys and entries, those that the exporter writes are listed here, and
any other is a finding. What follows from the flights and the rules of the manifest is
held against them. Shows of other tools are never asked this.
"""

from __future__ import annotations

import re
from base64 import b64encode
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.documents.archive import Archive
from showc.documents.values import parse_json, unlike
from showc.files import read_file
from showc.foreign.lights import END, FADE_COLOUR, PYRO, PYRO_ALL, SET_COLOUR
from showc.foreign.parameters import landing_speed, parameter_file
from showc.foreign.skyb import COMMENT, LIGHTS, TRAJECTORY, YAW, blocks_of
from showc.verify.report import Check

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from showc.arrays import FloatArray
    from showc.foreign.folder import Manifest
    from showc.foreign.show import ForeignShow

PARAMETERS = "showmode.parm"
"""Name of the parameter file beside show files."""

LARGEST_SMALL = 1 << 20
"""Longest parameter file and binary file that is read [bytes]."""

UNKNOWN = (
    "rules, site, cues, yaw, colours of lights and the order of drones cannot be known "
    "from the folder: `showc verify` of the log holds them against it"
)
"""Said of show mode's formats: what a folder alone does not prove."""

OPAQUE = (
    "rules, the order of drones, and what files hold beside flights cannot be known "
    "from the folder: `showc verify` of the log holds them against it"
)
"""Said of the other formats."""

_SPELT_OUT = 8
"""Findings that are spelt out; the rest are counted."""

_MILLISECOND = 1.5e-3
"""How much the manifest's duration may differ: it is rounded to milliseconds [s]."""

_ROUNDING = 1e-6
"""How much a place may differ that is written twice [m]."""

_HEAD = b"skyb\x02\x01"
"""How a binary file begins: version 2, with a CRC."""

_BLOCKS = [TRAJECTORY, LIGHTS, YAW, COMMENT]
"""Blocks of a binary file, in order."""

_PLAIN = re.compile(
    rb"(?s:(?:\x02|[\x06\x07\x0a\x0b]|[\x05\x09].|[\x04\x08]...)[\x80-\xff]{0,3}+"
    rb"[\x00-\x7f])*+"
)
"""Commands of a light program: waits, colours that are set, fades; then ``END``."""

_NUMBER = r"-?\d++(?:\.\d++)?(?:e-?\d++)?"
_PLACE = rf"\[{_NUMBER},{_NUMBER},{_NUMBER}\]"
_POINT = rf"\[{_NUMBER},{_PLACE},\[(?:{_PLACE},{_PLACE})?+\]\]"
_TURN = rf"\[{_NUMBER},{_NUMBER}\]"
_TEXTS = {
    "trajectory": re.compile(
        rf'\{{"version":1,"points":\[{_POINT}(?:,{_POINT})*+\],"takeoffTime":0\}}'
    ),
    "yaw": re.compile(rf'\{{"version":1,"setpoints":\[{_TURN}(?:,{_TURN})*+\]\}}'),
}
"""Documents of a drone of a compiled show, as they are written."""


def drone_name(drone: int) -> str:
    """Name of a drone, counting from 0, in files: ``drone_0001``."""
    return f"drone_{drone + 1:04d}"


def names_of(form: str, drones: int) -> set[str]:
    """Return the names of the files of an export."""
    whole = {
        "skyc": "show.skyc",
        "skybrush-csv": "show.zip",
        "vviz": "show.vviz",
        "gltf": "show.glb",
        "kml": "show.kml",
    }
    each = {"skyb": ".skyb", "poly7": ".csv", "crazyflie": ".traj"}
    if form in each:
        found = {f"{drone_name(drone)}{each[form]}" for drone in range(drones)}
    else:
        found = {whole[form]}
    return found | ({PARAMETERS} if form in {"skyb", "skyc"} else set())


def what_is_written(folder: Path, manifest: Manifest, show: ForeignShow) -> list[Check]:
    """Hold the files of an export against what the exporter writes.

    Parameters
    ----------
    folder
        Where they lie.
    manifest
        What the manifest says.
    show
        What was read of the files.

    Raises
    ------
    DamagedFileError
        If a file cannot be read.
    """
    return [_closed(folder, manifest, show), _sized(manifest, show)]


def _closed(folder: Path, manifest: Manifest, show: ForeignShow) -> Check:
    wrong = _beside(folder, manifest, show)
    name, note = "files hold what showc writes, and nothing else", UNKNOWN
    if manifest.format == "skyb":
        wrong += _binaries(folder, manifest, show)
    elif manifest.format == "skyc":
        wrong += _compiled(folder / "show.skyc", manifest, show)
    else:
        name, note = "files are named as showc names them", OPAQUE
    if len(wrong) > _SPELT_OUT:
        wrong = [*wrong[:_SPELT_OUT], f"and {len(wrong) - _SPELT_OUT} more"]
    return Check(
        "VRF587",
        "integrity",
        name,
        "fail" if wrong else "pass",
        notes=(*wrong, note),
    )


def _sized(manifest: Manifest, show: ForeignShow) -> Check:
    """Whether the manifest counts the drones and the time of the files."""
    off = abs(manifest.duration - show.duration)
    same = manifest.drones == show.drones and off <= _MILLISECOND
    said = (
        f"the manifest says {manifest.drones} drones and {manifest.duration:.3f} s, "
        f"the files have {show.drones} and {show.duration:.3f} s"
    )
    return Check(
        "VRF588",
        "integrity",
        "drones and duration are those of the manifest",
        "pass" if same else "fail",
        notes=() if same else (said,),
    )


def _beside(folder: Path, manifest: Manifest, show: ForeignShow) -> list[str]:
    """Say what is wrong with the names of the files, and with the parameters."""
    found = {one.name for one in folder.iterdir()} - {"export.json"}
    wanted = names_of(manifest.format, show.drones)
    wrong = [f"{name} is missing" for name in sorted(wanted - found)]
    wrong += [f"{name} is no file of an export" for name in sorted(found - wanted)]
    if PARAMETERS in wanted & found:
        content = read_file(folder / PARAMETERS, LARGEST_SMALL)
        right = parameter_file(landing_speed(show.tracks))
        if content != right:
            wrong.append(
                f"{PARAMETERS} is not what showc writes for these flights: it has "
                f"{_lines(content, right)}, and lacks {_lines(right, content)}"
            )
    return wrong


def _lines(one: bytes, other: bytes) -> str:
    """Name lines of one file that the other does not have."""
    there = set(other.split(b"\n"))
    odd = [line for line in one.split(b"\n") if line not in there]
    said = [repr(line.decode("ascii", "replace"))[:60] for line in odd[:3]]
    return ", ".join(said) or "nothing else"


def _binaries(folder: Path, manifest: Manifest, show: ForeignShow) -> list[str]:
    """Say what binary files hold that the exporter does not write."""
    wrong = []
    for drone, name in enumerate(show.names):
        path = folder / f"{name}.skyb"
        if path.is_file():
            content = read_file(path, LARGEST_SMALL)
            found = _binary(content, path.name, drone, manifest)
            wrong += [f"{path.name}: {one}" for one in [*found, *_stored(show, drone)]]
    return wrong


def _binary(content: bytes, name: str, drone: int, manifest: Manifest) -> Iterator[str]:
    if not content.startswith(_HEAD):
        yield f"begins with {content[:6]!r}; showc writes version 2 with a CRC"
    blocks = blocks_of(content, name)[0]
    kinds = [kind for kind, _, _ in blocks]
    if kinds != _BLOCKS:
        said = ", ".join(map(str, kinds[:_SPELT_OUT]))
        yield f"has blocks of types {said}; showc writes {_BLOCKS}, each once"
    body = {kind: content for kind, _, content in reversed(blocks)}
    flight, yaw = body.get(TRAJECTORY, bytes(9)), body.get(YAW, b"\0")
    if flight[0] & 0x80 or any(flight[7:9]):
        yield "its trajectory turns the drone; showc writes yaw apart"
    if yaw[:1] != b"\0":
        yield f"its yaw is of mode {yaw[0] if yaw else 'none'}; showc writes 0"
    comment = f"showc {manifest.release}: {manifest.show}, drone {drone + 1}"
    if COMMENT in body and body[COMMENT] != comment.encode("utf-8", "replace"):
        said = body[COMMENT].decode("utf-8", "replace")
        yield f"its comment is {said!r:.80}; wanted {comment!r:.80}"
    yield from odd_command(body.get(LIGHTS, b"\0"))


def _stored(show: ForeignShow, drone: int) -> Iterator[str]:
    """Say how a trajectory is stored otherwise: no cubics, or pieces of no length."""
    stored = show.stored[drone]
    degrees = stored.degrees
    if not np.isin(degrees[:, :3], (0, 3)).all() or degrees[:, 3].any():
        yield "its trajectory has pieces that are not cubic; showc writes no others"
    if stored.block != 9 + int((3 + 2 * degrees.sum(axis=1)).sum()):
        yield "its trajectory has pieces of no length"


def odd_command(program: bytes) -> Iterator[str]:
    """Say which command of a light program the exporter does not write."""
    begun = _PLAIN.match(program)
    end = begun.end() if begun is not None else 0
    if program[end:] == bytes([END]):
        return
    if end >= len(program):
        yield "its light program has no end"
        return
    command = program[end]
    said = f"command {command}"
    if command in {PYRO, PYRO_ALL}:
        said += ", pyrotechnics,"
    elif command == END:
        said = f"{len(program) - end - 1} bytes after its end"
    elif SET_COLOUR <= command < FADE_COLOUR + 4:
        said = "a command that is cut"
    yield f"its light program has {said} at byte {end}; showc writes colours alone"


def _compiled(path: Path, manifest: Manifest, show: ForeignShow) -> list[str]:
    """Say what an archive holds that the exporter does not write."""
    if not path.is_file():
        return []
    archive = Archive(path)
    folders = [f"drones/{drone_name(drone)}" for drone in range(show.drones)]
    parts = ("trajectory", "lights", "yaw")
    wanted = {f"{folder}/{part}.json" for folder in folders for part in parts}
    wanted |= {"show.json", "cues.json"}
    names = set(archive.names)
    wrong = [f"{path.name}: lacks {name}" for name in sorted(wanted - names)]
    wrong += [f"{path.name}: {name!r} is unknown" for name in sorted(names - wanted)]
    if wanted - names:
        return wrong
    top = parse_json(archive.read("show.json"), f"{path}:show.json")
    wrong += islice(unlike(top, _top(top, manifest, show), "show.json"), 2 * _SPELT_OUT)
    cues = parse_json(archive.read("cues.json"), f"{path}:cues.json")
    wrong += islice(unlike(cues, _cues(cues), "cues.json"), _SPELT_OUT)
    for drone, folder in enumerate(folders):
        for part, pattern in _TEXTS.items():
            name = f"{folder}/{part}.json"
            if not pattern.fullmatch(archive.read(name).decode("utf-8", "replace")):
                wrong.append(f"{name} is not what showc writes")
        program = show.lights[drone]
        program = program if isinstance(program, bytes) else b""
        lights = b'{"version":1,"data":"%s"}' % b64encode(program)
        if archive.read(f"{folder}/lights.json") != lights:
            wrong.append(f"{folder}/lights.json is not what showc writes")
        wrong += [f"{drone_name(drone)}: {one}" for one in odd_command(program)]
        if len(wrong) > 1000:
            break
    return wrong


def _top(top: Any, manifest: Manifest, show: ForeignShow) -> dict[str, Any]:  # noqa: ANN401
    """Return what ``show.json`` must be; what is free in it, as it was found."""
    asked = manifest.asked
    assert asked.volume is not None and asked.separation is not None  # noqa: S101, PT018
    roof = asked.volume[1][2]

    def free(path: str, fits: Callable[[Any], bool], wanted: str) -> Any:  # noqa: ANN401
        return _free(top, path.split("."), fits, wanted)

    def site(value: Any) -> bool:  # noqa: ANN401
        return _whole(value, 3) and abs(value[0]) <= 9e8 and abs(value[1]) <= 1.8e9

    def below(value: Any) -> bool:  # noqa: ANN401
        return _real(value) and -_ROUNDING <= roof - value <= manifest.error + _ROUNDING

    segments = {
        name: free(f"meta.segments.{name}", _span, "[begin, end]")
        for name in ("takeoff", "show", "landing")
    }
    return {
        "version": 1,
        "environment": {
            "type": "outdoor",
            "location": {
                "origin": free("environment.location.origin", site, "a place"),
                "orientation": free(
                    "environment.location.orientation", _bearing, "a bearing"
                ),
            },
        },
        "meta": {"title": manifest.show, "segments": segments},
        "settings": {
            "cues": {"$ref": "./cues.json#"},
            "validation": {
                "maxAltitude": free("settings.validation.maxAltitude", below, "roof"),
                "maxVelocityXY": _above(asked.speed_xy),
                "maxVelocityZ": _above(asked.speed_down),
                "maxVelocityZUp": _above(asked.speed_up),
                "minDistance": asked.separation.distance,
            },
            "geofence": {
                "version": 1,
                "polygons": [{"isInclusion": True, "points": _fence(manifest, show)}],
                "action": "return",
            },
        },
        "swarm": {"drones": [_drone(show, drone) for drone in range(show.drones)]},
    }


def _fence(manifest: Manifest, show: ForeignShow) -> Any:  # noqa: ANN401 - JSON
    """Return the fence that the file must have: the rules', or the walls'."""
    if manifest.asked.fence:
        return manifest.asked.fence[0].points.tolist()
    assert manifest.asked.volume is not None  # noqa: S101 - a manifest has one
    (x, y, _), (far_x, far_y, _) = manifest.asked.volume
    error = manifest.error
    inner = np.array([x + error, y + error, far_x - error, far_y - error])
    walls = inner[[[0, 1], [2, 1], [2, 3], [0, 3]]]
    found = show.fences[0].points if show.fences else np.zeros((0, 2))
    # The error that the walls have been moved by is known rounded up.
    near = found.shape == walls.shape and np.abs(found - walls).max() <= 1e-4
    return (found if near else walls).tolist()


def _drone(show: ForeignShow, drone: int) -> dict[str, Any]:
    folder = f"./drones/{drone_name(drone)}"
    tracks = show.tracks
    first = tracks.position[tracks.first[drone], 0]
    last = tracks.position[tracks.first[drone + 1] - 1, -1]
    return {
        "type": "generic",
        "settings": {
            "name": drone_name(drone),
            "home": _place(show.home, drone, first),
            "landAt": _place(show.land, drone, last),
            "trajectory": {"$ref": f"{folder}/trajectory.json#"},
            "lights": {"$ref": f"{folder}/lights.json#"},
            "yawControl": {"$ref": f"{folder}/yaw.json#"},
        },
    }


def _place(found: FloatArray | None, drone: int, flown: FloatArray) -> list[float]:
    """Return where a drone must stand by its flight, as the file has it."""
    if found is not None and np.abs(found[drone] - flown).max() <= _ROUNDING:
        return [float(value) for value in found[drone]]
    return [round(float(value), 3) for value in flown]


def _cues(found: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
    """Return what ``cues.json`` must be, its times and names as they were found."""
    items = found.get("items") if isinstance(found, dict) else None
    items = items if isinstance(items, list) else []
    each = []
    for number in range(len(items)):
        place = ["items", str(number)]
        each.append(
            {
                "time": _free(found, [*place, "time"], _real, "a time"),
                "name": _free(found, [*place, "name"], _text, "a name"),
            }
        )
    return {"version": 1, "items": each}


def _free(
    found: Any,  # noqa: ANN401 - JSON
    path: Sequence[str],
    fits: Callable[[Any], bool],
    wanted: str,
) -> Any:  # noqa: ANN401 - JSON
    """Return what lies at a path in a document, if it fits; else what is wanted."""
    for key in path:
        if isinstance(found, list) and key.isdigit() and int(key) < len(found):
            found = found[int(key)]
        elif isinstance(found, dict) and key in found:
            found = found[key]
        else:
            return wanted
    return found if fits(found) else wanted


def _real(value: Any) -> bool:  # noqa: ANN401 - JSON
    return type(value) in {int, float} and abs(value) < 1e12


def _text(value: Any) -> bool:  # noqa: ANN401 - JSON
    return isinstance(value, str)


def _bearing(value: Any) -> bool:  # noqa: ANN401 - JSON
    return _real(value) and 0.0 <= value <= 360.0


def _whole(value: Any, count: int) -> bool:  # noqa: ANN401 - JSON
    many = isinstance(value, list) and len(value) == count
    return many and all(type(one) is int for one in value)


def _span(value: Any) -> bool:  # noqa: ANN401 - JSON
    many = isinstance(value, list) and len(value) == 2
    return many and all(_real(one) for one in value)


def _above(value: float | None) -> float:
    """Round up to whole centimetres a second, as a file's own limits are [m/s]."""
    assert value is not None  # noqa: S101 - a manifest has it
    return float(np.ceil(value * 100.0 - 1e-9) / 100.0)
