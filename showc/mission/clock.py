"""The clock that missions wait for: UTC, or the minute and second of any hour."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from math import floor

from showc.errors import ExportError, UsageError
from showc.script.rules.missions import HOUR

ANY = -1.0
"""An hour that is left open."""

SAME = 1e-6
"""Instants that are nearer are one [s]: missions count milliseconds."""


@dataclass(frozen=True, slots=True)
class Slot:
    """An instant of the clock: what ``NAV_DELAY`` waits for, and a rest after it."""

    hour: float
    """0 to 23, or ``ANY``."""
    minute: float
    """0 to 59."""
    second: float
    """0 to 59, whole: autopilots wait for no part of a second."""
    part: float
    """What is waited for after it, below one second, in whole milliseconds [s]."""


@dataclass(frozen=True, slots=True)
class MissionClock:
    """When the missions of a fleet begin.

    ArduPilot's ``NAV_DELAY`` waits for hour, minute and second, or with the hour left
    open for the next time that minute and second come round
    (``AP_RTC::get_time_utc``).
    """

    start: datetime | None
    """UTC of mission time 0, a whole second; None: any hour."""
    minute: int
    """Minute of mission time 0 where the hour is open."""

    @classmethod
    def of(cls, start: datetime | None, minute: int) -> MissionClock:
        """Return the clock of missions that begin at ``start``, or any full ``minute``.

        Raises
        ------
        UsageError
            If ``start`` has no time zone or is no whole second.
        """
        if start is None:
            return cls(None, minute)
        if start.tzinfo is None:
            raise UsageError(
                f"start {start.isoformat()} has no time zone; write UTC, for instance "
                "2026-06-01T20:00:00Z"
            )
        if start.microsecond:
            raise UsageError(
                f"start {start.isoformat()} is no whole second; a clock slot is"
            )
        return cls(start.astimezone(UTC), minute)

    @property
    def kind(self) -> str:
        """``UTC`` or ``hour``: what a slot names."""
        return "hour" if self.start is None else "UTC"

    def slot(self, release: float) -> Slot:
        """Return the slot at ``release``, mission time [s]."""
        whole = floor(release + SAME)
        part = round(release - whole, 3)
        if self.start is None:
            minutes, second = divmod(60 * self.minute + whole, 60)
            return Slot(ANY, float(minutes % 60), float(second), part)
        moment = self.start + timedelta(seconds=whole)
        return Slot(
            float(moment.hour), float(moment.minute), float(moment.second), part
        )

    def check_span(self, last: float) -> None:
        """Refuse missions whose slots would come round again while they are flown.

        ``last`` [s] is the mission time of the last one.

        Raises
        ------
        ExportError
            With the time, and what to do.
        """
        if self.start is None and last >= HOUR:
            raise ExportError(
                f"the last leg begins {last / 60.0:.0f} min after the start, and "
                "slots of minute and second come round within the hour; give the "
                "date and hour with --start"
            )

    def text(self, time: float) -> str:
        """Name mission time ``time`` [s], rounded down to a second, for people."""
        if self.start is None:
            seconds = (60 * self.minute + floor(time)) % int(HOUR)
            return f"{seconds // 60:02d}:{seconds % 60:02d} past the hour"
        return f"{self.start + timedelta(seconds=floor(time)):%H:%M:%S} UTC"
