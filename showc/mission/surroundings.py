"""Where all drones are while a leg is looked at, and how they move in a stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.mission.geodesy import POSITION_RESOLUTION
from showc.mission.law import LegProfile
from showc.mission.separation import TOLERANCE, Motion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.mission.stage import Stage
    from showc.mission.timing import Timing
    from showc.script.show import Site
    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """Where all drones are while one leg is looked at, and what must hold."""

    positions: FloatArray
    """Where everyone is before the leg, shape (drones, 3), on the grid [m]."""
    separation: Separation
    """What every pair keeps."""
    site: Site
    """Whose volume and fence they keep."""
    timing: Timing
    """How surely legs are flown on time."""
    pause: float = 0.0
    """Least time between the latest end of a stage and the next release [s]."""

    @property
    def required(self) -> float:
        """Least distance that a proof must show [m].

        Places that are as near as the separation allows can be nearer by the
        resolution of the mission's numbers; a proof may fall short of the truth by its
        tolerance.
        """
        return self.separation.distance - POSITION_RESOLUTION - TOLERANCE


def stage_motion(
    stage: Stage, positions: FloatArray, timing: Timing, start: float = 0.0
) -> Motion:
    """Return the motion of the whole fleet while ``stage`` is flown.

    ``positions`` (drones, 3) is where everyone is before it, ``start`` the time of its
    release [s]. Drones that it leaves out rest.
    """
    count = positions.shape[0]
    begin, end = positions.copy(), positions.copy()
    begin[stage.drones], end[stage.drones] = stage.begin, stage.end
    rank = np.full(count, len(stage.profile), dtype=np.int64)
    rank[stage.drones] = np.arange(stage.drones.size)
    spread = timing.spread(stage.profile.speed)
    # At no time in particular, there is no last instant.
    last = stage.finish(spread) if np.isfinite(spread).all() else np.inf
    beyond = stage.overshoot if timing.overshoots else np.zeros(stage.drones.size)
    return Motion(
        begin,
        end,
        with_rest(stage.profile).select(rank),
        start + np.append(stage.wait, 0.0)[rank],
        np.append(stage.level, 0.0)[rank],
        np.append(spread, timing.spread(np.zeros(1)))[rank],
        np.append(beyond, 0.0)[rank],
        (start - float(spread.max(initial=0.0)), start + last),
    )


def with_rest(profile: LegProfile) -> LegProfile:
    """Return the legs of ``profile`` and behind them one of length 0."""
    return LegProfile(
        *(
            np.append(getattr(profile, name), 0.0)
            for name in profile.__dataclass_fields__
        )
    )
