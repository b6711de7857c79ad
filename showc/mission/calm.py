"""Legs that end when they are expected to: none is held back on its last bit.

An autopilot takes the next item when the law's own time for a leg has ended, and it
holds that time back while the drone does not keep up. On a short quick leg the drone
flies past its end, turns round, and so does not keep up with a law that still creeps
on: its time stands until the drone has come back, for up to a second and a half.
Whether that happens hangs on a few hundredths of a second, and no prediction is that
good. With a clock it does not matter. Who goes by sums of times flies such legs a
little slower, so that their law has ended before the drone turns round.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.mission.law import LegProfile
from showc.mission.loops import STEP, TIME, Loops

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from showc.mission.parameters import Parameters
    from showc.mission.stage import Stage

    FloatArray = NDArray[np.float64]

LAST = 0.3
"""The last bit of a leg, on the law's own clock [s]: there it only creeps."""

HELD = 0.15
"""For how much longer than that it may last [s].

Against a transcription of the autopilot's controllers, legs that are held back for
less end within 0.17 s of what is predicted, 99 of 100 within 0.08 s; others up to 0.9 s
off.
"""

PACES = (0.95, 0.9, 0.85, 0.8), (0.75, 0.7, 0.65, 0.6, 0.55, 0.5)
"""Factors on the speeds of legs that are held back longer, the first that helps; the
later ones for those whom none of the others helps."""

SLOWEST = PACES[-1][-1]
"""Those whom no factor helps are flown so."""

PATIENCE = 4.0
"""Who is held back for so long is not looked at any further [s]."""

LOOK = 25
"""Steps after which it is looked whether all have ended."""


def held_back(
    profile: LegProfile, level: FloatArray, climb: FloatArray, late: float
) -> FloatArray:
    """Return for how long autopilots hold back the last bits of n legs.

    Parameters
    ----------
    profile
        How the law has the legs, begun at rest.
    level, climb
        Horizontal and vertical parts of their directions, shape (n,).
    late
        How late the law's time changes its rate [s].

    Returns
    -------
    ndarray
        Shape (n,) [s]; inf for more than 4 s in all.
    """
    count = len(profile)
    loops = Loops(profile, np.vstack([level, np.zeros(count), climb]), late)
    ends = profile.duration / STEP
    marks = np.stack([np.maximum(ends - LAST / STEP, 1e-9), ends])
    passed = np.full((2, count), np.inf)
    passed[:, ends <= 0.0] = 0.0
    passed[1, ends <= 0.0] = LAST / STEP
    time = loops.state[TIME]
    for step in range(int(np.ceil(ends.max(initial=0.0) + PATIENCE / STEP))):
        before = time.copy()
        loops.advance()
        now = (before < marks) & (time >= marks)
        if now.any():
            share = (marks - before) / np.where(time > before, time - before, 1.0)
            passed[now] = step + share[now]
        if step % LOOK == 0 and np.all(np.isfinite(passed)):
            break
    taken = np.subtract(
        passed[1], passed[0], out=np.full(count, np.inf), where=np.isfinite(passed[1])
    )
    return np.asarray(STEP * taken - LAST)


def calmed(stages: Sequence[Stage], parameters: Parameters) -> list[Stage]:
    """Return ``stages`` with those legs flown slower that would be held back.

    By as little as it takes; a leg that no factor calms is flown as slowly as may be.
    Stages in which nothing is to be done are the same objects.
    """
    late = parameters.acceleration / parameters.jerk
    found = list(stages)
    left = [np.flatnonzero(held > HELD) for held in _held_back_all(stages, late)]
    for paces in PACES:
        trials = [
            stage.part(some).at_speeds(pace * stage.profile.speed[some], parameters)
            for stage, some in zip(stages, left, strict=True)
            for pace in paces
        ]
        outcomes = iter(zip(trials, _held_back_all(trials, late), strict=True))
        for number, some in enumerate(left):
            rash = some
            for pace in paces:
                trial, held = next(outcomes)
                helps = (held <= HELD) | (pace == SLOWEST)
                fits = helps[np.searchsorted(some, rash)]
                found[number] = _with(found[number], rash[fits], trial, some)
                rash = rash[~fits]
            left[number] = rash
    return found


def _held_back_all(stages: Sequence[Stage], late: float) -> list[FloatArray]:
    """Return ``held_back`` of each stage: all at once, which takes hardly longer."""
    if not any(stage.drones.size for stage in stages):
        return [np.zeros(0)] * len(stages)
    profile = LegProfile(
        *(
            np.concatenate([getattr(stage.profile, one.name) for stage in stages])
            for one in fields(LegProfile)
        )
    )
    level = np.concatenate([stage.level for stage in stages])
    climb = np.concatenate([stage.climb for stage in stages])
    edges = np.cumsum([stage.drones.size for stage in stages])[:-1]
    return np.split(held_back(profile, level, climb, late), edges)


def _with(
    stage: Stage, rows: NDArray[np.int64], other: Stage, some: NDArray[np.int64]
) -> Stage:
    """Return ``stage`` with ``rows`` as in ``other``, whose rows are ``some``."""
    if not rows.size:
        return stage
    at = np.searchsorted(some, rows)

    def mixed(own: FloatArray, new: FloatArray) -> FloatArray:
        result = own.copy()
        result[rows] = new[at]
        return result

    profile = LegProfile(
        *(
            mixed(getattr(stage.profile, one.name), getattr(other.profile, one.name))
            for one in fields(LegProfile)
        )
    )
    return replace(stage, profile=profile, command=mixed(stage.command, other.command))
