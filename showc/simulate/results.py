"""What simulated flights of a show in wind gave, and its form on disk."""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

from showc.log.schema import WIND_NAME

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.log.reader import LoggedShow

CONFIDENCE = 0.95
"""With which a tube is said to hold: the usual level of tests."""
WANTED = 0.999
"""Share of flights that a tube is to hold: with that confidence of 2995 flights the
greatest error does, for 0.999^2995 is just below 0.05."""
LEAN = 0.785
"""Greatest roll and pitch that controllers ask for [rad]: 45 degrees, what autopilots
are usually allowed. Plans have less, and leave the rest to the wind."""
WHOLE = "whole show"
"""Name of the last tube."""


@dataclass(frozen=True, slots=True)
class Weather:
    """Wind and gusts of a campaign."""

    wind: float
    """Mean wind, of a direction drawn for each run [m/s]."""
    gusts: str
    """``none``, ``light``, ``moderate`` or ``severe``, for the wind; there are none in
    still air."""
    runs: int
    """How often the show is flown."""
    seed: int = 0
    """Of the first run; the others follow."""


@dataclass(frozen=True, slots=True)
class Tube:
    """How far drones stray over a part of the show."""

    name: str
    """Of the leg."""
    start: float
    """Show time [s]."""
    greatest: float
    """Greatest error of any drone in any run [m]."""
    radius: float
    """Radius that holds the share of flights [m]."""
    share: float
    """Share of flights that the radius holds, with the confidence of 95 %."""
    rms: float
    """Root of the mean squared error [m]."""
    closest: float
    """Least distance of two drones in any run, looked at every 0.1 s [m]; infinite
    for one drone."""
    saturated: float
    """Share of commands that rotors could not follow."""
    used: float
    """Greatest share of a limit that any drone took; above 1: beyond it."""


@dataclass(frozen=True, slots=True)
class Campaign:
    """What a campaign found; of the model, not of an aircraft."""

    weather: Weather
    tubes: tuple[Tube, ...]
    """By leg; the last is the whole show."""
    controller: str
    """``flatness`` or ``predictive``."""
    observer: bool
    """Whether it has a disturbance observer."""

    @classmethod
    def of(cls, logged: LoggedShow) -> Campaign | None:
        """Return what was simulated of a log, and added to it; None if nothing was."""
        try:
            found = cls.from_json(json.loads(logged.added.get(WIND_NAME, b"")))
        except (LookupError, TypeError, ValueError, OverflowError, RecursionError):
            return None
        return found if found.tubes else None

    @property
    def whole(self) -> Tube:
        """The tube of the whole show."""
        return self.tubes[-1]

    def to_json(self) -> dict[str, Any]:
        """Return the campaign as JSON-able data; lengths in m, times in s."""
        return {
            "wind": self.weather.wind,
            "gusts": self.weather.gusts,
            "runs": self.weather.runs,
            "seed": self.weather.seed,
            "controller": self.controller,
            "observer": self.observer,
            "confidence": CONFIDENCE,
            "legs": [
                {
                    "name": tube.name,
                    "start": round(tube.start, 3),
                    "greatest": round(tube.greatest, 4),
                    "radius": round(tube.radius, 4),
                    "share": round(tube.share, 5),
                    "rms": round(tube.rms, 4),
                    "closest": round(tube.closest, 4)
                    if isfinite(tube.closest)
                    else None,
                    "saturated": round(tube.saturated, 6),
                    "used": round(tube.used, 4),
                }
                for tube in self.tubes
            ],
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Campaign:
        """Return the campaign that :meth:`to_json` gave.

        Raises
        ------
        KeyError, TypeError, ValueError
            If it gave something else.
        """
        return cls(
            Weather(
                float(content["wind"]),
                str(content["gusts"]),
                int(content["runs"]),
                int(content["seed"]),
            ),
            tuple(
                Tube(
                    str(leg["name"]),
                    float(leg["start"]),
                    float(leg["greatest"]),
                    float(leg["radius"]),
                    float(leg["share"]),
                    float(leg["rms"]),
                    inf if leg["closest"] is None else float(leg["closest"]),
                    float(leg["saturated"]),
                    float(leg["used"]),
                )
                for leg in content["legs"]
            ),
            str(content["controller"]),
            bool(content["observer"]),
        )
