"""How far written flights are from the solved ones, at every instant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from showc.foreign.motion import (
    Greatest,
    chosen,
    derivative,
    difference,
    greatest,
    jumps,
    length,
    owners,
    portions,
    standing,
)
from showc.foreign.smoothing import moved
from showc.processes import side_by_side

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.verify.kernel.slices import Tracks


_POSITION_RESOLUTION, _VELOCITY_RESOLUTION, _ACCELERATION_RESOLUTION = 1e-4, 1e-3, 1e-2
"""Widths of the enclosures of the three errors [m, m/s, m/s²]."""


@dataclass(frozen=True, slots=True)
class FitError:
    """How far the written flight is from the solved one, at most, at any instant."""

    position: Greatest
    """[m]"""
    velocity: Greatest
    """[m/s]"""
    acceleration: Greatest
    """[m/s²]: large where the solved one jumps, for a cubic cannot."""

    @staticmethod
    def worst(errors: Sequence[FitError]) -> FitError:
        """Return the greatest of each kind."""
        return FitError(
            max((one.position for one in errors), key=_upper),
            max((one.velocity for one in errors), key=_upper),
            max((one.acceleration for one in errors), key=_upper),
        )


@dataclass(frozen=True, slots=True)
class Sampled:
    """Files in a format of samples or pieces of the solved flight."""

    files: dict[str, bytes]
    """Content by name."""
    error: FitError
    """What they cost."""
    duration: float
    """How long the written show is [s]."""


def _upper(found: Greatest) -> float:
    return found.upper


NO_ERROR = FitError(*(Greatest(0.0, 0.0, 0, 0.0) for _ in range(3)))
"""Before anything is known of it."""


def error_of(
    exact: Tracks,
    written: Tracks,
    lead: float,
    *,
    first: int = 0,
    jobs: int | None = None,
) -> FitError:
    """Bound the difference of two fleets at every instant, some drones at a time.

    Parameters
    ----------
    exact
        What was solved, in the show's own time.
    written
        What the file says, in its time.
    lead
        How much later everything happens in the file [s].
    first
        Number of the first drone.
    jobs
        Processes that share the work; None: one for each core.
    """
    end = max(written.end, exact.end + lead)

    def bounded(low: int, part: Tracks) -> FitError:
        solved = chosen(exact, slice(low, low + part.drones))
        path = replace(solved, position=solved.position[:, :, :3])
        late = standing(moved(path, lead), 0.0, end)
        apart = difference(late, standing(part, 0.0, end))
        found = []
        for resolution in (
            _POSITION_RESOLUTION,
            _VELOCITY_RESOLUTION,
            _ACCELERATION_RESOLUTION,
        ):
            one = greatest(apart, length((0, 1, 2)), resolution)
            found.append(replace(one, drone=one.drone + low + first))
            apart = derivative(apart)
        return FitError(*found)

    parts = [partial(bounded, low, part) for low, part in portions(written)]
    return FitError.worst(side_by_side(parts, jobs))


def error_of_lines(exact: Tracks, step: float, grid: float) -> FitError:
    """Bound what straight lines between even samples miss, at every instant.

    A line through both ends of a step h misses a function by h² / 8 of its greatest
    second derivative at most, and its slope by h / 2 (Davis 1975, Interpolation and
    Approximation, section 3.1); a jump of the slope adds a quarter of h, and itself.

    Parameters
    ----------
    exact
        What was solved.
    step
        Between two samples [s].
    grid
        Step to which each coordinate is rounded [m].
    """
    path = replace(exact, position=exact.position[:, :, :3])
    velocity = derivative(path)
    bend = greatest(derivative(velocity), length((0, 1, 2)), _ACCELERATION_RESOLUTION)
    off, kink = (_all_jumps(one) for one in (path, velocity))
    rounding = 0.5 * sqrt(3.0) * grid
    bounds = (
        step**2 / 8.0 * bend.upper + 0.25 * step * kink + off + rounding,
        0.5 * step * bend.upper + kink + (off + 2.0 * rounding) / step,
        bend.upper,
    )
    return FitError(*(replace(bend, upper=bound, lower=0.0) for bound in bounds))


def _all_jumps(tracks: Tracks) -> float:
    """Sum of the jumps of the drone that has most of them: rounding, mostly."""
    rows, off = jumps(tracks)
    size = np.sqrt((off**2).sum(axis=1))
    return float(np.bincount(owners(tracks)[rows], weights=size).max(initial=0.0))
