"""What a show shows, act by act: pictures that stand, and pictures that move.

An act is a hold of the fleet, or several with flights between them that belong to the
picture: the fleet turns, waves or breathes. In a transition drones go nearly straight
from where they were to where they will be; where the middle drone strays from its
straight way by more than a sixth of it, the picture moves.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import UsageError
from showc.foreign.motion import jumps, place_at

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.verify.kernel.slices import Tracks

Span = tuple[float, float]
"""Begin and end [s]."""

STILL = 0.05
"""Speed below which a drone stands [m/s]: rounded files creep."""

SHORTEST_HOLD = 0.5
"""Shortest time that counts as a hold [s]."""

STRAYS = 1.0 / 6.0
"""Share of its straight way by which a drone strays from it in a moving picture: it is
0.21 in a quarter turn, 0.13 in 60 degrees; measured of transitions: up to 0.08."""

MOVES = 0.1
"""Way below which a drone stands [m]."""

_LOOKS = 64
"""Instants at which a stretch is looked at: to tell kinds of motion, not to prove."""

FINEST = 0.2
"""Least time between two frames [s]: rounded to 0.1 mm, they shake a curve by less than
a hundredth of what drones can do."""

COARSEST = 0.5
"""Greatest time between two frames [s]: of corners 0.2 m are cut off at 3 m/s²."""

MOST_ROWS = 90_000
"""Rows of a table of frames: scripts read 4 MB, and 41 bytes hold a row."""

RAMP = 0.2
"""Shortest time in which a script sets a motion in [s]."""

_SETS_IN = 0.75
"""Time to set in for each m/s at which a stretch is cut [s]: at most 3 m/s² then, for
the step of degree seven rises 35/16 times as steeply as evenly."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Places of the fleet at evenly spaced moments of an act."""

    step: float
    """Time between two [s]."""
    points: FloatArray
    """Control points of the curve, shape (frames, drones, 3) [m]."""
    beside: float
    """How far the curve is from the file at its knots, at most [m]."""
    ramp: float
    """Time to set in, and to end [s]."""

    @property
    def length(self) -> float:
        """Time from the first to the last [s]."""
        return self.step * (len(self.points) - 1)


@dataclass(frozen=True, slots=True)
class Act:
    """A time in which one picture is shown."""

    begin: float
    """Show time [s]."""
    end: float
    """Show time [s]."""
    moves: bool
    """Whether the picture moves."""


def holds(tracks: Tracks) -> list[Span]:
    """Return the times in which no drone moves or jumps, in order [s]."""
    width = np.maximum(tracks.ends - tracks.starts, 1e-9)
    reach = tracks.position.max(axis=1) - tracks.position.min(axis=1)
    moving = np.sqrt((reach**2).sum(axis=1)) > STILL * width
    rows, missed = jumps(tracks)
    # What stands and then jumps is no slower than what goes there meanwhile.
    rows = rows[np.sqrt((missed**2).sum(axis=1)) > STILL * width[rows - 1]]
    begin = np.concatenate([tracks.starts[moving], tracks.starts[rows]])
    end = np.concatenate([tracks.ends[moving], tracks.starts[rows]])
    order = np.argsort(begin)
    found: list[Span] = []
    free = tracks.begin
    for low, high in zip(begin[order].tolist(), end[order].tolist(), strict=True):
        if low - free >= SHORTEST_HOLD:
            found.append((free, low))
        free = max(free, high)
    if tracks.end - free >= SHORTEST_HOLD:
        found.append((free, tracks.end))
    return found


def acts(
    tracks: Tracks, stands: Sequence[Span], moving: Sequence[Span] = ()
) -> list[Act]:
    """Return what is shown, in order.

    Parameters
    ----------
    tracks
        The fleet.
    stands
        Holds in the air, in order, and instants that are asked for.
    moving
        Times that are asked for as moving pictures.

    Raises
    ------
    UsageError
        If a time that is asked for is none of the show.
    """
    for begin, end in moving:
        if not tracks.begin <= begin < begin + SHORTEST_HOLD <= end <= tracks.end:
            raise UsageError(
                f"{begin:g}-{end:g} is no stretch of the show; wanted {SHORTEST_HOLD} s"
                f" or more within {tracks.begin:g} to {tracks.end:g} s"
            )
    found = [Act(begin, end, moves=False) for begin, end in stands]
    joined = [
        Act(one.end, other.begin, moves=True)
        for one, other in pairwise(found)
        if other.begin - one.end >= SHORTEST_HOLD
        and strays(tracks, one.end, other.begin) > STRAYS
    ]
    asked = [Act(begin, end, moves=True) for begin, end in moving]
    result: list[Act] = []
    for act in sorted([*found, *joined, *asked], key=lambda one: (one.begin, one.end)):
        last = result[-1] if result else None
        # Two holds never touch; what a moving picture touches belongs to it.
        if last is None or act.begin > last.end or not (act.moves or last.moves):
            result.append(act)
        else:
            result[-1] = Act(last.begin, max(last.end, act.end), moves=True)
    return result


def strays(tracks: Tracks, begin: float, end: float) -> float:
    """How far the middle one of the drones that move strays from its straight way.

    As a share of that way: infinity if it comes back to where it was.
    """
    times = np.linspace(begin, end, _LOOKS)
    places = np.stack([place_at(tracks, time) for time in times.tolist()])
    offset, way = places - places[0], places[-1] - places[0]
    length = np.linalg.norm(way, axis=1)
    unit = way / np.maximum(length, 1e-12)[:, None]
    along = np.clip(np.einsum("tdk,dk->td", offset, unit), 0.0, length)
    aside = np.linalg.norm(offset - along[..., None] * unit, axis=2).max(axis=0)
    moved = np.linalg.norm(offset, axis=2).max(axis=0) > MOVES
    if not moved.any():
        return 0.0
    return float(np.median(aside[moved] / np.maximum(length[moved], 1e-12)))


def row_step(tracks: Tracks, act: Act) -> float:
    """Return how far apart in time a file of straight lines has its rows in an act [s].

    Zero for files of curves, which say what is between.
    """
    inside = (tracks.starts >= act.begin - 1e-6) & (tracks.ends <= act.end + 1e-6)
    widths = (tracks.ends - tracks.starts)[inside]
    straight = tracks.position.shape[1] == 2
    return float(np.median(widths)) if straight and widths.size else 0.0


def frames_of(tracks: Tracks, act: Act) -> Frames | None:
    """Return the frames of a moving picture; None: they would be too far apart.

    Either the picture is too long for its drones, or the file has too few rows.

    A script draws the B-spline of degree five whose control points the frames are. So
    they lie as far outside of the file as that curve goes inside of them, and are its
    corners, where it is one of straight lines: between them nothing is known.
    """
    length = act.end - act.begin
    step = max(row_step(tracks, act), FINEST, length * tracks.drones / MOST_ROWS)
    count = max(round(length / step), 3)
    step = length / count
    if step > COARSEST * 1.01:
        return None
    times = np.linspace(act.begin, act.end, count + 1)
    places = np.stack([place_at(tracks, time) for time in times.tolist()])
    points = places.copy()
    # To the second order it goes inside by a quarter of the second difference.
    points[1:-1] -= 0.25 * np.diff(places, 2, axis=0)
    speeds = np.linalg.norm(np.diff(places[[0, 1, -2, -1]], axis=0)[::2], axis=2)
    ramp = max(RAMP, _SETS_IN * float(speeds.max()) / step)
    beside = float(np.linalg.norm(_knots(points) - places, axis=2).max())
    return Frames(step, points, beside, round(min(ramp, 0.5 * length), 3))


def _knots(points: FloatArray) -> FloatArray:
    """Values at its knots of the curve that a script draws (de Boor 1978)."""
    ends = 2.0 * points[[0, 0, -1, -1]] - points[[2, 1, -2, -3]]
    every = np.concatenate([ends[:2], points, ends[2:]])
    weights = np.array([1.0, 26.0, 66.0, 26.0, 1.0]) / 120.0
    count = len(points)
    return np.asarray(sum(w * every[k : k + count] for k, w in enumerate(weights)))
