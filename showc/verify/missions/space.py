"""Whether missions stay in the flight volume and inside the fence.

Drones fly straight lines from place to place, and beyond their ends by the overshoot at
most. A line is a polynomial of degree 1, so that the kernel's proof of the fence holds
for it, concave fences included.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel.fence import RESOLUTION, enclosed
from showc.verify.kernel.show import xyz

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.log.showc_pb2 import Site
    from showc.verify.missions.legs import FleetLegs


ROUNDING = 0.02
"""How far a stored place may be off the one that was meant [m]."""


@dataclass(frozen=True, slots=True)
class Inside:
    """How far inside a boundary the missions stay, less what is asked for."""

    spare: float
    """Negative outside [m]."""
    leg: int
    """On which leg of the fleet."""


def inside_volume(fleet: FleetLegs, site: Site) -> Inside:
    """Return how far inside the volume's walls all places are, overshoot included.

    Where the walls are the fence, lines keep its margin; what is flown beyond their
    ends may use it up.
    """
    low, high = xyz(site.volume_min), xyz(site.volume_max)
    margin = 0.0 if len(site.fence) else site.fence_margin
    inset = np.array([margin, margin, 0.0])
    spare = np.full(fleet.lines.size, np.inf)
    for places, less in ((fleet.begin, inset), (fleet.end, inset), (_beyond(fleet), 0)):
        walls = np.minimum(places - low, high - places) - less
        spare = np.minimum(spare, walls.min(axis=1))
    leg = int(np.argmin(spare))
    return Inside(float(spare[leg]), leg)


def inside_fence(fleet: FleetLegs, site: Site) -> Inside | None:
    """Return how far inside the fence all lines are, its margin taken off.

    None where the site has no fence but the volume's walls; minus infinity where a line
    leaves the fence, or touches it.
    """
    if not len(site.fence):
        return None
    fence = np.array(site.fence).reshape(-1, 2)
    found = []
    for begin, end, margin in (
        (fleet.begin, fleet.end, site.fence_margin),
        (fleet.end, _beyond(fleet), 0.0),
    ):
        lines = np.stack([begin[:, :2], end[:, :2]], axis=1)
        lower, leg = enclosed(lines, fence)
        found.append(Inside(lower - margin if lower >= RESOLUTION else -np.inf, leg))
    return min(found, key=lambda one: one.spare)


def _beyond(fleet: FleetLegs) -> FloatArray:
    """Foremost places (n, 3) of all legs; a landing ends on the ground."""
    excess = fleet.profiles.excess.copy()
    excess[fleet.first[1:] - 1] = 1.0
    return fleet.begin + excess[:, None] * (fleet.end - fleet.begin)
