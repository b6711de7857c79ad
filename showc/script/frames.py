"""Frames: where the places of a formation are at many moments, from a table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.script.formations.shape import FormationError
from showc.script.timed import LONGEST, headed, timed_rows

if TYPE_CHECKING:
    from showc.arrays import FloatArray

COLUMNS = ("time", "place", "x", "y", "z")
"""Of a table of frames: s, from 1, m in the show frame."""
_FURTHEST = 10_000.0
"""Greatest coordinate [m]."""
_MOST_PLACES = 10_000
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


def has_frames(content: bytes) -> bool:
    """Whether a table is one of frames, and not of places."""
    return headed(content, COLUMNS)


@lru_cache(maxsize=4)
def frames_of(content: bytes, name: str, key: str) -> Frames:
    """Read a table of frames.

    Moments are spread evenly, as many as the place with the most rows has; where rows
    are not spaced so, places move along straight lines from row to row.

    Raises
    ------
    FormationError
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
        raise FormationError(
            "SHW110", f"`{name}` has place {place} twice at {time:g} s", key,
            help_text="give each place one row at each moment",
        )  # fmt: skip
    if counts.min() < 2:
        place = int(np.argmax(counts < 2)) + 1
        raise FormationError(
            "SHW110",
            f"`{name}` has {counts.min()} rows of place {place}, "
            f"{owner.max(initial=0) + 1} places are counted",
            key,
            help_text=_HELP,
        )
    steps = max(int(counts.max()), _FEWEST)
    if steps * counts.size > _MOST:
        raise FormationError(
            "SHW119",
            f"`{name}` has {steps} frames of {counts.size} places, at most {_MOST} "
            "points are read",
            key,
        )
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
