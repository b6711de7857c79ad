"""The case: volumes of a show on its site, distances that are left, findings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.safety.codes import codes
from showc.safety.ground import area

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray
    from showc.safety.energy import Energy
    from showc.safety.failure import Failures
    from showc.safety.pieces import Place
    from showc.safety.stop import Stops
    from showc.safety.volumes import Buffers, Flying
    from showc.script.show import Show


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is missing."""

    code: str
    """``SAF`` and three digits."""
    severity: str
    """``error`` or ``warning``."""
    message: str
    """What is wrong: the value against what is wanted."""
    missing: float
    """Metres, or other units as the message says, that are missing."""
    place: Place | None = None
    """The drone and the second that decide; None: no one drone."""

    @property
    def title(self) -> str:
        """What is found, in a few words."""
        return codes()[self.code].title


@dataclass(frozen=True, slots=True)
class Distance:
    """A distance that is left, proved for every instant."""

    name: str
    """Between what."""
    left: float
    """At least so much is left; negative: it overlaps [m]."""
    wanted: float
    """[m]."""
    place: Place
    """The drone and the second that decide."""


@dataclass(frozen=True, slots=True, eq=False)
class Volume:
    """A volume over a convex polygon."""

    name: str
    """As authorities call it."""
    corners: FloatArray
    """Shape (n, 2), show frame [m]."""
    top: float
    """Height of its upper side [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class SafetyCase:
    """What is known of a show on its site."""

    show: Show
    """As the script in the log asks for it."""
    buffers: Buffers
    """By the LBA's formulas."""
    flying: Flying
    """What they were taken from."""
    geography: FloatArray
    """Hull of the flight, as a convex polygon, (n, 2) [m]."""
    contingency: FloatArray
    """With the contingency's width, (n, 2) [m]."""
    one_to_one: FloatArray
    """With the 1:1 buffer, (n, 2) [m]."""
    ballistic: FloatArray
    """With the ballistic buffer, (n, 2) [m]."""
    footprint: FloatArray
    """Hull of all places where a drone may hit the ground, (n, 2) [m]."""
    distances: tuple[Distance, ...]
    """What is left to what stands around."""
    impact_speed: float
    """Greatest speed of an impact [m/s]."""
    leans: tuple[float, float]
    """Tilt that the greatest wind takes of a drone that stands, and of the fastest
    against it; by the greatest drag area, an estimate [rad]."""
    energy: Energy
    """How the batteries empty."""
    failures: Failures
    """Which drones may be met by one that falls."""
    stops: Stops
    """How long the fleet takes to stand still, by the moment of the stop."""
    findings: tuple[Finding, ...]

    @property
    def volumes(self) -> tuple[Volume, ...]:
        """Every volume, from the innermost; those on the ground have no height."""
        ground = self.show.site.risk.ground
        high, higher = self.flying.height + ground, self.buffers.height + ground
        return (
            Volume("Flight geography", self.geography, high),
            Volume("Contingency volume", self.contingency, higher),
            Volume("Impact footprint", self.footprint, ground),
            Volume("Ground risk buffer, ballistic", self.ballistic, ground),
            Volume("Ground risk buffer, 1:1", self.one_to_one, ground),
        )

    @property
    def impact_energy(self) -> float:
        """Greatest energy of an impact [J]."""
        return 0.5 * self.show.vehicle.mass * self.impact_speed**2

    @property
    def fence(self) -> FloatArray:
        """Corners of the fence; of the volume's walls where there is none (n, 2)."""
        return fence_of(self.show)

    @property
    def errors(self) -> tuple[Finding, ...]:
        """The findings with which a show should not fly."""
        return tuple(item for item in self.findings if item.severity == "error")

    def to_json(self) -> dict[str, Any]:
        """Return the case as data that JSON can be written of; drones count from 1."""
        lowest = float(self.energy.voltage.min())
        return {
            "name": self.show.name,
            "findings": [
                {
                    "code": item.code,
                    "severity": item.severity,
                    "message": item.message,
                    "missing": round(item.missing, 3),
                    **_said(item.place),
                }
                for item in self.findings
            ],
            "distances": [
                {
                    "name": item.name,
                    "left": round(item.left, 3),
                    "wanted": round(item.wanted, 3),
                    **_said(item.place),
                }
                for item in self.distances
            ],
            "contingency_width": round(self.buffers.contingency, 3),
            "contingency_height": round(self.buffers.height, 3),
            "one_to_one": round(self.buffers.one_to_one, 3),
            "ballistic": round(self.buffers.ballistic, 3),
            "impact_speed": round(self.impact_speed, 2),
            "impact_energy": round(self.impact_energy, 1),
            "lean_standing": round(self.leans[0], 4),
            "lean_flying": round(self.leans[1], 4),
            "energy": {
                "charge_used": round(float(self.energy.used.max()), 4),
                "charge_of_abort": round(self.energy.abort, 4),
                "charge_allowed": round(self.show.battery.allowed, 4),
                "most_energy": round(float(self.energy.energy.max()), 1),
                # None where the battery cannot give the power at any voltage.
                "lowest_voltage": None if np.isnan(lowest) else round(lowest, 3),
                "hover_endurance": self.energy.hover_endurance,
            },
            "failures": {
                "share": round(self.failures.share, 4),
                "falls": _Falls(self.failures),
            },
            "stops": {
                "times": self.stops.times.tolist(),
                "durations": np.round(self.stops.durations, 3).tolist(),
                "from_any_instant": round(self.stops.sure, 3),
            },
            "volumes": [
                {
                    "name": volume.name,
                    "top": round(volume.top, 2),
                    "area": round(area(volume.corners), 1),
                    "corners": np.round(volume.corners, 2).tolist(),
                }
                for volume in self.volumes
            ],
        }


class _Falls(list[dict[str, Any]]):
    """Falls in which others may be met, each made when it is written.

    Of a thousand drones they are more than memory should hold. A list, for that is what
    the JSON encoder goes through one by one.
    """

    def __init__(self, failures: Failures) -> None:
        super().__init__()
        self._failures = failures

    def __len__(self) -> int:
        return int(np.count_nonzero(self._failures.met))

    def __iter__(self) -> Iterator[dict[str, Any]]:
        for (step, drone), others in self._failures.meetings():
            yield {
                "time": float(self._failures.times[step]),
                "drone": drone + 1,
                "may_meet": [other + 1 for other in others],
            }


def _said(place: Place | None) -> dict[str, Any]:
    if place is None:
        return {}
    return {"drone": place.drone + 1, "time": round(place.time, 2)}


def fence_of(show: Show) -> FloatArray:
    """Return the corners of the fence, or of the volume's walls (n, 2) [m]."""
    if show.site.fence is not None:
        return show.site.fence
    low, high = show.site.volume_min, show.site.volume_max
    return np.array(
        [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]]
    )
