"""Motions worked out a second time, from their definitions: an oracle for the tests.

Over a hold of time T, with the ramp r (T / 2 at most) and S(u) = 35 u^4 - 84 u^5 + 70
u^6 - 20 u^7, a motion has the strength E, which is S(t / r), 1, S((T - t) / r), and the
progress G, its integral over that of the whole hold. At an end where the motion is
under way there is no ramp.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from math import isinf, tau
from typing import TYPE_CHECKING

import numpy as np

from showc.script.show import Breathe, Follow, Morph, Orbit, Rotate, Travel, Wave

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray, IntArray
    from showc.script.show import Formation, Motion, Transition

_NO_TIME = 1e-300
"""Stands for a ramp of no length [s]."""


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
