"""The clock that a streamed show runs on, and how well its setpoints kept to it."""

from __future__ import annotations

import time
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Clock:
    """Time that may run faster than the wall's, for rehearsals."""

    speed: float = 1.0
    """Seconds of the show for each second of the wall's clock."""

    def now(self) -> float:
        """Return the present time [s]; only differences mean something."""
        return time.monotonic() * self.speed

    def wall(self, span: float) -> float:
        """Return how long ``span`` [s] takes on the wall's clock [s]."""
        return span / self.speed


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
