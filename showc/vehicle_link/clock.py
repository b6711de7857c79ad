"""The clocks of a flight: the wall's, and the one that all its vehicles share."""

from __future__ import annotations

import select
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from showc.vehicle_link.setpoints import NEGLIGIBLE

if TYPE_CHECKING:
    import socket
    from collections.abc import Sequence

    from showc.vehicle_link.setpoints import Authority, Instant, StreamPlan


RATE_CHANGE = 1.0
"""Fastest change of the shared clock's rate [1/s]: to rest in a second and a half."""

RATE_JERK = 2.0
"""Fastest change of that change [1/s²]: a quarter of a second of the ramp each way."""

JERK = 10.0
"""Jerk that a change of rate may add [m/s³]: two thirds of the 15 m/s³ that autopilots
need to follow solved flights."""


class Clock(Protocol):
    """Time, and waiting for datagrams; a rehearsal may bring its own."""

    def now(self) -> float:
        """Return the present time [s]; only differences mean something."""

    def wait(
        self, sockets: Sequence[socket.socket], span: float
    ) -> Sequence[socket.socket]:
        """Wait up to ``span`` [s] for datagrams; return the sockets that have some."""


class WallClock:
    """The wall's clock."""

    def now(self) -> float:
        """Return the time since the machine started [s]."""
        return time.monotonic()

    def wait(
        self, sockets: Sequence[socket.socket], span: float
    ) -> Sequence[socket.socket]:
        """Wait up to ``span`` [s] for datagrams; return the sockets that have some."""
        return select.select(sockets, [], [], max(span, 0.0))[0]


class ShowClock:
    """The show time of a whole fleet, which can be brought to rest and turned back.

    All drones are where the plan has them at one show time s, whatever its rate
    r = ds/dt: every separation that holds along the plan holds. With the plan's
    velocity v and acceleration a at s a drone flies r v and r² a + r' v. The rate
    changes as fast as the vehicles' authority leaves room for r' v with every drone. At
    r' = 0 and r <= 1 the plan's own acceleration is never exceeded, so the clock always
    comes to rest: at the latest where the plan does.

    Parameters
    ----------
    plan
        What the fleet flies.
    authority
        What the vehicles follow.
    start
        Show time at which the clock stands first [s].
    """

    def __init__(self, plan: StreamPlan, authority: Authority, start: float) -> None:
        self.time = start
        self.rate = 0.0
        self.rate_change = 0.0
        self._plan, self._authority = plan, authority
        self._goal = 0.0
        speed = max(plan.greatest_speed, NEGLIGIBLE)
        self._jerk = min(RATE_JERK, JERK / speed)

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
        if (before - self._goal) * (self.rate - self._goal) <= 0.0:
            self.rate = self._goal
        self.time += 0.5 * (before + self.rate) * span

    def hold_at(self, time: float) -> None:
        """Stand still at the show time ``time`` [s], where the plan is at rest."""
        self.time, self.rate, self.rate_change, self._goal = time, 0.0, 0.0, 0.0

    def instant(self) -> Instant:
        """Return where the fleet is to be, and how it is to move, now."""
        return self._plan.at(self.time).scaled(self.rate, self.rate_change)

    def _change(self, span: float) -> float:
        """Return the change of rate for the next ``span`` [s], [1/s]."""
        left = self._goal - self.rate
        sign = np.sign(left)
        # So that the change has died away when the rate is reached.
        wanted = min(RATE_CHANGE, float(np.sqrt(2.0 * self._jerk * abs(left))))
        wanted = min(wanted, abs(left) / span)
        present = max(sign * self.rate_change, 0.0)
        wanted = min(wanted, present + self._jerk * span)
        # What is sent is the end of the period: both of its ends have to fit.
        for ahead in (0.0, span):
            rate = self.rate + sign * wanted * ahead
            instant = self._plan.at(self.time + 0.5 * (self.rate + rate) * ahead)
            room = self._authority.room(
                sign * instant.velocity, rate**2 * instant.acceleration
            )
            wanted = min(wanted, room)
        return float(sign * wanted)


class Rounds:
    """When rounds of setpoints were sent, one to each vehicle.

    Attributes
    ----------
    longest_gap
        Longest time between two rounds [s].
    longest_hold_up
        Longest time between the moment a round is for and its last message [s].
    """

    def __init__(self) -> None:
        self.count = 0
        self.first = self.last = 0.0
        self.longest_gap = self.longest_hold_up = 0.0

    @property
    def rate(self) -> float:
        """Rounds a second [Hz]; 0 before there were two."""
        span = self.last - self.first
        return (self.count - 1) / span if span > 0.0 else 0.0

    def note(self, meant: float, sent: float) -> None:
        """Note a round for the time ``meant`` [s], its last message out at ``sent``."""
        if self.count:
            self.longest_gap = max(self.longest_gap, sent - self.last)
        else:
            self.first = sent
        self.count, self.last = self.count + 1, sent
        self.longest_hold_up = max(self.longest_hold_up, sent - meant)


@dataclass(frozen=True, slots=True)
class _Tick:
    """The show time that setpoints were for at a time."""

    now: float
    show: float


class History:
    """Which show time the fleet was to be at, at a time of the recent past."""

    SPAN = 10.0
    """How long it is remembered [s]: positions arrive within it, or are too old."""

    def __init__(self) -> None:
        self._ticks: list[_Tick] = []

    def note(self, now: float, show: float) -> None:
        """Remember that the fleet is to be at ``show`` at the time ``now`` [s]."""
        self._ticks.append(_Tick(now, show))
        while self._ticks[0].now < now - self.SPAN:
            del self._ticks[0]

    def show_time(self, moment: float) -> float | None:
        """Return the show time at ``moment`` [s]; None: before the first."""
        ticks = self._ticks
        if not ticks or moment < ticks[0].now:
            return None
        for earlier, later in zip(reversed(ticks[:-1]), reversed(ticks), strict=False):
            if earlier.now <= moment:
                if later.now <= earlier.now:
                    return later.show
                part = (moment - earlier.now) / (later.now - earlier.now)
                return earlier.show + part * (later.show - earlier.show)
        return ticks[-1].show
