"""Cruise speeds: the greatest that fits a leg, and the one that takes a given time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.mission.law import ramp_time

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from showc.mission.law import LegLimits
    from showc.mission.parameters import Parameters

    FloatArray = NDArray[np.float64]

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
    tight = every[missing(speed, every) > 0.0]
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
