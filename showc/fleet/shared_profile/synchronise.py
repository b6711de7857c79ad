"""Which shared profile suits a fleet: the fastest one all can fly, the best at a time.

A profile's shape is two numbers, phase / T and ramp / T. For a fixed shape the strain
on every limit falls as T grows (the thrust vector moves towards hover, rates and
torques shrink), so the least T of a drone and shape is found by bisection; shapes are
searched on a grid, over the drones that matter.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.shared_profile.flat import attitude, keeps_limits
from showc.fleet.shared_profile.profile import BLEND, Profile
from showc.fleet.shared_profile.straight import fly_straight

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.vehicle import Limits, Quadrotor


_PHASES = np.concatenate([np.geomspace(0.004, 0.3, 22), np.linspace(0.32, 0.5, 10)])
"""Lengths of the phase of acceleration that are tried, of the whole: closer together
where they are short, for a long cruise is flown so."""
_RAMPS = np.array([0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5])
"""Lengths of the ramps that are tried, of that phase: 0.5 has ramps alone."""
SHAPES: FloatArray = np.array(
    [(phase, phase * ramp) for phase in _PHASES for ramp in _RAMPS]
)
"""Shapes tried: phase / T and ramp / T, shape (m, 2)."""
_SAMPLE, _TRIED = 100, 24
"""Drones that name the shapes tried for many of them, and how many of these."""
_JERKED = 1.02
"""What the bound on jerk leaves out of the cosine of the roll, and the width of its
enclosure: what the proof finds beyond the straight line's own jerk, as a share."""
_FRACTIONS = np.linspace(-1.0, 1.0, 9)
"""Where strain is looked at, of the greatest acceleration along the way."""
CLOSELY, ROUGHLY = 14, 8
"""Halvings of the time between twice too short and long enough."""


def strain(  # noqa: PLR0917 - vectorised physics names every quantity
    vehicle: Quadrotor,
    limits: Limits,
    heading: float,
    displacement: FloatArray,
    duration: FloatArray,
    shape: FloatArray,
) -> FloatArray:
    """Greatest use of any limit by straight flights; at most 1 if they are kept.

    Parameters
    ----------
    displacement
        Shape (n, 3) [m].
    duration
        Shape (n,) [s].
    shape
        Phase / T and ramp / T of each flight, shape (n, 2).

    Returns
    -------
    ndarray, shape (n,)
        Slightly pessimistic for torques and rotors (greatest values are added up),
        sampled for rates: a first look, before the proof on Bernstein coefficients.
    """
    phase, ramp = shape[:, 0] * duration, shape[:, 1] * duration
    speed = 1.0 / (duration - phase)
    peak = speed / (phase - ramp)
    jerk = peak / (ramp * (1.0 - BLEND))
    snap = jerk / (BLEND * ramp)
    # Axes first, then fractions, then flights: every operation and every maximum runs
    # along flights, which lie next to each other.
    way = np.ascontiguousarray(displacement.T)[:, None]
    thrust = way * (peak * _FRACTIONS[:, None])
    thrust[2] += vehicle.gravity
    # u is linear in s'': its derivatives by s'' are the way itself, and zero.
    first, second = np.moveaxis(way, 0, -1), np.zeros((1, 1, 3))
    flat = attitude(np.moveaxis(thrust, 0, -1), first, second, heading)
    velocity = way[:, 0] * speed
    most, least = np.asarray(limits.velocity_max), np.asarray(limits.velocity_min)
    use = np.maximum(velocity / most[:, None], velocity / least[:, None]).max(axis=0)
    use = np.maximum(use, _round_strain(limits, displacement, speed, peak))
    length = np.linalg.norm(displacement, axis=1)
    use = np.maximum(use, _JERKED * length * jerk / (limits.jerk or np.inf))
    roll = np.abs(flat.roll[0]).max(axis=0)
    pitch = np.abs(flat.pitch[0]).max(axis=0)
    use = np.maximum(use, np.maximum(roll, pitch) / limits.tilt)
    # A maximum scaled by what no fraction changes is the maximum of the scaled.
    rate_x = np.abs(flat.roll[1]).max(axis=0) * jerk
    rate_y = np.abs(flat.pitch[1]).max(axis=0) * jerk
    use = np.maximum(use, rate_x / limits.body_rate[0])
    use = np.maximum(use, rate_y / limits.body_rate[1])
    greatest = vehicle.mass * flat.acceleration.max(axis=0)
    smallest = vehicle.mass * flat.acceleration.min(axis=0)
    use = np.maximum(use, greatest / limits.thrust_max)
    use = np.where(smallest < limits.thrust_min, np.inf, use)
    torques = np.stack(
        [
            vehicle.inertia[axis]
            / vehicle.torque_factor
            * (np.abs(angle[2]) * jerk**2 + np.abs(angle[1]) * snap).max(axis=0)
            for axis, angle in enumerate((flat.roll, flat.pitch))
        ]
        + [abs(vehicle.inertia[0] - vehicle.inertia[1]) * rate_x * rate_y],
        axis=1,
    )
    use = np.maximum(use, (torques / np.asarray(limits.torque_max)).max(axis=1))
    rotors = vehicle.rotor_fractions()
    turning = (torques @ np.abs(rotors[:, 1:]).T).max(axis=1)
    base = rotors[0, 0]
    use = np.maximum(use, base * greatest + turning)
    return np.where(base * smallest < turning, np.inf, use)


def _round_strain(
    limits: Limits, displacement: FloatArray, speed: FloatArray, peak: FloatArray
) -> FloatArray:
    """Use of level speed and accelerations by straight flights, shape (n,)."""
    level = np.hypot(displacement[:, 0], displacement[:, 1])
    use = level * speed / (limits.level_speed or np.inf)
    use = np.maximum(use, level * peak / (limits.acceleration or np.inf))
    # Speeding up and slowing down are alike: a straight move goes both ways.
    least = min(limits.acceleration_up or np.inf, limits.acceleration_down or np.inf)
    return np.asarray(np.maximum(use, np.abs(displacement[:, 2]) * peak / least))


def least_times(  # noqa: PLR0917 - same
    vehicle: Quadrotor,
    limits: Limits,
    heading: float,
    displacement: FloatArray,
    shapes: FloatArray,
    halvings: int = CLOSELY,
) -> FloatArray:
    """Least duration of each drone for each shape, shape (n, m) [s].

    Too long by a factor of 2 to the power of 2 to the minus ``halvings`` at most: by
    4e-5 of it, or by 0.3 % where only a ranking is wanted (``ROUGHLY``).
    """
    drones, count = displacement.shape[0], shapes.shape[0]
    way = np.repeat(displacement, count, axis=0)
    shape = np.tile(shapes, (drones, 1))
    low = np.full(way.shape[0], 1e-3)
    high = np.ones(way.shape[0])
    for _ in range(40):
        bad = strain(vehicle, limits, heading, way, high, shape) > 1.0
        if not bad.any():
            break
        low = np.where(bad, high, low)
        high = np.where(bad, 2.0 * high, high)
    for _ in range(halvings):
        middle = np.sqrt(low * high)
        good = strain(vehicle, limits, heading, way, middle, shape) <= 1.0
        high = np.where(good, middle, high)
        low = np.where(good, low, middle)
    return np.asarray(high.reshape(drones, count))


_TOGETHER = 100
"""Flights that are proved at once: their numbers stay in a core's cache."""
_WORKING = 2
"""Drones over which shapes are first compared; others join when they break it."""


def shared_profile(
    vehicle: Quadrotor,
    limits: Limits,
    heading: float,
    start: FloatArray,
    goal: FloatArray,
) -> Profile:
    """Find the fastest profile of the family that every drone can fly straight.

    Parameters
    ----------
    start, goal
        Positions, shape (n, 3) [m].

    Returns
    -------
    Profile
        Proved flyable for all drones on the Bernstein coefficients.
    """
    displacement = goal - start
    moving = np.linalg.norm(displacement, axis=1) > 0.0
    if not moving.any():
        raise ValueError("no drone moves: a hold has no profile")
    displacement = np.unique(displacement[moving], axis=0)
    coarse = SHAPES[::71]
    rough = least_times(vehicle, limits, heading, displacement, coarse, ROUGHLY)
    chosen = np.argsort(rough.min(axis=1))[::-1][:_WORKING]
    for _ in range(8):
        shapes = _promising(vehicle, limits, heading, displacement[chosen])
        times = least_times(vehicle, limits, heading, displacement[chosen], shapes)
        worst = times.max(axis=0)
        best = int(np.argmin(worst))
        shape = shapes[best : best + 1]
        own = least_times(vehicle, limits, heading, displacement, shape)[:, 0]
        if own.max() <= worst[best] * (1.0 + 1e-6):
            break
        chosen = np.union1d(chosen, np.argsort(own)[::-1][:_WORKING])
    duration = float(own.max()) * (1.0 + 1e-6)
    suspects = displacement[np.argsort(own)[::-1]]
    profile = Profile(
        duration, float(shape[0, 0]) * duration, float(shape[0, 1]) * duration
    )
    # Those that are likeliest to fail come first, and end the look at the others.
    some = [suspects[top : top + _TOGETHER] for top in range(0, len(own), _TOGETHER)]
    while not all(proved(vehicle, limits, heading, s, profile).all() for s in some):
        profile = profile.stretched(profile.duration * 1.002)
    return profile


def _promising(
    vehicle: Quadrotor, limits: Limits, heading: float, displacement: FloatArray
) -> FloatArray:
    """Shapes (m, 2) of which one is the best for all of these drones."""
    rough = least_times(vehicle, limits, heading, displacement, SHAPES, ROUGHLY)
    worst = rough.max(axis=0)
    best = worst.min() * 2.0 ** (0.5**ROUGHLY) * (1.0 + 1e-9)
    return np.asarray(SHAPES[worst <= best])


def best_profile(
    vehicle: Quadrotor,
    limits: Limits,
    heading: float,
    displacement: FloatArray,
    duration: float,
) -> tuple[Profile, BoolArray]:
    """Choose the profile over ``duration`` that the most drones can fly straight.

    For many drones an even sample of them names the shapes that are worth trying.

    Returns
    -------
    Profile
        Among equals, the one under which the fleet is strained least.
    ndarray of bool, shape (n,)
        Drones for which a first look finds all limits kept.
    """
    distinct, inverse = np.unique(displacement, axis=0, return_inverse=True)
    weights = np.bincount(inverse.ravel(), minlength=distinct.shape[0])

    def judged(rows: IntArray, shapes: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Drones that keep all limits by shape, (n, m), and each shape's score."""
        use = uses(vehicle, limits, heading, distinct[rows], duration, shapes)
        fits = use <= 0.9999
        least = np.minimum(use, 10.0).max(axis=0)
        return fits, weights[rows] @ fits - 1e-3 * least

    every, shapes = np.arange(distinct.shape[0]), SHAPES
    if every.size > 2 * _SAMPLE:
        # In the order of their lengths, so that the longest one is among them.
        order = np.argsort(np.linalg.norm(distinct, axis=1), kind="stable")[::-1]
        sample = order[:: every.size // _SAMPLE]
        _, score = judged(sample, shapes)
        shapes = shapes[np.sort(np.argsort(-score, kind="stable")[:_TRIED])]
    fits, score = judged(every, shapes)
    best = int(np.argmax(score))
    phase, ramp = shapes[best]
    profile = Profile(duration, float(phase) * duration, float(ramp) * duration)
    return profile, np.asarray(fits[inverse.ravel(), best])


def uses(  # noqa: PLR0917 - same
    vehicle: Quadrotor,
    limits: Limits,
    heading: float,
    displacement: FloatArray,
    duration: float,
    shapes: FloatArray,
) -> FloatArray:
    """Greatest use of a limit by each move (n, 3) under each shape, shape (n, m)."""
    count = shapes.shape[0]
    use = np.empty((displacement.shape[0], count))
    # In blocks that bound the memory.
    for top in range(0, displacement.shape[0], 100):
        way = displacement[top : top + 100]
        use[top : top + 100] = strain(
            vehicle,
            limits,
            heading,
            np.repeat(way, count, axis=0),
            np.full(way.shape[0] * count, duration),
            np.tile(shapes, (way.shape[0], 1)),
        ).reshape(way.shape[0], count)
    return use


def proved(
    vehicle: Quadrotor,
    limits: Limits,
    heading: float,
    displacement: FloatArray,
    profile: Profile,
) -> BoolArray:
    """Whether straight flights keep all limits but the volume, shape (n,)."""
    # Both ends lie in the volume, which is convex: so does every straight way.
    everywhere = (np.inf, np.inf, np.inf)
    nowhere = (-np.inf, -np.inf, -np.inf)
    free = replace(limits, position_min=nowhere, position_max=everywhere)
    origin = np.zeros_like(displacement)
    flights = fly_straight(vehicle, heading, origin, displacement, profile)
    return keeps_limits(vehicle, free, flights)
