"""Least times: below which no drone makes a move, by its limits and rotors alone."""

from __future__ import annotations

from math import inf, remainder, sin, sqrt, tau
from typing import TYPE_CHECKING

import numpy as np

from showc.script.show import Follow, Morph, Rotate, Travel

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.arrays import FloatArray
    from showc.script.show import Show, Transition
    from showc.vehicle import Limits, Quadrotor

_FEW, _SAMPLE, _PAIRS = 4, 40, 2_000_000
"""Others that each place is first held against, at least and at most, and pairs of
places that are looked at in a script: all of them up to ten moves of 450 drones."""
_NONE = 1e-12
"""What keeps quotients finite: far below any acceleration and speed."""
_FULL_TURN = 1e-6
"""What an angle may miss a whole turn by, for rounding [rad]: 0.1 mm at 100 m."""


def least_times(
    displacement: FloatArray, limits: Limits, vehicle: Quadrotor
) -> FloatArray:
    """Return a time below which no drone moves by a displacement, hover to hover.

    Along each axis by itself, and level: speed and acceleration are bounded, and a
    point with these bounds needs 2 sqrt(d / a), or d / v + v / a if it reaches the
    speed v. The horizontal acceleration is at most the thrust's horizontal part at
    full tilt, the vertical one what thrust and weight leave; both are generous, so
    that the time is a lower bound. Where jerk is at most j, a move of length d takes
    (32 d / j)^(1/3).

    Parameters
    ----------
    displacement
        Shape (..., 3) [m].
    limits
        What the drone keeps.
    vehicle
        What flies.

    Returns
    -------
    FloatArray
        Shape (...) [s].
    """
    thrust = min(limits.thrust_max, vehicle.thrust_max) / vehicle.mass
    # Roll and pitch tilt together: the horizontal part is at most sqrt(2) sin(tilt).
    level = thrust * min(1.0, sqrt(2.0) * sin(limits.tilt))
    # Upright drones, which launch, have no level acceleration at all.
    level = max(min(level, limits.acceleration or inf), _NONE)
    up = min(thrust - vehicle.gravity, limits.acceleration_up or inf)
    down = min(vehicle.gravity, limits.acceleration_down or inf)
    length = np.linalg.norm(displacement, axis=-1)
    times: FloatArray = np.cbrt(32.0 * length / (limits.jerk or inf))
    across = np.linalg.norm(displacement[..., :2], axis=-1)
    pull = np.full(across.shape, level)
    speed = np.full(across.shape, limits.level_speed or inf)
    times = np.maximum(times, _axis_time(across, speed, pull, pull))
    for axis in range(3):
        distance = np.abs(displacement[..., axis])
        forward = displacement[..., axis] > 0.0
        speed = np.where(forward, limits.velocity_max[axis], -limits.velocity_min[axis])
        if axis < 2:
            gain = loss = np.full(distance.shape, level)
        else:
            gain = np.where(forward, up, down)
            loss = np.where(forward, down, up)
        times = np.maximum(times, _axis_time(distance, speed, gain, loss))
    return times


def _axis_time(
    distance: FloatArray, speed: FloatArray, gain: FloatArray, loss: FloatArray
) -> FloatArray:
    """Return the least time of a point that gains and loses speed at given rates."""
    mean = 1.0 / gain + 1.0 / loss
    peak = np.sqrt(2.0 * distance / mean)
    reached = np.minimum(peak, speed)
    cruise = np.maximum(distance - reached**2 * mean / 2.0, 0.0)
    return np.asarray(reached * mean + cruise / np.maximum(reached, _NONE))


def least_mean_time(show: Show, index: int) -> float:
    """Return a lower bound on a transition's time from the fleet's middle alone [s].

    Some drone moves at least as far along an axis as the middle of all places does.
    Cheap, and weaker than :func:`least_duration`.
    """
    ends = _ends(show, index)
    if ends is None:
        return 0.0
    start, goal = ends
    way = goal.mean(axis=0) - start.mean(axis=0)
    # The middle may move along several axes with different drones: each by itself.
    each = [least_times(way * axis, show.limits, show.vehicle) for axis in np.eye(3)]
    return float(np.max(each))


def _ends(show: Show, index: int) -> tuple[FloatArray, FloatArray] | None:
    """Return where the drones of a transition start and end, if that is known."""
    transition = show.transitions[index]
    own = transition.group
    if show.parking is not None:
        return None
    before = next(
        (
            one
            for one in reversed(show.transitions[:index])
            if own is None or one.group in {None, own}
        ),
        None,
    )
    rows = slice(None) if own is None else list(show.groups[own])
    if before is None:
        start = show.formations[show.pads].points[: show.drones][rows]
        start = start + np.array([0.0, 0.0, show.launch.altitude])
    elif (
        _elsewhere(before)
        or (own is None and before.group is not None)
        or before.under_way[1]
        or transition.under_way[0]
    ):
        return None
    else:
        start = show.formations[before.to].points
        if before.group != own:
            if before.assignment != "fixed":
                return None
            start = start[rows]
    goal = show.formations[transition.to].points
    return (start, goal) if len(start) == len(goal) else None


def _elsewhere(held: Transition) -> bool:
    """Tell whether a formation ends its hold in other places than it began it."""
    return any(
        abs(remainder(one.angle, tau)) > _FULL_TURN
        if isinstance(one, Rotate)
        else isinstance(one, Travel | Morph | Follow)
        for one in held.motion
    )


def least_duration(show: Show, index: int) -> tuple[float, int | None]:
    """Return a lower bound on a transition's time [s], and the drone that sets it.

    With fixed places it is that of the drone that needs longest. With optimal ones
    it is that of the drone whose nearest place, or of the place whose nearest drone,
    is furthest in time. Zero where it is not known where the drones come from.
    """
    transition = show.transitions[index]
    ends = _ends(show, index)
    if ends is None:
        return 0.0, None
    start, goal = ends
    known = index == 0 or all(
        item.assignment == "fixed" for item in show.transitions[:index]
    )
    if transition.assignment == "fixed" and known:
        times = least_times(goal - start, show.limits, show.vehicle)
        row = int(np.argmax(times))
        own = transition.group
        return float(times[row]), row if own is None else show.groups[own][row]
    if transition.assignment == "fixed":
        return 0.0, None
    pairs = _PAIRS // len(show.transitions)
    return max(
        _furthest(start, goal, lambda way: _moves(show, way), pairs),
        _furthest(goal, start, lambda way: _moves(show, -way), pairs),
    ), None


def _moves(show: Show, displacement: FloatArray) -> FloatArray:
    return least_times(displacement, show.limits, show.vehicle)


def _furthest(
    places: FloatArray,
    others: FloatArray,
    times: Callable[[FloatArray], FloatArray],
    pairs: int,
) -> float:
    """Return how long the way to the nearest other takes, from the furthest place [s].

    Places that are near one of a few others are not looked at further; of great fleets
    at most as many places as take little time, the least of which is a bound too.

    Parameters
    ----------
    places, others
        Shape (n, 3) and (m, 3) [m].
    times
        Least times of displacements, shape (..., 3) [m], to shape (...) [s].
    pairs
        How many displacements take little time.
    """
    sample = min(max(pairs // (2 * len(places)), _FEW), _SAMPLE)
    few = others[:: max(len(others) // sample, 1)]
    most = np.min([times(other - places) for other in few], axis=0)
    least = 0.0
    for place in np.argsort(-most, kind="stable")[: max(pairs // len(others), 1)]:
        if most[place] <= least:
            break
        least = max(least, float(times(others - places[place]).min()))
    return least
