"""Moving formations: where the script wants each drone at every instant of a motion.

Over a hold of time T, with the ramp r (T / 2 at most) and S(u) = 35 u^4 - 84 u^5 + 70
u^6 - 20 u^7, a motion has the strength E, which is S(t / r), 1, S((T - t) / r), and the
progress G, its integral over that of the whole hold. At an end where the motion is
under way there is no ramp. What each motion makes of a place is said at
:func:`_carried`, in the order of the script.

**Bound.** Let e be what is logged less what is asked, |e''| <= A. Between two instants
at a distance of h, |e| is at most the greater of its values there, plus A h^2 / 8 (the
error of linear interpolation, in the direction of e). A is the greatest second
difference of the logged polynomials plus a bound on the motion, which the chain rule
gives from |S'| <= 35/16 and |S''| <= 7.52. So a few instants prove all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from math import ceil, isinf, sqrt, tau
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev

from showc.script.show import Breathe, Follow, Morph, Orbit, Rotate, Travel, Wave
from showc.verify.kernel.choreography import MOMENT
from showc.verify.kernel.dynamics import STILL
from showc.verify.samples import evaluate

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.log.showc_pb2 import Move
    from showc.script.show import Formation, Motion, Transition
    from showc.verify.kernel.show import PieceTable, Segment

FOLLOWED = 1e-3
"""Greatest distance from the place that the motion asks for, at any instant [m]: as
near as a place of a formation must be reached."""

JOINED = 1e-5, 1e-4, 1e-2
"""How far velocity [m/s], acceleration [m/s²] and jerk [m/s³] at an end of a motion may
be from those asked for: of these a hover is left with 0.001 deg and 0.06 deg/s."""

_CLOSE = 0.04
"""Stretch of time at an end over which an error is derived [s]."""

_NO_TIME = 1e-300
"""Stands for a ramp of no length [s]."""

_REST = 4e-4
"""Share of it that is left to what happens between two instants [m]."""
_MOST = 200_000
"""Instants of one motion at which a look gives up."""
_SLOPE, _BEND = 35.0 / 16.0, 7.52
"""Greatest |S'| and |S''|: 420 u^2 (1 - u)^2 (1 - 2 u) is at most 7.513."""


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """Drones that hold a formation, and what it does meanwhile."""

    drones: IntArray
    """Which drones, counting from 0, shape (n,)."""
    places: FloatArray
    """Where they stand before, shape (n, 3) [m]."""
    motions: tuple[Motion, ...] = ()
    """What they do, in order."""
    shapes: tuple[FloatArray, ...] = ()
    """What each motion goes through, (m, n, 3) [m]: displacements, formations or
    frames; none, m being 0, for the others."""
    middle: FloatArray = field(default_factory=partial(np.zeros, 3))
    """The middle of the box around the formation, (3,) [m]."""
    under_way: tuple[bool, bool] = (False, False)
    """Whether it moves already when they arrive, and still when they leave."""

    @property
    def moves_on(self) -> bool:
        """Whether they end elsewhere than they began."""
        moved = Rotate | Travel | Morph | Follow
        return any((*self.under_way, *(isinstance(one, moved) for one in self.motions)))

    def ramps(self, ramp: float, duration: float) -> tuple[float, float]:
        """Time to set in and to end [s]; next to none where it is under way."""
        ramp = min(ramp, duration / 2.0)
        begins, ends = self.under_way
        return _NO_TIME if begins else ramp, _NO_TIME if ends else ramp

    def at(self, times: FloatArray, duration: float) -> FloatArray:
        """Where the script wants them at times (m,) [s], shape (m, n, 3) [m]."""
        found = np.broadcast_to(self.places, (times.size, *self.places.shape))
        for motion, shapes in zip(self.motions, self.shapes, strict=True):
            if isinstance(motion, Travel | Morph):
                found = found + _along(shapes, _spans(motion, shapes), times / duration)
            elif isinstance(motion, Follow):
                ramps = self.ramps(motion.ramp, duration)
                share = _progress(times, ramps, duration)
                found = found + _followed(shapes, share)
            else:
                found = _carried(found, motion, self, times, duration)
        return np.asarray(found)


def held(
    transition: Transition,
    drones: IntArray,
    places: IntArray,
    formations: Mapping[str, Formation],
) -> Held:
    """Say how drones, each at its place of a formation, are to move while it is held.

    Those without a place, at -1, do not.
    """
    drones, places = drones[places >= 0], places[places >= 0]
    points, shapes = formations[transition.to].points, []
    for motion in transition.motion:
        through = np.zeros((0, len(places), 3))
        if isinstance(motion, Travel):
            ways = np.array([(0.0, 0.0, 0.0), *motion.points])[:, None]
            through = np.repeat(ways, len(places), axis=1)
        elif isinstance(motion, Morph):
            become = [transition.to, *motion.through]
            through = np.array([formations[name].points[places] for name in become])
        elif isinstance(motion, Follow):
            through = motion.frames[:, places]
        shapes.append(through)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    there, asked = points[places], transition.motion
    return Held(drones, there, asked, tuple(shapes), middle, transition.under_way)


def _step(share: FloatArray) -> FloatArray:
    u = np.clip(share, 0.0, 1.0)
    return np.asarray(u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3))


def _strength(
    times: FloatArray, ramps: tuple[float, float], duration: float
) -> FloatArray:
    shares = times / ramps[0], (duration - times) / ramps[1]
    rise, fall = (
        np.ones_like(share) if ramp == _NO_TIME else share
        for share, ramp in zip(shares, ramps, strict=True)
    )
    return _step(np.minimum(rise, fall))


def _progress(
    times: FloatArray, ramps: tuple[float, float], duration: float
) -> FloatArray:
    """Integral of the strength: 7 u^5 - 14 u^6 + 10 u^7 - 5/2 u^8 over a ramp."""
    rise, fall = ramps

    def area(time: FloatArray, ramp: float) -> FloatArray:
        u = np.clip(time / ramp, 0.0, 1.0)
        return ramp * u**5 * (7.0 - 14.0 * u + 10.0 * u**2 - 2.5 * u**3)

    whole = np.clip(times - rise, 0.0, duration - rise - fall)
    falling = 0.5 * fall - area(np.minimum(duration - times, fall), fall)
    total = duration - 0.5 * (rise + fall)
    return np.asarray((area(times, rise) + whole + falling) / total)


def _carried(
    found: FloatArray,
    motion: Rotate | Breathe | Wave | Orbit,
    one: Held,
    times: FloatArray,
    duration: float,
) -> FloatArray:
    """Return places (m, n, 3) after one motion.

    ``rotate``: turned about the axis by the angle times G. ``breathe``: from the point
    that stays, times 1 + (scale - 1) E (1 - cos) / 2. ``wave``: along the axis by the
    amplitude times E sin. ``orbit``: by the radius times E (cos, sin) in the plane of
    the normal. The phase is 2 pi (t / period - x . direction / wavelength).
    """
    middle, ramps = one.middle, one.ramps(motion.ramp, duration)
    strength = _strength(times, ramps, duration)[:, None]
    if isinstance(motion, Rotate):
        centre = middle if motion.about is None else np.array(motion.about)
        angle = motion.angle * _progress(times, ramps, duration)
        half = angle[:, None] / 2.0
        # Quaternions: v + 2 w (q x v) + 2 q x (q x v).
        axis = np.sin(half)[..., None] * np.array(motion.axis)
        offset = found - centre
        cross = np.cross(axis, offset)
        turned = offset + 2.0 * (
            np.cos(half)[..., None] * cross + np.cross(axis, cross)
        )
        return np.asarray(centre + turned)
    if isinstance(motion, Breathe):
        centre = middle if motion.about is None else np.array(motion.about)
        swell = (1.0 - np.cos(tau * times / motion.period))[:, None] / 2.0
        size = 1.0 + (motion.scale - 1.0) * strength * swell
        return np.asarray(centre + size[..., None] * (found - centre))
    lag = 0.0 if isinf(motion.wavelength) else found @ np.array(motion.direction)
    phase = tau * (times[:, None] / motion.period - lag / motion.wavelength)
    if isinstance(motion, Wave):
        swing = motion.amplitude * strength * np.sin(phase)
        return np.asarray(found + swing[..., None] * np.array(motion.axis))
    normal = np.array(motion.axis)
    # The coordinate axis furthest from the normal, made square to it.
    first = np.zeros(3)
    first[int(np.argmin(np.abs(normal)))] = 1.0
    first -= (first @ normal) * normal
    first /= np.sqrt(first @ first)
    circle = np.cos(phase)[..., None] * first + np.sin(phase)[..., None] * np.cross(
        normal, first
    )
    return np.asarray(found + (motion.radius * strength)[..., None] * circle)


def _spans(motion: Travel | Morph, shapes: FloatArray) -> FloatArray:
    """Shares of the time from one of the shapes (m + 1, n, 3) to the next, (m,).

    Those of ``travel`` go by the length of the way, those of ``morph`` are equal.
    """
    parts = np.ones(len(shapes) - 1)
    if isinstance(motion, Travel):
        lengths = np.linalg.norm(np.diff(shapes[:, 0], axis=0), axis=1)
        parts = lengths if lengths.any() else parts
    return np.asarray(parts / parts.sum())


def _along(shapes: FloatArray, spans: FloatArray, share: FloatArray) -> FloatArray:
    """Way through shapes (m + 1, n, 3) from the first, each by S, (k, n, 3)."""
    begin = np.cumsum(spans) - spans
    moving = spans > 0.0
    done = _step((share[:, None] - begin[moving]) / spans[moving])
    return np.asarray(np.einsum("km,mnc->knc", done, np.diff(shapes, axis=0)[moving]))


def _followed(frames: FloatArray, share: FloatArray) -> FloatArray:
    """Way from the first of the frames (m, n, 3) at shares of their time, (k, n, 3).

    The cardinal B-spline of degree five about each frame, the sum over i of (-1)^i
    binom(6, i) max(d + 3 - i, 0)^5 / 5! at a distance of d frames (de Boor 1978,
    chapter 9); two frames beyond each end are reflected in it.
    """
    before = 2.0 * frames[0] - frames[2:0:-1]
    after = 2.0 * frames[-1] - frames[-2:-4:-1]
    points = np.concatenate([before, frames, after])
    place = share * (len(frames) - 1.0)
    row = np.minimum(place.astype(np.int64), len(frames) - 2)
    result = np.broadcast_to(-frames[0], (share.size, *frames.shape[1:]))
    for near in range(-2, 4):
        signs = (1.0, -6.0, 15.0, -20.0, 15.0, -6.0)
        reach = place - row - near + 3.0 - np.arange(6.0)[:, None]
        weight = np.array(signs) @ np.maximum(reach, 0.0) ** 5 / 120.0
        result = result + weight[:, None, None] * points[row + near + 2]
    return result


def _gone(
    motion: Travel | Morph | Follow, shapes: FloatArray, duration: float
) -> tuple[float, float, float]:
    """Bound way [m], speed [m/s] and acceleration [m/s²] through shapes (m, n, 3).

    A B-spline's derivatives are B-splines of its points' differences, and so within
    them (de Boor 1978, chapter 10).
    """
    steps = np.linalg.norm(np.diff(shapes, axis=0), axis=2).max(axis=1)
    if not isinstance(motion, Follow):
        spans = _spans(motion, shapes) * duration
        steps, spans = steps[spans > 0.0], spans[spans > 0.0]
        speed, bend = _SLOPE * steps / spans, _BEND * steps / spans**2
        return float(steps.sum()), float(speed.max()), float(bend.max())
    ramp = min(motion.ramp, duration / 2.0)
    rate = (len(shapes) - 1.0) / (duration - ramp)
    turns = np.linalg.norm(np.diff(shapes, n=2, axis=0), axis=2)
    bend = rate**2 * turns.max() + _SLOPE / ramp * rate * steps.max()
    return float(steps.sum()), float(rate * steps.max()), float(bend)


def _restless(one: Held, duration: float) -> float:
    """Bound on the acceleration that a motion asks of any of its drones [m/s²]."""
    off = one.places - one.middle
    reach = float(np.sqrt((off**2).sum(axis=1)).max(initial=0.0))
    speed = bend = 0.0
    for motion, shapes in zip(one.motions, one.shapes, strict=True):
        if isinstance(motion, Travel | Morph | Follow):
            asked = _gone(motion, shapes, duration)
            speed, bend, reach = speed + asked[1], bend + asked[2], reach + asked[0]
            continue
        ramp = min(motion.ramp, duration / 2.0)
        rise, curve = _SLOPE / ramp, _BEND / ramp**2
        if isinstance(motion, Rotate | Breathe):
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
            continue
        size = motion.amplitude if isinstance(motion, Wave) else motion.radius
        lag = tau / motion.wavelength
        turn = tau / motion.period + lag * speed
        bend += size * (curve + 2.0 * rise * turn + turn**2 + lag * bend)
        speed += size * (rise + turn)
        reach += size
    return bend


def astray(segment: Segment, parts: Sequence[Held]) -> Iterator[str]:
    """Say how far the worst drone may be from where a motion wants it, if too far.

    Else say it of velocity, acceleration and jerk when the segment begins and ends: of
    the error's polynomial of degree 8 through nine instants close by. Attitude and
    body rates follow from these, and pass the joints without a jump, by the kernel.
    """
    worst, slip, worse = 0.0, 0.0, [0, 0]
    for one in parts:
        asked = _restless(one, segment.duration) if one.motions else 0.0
        tables = (table.parts(1) for table in segment.tables)
        for alone in chain.from_iterable(tables):
            row = np.flatnonzero(one.drones == alone.drones[0])
            if not row.size:
                continue
            bend = asked + _bend(alone)
            step = sqrt(8.0 * _REST / max(bend, 1e-9))
            count = max(2, ceil(segment.duration / min(step, segment.duration)) + 1)
            places, shapes = one.places[row], tuple(part[:, row] for part in one.shapes)
            mine = replace(one, drones=alone.drones, places=places, shapes=shapes)
            close = min(_CLOSE, segment.duration)
            ends = close * (1.0 - np.cos(np.pi * np.arange(9) / 8.0)) / 2.0
            times = np.linspace(0.0, segment.duration, count if count <= _MOST else 2)
            times = np.concatenate([ends, times, segment.duration - ends])
            wanted = mine.at(times, segment.duration)[:, 0]
            off = evaluate(alone, times)[:3, :, 0].T - wanted
            rest = bend * (segment.duration / (count - 1)) ** 2 / 8.0
            far = float(np.sqrt((off**2).sum(axis=1)).max()) + rest
            far = far if count <= _MOST else np.inf
            if not far <= worst:
                worst, worse[0] = far, int(alone.drones[0])
            for found in (off[:9], off[-9:]):
                series = chebyshev.chebfit(1.0 - 2.0 * ends / close, found, 8)
                for order, allowed in enumerate(JOINED, start=1):
                    slope = chebyshev.chebval(1.0, chebyshev.chebder(series, order))
                    size = float(np.abs(slope).max()) * (2.0 / close) ** order
                    if not size <= slip * allowed:
                        slip, worse[1] = size / allowed, int(alone.drones[0])
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


def _bend(table: PieceTable) -> float:
    """Greatest acceleration of the logged positions, by their coefficients [m/s²]."""
    degree = table.state.shape[1] - 1
    if degree < 2:
        return 0.0
    width = (table.end - table.start)[:, None, None]
    second = degree * (degree - 1) * np.diff(table.state[:, :, :3], n=2, axis=1)
    return float(np.sqrt(((second / width**2) ** 2).sum(axis=2)).max())


def reached(segment: Segment, drones: IntArray, time: float) -> FloatArray:
    """Where drones (n,), increasing, are at a show time [s], shape (n, 3) [m]."""
    found = np.empty((drones.size, 3))
    for table in segment.tables:
        mine = np.isin(table.drones, drones)
        there = evaluate(table, np.array([time - segment.start]))[:3, 0]
        found[np.searchsorted(drones, table.drones[mine])] = there[:, mine].T
    return found


def unlike_claims(
    segment: Segment, drones: IntArray, claims: Sequence[Move]
) -> Iterator[str]:
    """Yield moves of a group that do not begin and end when the log claims it.

    At all other times every coefficient of its drones' positions is one place.
    """
    starts = np.array([claim.start for claim in claims])
    first, last = np.full(len(claims), np.inf), np.full(len(claims), -np.inf)
    for table in segment.tables:
        mine = np.isin(table.owner, drones)
        way = table.state[mine, :, :3]
        mine[mine] = np.abs(way - way[:, :1]).max(axis=(1, 2), initial=0.0) > STILL
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
