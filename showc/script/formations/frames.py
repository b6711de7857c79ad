"""Frames: where the places of a formation are at many moments, from an animation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import DamagedFileError
from showc.script.diagnostic import ScriptError
from showc.script.formations.shape import Drawing, Request, Shape
from showc.script.language.kinds import Field, File, Section
from showc.script.language.timed import LONGEST, timed_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.arrays import FloatArray
    from showc.documents.gltf import Keys
    from showc.script.language.settings import Settings

SCENES = (".gltf", ".glb")
"""Endings of scenes; other files are tables."""
FILE = File((".csv", ".tsv", ".txt", *SCENES))
SECTION = Section(
    "frames",
    "The places at which an animation begins, show frame. A table has the columns "
    "time [s], place (from 1), x, y and z [m]. Each moving node of a glTF is a place, "
    "in file order. The motion `follow` plays the animation.",
    (Field("file", FILE, "The table or scene.", required=True),),
)
COLUMNS = ("time", "place", "x", "y", "z")
"""Of a table: s, from 1, m in the show frame."""
_FURTHEST = 10_000.0
"""Greatest coordinate [m]."""
_MOST_PLACES = 10_000
"""Ten times the largest fleet that is planned for."""
_MOST = 3_000_000
"""Frames times places: a minute at 50 Hz for a thousand."""
_FEWEST = 3
"""Frames that a curve through them needs."""
_HELP = (
    "times are seconds, places count from 1, x, y and z are metres in the show frame; "
    "every place has two rows at least"
)


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Places at evenly spaced moments."""

    length: float
    """Time from the first to the last [s]."""
    points: FloatArray
    """Shape (frames, places, 3), show frame [m]; read-only."""


def frames_of(name: str, key: str, read: Callable[[str, str], bytes]) -> Frames:
    """Read an animation.

    Parameters
    ----------
    name
        The file, as the script names it.
    key
        The script's key that names it.
    read
        Gives the content of a file by its name; the second names the key.

    Raises
    ------
    ScriptError
        Naming the first faulty line, the place without rows, or what else is wrong.
    """
    content = read(name, key)
    path = PurePath(name)
    if path.suffix.lower() in SCENES:
        return _scene(
            content, name, key, lambda beside: read(str(path.parent / beside), key)
        )
    return _table(content, name, key)


@lru_cache(maxsize=4)
def _table(content: bytes, name: str, key: str) -> Frames:
    """Read a table of frames.

    Moments are spread evenly, as many as the place with the most rows has; where rows
    are not spaced so, places move along straight lines from row to row.

    Raises
    ------
    ScriptError
        Naming the first faulty line, or the place without rows.
    """
    ranges = dict.fromkeys(COLUMNS, (-_FURTHEST, _FURTHEST))
    ranges |= {"time": (0.0, LONGEST), "place": (1.0, float(_MOST_PLACES))}
    rows = timed_rows(content, name, key, ranges, _HELP)
    rows = rows[np.lexsort((rows[:, 0], rows[:, 1]))]
    owner = rows[:, 1].astype(np.int64) - 1
    counts = np.bincount(owner, minlength=1)
    again = np.flatnonzero((np.diff(rows[:, 0]) <= 0.0) & (np.diff(owner) == 0))
    if again.size:
        place, time = owner[again[0]] + 1, rows[again[0], 0]
        raise ScriptError(
            "SHW110", f"`{name}` has place {place} twice at {time:g} s", key=key,
            help_text="give each place one row at each moment",
        )  # fmt: skip
    if counts.min() < 2:
        place = int(np.argmax(counts < 2)) + 1
        raise ScriptError(
            "SHW110",
            f"`{name}` has {'1 row' if counts.min() else 'no rows'} of place {place}, "
            f"and places up to {owner.max(initial=0) + 1}; each has two at least",
            key=key,
            help_text=_HELP,
        )
    steps = max(int(counts.max()), _FEWEST)
    _demand_few(steps, counts.size, name, key)
    begin, end = float(rows[:, 0].min()), float(rows[:, 0].max())
    times = np.linspace(begin, end, steps)
    points = np.empty((steps, counts.size, 3))
    last = np.cumsum(counts)
    for place, (low, high) in enumerate(zip(last - counts, last, strict=True)):
        for axis in range(3):
            points[:, place, axis] = np.interp(
                times, rows[low:high, 0], rows[low:high, 2 + axis]
            )
    points.setflags(write=False)
    return Frames(end - begin, points)


def _scene(content: bytes, name: str, key: str, read: Callable[[str], bytes]) -> Frames:
    """Read the nodes of a scene that move, at as many moments as the finest has keys.

    Raises
    ------
    ScriptError
        If there are none, or the scene is not what its format wants.
    """
    from showc.documents.gltf import Document  # noqa: PLC0415 - few scripts need it
    from showc.documents.scene import Scene  # noqa: PLC0415 - same

    try:
        found = dict(Scene(Document(name, content, read)).moves())
    except DamagedFileError as fault:
        raise ScriptError("SHW110", str(fault), key=key) from None
    if not found:
        raise ScriptError(
            "SHW110", f"`{name}` has no node whose translation is animated", key=key
        )
    nodes = [found[node] for node in sorted(found)]
    steps = max(_FEWEST, *(keys.times.size for keys in nodes))
    _demand_few(steps, len(nodes), name, key)
    begin = min(float(keys.times[0]) for keys in nodes)
    end = max(float(keys.times[-1]) for keys in nodes)
    if not end > begin:
        raise ScriptError("SHW110", f"`{name}` has one moment only", key=key)
    times = np.linspace(begin, end, steps)
    points = np.stack([_sampled(keys, times) for keys in nodes], axis=1)
    points.setflags(write=False)
    return Frames(end - begin, points)


def _sampled(keys: Keys, times: FloatArray) -> FloatArray:
    """Return places (n, 3) at times (n,), held before the first and after the last."""
    spline = keys.way == "CUBICSPLINE"
    values = keys.values.reshape(-1, 3, 3)[:, 1] if spline else keys.values
    if keys.times.size == 1:
        return np.repeat(values, times.size, axis=0)
    inner = np.clip(times, keys.times[0], keys.times[-1])
    row = np.searchsorted(keys.times, inner, side="right") - 1
    row = np.minimum(row, keys.times.size - 2)
    width = (keys.times[row + 1] - keys.times[row])[:, None]
    u = (inner - keys.times[row])[:, None] / width
    if keys.way == "STEP":
        u = np.floor(u)
    if not spline:
        return np.asarray((1.0 - u) * values[row] + u * values[row + 1])
    # The format's own cubic: glTF 2.0, appendix C.
    tangents = keys.values.reshape(-1, 3, 3)
    return np.asarray(
        (2.0 * u**3 - 3.0 * u**2 + 1.0) * values[row]
        + (u**3 - 2.0 * u**2 + u) * width * tangents[row, 2]
        + (3.0 * u**2 - 2.0 * u**3) * values[row + 1]
        + (u**3 - u**2) * width * tangents[row + 1, 0]
    )


def _demand_few(steps: int, places: int, name: str, key: str) -> None:
    if steps * places > _MOST:
        raise ScriptError(
            "SHW119",
            f"`{name}` has {steps} frames of {places} places, at most {_MOST} points "
            "are read",
            key=key,
        )


def own_count(settings: Settings, read: Callable[[str, str], bytes]) -> int:
    """Return the number of places that the animation has."""
    return len(frames_of(settings.text("file"), "file", read).points[0])


def draw(settings: Settings, request: Request) -> Drawing:
    """Return the places of the first frame."""
    name = settings.text("file")
    points = frames_of(name, "file", request.read).points[0]
    if len(points) < request.count:
        raise ScriptError(
            "SHW205",
            f"`{name}` has {len(points)} places; {request.count} are needed",
            key="file",
        )
    return Drawing(points[: request.count])


SHAPE = Shape(SECTION, own_count, draw, absolute=True)
