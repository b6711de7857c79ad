"""Where the places of a moving formation are at any time, with three derivatives.

Over a hold of time T, with the ramp r (T / 2 at most) and the step of degree seven
S(u) = 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7, the strength E of a motion is S(t / r) at the
beginning, 1, and S((T - t) / r) at the end; G is its integral over that of the whole
hold, from 0 to 1. Both have three continuous derivatives, so states are continuous, and
the motion begins and ends at rest. At an end where it is under way, E stays 1: there
the drones join, or leave, a formation that moves. A place x becomes, n being the axis
and w = t / period - x . direction / wavelength:

- rotate: R(n, angle G) (x - c) + c
- breathe: c + (1 + (scale - 1) E (1 - cos 2 pi w) / 2) (x - c), w = t / period
- wave: x + n amplitude E sin 2 pi w
- orbit: x + radius E (a cos 2 pi w + b sin 2 pi w), a and b spanning the circle's plane
- travel, morph: x + the displacements, one after the other, each times S of its share
- follow: x + B(G) - B(0), B being the B-spline of degree five whose control points
  are the frames, continued beyond either end by their reflections in it

Derivatives are those of truncated Taylor series (Griewank and Walther 2008, Evaluating
Derivatives, chapter 13).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, factorial, tau
from typing import TYPE_CHECKING

import numpy as np

from showc.script.show import Breathe, Follow, Morph, Rotate, Travel, Wave

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray, IntArray
    from showc.script.show import Formation, Motion, Transition

ORDER = 4
"""Taylor coefficients that are carried: the value and three derivatives."""

_STEP = (0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0)
"""S, by powers of u."""
_AREA = tuple(0.0 if k == 0 else _STEP[k - 1] / k for k in range(9))
"""Its integral from 0."""

_SLOPE, _BEND = 35.0 / 16.0, 7.52
"""Greatest |S'| and |S''|: 420 u^2 (1 - u)^2 (1 - 2 u) is at most 7.513."""

_DEGREE = 5
"""Of splines through frames: the torque of what follows them is continuous."""
_SPLINE = np.array(
    [
        [
            comb(_DEGREE, power)
            * sum(
                (-1) ** i
                * comb(_DEGREE + 1, i)
                * (_DEGREE - j - i) ** (_DEGREE - power)
                for i in range(_DEGREE - j + 1)
            )
            for j in range(_DEGREE + 1)
        ]
        for power in range(_DEGREE + 1)
    ]
) / factorial(_DEGREE)
"""Weights of the six control points about an interval, by powers of the share of the
interval that has passed, shape (power, point): the sum of truncated powers
(-1)^i binom(6, i) (u + 5 - j - i)^5 / 5! (de Boor 1978, chapter 9)."""


@dataclass(frozen=True, slots=True, eq=False)
class MovingPlaces:
    """Drones that move with a formation while it is held."""

    rows: IntArray
    """Which drones, counting from 0, shape (n,)."""
    places: FloatArray
    """Where they would stand without it, shape (n, 3) [m]."""
    motions: tuple[Motion, ...]
    """What they do, each on top of those before it."""
    middle: FloatArray
    """The middle of the box around the formation, shape (3,) [m]."""
    frames: tuple[FloatArray, ...]
    """For each motion that goes through displacements, those, (m, n or 1, 3) [m]; how
    far frames are from the first one; an empty array for the others."""
    under_way: tuple[bool, bool] = (False, False)
    """Whether the motion is under way at the beginning and at the end of the hold."""

    @property
    def tied(self) -> bool:
        """Whether the state at an end depends on how long the formation is held."""
        return self.under_way[1] or self.paced

    @property
    def paced(self) -> bool:
        """Whether the state in which it is met does."""
        turning = any(isinstance(one, Rotate | Follow) for one in self.motions)
        return self.under_way[0] and turning

    @property
    def moves_on(self) -> bool:
        """Whether the drones end elsewhere than they began."""
        return any(self.under_way) or any(
            isinstance(one, Rotate | Travel | Morph | Follow) for one in self.motions
        )

    def borders(self, duration: float) -> FloatArray:
        """Return the times [s] at which a higher derivative jumps, ends included."""
        found = [0.0, duration]
        for motion, frames in zip(self.motions, self.frames, strict=True):
            if isinstance(motion, Travel | Morph):
                found += (duration * shares_of(motion, frames)).tolist()
            else:
                rise, fall = self._ramps(motion.ramp, duration)
                found += [rise, duration - fall]
        return np.unique(np.round(found, 9))

    def derivatives(self, duration: float, times: FloatArray) -> FloatArray:
        """Position, velocity, acceleration and jerk, shape (4, times, n, 3) (SI).

        Parameters
        ----------
        duration
            Of the hold [s].
        times
            Since its start, shape (times,) [s].
        """
        factorials = np.array([1.0, 1.0, 2.0, 6.0]).reshape(-1, 1, 1, 1)
        return np.asarray(self._series(duration, times, ORDER) * factorials)

    def positions(self, duration: float, times: FloatArray) -> FloatArray:
        """Position alone, by the same arguments, shape (times, n, 3) [m]."""
        return np.asarray(self._series(duration, times, 1)[0])

    def ends(self, duration: float) -> tuple[FloatArray, FloatArray]:
        """Position and its derivatives when the hold begins and ends, (4, n, 3)."""
        found = self.derivatives(duration, np.array([0.0, duration]))
        # A motion that begins or ends at rest does so exactly.
        for side, moving in enumerate(self.under_way):
            if not moving:
                found[1:, side] = 0.0
        return found[:, 0], found[:, 1]

    def greatest_acceleration(self, duration: float) -> float:
        """Bound the acceleration of any drone in a hold of ``duration`` [s] [m/s²].

        The chain rule gives it from |S'| <= 35/16 and |S''| <= 7.52.
        A B-spline's derivatives are B-splines of its points' differences, and so within
        them (de Boor 1978, chapter 10).
        """
        off = self.places - self.middle
        reach = float(np.sqrt((off**2).sum(axis=1)).max(initial=0.0))
        speed = bend = 0.0
        for motion, frames in zip(self.motions, self.frames, strict=True):
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
                centre = self.middle if motion.about is None else np.array(motion.about)
                away = float(np.linalg.norm(centre - self.middle))
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

    def _series(self, duration: float, times: FloatArray, order: int) -> FloatArray:
        """Taylor series of the places, truncated after ``order`` coefficients."""
        series = np.zeros((order, times.size, *self.places.shape))
        series[0] = self.places
        for motion, frames in zip(self.motions, self.frames, strict=True):
            series = self._moved(series, motion, frames, duration, times)
        return series

    def _ramps(self, ramp: float, duration: float) -> tuple[float, float]:
        """Time to set in, and to end [s]: none where it is under way."""
        begins, ends = self.under_way
        ramp = min(ramp, 0.5 * duration)
        return 0.0 if begins else ramp, 0.0 if ends else ramp

    def _moved(
        self,
        series: FloatArray,
        motion: Motion,
        frames: FloatArray,
        duration: float,
        times: FloatArray,
    ) -> FloatArray:
        if isinstance(motion, Travel | Morph):
            return _displaced(series, motion, frames, duration, times)
        ramps = self._ramps(motion.ramp, duration)
        strength, progress = _envelope(ramps, duration, times, len(series))
        if isinstance(motion, Follow):
            return np.asarray(series + _along(frames, progress))
        clock = _line(times, 1.0, len(series))
        if isinstance(motion, Rotate):
            centre = self._centre(motion.about)
            return _turned(series, centre, motion, motion.angle * progress)
        if isinstance(motion, Breathe):
            _, cosine = _sine_cosine(tau / motion.period * clock)
            size = 0.5 * (motion.scale - 1.0) * _product(strength, _less(cosine))
            size[0] += 1.0
            centre = self._centre(motion.about)
            offset = _shifted(series, -centre)
            return _shifted(_product(size[..., None], offset), centre)
        turns = tau / motion.period * clock
        if np.isfinite(motion.wavelength):
            lag = series @ np.asarray(motion.direction)
            turns = turns - tau / motion.wavelength * lag
        sine, cosine = _sine_cosine(turns)
        if isinstance(motion, Wave):
            swing = motion.amplitude * _product(strength, sine)
            return np.asarray(series + swing[..., None] * np.asarray(motion.axis))
        first, second = plane_of(np.asarray(motion.axis))
        across = motion.radius * _product(strength, cosine)
        along = motion.radius * _product(strength, sine)
        return np.asarray(
            series + across[..., None] * first + along[..., None] * second
        )

    def _centre(self, about: tuple[float, float, float] | None) -> FloatArray:
        return self.middle if about is None else np.asarray(about)


def moving_places(
    rows: IntArray,
    places: IntArray,
    formation: Formation,
    transition: Transition,
    formations: Mapping[str, Formation],
) -> MovingPlaces:
    """Return how drones move with a formation.

    Parameters
    ----------
    rows
        Which drones, counting from 0, shape (n,).
    places
        Place of each in ``formation``, shape (n,).
    formation
        What is held.
    transition
        Says what it does.
    formations
        Those that it may become, by name.
    """
    low, high = formation.points.min(axis=0), formation.points.max(axis=0)
    frames = []
    for motion in transition.motion:
        shift = np.zeros((0, 1, 3))
        if isinstance(motion, Travel):
            ways = np.array([(0.0, 0.0, 0.0), *motion.points])
            shift = np.diff(ways, axis=0)[:, None, :]
        elif isinstance(motion, Morph):
            shapes = [formation, *(formations[name] for name in motion.through)]
            shift = np.diff([one.points[places] for one in shapes], axis=0)
        elif isinstance(motion, Follow):
            shift = motion.frames[:, places] - motion.frames[:1, places]
        frames.append(shift)
    return MovingPlaces(
        rows,
        formation.points[places],
        transition.motion,
        0.5 * (low + high),
        tuple(frames),
        transition.under_way,
    )


def plane_of(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that span the plane of a normal, right-handed with it.

    The first comes from the coordinate axis that is furthest from the normal, the
    first of several.
    """
    axis = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = axis - (axis @ normal) * normal
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def shares_of(motion: Travel | Morph, frames: FloatArray) -> FloatArray:
    """Shares of the time at which displacements begin and end, (m + 1,)."""
    parts = np.ones(len(frames))
    if isinstance(motion, Travel):
        parts = np.linalg.norm(frames[:, 0], axis=1)
        if not parts.any():
            parts[:] = 1.0
    return np.concatenate([[0.0], np.cumsum(parts) / parts.sum()])


def _displaced(
    series: FloatArray,
    motion: Travel | Morph,
    frames: FloatArray,
    duration: float,
    times: FloatArray,
) -> FloatArray:
    shares = duration * shares_of(motion, frames)
    result = series.copy()
    for begin, end, shift in zip(shares[:-1], shares[1:], frames, strict=True):
        if end <= begin:
            continue
        inside = (times > begin) & (times < end)
        passed = np.clip((times - begin) / (end - begin), 0.0, 1.0)
        share = _line(passed, inside / (end - begin), len(series))
        result += _polynomial(_STEP, share)[..., None] * shift
    return result


def _along(frames: FloatArray, progress: FloatArray) -> FloatArray:
    """Follow frames (m, n, 3), the progress a series of shape (order, times, 1)."""
    steps = len(frames) - 1
    ends = 2.0 * frames[[0, 0, -1, -1]] - frames[[2, 1, -2, -3]]
    points = np.concatenate([ends[:2], frames, ends[2:]])
    share = steps * progress
    row = np.clip(share[0, :, 0].astype(np.int64), 0, steps - 1)
    share[0, :, 0] -= row
    result = np.zeros((len(progress), row.size, *frames.shape[1:]))
    for weights in _SPLINE[::-1]:
        result = _product(result, share[..., None])
        for near, weight in enumerate(weights):
            result[0] += weight * points[row + near]
    return result


def _envelope(
    ramps: tuple[float, float], duration: float, times: FloatArray, order: int
) -> tuple[FloatArray, FloatArray]:
    """Strength E and progress G, each of shape (order, times, 1)."""
    rise, fall = ramps
    rising, falling = times < rise, times > duration - fall
    slope = np.zeros(times.size)
    # Where there is no ramp, nothing lies in it.
    slope[rising], slope[falling] = 1.0 / (rise or 1.0), -1.0 / (fall or 1.0)
    passed = np.where(falling, (times - duration) * slope, 1.0)
    share = _line(np.where(rising, times * slope, passed), slope, order)
    strength = _polynomial(_STEP, share)
    area = np.where(rising, rise, fall)[:, None] * _polynomial(_AREA, share)
    # Between the ramps the strength is 1; the area of a ramp is half its time.
    middle = _line(times - 0.5 * rise, 1.0, order)
    whole = duration - 0.5 * (rise + fall)
    ending = -area
    ending[0] += whole
    which = np.where(rising, 0, np.where(falling, 2, 1))
    progress = np.choose(which[None, :, None], [area, middle, ending])
    return strength, progress / whole


def _turned(
    series: FloatArray, centre: FloatArray, motion: Rotate, angle: FloatArray
) -> FloatArray:
    """Rodrigues' formula, the angle a series of shape (order, times, 1)."""
    axis = np.asarray(motion.axis)
    sine, cosine = _sine_cosine(angle)
    offset = _shifted(series, -centre)
    along = (offset @ axis)[..., None] * axis
    turned = (
        _product(cosine[..., None], offset)
        + _product(sine[..., None], np.cross(axis, offset))
        + _product(_less(cosine)[..., None], along)
    )
    return _shifted(turned, centre)


def _shifted(series: FloatArray, by: FloatArray) -> FloatArray:
    result = series.copy()
    result[0] += by
    return result


def _less(cosine: FloatArray) -> FloatArray:
    """1 - cos as a series."""
    result = -cosine
    result[0] += 1.0
    return result


def _line(values: FloatArray, slope: FloatArray | float, order: int) -> FloatArray:
    """Series of what is linear in time, shape (order, times, 1)."""
    result = np.zeros((order, values.size, 1))
    result[0, :, 0] = values
    result[1:2, :, 0] = slope
    return result


def _product(one: FloatArray, other: FloatArray) -> FloatArray:
    """Product of two truncated series along the first axis."""
    return np.stack(
        [
            np.sum([one[j] * other[k - j] for j in range(k + 1)], axis=0)
            for k in range(len(one))
        ]
    )


def _polynomial(powers: tuple[float, ...], argument: FloatArray) -> FloatArray:
    """Horner's rule on a series."""
    result = np.zeros_like(argument)
    for factor in reversed(powers):
        result = _product(result, argument)
        result[0] += factor
    return result


def _sine_cosine(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sine and cosine of a series, by their differential equation."""
    sine, cosine = np.zeros_like(angle), np.zeros_like(angle)
    sine[0], cosine[0] = np.sin(angle[0]), np.cos(angle[0])
    for k in range(1, len(angle)):
        for j in range(1, k + 1):
            sine[k] += j / k * angle[j] * cosine[k - j]
            cosine[k] -= j / k * angle[j] * sine[k - j]
    return sine, cosine
