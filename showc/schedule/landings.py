"""Landings while others still fly: whether drones may sink one by one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.following import time_followed
from showc.autopilot.timing import CLOCK_LAG
from showc.schedule.distances import part_distance

if TYPE_CHECKING:
    from showc.autopilot.stage import Stage
    from showc.schedule.surroundings import Surroundings
    from showc.schedule.timeline import ScheduledLeg


def landings_meet(
    leg: ScheduledLeg, land: Stage, pause: float, around: Surroundings
) -> bool:
    """Tell whether drones that sink may come too near to what others have still to fly.

    Parameters
    ----------
    leg
        The last leg, to above the pads.
    land
        The landing of the whole fleet, straight down from its ends.
    pause
        For how long each drone hovers before it sinks [s].
    around
        How near drones may come, and how surely legs are flown on time.
    """
    timing, separation = around.timing, around.separation
    sinks = np.full(land.drones.size, np.inf)
    spreads = [timing.spread(stage.profile.speed) for _, stage in leg.flown]
    ends = []
    for (release, stage), spread in zip(leg.flown, spreads, strict=True):
        own = release + stage.wait
        early, late = (
            own + time_followed(stage.level, stage.profile.duration + by)
            for by in (-spread, spread)
        )
        # All clocks are late alike, but for how late that is.
        sinks[stage.drones] = early + pause - CLOCK_LAG
        ends.append(late + CLOCK_LAG)
    last = max(float(late.max(initial=-np.inf)) for late in ends)
    for drone in np.flatnonzero(sinks < last).tolist():
        foot, pad = land.begin[drone], land.end[drone]
        for (release, stage), spread, over in zip(
            leg.flown, spreads, ends, strict=True
        ):
            left = np.flatnonzero((over > sinks[drone]) & (stage.drones != drone))
            flown = stage.covered(sinks[drone] - CLOCK_LAG - spread - release)[left]
            way = stage.end[left] - stage.begin[left]
            rest = stage.begin[left] + flown[:, None] * way
            sinking = np.broadcast_to(foot, way.shape), np.broadcast_to(pad, way.shape)
            gap = part_distance((rest, stage.farthest[left]), sinking, separation)
            if gap.min(initial=np.inf) < around.required:
                return True
    return False
