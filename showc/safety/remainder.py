"""What interpolation between falls misses, bounded.

The Jacobian of |y| y is symmetric and at least |y|, so that two falls never part (the
flow contracts; Lohmiller and Slotine 1998, On contraction analysis for non-linear
systems), and a change of the start by one fades as exp(-k (way)). The second derivative
of |y| y is at most 2. Both bound the second derivatives of y, of its integrals and,
through the sink at the impact, of the time T. A multilinear interpolation over cells of
width d is wrong by at most the sum of d² / 8 times these over its directions. Of many
functions with that property the greatest has it from above.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.safety.fall import (
    AIRSPEED,
    DRAG_CELLS,
    STEP,
    runge_kutta,
    shares_of_step,
)

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.safety.fall import Fall


def remainder(
    fall: Fall,
    climbs: FloatArray,
    fastest: tuple[float, float],
    levels: FloatArray,
    square: float,
) -> FloatArray:
    """Bound what interpolation misses, (climbs, levels) [m].

    The cells lie on both sides of a climb, and between a level and the next.

    Parameters
    ----------
    fall
        What falls.
    climbs
        Of the table, shape (i,) [m/s].
    fastest
        Greatest level speed over ground, and through the air [m/s].
    levels
        Of the table, shape (m,) [m].
    square
        Sum of the squared widths of a cell in climb and in level speed [m²/s²].
    """
    edges = np.maximum(np.linspace(*fall.drag, DRAG_CELLS + 1), 1e-9)
    worst = np.zeros((climbs.size, levels.size))
    slowest = _Slowest(fall, climbs, fastest[1], edges[:-1, None], edges[1:, None])
    for parts in slowest.bounds(levels):
        ground = max(fastest[0], fall.wind)
        worst = np.maximum(worst, parts.missed(ground, fastest, square))
    return worst


@dataclass(frozen=True, slots=True, eq=False)
class _Bounds:
    """Bounds over cells of heights, at the impact, for one cell of drags.

    Arrays of shape (climbs, levels), or one that broadcasts.
    """

    sink: FloatArray
    """Least downward speed [m/s]."""
    time: FloatArray
    """Longest fall [s]."""
    fade: FloatArray
    """What is left of a change of the start by one."""
    ways: FloatArray
    """Integral of such a change [s]."""
    bends: FloatArray
    """Integral of the second derivative [s²/m]."""
    change: FloatArray
    """Derivative of y by k, [m²/s]."""
    changes: FloatArray
    """Its integral [m²]."""
    twices: FloatArray
    """Integral of the second derivative by k [m³]."""
    brake: FloatArray
    """Greatest vertical acceleration [m/s²]."""
    turn: FloatArray
    """Greatest level acceleration [m/s²]."""
    width: float
    """Of the cell of drags [1/m]."""
    gap: FloatArray
    """Of the cells of heights [m]."""

    def missed(
        self, ground: float, fastest: tuple[float, float], square: float
    ) -> FloatArray:
        """Bound what interpolation over the cells misses [m].

        ``ground`` [m/s] is the greatest level speed over ground in a fall.
        """
        sink, fade = self.sink, self.fade
        # Derivatives of the time, by a change of the start and by k.
        longer = self.ways / sink
        bent = (self.bends + 2.0 * fade * longer + self.brake * longer**2) / sink
        later = self.changes / sink
        curved = self.twices + 2.0 * self.change * later + self.brake * later**2
        rest = self.turn * longer**2 + 2.0 * fade * longer + self.bends
        total = square * (ground * bent + rest)
        total = total + AIRSPEED**2 * (sum(fastest) * bent + 2.0 * longer + rest)
        total = total + self.width**2 * (
            ground * curved / sink
            + self.turn * later**2
            + 2.0 * self.change * later
            + self.twices
        )
        total = total + self.gap**2 * (
            ground * self.brake / sink**3 + self.turn / sink**2
        )
        # Both what is tabled and what is sought lie within the way over ground.
        return np.minimum(total / 8.0, 2.0 * ground * self.time)


class _Slowest:
    """The slowest falls of cells, and bounds along them.

    Parameters
    ----------
    fall
        What falls.
    climbs
        Of the table, shape (i,) [m/s].
    air
        Greatest level speed through the air [m/s].
    least, most
        Bounds of each cell of drags, shape (cells, 1) [1/m].
    """

    def __init__(
        self,
        fall: Fall,
        climbs: FloatArray,
        air: float,
        least: FloatArray,
        most: FloatArray,
    ) -> None:
        self.gravity, self.air, self.least, self.most = fall.gravity, air, least, most
        # The cells about a climb: the longest rise, and one that is sure.
        cell = climbs[1] - climbs[0]
        climb, slow = np.maximum(climbs + cell, 0.0), np.maximum(climbs - cell, 0.0)
        self.above = climb**2 / (2.0 * fall.gravity)
        self.rising = climb / fall.gravity
        against = fall.gravity + most * np.hypot(air, slow) * slow
        self.sure = slow**2 / (2.0 * against)
        self.first = air**2 + np.maximum(climb, -climbs[0]) ** 2

    def bounds(self, levels: FloatArray) -> list[_Bounds]:
        """Return the bounds of each cell of drags, at ``levels`` (m,) [m] and above.

        A cell of heights reaches from its level to the next.
        """
        course = self._course(float(levels[-1]))
        times = np.asarray(STEP * np.arange(len(course)))
        after = np.append(levels[1:], levels[-1])
        found = []
        for cell in range(self.least.shape[0]):
            least, most = float(self.least[cell, 0]), float(self.most[cell, 0])
            depth = course[:, 1, cell, 0]
            sink = np.interp(
                levels + self.sure[cell][:, None], depth, course[:, 0, cell, 0]
            )
            deepest = after + self.above[:, None]
            ways, bends, change, changes, twices = (
                np.stack(
                    [
                        np.interp(deepest[row], depth, course[:, part, cell, row])
                        for row in range(self.above.size)
                    ]
                )
                for part in (2, 4, 5, 6, 8)
            )
            fade = np.exp(-least * levels)
            square = np.maximum(
                self._squared(levels[:, None], least),
                self._squared(after[:, None], least),
            ).T
            found.append(
                _Bounds(
                    np.maximum(sink, 1e-9),
                    self.rising[:, None] + np.interp(deepest, depth, times),
                    fade,
                    ways,
                    bends,
                    change,
                    changes,
                    twices,
                    np.maximum(self.gravity, most * square - self.gravity),
                    most * np.sqrt(square) * self.air * fade,
                    most - least,
                    after - levels,
                )
            )
        return found

    def _squared(self, depth: FloatArray, least: FloatArray | float) -> FloatArray:
        """Bound |y|² after falling a depth: d|y|²/dh <= 2 g - 2 k |y|²."""
        fade = np.exp(-2.0 * least * depth)
        return np.asarray(self.first * fade + self.gravity / least * (1.0 - fade))

    def _slope(self, now: FloatArray) -> FloatArray:
        """Return the rates of what :meth:`_course` follows.

        Sink and depth; the integral of a change of the start; its second derivative and
        that one's integral; the derivative by k and its integral; the second derivative
        by k and its integral.
        """
        sink, depth, _, second, _, change, _, twice, _ = now
        fade, square = np.exp(-self.least * depth), self._squared(depth, self.least)
        own, most = self.least * sink, self.most
        return np.stack(
            [
                self.gravity - most * sink * np.hypot(sink, self.air * fade),
                sink,
                fade,
                2.0 * most * fade**2 - own * second,
                second,
                square - own * change,
                change,
                4.0 * np.sqrt(square) * change + 2.0 * most * change**2 - own * twice,
                twice,
            ]
        )

    def _course(self, height: float) -> FloatArray:
        """Fall from the top of the rise by ``height`` [m]: greatest values so far.

        Shape (steps, 9, cells, climbs).
        """
        rising, first, most = self.rising, self.first, self.most
        still = np.zeros((self.least.shape[0], rising.size))
        change = first * rising + still
        twice = (4.0 * np.sqrt(first) * change + 2.0 * most * change**2) * rising
        now = np.stack(
            [
                still,
                still,
                rising + still,
                2.0 * most * rising,
                most * rising**2,
                change,
                0.5 * first * rising**2 + still,
                twice,
                twice * rising,
            ]
        )
        history = [now]
        while now[1].min() < height + self.above.max():
            rub = most * np.hypot(now[0], self.air * np.exp(-self.least * now[1]))
            shares = shares_of_step(rub, STEP)
            for _ in range(shares):
                now = runge_kutta(self._slope, now, STEP / shares)
            history.append(now)
        return np.maximum.accumulate(np.stack(history), axis=0)
