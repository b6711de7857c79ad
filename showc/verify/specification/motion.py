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
from itertools import chain
from math import ceil, sqrt, tau
from typing import TYPE_CHECKING

import numpy as np

from showc.script.moving import shares_of
from showc.script.show import Breathe, Follow, Morph, Rotate, Travel, Wave
from showc.verify.kernel.choreography import MOMENT
from showc.verify.kernel.dynamics import STILL
from showc.verify.kernel.show import PieceTable
from showc.verify.samples import evaluate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.log.showc_pb2 import Move
    from showc.script.moving import MovingPlaces
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


def astray(segment: Segment, parts: Sequence[MovingPlaces]) -> Iterator[str]:
    """Say how far the worst drone may be from where a motion wants it, if too far.

    Else say it of velocity, acceleration and jerk when the segment begins and ends.
    Attitude and body rates follow from these, and pass the joints without a jump, by
    the kernel.
    """
    duration, worst, slip, worse = segment.duration, 0.0, 0.0, [0, 0]
    for one in parts:
        asked = _restless(one, duration) if one.motions else 0.0
        tables = (table.parts(1) for table in segment.tables)
        for alone in chain.from_iterable(tables):
            row = np.flatnonzero(one.rows == alone.drones[0])
            if not row.size:
                continue
            # Frames of one place are those of all.
            own = (part if part.shape[1] == 1 else part[:, row] for part in one.frames)
            mine = replace(one, rows=row, places=one.places[row], frames=tuple(own))
            bend = asked + _bend(alone)
            step = sqrt(8.0 * _REST / max(bend, 1e-9))
            count = max(2, ceil(duration / min(step, duration)) + 1)
            times = np.linspace(0.0, duration, count if count <= _MOST else 2)
            off = evaluate(alone, times)[:3, :, 0].T
            off -= mine.derivatives(duration, times)[0, :, 0]
            rest = bend * (duration / (count - 1)) ** 2 / 8.0
            far = float(np.sqrt((off**2).sum(axis=1)).max()) + rest
            far = far if count <= _MOST else np.inf
            if not far <= worst:
                worst, worse[0] = far, int(alone.drones[0])
            ends = np.stack(mine.ends(duration))[:, 1:, 0]
            missed = np.abs(_slopes(alone) - ends).max(axis=(0, 2)) / JOINED
            if not missed.max() <= slip:
                slip, worse[1] = float(missed.max()), int(alone.drones[0])
    if not worst <= FOLLOWED:
        yield (
            f"drone {worse[0] + 1} may be {worst:.6f} m from where the motion has it, "
            f"{FOLLOWED:g} m is allowed"
        )
    elif not slip <= 1.0:
        yield (
            f"drone {worse[1] + 1} begins or ends in another state than the motion's: "
            f"{slip:.3g} times what is allowed"
        )


def _slopes(table: PieceTable) -> FloatArray:
    """Velocity, acceleration and jerk at start and end of one drone, (2, 3, 3) (SI)."""
    found = np.zeros((2, 3, 3))
    for side, row in ((0, 0), (-1, -1)):
        curve, width = table.state[row, :, :3], table.end[row] - table.start[row]
        for order in range(min(3, len(curve) - 1)):
            curve = np.diff(curve, axis=0) * (len(curve) - 1) / width
            found[side, order] = curve[side]
    return found


def _bend(table: PieceTable) -> float:
    """Greatest acceleration of the logged positions, by their coefficients [m/s²]."""
    degree = table.state.shape[1] - 1
    if degree < 2:
        return 0.0
    width = (table.end - table.start)[:, None, None]
    second = degree * (degree - 1) * np.diff(table.state[:, :, :3], n=2, axis=1)
    return float(np.sqrt(((second / width**2) ** 2).sum(axis=2)).max())


def during(
    segment: Segment, drones: IntArray, begin: float, end: float
) -> Segment | None:
    """Return what drones (n,) fly of a segment between two show times [s].

    None if a polynomial runs across one of them.
    """
    message = type(segment.message)()
    message.CopyFrom(segment.message)
    message.start, message.duration, tables = begin, end - begin, []
    first, last = begin - segment.start, end - segment.start
    for table in segment.tables:
        within = (table.end > first + MOMENT) & (table.start < last - MOMENT)
        within &= np.isin(table.owner, drones)
        whole = (table.start >= first - MOMENT) & (table.end <= last + MOMENT)
        if (within & ~whole).any():
            return None
        mine, rows = np.unique(table.owner[within], return_index=True)
        rows = np.append(rows, np.count_nonzero(within))
        times = table.start[within] - first, table.end[within] - first
        states = table.state[within], table.control[within]
        tables.append(PieceTable(mine, rows, *times, *states))
    return replace(segment, message=message, tables=tuple(tables))


def unlike_claims(
    segment: Segment,
    drones: IntArray,
    claims: Sequence[Move],
    motions: Sequence[tuple[float, float]],
) -> Iterator[str]:
    """Yield moves of a group that do not begin and end when the log claims it.

    At all other times every coefficient of its drones' positions is one place, but for
    ``motions`` of what is held, between two show times [s].
    """
    starts = np.array([claim.start for claim in claims])
    first, last = np.full(len(claims), np.inf), np.full(len(claims), -np.inf)
    for table in segment.tables:
        mine = np.isin(table.owner, drones)
        way = table.state[mine, :, :3]
        mine[mine] = np.abs(way - way[:, :1]).max(axis=(1, 2), initial=0.0) > STILL
        for low, high in motions:
            inside = segment.start + table.start >= low - MOMENT
            mine &= ~(inside & (segment.start + table.end <= high + MOMENT))
        begin, end = segment.start + table.start[mine], segment.start + table.end[mine]
        which = np.maximum(np.searchsorted(starts, 0.5 * (begin + end)) - 1, 0)
        np.minimum.at(first, which, begin)
        np.maximum.at(last, which, end)
    for claim, begins, ends in zip(claims, first, last, strict=True):
        off = max(abs(begins - claim.start), abs(ends - claim.start - claim.duration))
        if np.isfinite(begins) and not off <= MOMENT:
            yield (
                f"“{claim.name}” is flown from {begins:.3f} s to {ends:.3f} s, the log "
                f"says from {claim.start:.3f} s, for {claim.duration:.3f} s"
            )
