"""A foreign show as a script: what it holds becomes formations, the rest transitions.

The fleet holds where no drone moves faster than a few centimetres a second for a while.
Each such picture is a formation with its colours; between two of them lies a
transition, which showc solves again in the least time. A picture that moves is played
as it is, from a table of frames, and lights that change from a table of colours. The
first hold, on the ground, gives the pads. What moves all the time has no picture:
instants and stretches can be asked for.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import UsageError
from showc.foreign.acts import (
    COARSEST,
    MOST_ROWS,
    SHORTEST_HOLD,
    Act,
    acts,
    frames_of,
    holds,
    row_step,
)
from showc.foreign.lights import FRAME, Budget, read_lights
from showc.foreign.motion import place_at
from showc.light.colour import srgb_bytes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import ByteArray, FloatArray
    from showc.foreign.acts import Frames, Span
    from showc.foreign.show import ForeignShow, LightTrack


ON_GROUND = 1.0
"""How far above its first place a drone still stands on its pad [m]."""

SAME = 0.1
"""Distance within which two pictures are the same [m]."""

GROUND = "on the ground"
"""Name of what the fleet shows before and after the flight."""

STATED = 0.02
"""Distance from a file from which a curve beside it is named [m]."""

MARGIN = 10.0
"""Space left around the flights [m]: solved transitions take other ways."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What the fleet shows for a while."""

    name: str
    """``hold-1``, ``hold-2``, ...; ``move-1``, ... where it never holds."""
    begin: float
    """Show time [s]."""
    end: float
    """Show time [s]."""
    places: FloatArray
    """Shape (drones, 3) [m]; of one that moves, at its beginning."""
    colours: ByteArray | None
    """Screen colours (sRGB), shape (drones, 3); None: the file has no lights."""
    moves: bool = False
    """Whether it moves."""
    frames: Frames | None = None
    """How it moves; None: it stands, or frames would be too far apart."""


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


def pictures(
    show: ForeignShow, instants: Sequence[float] = (), moving: Sequence[Span] = ()
) -> list[Picture]:
    """Return what a show shows in the air, in order.

    Parameters
    ----------
    show
        What was read.
    instants
        Show times whose pictures are wanted too [s].
    moving
        Stretches that are wanted as moving pictures [s].

    Raises
    ------
    UsageError
        If one of them is none of the show.
    """
    begin, end = show.tracks.begin, show.tracks.end
    for at in instants:
        if not begin <= at <= end:
            raise UsageError(
                f"{at:g} s is no time of the show; wanted {begin:g} to {end:g} s"
            )
    spans = [*holds(show.tracks), *((at, at) for at in instants)]
    stands = [one for one in held(show, spans) if one.name != GROUND]
    found: list[Picture] = []
    every = acts(show.tracks, [(one.begin, one.end) for one in stands], moving)
    for act in every:
        within = [one for one in stands if act.begin <= one.begin <= act.end]
        if act.moves:
            found.append(_moving(show, act, within, len(found)))
        elif found and found[-1].name == within[0].name:
            found[-1] = replace(found[-1], end=act.end)
        else:
            found.append(within[0])
    return found


def _moving(
    show: ForeignShow, act: Act, within: Sequence[Picture], before: int
) -> Picture:
    colours = colours_at(show, np.array([act.begin]))
    return Picture(
        within[0].name if within else f"move-{before + 1}",
        act.begin,
        act.end,
        place_at(show.tracks, act.begin),
        None if colours is None else colours[0],
        moves=True,
        frames=frames_of(show.tracks, act),
    )


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
    for drone, track in enumerate(_light_tracks(show)):
        if track is not None:
            result[:, drone] = srgb_bytes(track.at(times) / 255.0)
    return result


@lru_cache(maxsize=1)
def _light_tracks(show: ForeignShow) -> list[LightTrack | None]:
    """Play all programs, once a show."""
    budget = Budget.of(show.lights)
    return [
        read_lights(light, show.names[drone], show.duration, budget)
        if isinstance(light, bytes)
        else light
        for drone, light in enumerate(show.lights)
    ]


def import_show(
    show: ForeignShow,
    folder: str,
    instants: Sequence[float] = (),
    moving: Sequence[Span] = (),
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
    moving
        Stretches that become moving formations too [s].

    Raises
    ------
    UsageError
        If the fleet holds nowhere in the air and no instants or stretches are given,
        or if they are none of the show's.
    """
    found = pictures(show, instants, moving)
    if not found:
        raise UsageError(
            f"{show.path}: the fleet stands still nowhere in the air, so there is no "
            "picture to fly to; name instants with --at, for example --at 30,60, or "
            "stretches to be played as they are with --moving, for example "
            "--moving 30-60"
        )
    tables = {f"{folder}/pads.csv": _table(_pads(show), None)}
    lines = [
        *_head(show, found),
        f"pads: {{type: csv, file: {folder}/pads.csv}}",
        f"launch: {{altitude: {_launch(show, found):g} m}}",
    ]
    if any(picture.frames is not None for picture in found):
        # No mission goes along a curve.
        lines.append("mission: {wanted: false}")
    lines += ["", "formations:"]
    for picture in found:
        name = f"{folder}/{picture.name}.csv"
        lines.append(f"  {picture.name}: {{type: csv, file: {name}}}")
        tables[name] = _table(picture.places, picture.colours)
    lines += ["", "transitions:"]
    lights = _light_tracks(show)
    for picture in found:
        own = f"{folder}/{picture.name}"
        lines += _transition(picture, own)
        if picture.frames is not None:
            tables[f"{own}-frames.csv"] = _frame_table(picture.frames)
        table = _light_table(lights, picture)
        if table:
            lines.append(f"    lights: {own}-lights.csv")
            tables[f"{own}-lights.csv"] = table
    script = "\n".join(lines) + "\n"
    return Imported(script, tables, tuple(found), _lost(show, found, tables))


def _transition(picture: Picture, own: str) -> list[str]:
    """Lines of a transition to a picture; its tables' names begin with ``own``."""
    hold = max(round(picture.end - picture.begin, 3), SHORTEST_HOLD)
    frames = picture.frames
    if frames is not None:
        hold = round(frames.length + frames.ramp, 3)
    lines = [
        f"  - to: {picture.name} # from {picture.begin:.2f} s in the file",
        f"    hold: {hold:g} s",
    ]
    if frames is not None:
        follow = f"{{file: {own}-frames.csv, ramp: {frames.ramp:g}}}"
        lines.append(f"    motion: [{{follow: {follow}}}]")
    return lines


def _frame_table(frames: Frames) -> str:
    rows = ["time,place,x,y,z"]
    for index, places in enumerate((frames.points + 0.0).tolist()):
        time = f"{index * frames.step:.4f}"
        rows += [
            f"{time},{place},{x:.4f},{y:.4f},{z:.4f}"
            for place, (x, y, z) in enumerate(places, 1)
        ]
    return "\n".join(rows) + "\n"


def _light_table(lights: Sequence[LightTrack | None], picture: Picture) -> str:
    """Colours over a picture's time; nothing where they do not change, or too often."""
    rows = ["time,place,red,green,blue"]
    for place, light in enumerate(lights, 1):
        if light is None:
            continue
        # A jump lies between two rows that are a frame apart.
        jumps = light.times[1:][np.diff(light.times) == 0.0] - FRAME
        times = np.concatenate([light.times, jumps])
        times = times[(times > picture.begin) & (times < picture.end)]
        times = np.unique(np.round([picture.begin, *times, picture.end], 3))
        colours = srgb_bytes(light.at(times) / 255.0)
        same = np.all(colours[1:] == colours[:-1], axis=1)
        if same.all():
            continue
        keep = np.append(True, ~same) | np.append(~same, True)
        rows += [
            f"{time - picture.begin:.3f},{place},{red},{green},{blue}"
            for time, (red, green, blue) in zip(
                times[keep].tolist(), colours[keep].tolist(), strict=True
            )
        ]
    return "\n".join(rows) + "\n" if 1 < len(rows) <= MOST_ROWS else ""


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
    for picture in found:
        if picture.frames is not None:
            # Between frames, and on a curve beside them, drones are a bit nearer.
            near = min(_nearest(places) for places in picture.frames.points)
            nearest.append(near - 2.0 * picture.frames.beside)
    # At least half a centimetre less, that drones that stand there can be proved to.
    least = np.floor(100.0 * min(nearest) - 0.5) / 100.0
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


def _too_far_apart(show: ForeignShow, picture: Picture) -> str:
    """Say why a moving picture has no frames."""
    apart = row_step(show.tracks, Act(picture.begin, picture.end, moves=True))
    if apart > COARSEST:
        return f"the file's rows are {apart:.1f} s apart; wanted {COARSEST:g} s or less"
    length = picture.end - picture.begin
    return (
        f"frames of {show.drones} drones for {length:.1f} s would be more than "
        f"{COARSEST:g} s apart"
    )


def _lost(
    show: ForeignShow, found: list[Picture], tables: Mapping[str, str]
) -> tuple[str, ...]:
    """Say what is not in the script."""
    shown = sum(
        one.end - one.begin for one in found if one.frames is not None or not one.moves
    )
    flown = f"{show.duration - shown:.1f} s of {show.duration:.1f} s"
    notes = [
        f"how {flown} are flown: they are solved anew",
        "which drone is where: drones are assigned anew",
    ]
    notes += [
        f"how {one.name} moves: {_too_far_apart(show, one)}"
        for one in found
        if one.moves and one.frames is None
    ]
    notes += [
        f"how {one.name} moves within {one.frames.beside:.2f} m: a smooth curve goes "
        "beside the file's corners"
        for one in found
        if one.frames is not None and one.frames.beside > STATED
    ]
    if any(light is not None for light in show.lights):
        lit = any(name.endswith("-lights.csv") for name in tables)
        which = "between the pictures" if lit else "but for the pictures' own"
        notes.append(f"lights {which}: they fade evenly")
    if sum(not fence.inclusion for fence in show.fences):
        notes.append("areas of the fence to stay out of")
    if sum(fence.inclusion for fence in show.fences) > 1:
        notes.append("areas of the fence to stay in, but for the first")
    if show.cues:
        notes.append(f"{len(show.cues)} cues")
    return tuple(notes)
