"""A show of others as a script: what it holds becomes formations, the rest transitions.

The fleet holds where no drone moves faster than a few centimetres a second for a while.
Each such picture is a formation with its colours; between two of them lies a
transition, which showc solves again in the least time. The first hold, on the ground,
gives the pads. What moves all the time has no picture: instants can be asked for.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import UsageError
from showc.foreign.lights import read_lights
from showc.foreign.motion import place_at
from showc.light.colour import srgb_bytes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import ByteArray, FloatArray
    from showc.foreign.show import ForeignShow
    from showc.verify.kernel.slices import Tracks


STILL = 0.05
"""Speed below which a drone stands [m/s]: rounded files creep."""

SHORTEST_HOLD = 0.5
"""Shortest time that counts as a hold [s]."""

ON_GROUND = 1.0
"""How far above its first place a drone still stands on its pad [m]."""

SAME = 0.1
"""Distance within which two pictures are the same [m]."""

GROUND = "on the ground"
"""Name of what the fleet shows before and after the flight."""

MARGIN = 10.0
"""Space left around the flights [m]: solved transitions take other ways."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """The fleet at one hold."""

    name: str
    """``hold-1``, ``hold-2``, ..., or the cue's."""
    begin: float
    """Show time [s]."""
    end: float
    """Show time [s]."""
    places: FloatArray
    """Shape (drones, 3) [m]."""
    colours: ByteArray | None
    """Screen colours (sRGB), shape (drones, 3); None: the file has no lights."""


@dataclass(frozen=True, slots=True)
class Imported:
    """A script and the tables beside it."""

    script: str
    """YAML."""
    tables: dict[str, str]
    """CSV of each formation, by its name relative to the script."""
    pictures: tuple[Picture, ...]
    """What the script shows."""
    lost: tuple[str, ...]
    """What of the show is not in it."""


def holds(tracks: Tracks) -> list[tuple[float, float]]:
    """Return the times in which no drone moves, in order [s]."""
    width = np.maximum(tracks.ends - tracks.starts, 1e-9)
    reach = tracks.position.max(axis=1) - tracks.position.min(axis=1)
    moving = np.sqrt((reach**2).sum(axis=1)) > STILL * width
    begin, end = tracks.starts[moving], tracks.ends[moving]
    order = np.argsort(begin)
    found: list[tuple[float, float]] = []
    free = tracks.begin
    for low, high in zip(begin[order].tolist(), end[order].tolist(), strict=True):
        if low - free >= SHORTEST_HOLD:
            found.append((free, low))
        free = max(free, high)
    if tracks.end - free >= SHORTEST_HOLD:
        found.append((free, tracks.end))
    return found


def held(show: ForeignShow, spans: Sequence[tuple[float, float]]) -> list[Picture]:
    """Return what the fleet shows in each of some times, in order.

    A picture that is shown again at once has the name that it had; on the ground the
    name is ``on the ground``.
    """
    tracks, spans = show.tracks, sorted(spans)
    ground = tracks.position[tracks.first[:-1], 0]
    middles = np.array([0.5 * (begin + end) for begin, end in spans])
    colours = colours_at(show, middles)
    found: list[Picture] = []
    last: Picture | None = None
    count = 0
    for row, (begin, end) in enumerate(spans):
        places = place_at(tracks, float(middles[row]))
        off = np.sqrt(((places - ground) ** 2).sum(axis=1)).max()
        low = float((places[:, 2] - ground[:, 2]).max())
        if off <= SAME or low <= ON_GROUND:
            name = GROUND
        elif last is not None and np.abs(last.places - places).max() <= SAME:
            name = last.name
        else:
            count += 1
            name = f"hold-{count}"
        light = None if colours is None else colours[row]
        found.append(Picture(name, begin, end, places, light))
        last = last if name == GROUND else found[-1]
    return found


def pictures(show: ForeignShow, instants: Sequence[float] = ()) -> list[Picture]:
    """Return the holds of a show in the air, and what is there at ``instants`` [s]."""
    found: dict[str, Picture] = {}
    for one in held(show, [*holds(show.tracks), *((at, at) for at in instants)]):
        if one.name != GROUND:
            found.setdefault(one.name, one)
    return list(found.values())


def colours_at(show: ForeignShow, times: FloatArray) -> ByteArray | None:
    """Screen colours of all drones, shape (times, drones, 3); None: none are known.

    A drone without a light program among others with one is dark.

    Raises
    ------
    DamagedFileError
        If a light program is none.
    """
    if not any(light is not None for light in show.lights):
        return None
    result = np.zeros((times.size, show.drones, 3), dtype=np.uint8)
    for drone, light in enumerate(show.lights):
        track = light
        if isinstance(track, bytes):
            track = read_lights(track, show.names[drone], show.duration)
        if track is not None:
            result[:, drone] = srgb_bytes(track.at(times) / 255.0)
    return result


def import_show(
    show: ForeignShow, folder: str, instants: Sequence[float] = ()
) -> Imported:
    """Write a show down as a script.

    Parameters
    ----------
    show
        What was read.
    folder
        Where its tables go, relative to the script.
    instants
        Show times whose pictures become formations too [s].

    Raises
    ------
    UsageError
        If the fleet holds nowhere in the air and no instants are given.
    """
    found = pictures(show, instants)
    if not found:
        raise UsageError(
            f"{show.path}: the fleet stands still nowhere in the air, so there is no "
            "picture to fly to; name instants with --at, for example --at 30,60"
        )
    tables = {f"{folder}/pads.csv": _table(_pads(show), None)}
    for picture in found:
        tables[f"{folder}/{picture.name}.csv"] = _table(picture.places, picture.colours)
    lines = [
        *_head(show, found),
        f"pads: {{type: csv, file: {folder}/pads.csv}}",
        f"launch: {{altitude: {_launch(show, found):g} m}}",
        "",
        "formations:",
        *(
            f"  {picture.name}: {{type: csv, file: {folder}/{picture.name}.csv}}"
            for picture in found
        ),
        "",
        "transitions:",
        *(
            f"  - {{to: {picture.name}, hold: "
            f"{max(round(picture.end - picture.begin, 3), SHORTEST_HOLD):g} s}}"
            f" # from {picture.begin:.2f} s in the file"
            for picture in found
        ),
    ]
    return Imported("\n".join(lines) + "\n", tables, tuple(found), _lost(show, found))


def _head(show: ForeignShow, found: list[Picture]) -> list[str]:
    low, high = _box(show)
    lines = [
        "showc: 1",
        f"name: {json.dumps(show.title, ensure_ascii=False)}",
        "",
        "site:",
    ]
    if show.location is not None:
        where = show.location
        origin = f"latitude: {where.latitude:.7f}, longitude: {where.longitude:.7f}"
        if where.altitude is not None:
            origin += f", altitude: {where.altitude:g}"
        lines += [
            f"  origin: {{{origin}}}",
            f"  heading: {_bearing(where.orientation - 90.0):g} deg",
        ]
    lines.append(f"  volume: {{min: {low}, max: {high}}}")
    fences = [one for one in show.fences if one.inclusion]
    if fences:
        corners = [[round(x, 3), round(y, 3)] for x, y in fences[0].points.tolist()]
        lines.append(f"  fence: {corners}")
    lines += ["", f"drones: {show.drones}"]
    limits = _limits(show)
    if limits:
        lines.append(f"limits: {{{limits}}}")
    lines.append(f"separation: {_separation(show, found):g} m")
    return lines


def _bearing(degrees: float) -> float:
    """Return the same bearing from 0 to 360 [deg]."""
    return round(degrees % 360.0, 6)


def _limits(show: ForeignShow) -> str:
    """Speeds that the file declares, as limits."""
    declared = show.declared
    if declared.speed_xy is None or declared.speed_up is None:
        return ""
    level, down = declared.speed_xy, declared.speed_down or declared.speed_up
    return (
        f"speed: [{level:g}, {level:g}, {declared.speed_up:g}], "
        f"level_speed: {level:g}, descent: {down:g}"
    )


def _box(show: ForeignShow) -> tuple[list[float], list[float]]:
    """Corners of a volume with room around the flights."""
    body = show.tracks.position.reshape(-1, show.tracks.position.shape[2])
    low = np.floor(body.min(axis=0) - MARGIN)
    high = np.ceil(body.max(axis=0) + MARGIN)
    low[2] = np.floor(min(body[:, 2].min() + SAME, 0.0))
    if show.declared.altitude is not None:
        high[2] = max(show.declared.altitude, np.ceil(body[:, 2].max()))
    return low.tolist(), high.tolist()


def _separation(show: ForeignShow, found: list[Picture]) -> float:
    """Least distance: the file's, but no more than pads and pictures leave [m]."""
    nearest = [_nearest(_pads(show)), *(_nearest(one.places) for one in found)]
    least = np.floor(100.0 * min(nearest)) / 100.0
    if show.declared.distance is not None:
        least = min(least, show.declared.distance)
    return max(float(least), 0.05)


def _nearest(places: FloatArray) -> float:
    from scipy.spatial import cKDTree  # noqa: PLC0415 - heavy, for this alone

    if places.shape[0] < 2:
        return 2.0
    distance, _ = cKDTree(places).query(places, k=2)
    return float(distance[:, 1].min())


def _pads(show: ForeignShow) -> FloatArray:
    return np.asarray(show.tracks.position[show.tracks.first[:-1], 0])


def _launch(show: ForeignShow, found: list[Picture]) -> float:
    """Height of the first hover above the pads: below the first picture [m]."""
    lowest = float(found[0].places[:, 2].min() - _pads(show)[:, 2].max())
    return round(min(max(lowest, 3.0), 20.0), 1)


def _table(places: FloatArray, colours: ByteArray | None) -> str:
    heads = "x,y,z" if colours is None else "x,y,z,red,green,blue"
    rows = [heads]
    for index, (x, y, z) in enumerate((places + 0.0).tolist()):
        row = f"{x:.3f},{y:.3f},{z:.3f}"
        if colours is not None:
            row += ",{},{},{}".format(*colours[index].tolist())
        rows.append(row)
    return "\n".join(rows) + "\n"


def _lost(show: ForeignShow, found: list[Picture]) -> tuple[str, ...]:
    """Say what is not in the script."""
    held = sum(picture.end - picture.begin for picture in found)
    moving = show.duration - held
    notes = [
        f"how {moving:.1f} s of {show.duration:.1f} s are flown: they are solved anew",
        "which drone is where: drones are assigned anew",
    ]
    if any(light is not None for light in show.lights):
        notes.append("lights between the pictures: they fade evenly")
    if sum(not fence.inclusion for fence in show.fences):
        notes.append("areas of the fence to stay out of")
    if sum(fence.inclusion for fence in show.fences) > 1:
        notes.append("areas of the fence to stay in, but for the first")
    if show.cues:
        notes.append(f"{len(show.cues)} cues")
    return tuple(notes)
