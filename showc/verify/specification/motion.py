"""Moving formations: every drone where the script has it, at every instant of a motion.

What a script means by a motion is said by :mod:`showc.script.moving`, as the places of
formations are by its generators: where each drone is at any time, with derivatives.

**Bound.** Let e be what is logged less what is asked, |e''| <= A. Between two instants
at a distance of h, |e| is at most the greater of its values there, plus A h^2 / 8 (the
error of linear interpolation, in the direction of e). A is the greatest second
difference of the logged polynomials plus a bound on the motion, which the chain rule
gives from |S'| <= 35/16 and |S''| <= 7.52, S being the step of degree seven with which
motions set in. So a few instants prove all of them.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil, tau
from typing import TYPE_CHECKING

import numpy as np

from showc.script.moving import MovingPlaces, shares_of
from showc.script.show import Breathe, Follow, Morph, Rotate, Travel, Wave
from showc.verify.samples import evaluate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.verify.kernel.show import Segment

FOLLOWED = 1e-3
"""Greatest distance from the place that the motion asks for, at any instant [m]: as
near as a place of a formation must be reached."""

JOINED = np.array([1e-5, 1e-4, 1e-2])
"""How far velocity [m/s], acceleration [m/s²] and jerk [m/s³] at an end of a motion may
be from those asked for: of these a hover is left with 0.001 deg and 0.06 deg/s."""

_REST = 4e-4
"""Share of it that is left to what happens between two instants [m]."""
_MOST = 200_000
"""Instants of one motion at which a look gives up."""
_ROWS, _AT_ONCE = 1_000, 2_000
"""Polynomials, and instants of them, that are looked at together; bounds the memory."""
_SLOPE, _BEND = 35.0 / 16.0, 7.52
"""Greatest |S'| and |S''|: 420 u^2 (1 - u)^2 (1 - 2 u) is at most 7.513."""


def _restless(one: MovingPlaces, duration: float) -> float:
    """Bound on the acceleration that a motion asks of any of its drones [m/s²].

    A B-spline's derivatives are B-splines of its points' differences, and so within
    them (de Boor 1978, chapter 10).
    """
    off = one.places - one.middle
    reach = float(np.sqrt((off**2).sum(axis=1)).max(initial=0.0))
    speed = bend = 0.0
    for motion, frames in zip(one.motions, one.frames, strict=True):
        if isinstance(motion, Travel | Morph):
            steps = np.linalg.norm(frames, axis=2).max(axis=1)
            spans = duration * np.diff(shares_of(motion, frames))
            steps, spans = steps[spans > 0.0], spans[spans > 0.0]
            speed += float((_SLOPE * steps / spans).max())
            bend += float((_BEND * steps / spans**2).max())
            reach += float(steps.sum())
            continue
        ramp = min(motion.ramp, duration / 2.0)
        rise, curve = _SLOPE / ramp, _BEND / ramp**2
        if isinstance(motion, Follow):
            rate = (len(frames) - 1.0) / (duration - ramp)
            ways, turns = (np.diff(frames, n=k, axis=0) for k in (1, 2))
            steps = np.linalg.norm(ways, axis=2).max(axis=1)
            step, turn = float(steps.max()), np.linalg.norm(turns, axis=2).max()
            speed += rate * step
            bend += rate**2 * float(turn) + rise * rate * step
            reach += float(steps.sum())
        elif isinstance(motion, Rotate | Breathe):
            centre = one.middle if motion.about is None else np.array(motion.about)
            away = float(np.linalg.norm(centre - one.middle))
            arm = reach + away
            if isinstance(motion, Rotate):
                rate = abs(motion.angle) / (duration - ramp)
                bend += 2.0 * rate * speed + (rise * rate + rate**2) * arm
                speed += rate * arm
                reach = arm + away
            else:
                size, turn = abs(motion.scale - 1.0), tau / motion.period
                first = size * (rise + turn / 2.0)
                second = size * (curve + rise * turn + turn**2 / 2.0)
                largest = max(1.0, motion.scale)
                bend = largest * bend + 2.0 * first * speed + second * arm
                speed = largest * speed + first * arm
                reach = largest * arm + away
        else:
            size = motion.amplitude if isinstance(motion, Wave) else motion.radius
            lag = tau / motion.wavelength
            turn = tau / motion.period + lag * speed
            bend += size * (curve + 2.0 * rise * turn + turn**2 + lag * bend)
            speed += size * (rise + turn)
            reach += size
    return bend


def standing(rows: IntArray, places: FloatArray) -> MovingPlaces:
    """Return drones (n,) that stay at their places (n, 3) [m]."""
    return MovingPlaces(rows, places, (), np.zeros(3), ())


def astray(segment: Segment, parts: Sequence[MovingPlaces]) -> list[str]:
    """Say how far the worst drone may be from where a motion wants it, if too far.

    Else say it of velocity, acceleration and jerk when the segment begins and ends.
    Attitude and body rates follow from these, and pass the joints without a jump, by
    the kernel.
    """
    duration, worst, slip, worse = segment.duration, 0.0, 0.0, [0, 0]
    for one in parts:
        asked = _restless(one, duration) if one.motions else 0.0
        order, table = np.argsort(one.rows), segment.table
        for some in table.chosen(np.isin(table.owner, one.rows)).parts(_ROWS):
            row = order[np.searchsorted(one.rows, some.drones, sorter=order)]
            # Frames of one place are those of all.
            own = (part if part.shape[1] == 1 else part[:, row] for part in one.frames)
            mine = replace(one, rows=row, places=one.places[row], frames=tuple(own))
            position = some.state[:, :, :3]
            slopes = [position]
            for _ in JOINED:
                slopes.append(some.slope(slopes[-1]))
            # The greatest second difference of the logged positions.
            bends = np.linalg.norm(slopes[2], axis=2).max(axis=1)
            bends = asked + np.maximum.reduceat(bends, some.first[:-1])
            step = np.sqrt(8.0 * _REST / max(bends.max(), 1e-9))
            count = max(2, ceil(duration / min(step, duration)) + 1)
            if count > _MOST:
                worst, worse[0] = np.inf, int(some.drones[np.argmax(bends)])
                continue
            alone = replace(some, state=position, control=some.control[:, :, :0])
            times = np.linspace(0.0, duration, count)
            far = np.zeros(row.size)
            for at in np.array_split(times, ceil(count / _AT_ONCE)):
                off = np.moveaxis(evaluate(alone, at), 0, 2)
                off -= mine.positions(duration, at)
                far = np.maximum(far, np.linalg.norm(off, axis=2).max(axis=0))
            far += bends * (duration / (count - 1)) ** 2 / 8.0
            if not far.max() <= worst:
                worst, worse[0] = float(far.max()), int(some.drones[np.argmax(far)])
            ends = np.stack(mine.ends(duration), axis=1)[1:]
            first, last = some.first[:-1], some.first[1:] - 1
            flown = np.stack([[one[first, 0], one[last, -1]] for one in slopes[1:]])
            missed = (np.abs(flown - ends).max(axis=(1, 3)).T / JOINED).max(axis=1)
            if not missed.max() <= slip:
                slip = float(missed.max())
                worse[1] = int(some.drones[np.argmax(missed)])
    said = ""
    if not worst <= FOLLOWED:
        said = f"drone {worse[0] + 1} may be {worst:.6f} m from where the motion has it"
        said += f", {FOLLOWED:g} m is allowed"
    elif not slip <= 1.0:
        said = f"drone {worse[1] + 1} begins or ends in another state than the motion's"
        said += f": {slip:.3g} times what is allowed"
    return [f"“{segment.message.name}”: {said}"] if said else []
