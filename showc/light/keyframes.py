"""Keyframes: colours at moments of a hold, and what is shown between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.script.show import LightKey, Show, Transition

PARKED = -1
"""Place of a drone that has none."""


@dataclass(frozen=True, slots=True, eq=False)
class Keyframes:
    """Colours of some drones at moments of a hold; the first is its beginning."""

    times: FloatArray
    """Shape (k,), from 0, not decreasing: of two alike the later counts from there on
    [s]."""
    colours: FloatArray
    """Linear light, shape (k, n, 3)."""

    def linear(self, elapsed: FloatArray) -> FloatArray:
        """Linear colours at times (T,) since the start [s], shape (T, n, 3)."""
        after = np.searchsorted(self.times, elapsed, side="right")
        before = np.maximum(after - 1, 0)
        after = np.minimum(after, self.times.size - 1)
        width = self.times[after] - self.times[before]
        share = (elapsed - self.times[before]) / np.where(width > 0.0, width, 1.0)
        weight = np.clip(share, 0.0, 1.0)[:, None, None]
        first, last = self.colours[before], self.colours[after]
        return np.asarray((1.0 - weight) * first + weight * last)


@dataclass(frozen=True, slots=True, eq=False)
class Lit:
    """Drones that a transition's keys are for."""

    keys: Sequence[LightKey]
    drones: IntArray
    """Counting from 0, shape (n,)."""
    places: IntArray
    """Place of each in the transition's formation; -1: none."""


def keyframes_of(
    begin: FloatArray, start: float, lit: Iterable[Lit]
) -> Keyframes | None:
    """Return the keyframes of a hold; None where it has none.

    Parameters
    ----------
    begin
        Linear colours of all drones at its beginning, shape (drones, 3).
    start
        Show time of it [s].
    lit
        Keys of each transition, and its drones.
    """
    tracks = [
        (one.drones[one.places != PARKED], _track(begin, start, one))
        for one in lit
        if one.keys
    ]
    if not tracks:
        return None
    times = np.unique(np.concatenate([track.times for _, track in tracks]))
    # Steps need their moment twice: before and after.
    times = np.repeat(times, 2)
    colours = np.repeat(begin[None], times.size, axis=0)
    for members, track in tracks:
        colours[1::2, members] = track.linear(times[1::2])
        colours[::2, members] = _before(track, times[::2])
    return Keyframes(times, colours)


def _track(begin: FloatArray, start: float, lit: Lit) -> Keyframes:
    """Return the keyframes of the drones that have places."""
    standing = lit.places != PARKED
    places = lit.places[standing]
    shown = begin[lit.drones[standing]]
    timed = sorted(
        ((key.time - start if key.absolute else key.time), number, key)
        for number, key in enumerate(lit.keys)
    )
    # Until a place has a colour of its own, it goes there from the one it has.
    times, frames = [0.0], [shown]
    for moment, _, key in timed:
        colours = key.colours[places]
        if moment <= 0.0:
            frames[0] = np.where(np.isnan(colours), frames[0], colours)
            continue
        if key.step:
            times.append(moment)
            frames.append(frames[-1])
        times.append(moment)
        frames.append(colours)
    whole = np.stack(frames)
    for row in range(1, len(times)):
        lacking = np.isnan(whole[row])
        if lacking.any():
            whole[row][lacking] = _between(times, whole, row)[lacking]
    return Keyframes(np.array(times), whole)


def _between(times: Sequence[float], frames: FloatArray, row: int) -> FloatArray:
    """Return colours on the way from the row before to the next that is known."""
    result = frames[row - 1].copy()
    for later in range(len(times) - 1, row, -1):
        known = ~np.isnan(frames[later])
        width = times[later] - times[row - 1]
        share = (times[row] - times[row - 1]) / width if width > 0.0 else 1.0
        way = (1.0 - share) * frames[row - 1] + share * frames[later]
        result = np.where(known, way, result)
    return np.asarray(result)


def _before(track: Keyframes, times: FloatArray) -> FloatArray:
    """Return colours just before given times, where steps have not happened yet."""
    row = np.searchsorted(track.times, times, side="left")
    inside = np.minimum(row, track.times.size - 1)
    exact = (row < track.times.size) & (track.times[inside] == times)
    found = track.linear(times)
    found[exact] = track.colours[inside[exact]]
    return found


def placed(
    show: Show,
    one: Transition,
    places: FloatArray,
    own: Sequence[int] | IntArray,
) -> list[Lit]:
    """Return the keys of a transition, if it has any, with the places of its drones.

    Parameters
    ----------
    show
        With the formations.
    one
        Of the whole fleet, or of a group that flies in the time of the fleet.
    places
        Where its drones stand, shape (n, 3) [m].
    own
        Place of each where the fleet flies as one, shape (n,).
    """
    if not one.lights:
        return []
    every = np.arange(len(places))
    if one.group is None:
        return [Lit(one.lights, every, np.array(own))]
    points = show.formations[one.to].points
    apart = np.linalg.norm(places[:, None] - points[None], axis=-1)
    nearest = apart.argmin(axis=1)
    standing = apart[every, nearest] < _HERE
    return [Lit(one.lights, every, np.where(standing, nearest, PARKED))]


_HERE = 1e-3
"""Distance from a place within which a drone stands there [m]: places lie further
apart, and logged goals are rounded to less."""
