"""The clocks of a flight: the wall's, and the one that all its vehicles share."""

from __future__ import annotations

import select
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from showc.safety.stop import SharedClock

if TYPE_CHECKING:
    import socket
    from collections.abc import Sequence

    from showc.safety.stop import Authority
    from showc.vehicle_link.setpoints import Instant, StreamPlan


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


class ShowClock(SharedClock):
    """The shared clock of a plan that is flown, and where it has the fleet.

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
        super().__init__(plan.motion, authority, start, plan.greatest_speed)
        self._plan = plan

    def instant(self, ahead: float = 0.0) -> Instant:
        """Return where the fleet is to be, and how it is to move.

        Parameters
        ----------
        ahead
            How long from now [s], with the clock as it goes.
        """
        time = self.time + self.rate * ahead
        return self._plan.at(time).scaled(self.rate, self.rate_change)


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
