"""The leg that ArduCopter's AUTO mode really flies: an S-curve from rest to rest.

Jerk rises and falls as a raised cosine. A ramp from rest to speed V has jerk up over
``jerk_time``, constant jerk over ``hold_time``, jerk down over ``jerk_time``, constant
acceleration for the rest, and the mirror image of the jerk part; two ramps and a
cruise make a leg: ``T = L / V + T_ramp``. Own formulation of the law of ArduCopter 4.6
(AP_Math, trigonometric S-curves); everything is vectorised over legs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from showc.arrays import FloatArray, IntArray
    from showc.autopilot.parameters import Parameters

SHORTEST = 1e-6
"""What is shorter is no leg [m]; the mission's grid is a centimetre."""


@dataclass(frozen=True, slots=True, eq=False)
class LegProfile:
    """How far along each of n straight legs the autopilot is, over time.

    Every attribute has shape (n,). A leg of length 0 takes no time.
    """

    length: FloatArray
    """Length in the autopilot's metric [m]."""
    speed: FloatArray
    """Cruise speed [m/s]."""
    acceleration: FloatArray
    """Greatest acceleration reached [m/s²]."""
    jerk: FloatArray
    """Greatest jerk reached [m/s³]."""
    jerk_time: FloatArray
    """Time of a raised-cosine rise or fall of the jerk [s]."""
    hold_time: FloatArray
    """Time of constant jerk [s]."""
    ramp_time: FloatArray
    """Time from rest to cruise speed [s]."""
    duration: FloatArray
    """Time of the whole leg [s]."""

    def __len__(self) -> int:
        return int(self.length.size)

    def select(self, index: IntArray) -> LegProfile:
        """Return the legs at ``index`` (any number of them, repetition allowed)."""
        return LegProfile(
            *(getattr(self, name)[index] for name in self.__dataclass_fields__)
        )

    def distance(self, time: ArrayLike) -> FloatArray:
        """Distance covered [m] at ``time`` [s] since the start, broadcast to (..., n).

        Monotone in time; 0 before the start, ``length`` after the end.
        """
        t = np.clip(np.asarray(time, dtype=np.float64), 0.0, self.duration)
        near = np.minimum(t, self.duration - t)
        ramp, _, _ = self.ramp_motion(np.minimum(near, self.ramp_time))
        covered = ramp + self.speed * np.maximum(near - self.ramp_time, 0.0)
        covered = np.where(t <= 0.5 * self.duration, covered, self.length - covered)
        return np.asarray(np.clip(covered, 0.0, self.length))

    def fraction(self, time: ArrayLike) -> FloatArray:
        """Part of the leg covered, 0 to 1, at ``time`` [s], broadcast to (..., n)."""
        whole = np.where(self.length > 0.0, self.length, 1.0)
        return np.asarray(self.distance(time) / whole)

    def motion(self, time: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance [m], speed [m/s], acceleration [m/s²] at ``time`` [s], in one go.

        Each broadcast to (..., n).
        """
        t = np.clip(np.asarray(time, dtype=np.float64), 0.0, self.duration)
        near = np.minimum(t, self.duration - t)
        # Most instants of a long leg are cruise or rest, which take no trigonometry.
        moves = near > 0.0
        distance = np.where(moves, self.speed * (near - 0.5 * self.ramp_time), 0.0)
        speed = np.where(moves, self.speed, 0.0)
        acceleration = np.zeros_like(t)
        some = moves & (near < self.ramp_time)
        ramps = self.select(np.broadcast_to(np.arange(len(self)), t.shape)[some])
        distance[some], speed[some], acceleration[some] = ramps.ramp_motion(near[some])
        braking = t > 0.5 * self.duration
        distance = np.where(braking, self.length - distance, distance)
        acceleration = np.where(braking, -acceleration, acceleration)
        return np.clip(distance, 0.0, self.length), speed, acceleration

    def ramp_motion(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance [m], speed [m/s], acceleration [m/s²] within the ramp.

        All of the shape of ``t`` (..., n) [s], the time since the start.
        """
        # The ramp's speed is point-symmetric about (ramp_time / 2, speed / 2).
        late = t > 0.5 * self.ramp_time
        distance, speed, acceleration = self._half_ramp(
            np.where(late, self.ramp_time - t, t)
        )
        distance = np.where(
            late, self.speed * (t - 0.5 * self.ramp_time) + distance, distance
        )
        return distance, np.where(late, self.speed - speed, speed), acceleration

    def _half_ramp(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance, speed and acceleration in the first half of the ramp."""
        rise = self.jerk_time
        edge = rise + self.hold_time
        top = edge + rise
        # The jerk rises from rest; its fall mirrors that about the top.
        falls = t > edge
        left = np.maximum(top - t, 0.0)
        rising = self._raised_cosine(np.minimum(np.where(falls, left, t), rise))
        distance, speed, acceleration = rising
        held = np.clip(t - rise, 0.0, self.hold_time)
        distance = distance + held * (
            speed + held * (0.5 * acceleration + held * self.jerk / 6.0)
        )
        speed = speed + held * (acceleration + 0.5 * held * self.jerk)
        acceleration = acceleration + held * self.jerk
        mirror, mirror_speed, missing = rising
        full, full_speed, _ = self._raised_cosine(rise)
        speed_top = 0.5 * self.acceleration * top
        at_edge = full + self.hold_time * (
            full_speed
            + self.hold_time
            * (0.25 * self.jerk * rise + self.hold_time * self.jerk / 6.0)
        )
        distance_top = (
            at_edge + speed_top * rise - 0.5 * self.acceleration * rise**2 + full
        )
        # After the top the acceleration stays.
        pushed = np.maximum(t - top, 0.0)
        since = pushed - left
        distance = np.where(
            falls,
            distance_top
            + since * (speed_top + 0.5 * self.acceleration * since)
            - mirror,
            distance,
        )
        speed = np.where(
            falls, speed_top + self.acceleration * since + mirror_speed, speed
        )
        acceleration = np.where(falls, self.acceleration - missing, acceleration)
        return np.asarray(distance), np.asarray(speed), np.asarray(acceleration)

    def _raised_cosine(
        self, t: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance, speed, acceleration while the jerk rises from rest."""
        half = 0.5 * self.jerk
        rate = np.pi / np.where(self.jerk_time > 0.0, self.jerk_time, 1.0)
        sine, cosine = np.sin(rate * t), np.cos(rate * t)
        acceleration = half * (t - sine / rate)
        speed = half * (0.5 * t * t + (cosine - 1.0) / rate**2)
        distance = half * (t * t * t / 6.0 - t / rate**2 + sine / rate**3)
        return distance, speed, acceleration


@dataclass(frozen=True, slots=True, eq=False)
class LegLimits:
    """The greatest speed and acceleration along each of n straight legs."""

    length: FloatArray
    """Length in the autopilot's metric, shape (n,) [m]."""
    level: FloatArray
    """Horizontal part of the direction, 0 to 1, shape (n,)."""
    climb: FloatArray
    """Vertical part of the direction, -1 to 1, shape (n,)."""
    speed: FloatArray
    """Greatest cruise speed, shape (n,) [m/s]."""
    acceleration: FloatArray
    """Greatest acceleration, shape (n,) [m/s²]."""

    def select(self, index: IntArray) -> LegLimits:
        """Return the legs at ``index``."""
        return LegLimits(
            *(getattr(self, name)[index] for name in self.__dataclass_fields__)
        )

    @classmethod
    def joined(cls, parts: Sequence[LegLimits]) -> LegLimits:
        """Return the legs of all ``parts``, one after the other."""
        return cls(
            *(
                np.concatenate([getattr(part, name) for part in parts])
                for name in cls.__dataclass_fields__
            )
        )


def leg_limits(
    displacement: FloatArray, parameters: Parameters, speed: FloatArray
) -> LegLimits:
    """Limits along legs of ``displacement`` north, east, up (n, 3) [m].

    The law takes the largest that keep the horizontal and the vertical limits each;
    ``speed`` (n,) [m/s] is a further limit along the leg.
    """
    length = np.linalg.norm(displacement, axis=1)
    length = np.where(length > SHORTEST, length, 0.0)
    whole = np.where(length > 0.0, length, 1.0)
    level = np.linalg.norm(displacement[:, :2], axis=1) / whole
    climb = displacement[:, 2] / whole
    rise = np.where(climb > 0.0, parameters.speed_up, parameters.speed_down)
    with np.errstate(divide="ignore", over="ignore"):
        fastest = np.minimum(parameters.speed / level, rise / np.abs(climb))
        hardest = np.minimum(
            parameters.acceleration / level,
            parameters.acceleration_vertical / np.abs(climb),
        )
    return LegLimits(
        length,
        level,
        climb,
        np.minimum(fastest, speed),
        np.where(np.isfinite(hardest), hardest, parameters.acceleration),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Ramp:
    """From rest to a speed, or back: what :class:`LegProfile` has of it, each (n,)."""

    acceleration: FloatArray
    jerk: FloatArray
    jerk_time: FloatArray
    hold_time: FloatArray
    time: FloatArray


def _ramp(speed: FloatArray, acceleration: FloatArray, parameters: Parameters) -> _Ramp:
    """Return the ramps to ``speed`` (n,) [m/s] with an acceleration (n,) [m/s²]."""
    jerk, snap = parameters.jerk, parameters.snap
    rise = np.pi * jerk / (2.0 * snap)
    gentle = np.minimum(acceleration, speed / (2.0 * rise)) < jerk * rise
    # Gentle ramps never reach the full jerk.
    short = np.minimum(
        np.minimum(np.cbrt(np.pi * speed / (4.0 * snap)), rise),
        np.sqrt(np.pi * acceleration / (2.0 * snap)),
    )
    gentle_jerk = 2.0 * snap * short / np.pi
    # Harder ones hold the full jerk; those to a low speed reach less acceleration.
    reached = 0.5 * jerk * (np.sqrt(rise**2 + 4.0 * speed / jerk) - rise)
    hard = np.minimum(acceleration, reached)
    top = np.where(gentle, gentle_jerk * short, hard)
    used_jerk = np.where(gentle, gentle_jerk, jerk)
    jerk_time = np.where(gentle, short, rise)
    hold = np.where(gentle, 0.0, np.maximum(hard / jerk - rise, 0.0))
    safe = np.where(top > 0.0, top, 1.0)
    push = np.maximum(speed / safe - 2.0 * jerk_time - hold, 0.0)
    return _Ramp(top, used_jerk, jerk_time, hold, 4.0 * jerk_time + 2.0 * hold + push)


def ramp_time(
    speed: FloatArray, acceleration: FloatArray, parameters: Parameters
) -> FloatArray:
    """Time [s] from rest to ``speed`` [m/s]; all arrays of shape (n,)."""
    return _ramp(speed, acceleration, parameters).time


def profile(
    limits: LegLimits, parameters: Parameters, speed: FloatArray | None = None
) -> LegProfile:
    """Return the legs flown at cruise ``speed`` (n,) [m/s], or as fast as they may.

    A speed at which two ramps do not fit the leg is lowered until they do, as the
    autopilot does.
    """
    wanted = limits.speed if speed is None else np.minimum(speed, limits.speed)
    cruise = fitting_speed(replace(limits, speed=wanted), parameters)
    rise = _ramp(cruise, limits.acceleration, parameters)
    moving = limits.length > 0.0
    ramp = np.where(moving, rise.time, 0.0)
    safe = np.where(moving, cruise, 1.0)
    # The speed is lowered to fit, so the cruise cannot be shorter than nothing.
    duration = np.where(
        moving, 2.0 * ramp + np.maximum(limits.length / safe - ramp, 0.0), 0.0
    )
    return LegProfile(
        limits.length,
        np.where(moving, cruise, 0.0),
        np.where(moving, rise.acceleration, 0.0),
        np.where(moving, rise.jerk, 0.0),
        np.where(moving, rise.jerk_time, 0.0),
        np.where(moving, rise.hold_time, 0.0),
        ramp,
        duration,
    )


RESOLUTION = 1e-14
"""A step that changes speeds by less than this part is the last."""

MOST_STEPS = 60
"""Steps after which speeds are taken as they are."""


def fitting_speed(limits: LegLimits, parameters: Parameters) -> FloatArray:
    """Greatest speeds (n,) [m/s] within ``limits`` at which two ramps fit each leg.

    The ramps cover no more than the leg, to the last bit. Zero for a leg of no length.
    """
    speed, length = limits.speed, limits.length

    def missing(value: FloatArray, chosen: NDArray[np.intp]) -> FloatArray:
        hardest = limits.acceleration[chosen]
        return np.asarray(
            value * ramp_time(value, hardest, parameters) - length[chosen]
        )

    every = np.arange(speed.size)
    found = speed.copy()
    tight = every[(length > 0.0) & (missing(speed, every) > 0.0)]
    if tight.size:
        found[tight] = _onto(
            lambda v: missing(v, tight),
            _root(lambda v: missing(v, tight), np.zeros(tight.size), speed[tight]),
            -1.0,
        )
    return np.where(length > 0.0, found, 0.0)


def speed_for(
    limits: LegLimits,
    parameters: Parameters,
    duration: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
) -> FloatArray:
    """Cruise speeds (n,) [m/s] at which the legs take ``duration`` (n,) [s], or less.

    Less by 1e-12 s at most, where they may be so fast and so slow: no speed is above
    ``fastest`` (n,) [m/s], what :func:`fitting_speed` gives, and none below
    ``slowest`` (n,), unless the leg is too short for that.
    """
    slowest = np.minimum(slowest, fastest)

    # T = L / V + T_ramp(V), times V: grows with V up to the greatest that fits.
    def spare(value: FloatArray, chosen: NDArray[np.intp]) -> FloatArray:
        ramp = ramp_time(value, limits.acceleration[chosen], parameters)
        return np.asarray(value * (duration[chosen] - ramp) - limits.length[chosen])

    every = np.arange(fastest.size)
    found = fastest.copy()
    slow = spare(slowest, every) >= 0.0
    found[slow] = slowest[slow]
    between = every[~slow & (spare(fastest, every) > 0.0)]
    if between.size:
        found[between] = _onto(
            lambda v: spare(v, between),
            _root(lambda v: spare(v, between), slowest[between], fastest[between]),
            1.0,
        )
    return found


def _root(
    function: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray
) -> FloatArray:
    """Roots (n,) of growing functions, negative at ``low`` and positive at ``high``.

    The secant through the last two places, and bisection where it leaves the bracket:
    about eight steps, for the functions here are nearly powers.
    """
    before, at_before = high, function(high)
    place, value = low, function(low)
    for _ in range(MOST_STEPS):
        rise = value - at_before
        flat = rise == 0.0
        chord = place - value * (place - before) / np.where(flat, 1.0, rise)
        tried = np.where(
            ~flat & (chord > low) & (chord < high), chord, 0.5 * (low + high)
        )
        before, at_before = place, value
        place, value = tried, function(tried)
        low, high = (
            np.where(value <= 0.0, np.maximum(low, place), low),
            np.where(value >= 0.0, np.minimum(high, place), high),
        )
        if np.all(np.abs(place - before) <= RESOLUTION * high):
            break
    return place


def _onto(
    function: Callable[[FloatArray], FloatArray], place: FloatArray, side: float
) -> FloatArray:
    """Move roots (n,) by a few roundings until the function is not above zero.

    ``side`` -1: downwards; 1: upwards, until it is not below zero.
    """
    step = side * np.finfo(np.float64).eps
    while np.any(wrong := side * function(place) < 0.0):
        place = np.where(wrong, place * (1.0 + step), place)
        step *= 2.0
    return place
