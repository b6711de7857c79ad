"""Bringing the one clock of a fleet to rest, proved for every instant of the way.

All drones are where the plan has them at one show time s, whatever its rate r = ds/dt:
every distance that holds along the plan holds. With the plan's velocity v and
acceleration a at s a drone flies r v and r² a + r' v. Over a period in which r' is
constant these are polynomials in s times numbers between the squares of two rates. So
their Bernstein coefficients keep what the accelerations keep, for both squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from showc.trajectory import restrict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.log import showc_pb2 as pb
    from showc.script.show import Show
    from showc.trajectory import PiecewisePolynomial

RATE_CHANGE = 1.0
"""Fastest change of the shared clock's rate [1/s]: to rest in a second and a half."""

RATE_JERK = 2.0
"""Fastest change of that change [1/s²]: a quarter of a second of the ramp each way."""

JERK = 10.0
"""Jerk that a change of rate may add [m/s³]: two thirds of the 15 m/s³ that autopilots
need to follow solved flights."""


NEGLIGIBLE = 1e-3
"""Speeds below this bound no change of the clock's rate [m/s]: of at most 1 a second,
which adds a thousandth of a m/s²."""

PERIOD = 0.05
"""Time between two setpoints of a stop [s]: 20 Hz, as shows are streamed."""

AHEAD = 1.0
"""How far before and after a period pieces are kept at hand [s]."""


@dataclass(frozen=True, slots=True)
class Authority:
    """Accelerations that vehicles follow [m/s²]."""

    level: float
    """Greatest, sideways."""
    up: float
    """Greatest, upwards."""
    down: float
    """Greatest, downwards."""

    def room(
        self,
        velocity: FloatArray,
        acceleration: FloatArray,
        less: FloatArray | float = 0.0,
    ) -> FloatArray:
        """Return the greatest x >= 0 for which acceleration + x velocity fits, (...).

        Parameters
        ----------
        velocity
            Shape (..., 3) [m/s].
        acceleration
            Likewise [m/s²]; where it is beyond the authority there is no room.
        less
            What is kept free of every authority, broadcasting to (...) [m/s²].
        """
        flat, push = velocity[..., :2], acceleration[..., :2]
        square = np.sum(flat * flat, axis=-1)
        along = np.sum(flat * push, axis=-1)
        over = np.sum(push * push, axis=-1) - np.maximum(self.level - less, 0.0) ** 2
        root = np.sqrt(np.maximum(along**2 - square * over, 0.0))
        rise, lift = velocity[..., 2], acceleration[..., 2]
        end = np.where(rise > 0.0, self.up - less - lift, less - self.down - lift)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            level, upright = (root - along) / square, end / rise
        # Beyond the authority already, and moving further out: no room.
        level = np.where((over > 0.0) & (along >= 0.0), 0.0, level)
        level = np.where(square > NEGLIGIBLE**2, level, np.inf)
        upright = np.where(np.abs(rise) > NEGLIGIBLE, upright, np.inf)
        return np.maximum(np.minimum(level, upright), 0.0)

    def sure(
        self, velocity: FloatArray, acceleration: FloatArray, less: FloatArray
    ) -> FloatArray:
        """Return the room that is left to all within ``less`` of what is given, (...).

        None where an acceleration is not within what is kept at all. See :meth:`room`.
        """
        push, lift = acceleration[..., :2], acceleration[..., 2]
        kept = (
            (np.hypot(push[..., 0], push[..., 1]) <= self.level - less)
            & (lift <= self.up - less)
            & (-lift <= self.down - less)
        )
        return np.where(kept, self.room(velocity, acceleration, less), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Velocities and accelerations of a fleet over show time, in pieces."""

    start: FloatArray
    """Of each piece, shape (n,) [s]."""
    end: FloatArray
    """Of each piece, shape (n,) [s]."""
    velocity: FloatArray
    """Bernstein coefficients, shape (n, degree + 1, 3) [m/s]."""
    acceleration: FloatArray
    """Bernstein coefficients, shape (n, degree + 1, 3) [m/s²]."""

    @classmethod
    def of(cls, velocity: Sequence[PiecewisePolynomial]) -> Motion:
        """Take the motion from the velocities of all drones."""
        degree = max(speed.degree for speed in velocity)
        return cls(
            np.concatenate([speed.breaks[:-1] for speed in velocity]),
            np.concatenate([speed.breaks[1:] for speed in velocity]),
            np.concatenate([speed.elevated(degree).coefficients for speed in velocity]),
            np.concatenate(
                [speed.derivative().elevated(degree).coefficients for speed in velocity]
            ),
        )

    @property
    def fastest(self) -> float:
        """Greatest speed of any drone [m/s]."""
        return float(np.sqrt(np.sum(self.velocity**2, axis=2).max()))

    def between(self, first: float, last: float) -> Motion:
        """Return the pieces that are flown between two show times [s]."""
        met = np.flatnonzero((self.end >= first) & (self.start <= last))
        parts = self.start, self.end, self.velocity, self.acceleration
        return Motion(*(part[met] for part in parts))

    def over(self, first: float, last: float) -> tuple[FloatArray, FloatArray]:
        """Enclose the motion between two show times in the hulls of rows, (n, 3).

        Row i of the velocities [m/s] and of the accelerations [m/s²] belong together:
        a polynomial made of both has the same mixture of the rows as coefficients.
        """
        part = self.between(first, last)
        low, high = part.shares(first, last)
        return (
            restrict(part.velocity, low, high).reshape(-1, 3),
            restrict(part.acceleration, low, high).reshape(-1, 3),
        )

    def shares(self, first: float, last: float) -> tuple[FloatArray, FloatArray]:
        """Return where two show times are in each piece, 0 to 1, (n, 1, 1) each."""
        span = self.end - self.start
        low = np.clip((first - self.start) / span, 0.0, 1.0)
        high = np.clip((last - self.start) / span, 0.0, 1.0)
        return low[:, None, None], high[:, None, None]


class _Course:
    """Some pieces of a motion, and bounds that say which of them need a closer look.

    Most drones leave much more room than the clock takes. A piece's own greatest
    velocity and acceleration show that for many. For most others both ends of a period
    do, with what a polynomial may leave the line between them by: an eighth of its
    second derivative times the square of the period. Only what is left is restricted.
    """

    def __init__(self, motion: Motion, first: float, last: float) -> None:
        self.first, self.last = first, last
        self._all = motion.between(first, last)
        self._speed, self._push = (
            _sizes(part) for part in (self._all.velocity, self._all.acceleration)
        )
        degree = self._all.velocity.shape[1] - 1
        self._bends = [
            degree
            * (degree - 1)
            / 8.0
            * np.linalg.norm(np.diff(part, 2, axis=1), axis=2).max(axis=1, initial=0.0)
            for part in (self._all.velocity, self._all.acceleration)
        ]

    def room(
        self,
        authority: Authority,
        when: tuple[float, float],
        rates: Sequence[float],
        change: float,
    ) -> float:
        """Return how much of a ``change`` of the rate fits [1/s], at least 0.

        Parameters
        ----------
        authority
            What is kept.
        when
            Between which show times [s].
        rates
            Of the clock.
        change
            Of the rate, with its sign [1/s].
        """
        first, last = when
        found, all_ = abs(change), self._all
        square = max(rate**2 for rate in rates)
        level, upright = (
            square * push + found * speed
            for push, speed in zip(self._push, self._speed, strict=True)
        )
        some = np.flatnonzero(
            (all_.end >= first)
            & (all_.start <= last)
            & (
                (level > authority.level)
                | (upright > min(authority.up, authority.down))
            )
        )
        if not some.size:
            return found
        part = Motion(
            all_.start[some],
            all_.end[some],
            np.sign(change) * all_.velocity[some],
            all_.acceleration[some],
        )
        low, high = part.shares(first, last)
        width = (high - low)[:, 0, 0] ** 2
        ends = np.stack([low, high])[..., 0]
        speed, push = (_at(one, ends) for one in (part.velocity, part.acceleration))
        for rate in rates:
            less = width * (
                found * self._bends[0][some] + rate**2 * self._bends[1][some]
            )
            sure = authority.sure(speed, rate**2 * push, less).min(axis=0)
            found = min(found, float(authority.room(speed, rate**2 * push).min()))
            left = np.flatnonzero(sure < found)
            if left.size:
                rows, pushed = (
                    restrict(one[left], low[left], high[left])
                    for one in (part.velocity, part.acceleration)
                )
                room = authority.room(rows, rate**2 * pushed)
                found = min(found, float(room.min()))
        return found


def _sizes(coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Greatest size of each piece, level and upright, (n,) each."""
    level = np.hypot(coefficients[..., 0], coefficients[..., 1]).max(axis=1)
    return level, np.abs(coefficients[..., 2]).max(axis=1)


def _at(coefficients: FloatArray, share: FloatArray) -> FloatArray:
    """Values of pieces (n, degree + 1, 3) at shares (..., n, 1) of them, (..., n, 3).

    Horner's scheme in Bernstein form (Farouki 2012, section 5).
    """
    degree = coefficients.shape[1] - 1
    rest, power = 1.0 - share, np.ones_like(share)
    found = coefficients[:, 0] * rest
    for k in range(1, degree):
        power = power * share
        found = (found + comb(degree, k) * power * coefficients[:, k]) * rest
    return np.asarray(found + power * share * coefficients[:, degree])


class SharedClock:
    """The show time of a whole fleet, which can be brought to rest and turned back.

    The rate changes as fast as the vehicles' authority leaves room for r' v with every
    drone, at every instant of a period. At r' = 0 and r <= 1 the plan's own
    acceleration is never exceeded, so the clock always comes to rest: at the latest
    where the plan does.

    Parameters
    ----------
    motion
        What the fleet flies.
    authority
        What the vehicles follow.
    start
        Show time at which the clock stands first [s].
    greatest_speed
        Of any drone [m/s].
    """

    def __init__(
        self, motion: Motion, authority: Authority, start: float, greatest_speed: float
    ) -> None:
        self.time = start
        self.rate = 0.0
        self.rate_change = 0.0
        self._motion, self._authority = motion, authority
        self._course = _Course(motion, start, start)
        self._goal = 0.0
        self._jerk = min(RATE_JERK, JERK / max(greatest_speed, NEGLIGIBLE))

    @property
    def resting(self) -> bool:
        """Whether the show stands still and is to stand still."""
        return self.rate == 0.0 and self._goal == 0.0

    def run(self) -> None:
        """Let the show begin: from rest, so that the rate may jump."""
        self.rate = self._goal = 1.0

    def stop(self) -> None:
        """Bring the show to rest."""
        self._goal = 0.0

    def turn_back(self, rate: float) -> None:
        """Fly the plan backwards at ``rate`` > 0."""
        self._goal = -rate

    def advance(self, span: float) -> None:
        """Let ``span`` [s] pass, no longer than a period of setpoints."""
        before = self.rate
        self.rate_change = 0.0 if before == self._goal else self._change(span)
        self.rate += self.rate_change * span
        left = self.rate - self._goal
        # What is less than 1e-12 is rounding: no period more is flown for it.
        if (before - self._goal) * left <= 0.0 or abs(left) < 1e-12:
            self.rate = self._goal
        self.time += 0.5 * (before + self.rate) * span

    def hold_at(self, time: float) -> None:
        """Stand still at the show time ``time`` [s], where the plan is at rest."""
        self.time, self.rate, self.rate_change, self._goal = time, 0.0, 0.0, 0.0

    def changes(self, begin: float, end: float) -> tuple[float, ...]:
        """Run until it rests, or leaves the plan between two show times [s].

        Returns the change of the rate in each period [1/s].
        """
        taken = []
        while not self.resting and begin < self.time < end:
            before = self.rate
            self.advance(PERIOD)
            taken.append((self.rate - before) / PERIOD)
        return tuple(taken)

    def _change(self, span: float) -> float:
        """Return the change of rate for the next ``span`` [s], [1/s]."""
        left = self._goal - self.rate
        sign = float(np.sign(left))
        # So that the change has died away when the rate is reached.
        wanted = min(RATE_CHANGE, float(np.sqrt(2.0 * self._jerk * abs(left))))
        wanted = min(wanted, abs(left) / span)
        present = max(sign * self.rate_change, 0.0)
        wanted = min(wanted, present + self._jerk * span)
        rates = [self.rate, self.rate + sign * wanted * span]
        if rates[0] * rates[1] < 0.0:
            rates.append(0.0)
        # Both the show times and the squared rates of the period lie between these,
        # even where less change is left in the end.
        ways = [0.0, *(rate * span for rate in rates)]
        when = self.time + min(ways), self.time + max(ways)
        if when[0] < self._course.first or when[1] > self._course.last:
            self._course = _Course(self._motion, when[0] - AHEAD, when[1] + AHEAD)
        return sign * self._course.room(self._authority, when, rates, sign * wanted)


@dataclass(frozen=True, slots=True, eq=False)
class Stops:
    """How long the clock takes to rest, by the show time at which the stop begins."""

    times: FloatArray
    """Show times, shape (n,) [s]."""
    durations: FloatArray
    """Time until the fleet stands, shape (n,) [s]."""
    rests: FloatArray
    """Show time at which it stands, shape (n,) [s]."""
    authority: Authority
    """Accelerations that are kept."""
    changes: tuple[tuple[float, ...], ...]
    """Of the clock's rate, in each period of each stop [1/s]."""

    @property
    def longest(self) -> float:
        """Longest time from a moment of the table until the fleet stands [s]."""
        return float(self.durations.max())

    @property
    def sure(self) -> float:
        """Longest time from any instant at all [s].

        A stop between two moments of the table may wait for the later one.
        """
        step = np.diff(self.times, prepend=self.times[0])
        return float((self.durations + step).max())


def authority_within(show: Show) -> Authority:
    """Return the accelerations that a show's limits allow in every direction at once.

    Where the script limits no acceleration, half the weight is kept for falling; what
    the tilt makes of the other half is left sideways, and what the greatest thrust then
    leaves, upwards.
    """
    limits, gravity = show.limits, show.vehicle.gravity
    down = limits.acceleration_down or 0.5 * gravity
    level = limits.acceleration or (gravity - down) * float(np.tan(limits.tilt))
    most = min(limits.thrust_max, show.vehicle.thrust_max) / show.vehicle.mass
    up = (
        limits.acceleration_up or float(np.sqrt(max(most**2 - level**2, 0.0))) - gravity
    )
    return Authority(level, max(up, 0.0), down)


def stops(motion: Motion, authority: Authority, step: float) -> Stops:
    """Stop a fleet's clock from every ``step`` [s] of a show, proved each time.

    Parameters
    ----------
    motion
        What the fleet flies over the whole show.
    authority
        What the vehicles follow.
    step
        Time between the moments at which stops begin [s].
    """
    end = float(motion.end.max())
    times = np.arange(float(motion.start.min()), end, step)
    durations, rests = np.zeros((2, times.size))
    fastest = motion.fastest
    changes = []
    for number, time in enumerate(times.tolist()):
        clock = SharedClock(motion, authority, time, fastest)
        clock.run()
        clock.stop()
        taken = clock.changes(-np.inf, end)
        durations[number] = PERIOD * len(taken)
        rests[number] = min(clock.time, end)
        changes.append(taken)
    return Stops(times, durations, rests, authority, tuple(changes))


def time_to_rest(row: pb.AbortRow, period: float) -> float:
    """Return how long the clock of a logged ``row`` takes to rest [s].

    Back along the plan it runs on after that.
    """
    rates = 1.0 + period * np.cumsum(row.changes)
    # But for the rounding of the sum.
    rested = np.flatnonzero(rates < 1e-9)
    return period * float(rested[0] + 1 if rested.size else rates.size)
