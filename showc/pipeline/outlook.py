"""The outlook: what a compile would solve, and between which bounds, before solving."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.options import SolveOptions
    from showc.plan.itinerary import Itinerary, Leg
    from showc.script.show import Show
    from showc.vehicle import Limits


_STILL = 1e-9


@dataclass(frozen=True, slots=True)
class LegOutlook:
    """What is known of a leg before it is solved."""

    index: int
    name: str
    solve: bool
    """Whether a compile would have to solve it."""
    reason: str
    """Why, or why not."""
    lower: float
    """The leg cannot take less (a bound on the slowest drone's axes) [s]."""
    upper: float
    """A straight flight of all drones side by side takes this long [s]."""

    def to_json(self) -> dict[str, Any]:
        """Return the same as plain data."""
        return asdict(self)


def outlook(itinerary: Itinerary, options: SolveOptions) -> list[LegOutlook]:
    """Look at every leg of a show: bounds on its time, and whether it is cached."""
    from showc.fleet.execution.cache import Cache, leg_key  # noqa: PLC0415

    cache = Cache.of(options)
    return [
        _look(
            leg,
            itinerary.show,
            cache.find(leg_key(leg, itinerary.show, options), leg) is not None,
        )
        for leg in itinerary.legs
    ]


def _look(leg: Leg, show: Show, cached: bool) -> LegOutlook:  # noqa: FBT001
    way = np.linalg.norm(leg.goal - leg.start, axis=1)
    if not (way > _STILL).any():
        duration = leg.duration or 0.0
        return LegOutlook(
            leg.index, leg.name, False, "hold: nothing to solve", duration, duration
        )
    lower = _axis_bound(leg.goal - leg.start, leg.limits)
    upper = _straight_time(leg, show)
    reason = (
        "solved before, under the same rules"
        if cached
        else f"not in the cache: {int((way > _STILL).sum())} drones move, "
        f"{way.max():.1f} m at most"
    )
    return LegOutlook(leg.index, leg.name, not cached, reason, lower, upper)


def _axis_bound(displacement: FloatArray, limits: Limits) -> float:
    """No drone moves along an axis faster than its greatest velocity there [s]."""
    velocity = np.where(
        displacement > 0.0, limits.velocity_max, np.abs(limits.velocity_min)
    )
    return float((np.abs(displacement) / velocity).max())


def _straight_time(leg: Leg, show: Show) -> float:
    from showc.fleet.leg import aircraft_of  # noqa: PLC0415 - heavy
    from showc.fleet.shared_profile.synchronise import (  # noqa: PLC0415 - same
        shared_profile,
    )
    from showc.fleet.single_drone.vertical import (  # noqa: PLC0415 - same
        quickest_ascent,
    )

    if leg.kind in {"launch", "land"}:
        heights = (leg.goal - leg.start)[:, 2]
        return quickest_ascent(aircraft_of(show, leg), heights).duration
    profile = shared_profile(
        show.vehicle, leg.limits, show.heading, leg.start, leg.goal
    )
    return max(profile.duration, leg.duration or 0.0)
