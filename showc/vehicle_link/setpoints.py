"""The solved flight as setpoints: position, velocity and acceleration over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import UsageError
from showc.mission.geodesy import SiteFrame

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from showc.log.reader import LoggedShow
    from showc.trajectory import PiecewisePolynomial

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StreamPlan:
    """What a set of drones flies."""

    drones: tuple[int, ...]
    """Counting from 0."""
    frame: SiteFrame
    """The show frame on the globe."""
    position: tuple[PiecewisePolynomial, ...]
    """Of each drone, over show time, 3 components [m]."""
    velocity: tuple[PiecewisePolynomial, ...]
    """Likewise [m/s]."""
    acceleration: tuple[PiecewisePolynomial, ...]
    """Derivative of the velocity [m/s²]."""
    launch_end: float
    """Show time at which all hover above their pads [s]."""
    duration: float
    """Show time at which the flight ends [s]."""

    def pads(self) -> FloatArray:
        """Return where the drones stand at first, shape (n, 3), show frame [m]."""
        return np.array([path(0.0) for path in self.position])

    def at(self, time: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position, velocity and acceleration at ``time`` [s], each (n, 3)."""
        return (
            np.array([path(time) for path in self.position]),
            np.array([path(time) for path in self.velocity]),
            np.array([path(time) for path in self.acceleration]),
        )


def stream_plan(show: LoggedShow, drones: Sequence[int] | None = None) -> StreamPlan:
    """Return what ``drones`` (counting from 1; None: all) fly in a logged show.

    Raises
    ------
    UsageError
        If a drone is not in the show.
    """
    chosen = range(1, show.drones + 1) if drones is None else sorted(set(drones))
    for drone in chosen:
        if not 1 <= drone <= show.drones:
            raise UsageError(
                f"drone {drone} is not in the show of {show.drones}; drones count "
                "from 1"
            )
    states = [show.trajectory(drone - 1).state for drone in chosen]
    velocity = tuple(state.select([3, 4, 5]) for state in states)
    launches = [
        segment.start + segment.duration
        for segment in show.segments
        if segment.kind == "launch"
    ]
    site = show.rules.site
    return StreamPlan(
        tuple(drone - 1 for drone in chosen),
        SiteFrame(site.latitude, site.longitude, site.altitude, site.heading),
        tuple(state.select([0, 1, 2]) for state in states),
        velocity,
        tuple(speed.derivative() for speed in velocity),
        max(launches, default=0.0),
        show.duration,
    )
