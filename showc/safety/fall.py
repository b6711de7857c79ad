"""Falls with drag and wind: what a drone without thrust does.

A drone of mass m and drag area A (coefficient times area), in a steady level wind w,
has with y = (c, a) its climb and its level velocity a = u - w through the air, e the
unit vector upwards and k = rho A / (2 m)

    y' = -g e - k |y| y.

a keeps its direction. After the time T the drone has moved by w T and by the integral
of a.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from showc.vehicle.power import SEA_LEVEL

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.arrays import FloatArray


CELL = 0.5
"""Width of a table's cells in climb [m/s]: what interpolation across one may miss is
bounded and added (:mod:`showc.safety.remainder`)."""
AIRSPEED = 0.25
"""Distance between the airspeeds from which falls are integrated [m/s]."""
DRAG_CELLS = 24
"""Cells into which the range of drag areas is cut."""
STEP = 0.02
"""Longest step of the integration [s]."""
STIFF = 0.2
"""Greatest k |y| times a step: falls are then wrong by less than 1e-4 m, and those of
drones without a parachute by less than 1e-6 m."""
HEAD = 2.0
"""Height over the ground from which a fall may hit a person [m]."""
SPAN = 0.5
"""Range of heights over the ground that one look at the table serves [m]."""


@dataclass(frozen=True, slots=True)
class Fall:
    """What falls, and in which wind."""

    mass: float
    """[kg]."""
    drag_area: tuple[float, float]
    """Least and greatest drag coefficient times area [m²]."""
    wind: float
    """Greatest steady wind, from any direction [m/s]."""
    gravity: float = 9.81
    """[m/s²]."""
    thinnest: float = SEA_LEVEL
    """Least density of the air [kg/m³]; the greatest is that at sea level, for thin
    air lets speed carry farther, and dense air the wind."""

    @property
    def drag(self) -> tuple[float, float]:
        """Least and greatest k = rho A / (2 m) [1/m]."""
        low, high = self.drag_area
        factor = 0.5 / self.mass
        return factor * self.thinnest * low, factor * SEA_LEVEL * high

    def lean(self, airspeed: float) -> float:
        """Return the tilt at which level thrust holds the greatest drag [rad].

        Of a drone that flies level through the air at ``airspeed`` [m/s].
        """
        return float(np.arctan(self.drag[1] * airspeed**2 / self.gravity))


def shares_of_step(rub: FloatArray, step: float) -> int:
    """Return into how many parts a ``step`` [s] is cut where k |y| is ``rub`` [1/s]."""
    return max(ceil(float(rub.max()) * step / STIFF), 1)


def runge_kutta(
    slope: Callable[[FloatArray], FloatArray], now: FloatArray, step: float
) -> FloatArray:
    """Return a state one ``step`` [s] later, by the classical method."""
    first = slope(now)
    second = slope(now + 0.5 * step * first)
    third = slope(now + 0.5 * step * second)
    fourth = slope(now + step * third)
    return np.asarray(now + step / 6.0 * (first + 2.0 * (second + third) + fourth))


def falls(
    climbs: FloatArray,
    airspeeds: FloatArray,
    drags: FloatArray,
    levels: FloatArray,
    gravity: float,
) -> tuple[FloatArray, FloatArray]:
    """Integrate falls: times [s] and ways through the air [m] to each level below.

    Both of shape (climbs, airspeeds, drags, levels).
    """
    shape = climbs.size, airspeeds.size, drags.size
    climb, speed, drag = (
        np.broadcast_to(part, shape).ravel()
        for part in (
            climbs[:, None, None],
            airspeeds[None, :, None],
            drags[None, None, :],
        )
    )

    def slope(now: FloatArray) -> FloatArray:
        rate = np.empty_like(now)
        # Faster than a hypotenuse, which guards against overflow.
        np.multiply(-drag * np.sqrt(now[0] ** 2 + now[1] ** 2), now[:2], out=rate[:2])
        rate[0] -= gravity
        rate[2:] = now[:2]
        return rate

    still = np.zeros(climb.size)
    now = np.stack([climb, speed, still, still])
    found = np.zeros((2, climb.size, levels.size))
    # The first level is the start's own, where those that sink are at once.
    reached = np.where(climb <= 0.0, 1, 0)
    time = 0.0
    while (reached < levels.size).any():
        step = STEP / shares_of_step(drag * np.hypot(now[0], now[1]), STEP)
        after = runge_kutta(slope, now, step)
        while True:
            level = levels[np.minimum(reached, levels.size - 1)]
            here = np.flatnonzero(
                (reached < levels.size) & (after[2] <= -level) & (after[0] < 0.0)
            )
            if not here.size:
                break
            share = _crossing(now[:, here], after[:, here], -level[here], step)
            found[0, here, reached[here]] = time + share * step
            found[1, here, reached[here]] = _cubic(
                (now[3, here], after[3, here]),
                (now[1, here], after[1, here]),
                share,
                step,
            )
            reached[here] += 1
        now = after
        time += step
    time_to, way = found.reshape(2, *shape, levels.size)
    return time_to, way


def _cubic(
    values: tuple[FloatArray, FloatArray],
    rates: tuple[FloatArray, FloatArray],
    share: FloatArray,
    step: float,
) -> FloatArray:
    """Hermite's cubic over a step [s] with values and rates at its ends."""
    (start, end), (first, last) = values, rates
    rise = end - start
    return (
        start
        + share * step * first
        + share**2 * (3.0 * rise - step * (2.0 * first + last))
        + share**3 * (step * (first + last) - 2.0 * rise)
    )


def _crossing(
    now: FloatArray, after: FloatArray, height: FloatArray, step: float
) -> FloatArray:
    """Share of a step [s] after which falls, going down, are at a height (n,) [m]."""
    share = (now[2] - height) / np.maximum(now[2] - after[2], 1e-9)
    for _ in range(3):
        share = np.clip(share, 0.0, 1.0)
        rate = step * ((1.0 - share) * now[0] + share * after[0])
        off = _cubic((now[2], after[2]), (now[0], after[0]), share, step) - height
        share -= off / np.minimum(rate, -1e-6)
    return np.asarray(np.clip(share, 0.0, 1.0))
