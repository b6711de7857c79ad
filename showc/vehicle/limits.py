"""What a flight must keep: limits of the vehicle's state and control, separation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

Vector = tuple[float, float, float]

SeparationShape = Literal["sphere", "ellipsoid", "any-axis", "all-axes"]


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds on state and control that hold at every instant (show frame, SI)."""

    velocity_min: Vector
    """Least velocity per axis [m/s]; negative; the third is the fastest descent."""
    velocity_max: Vector
    """Greatest velocity per axis [m/s]; the third is the fastest climb."""
    tilt: float
    """Greatest |roll| and |pitch| [rad]."""
    body_rate: Vector
    """Greatest |p|, |q|, |r| [rad/s]."""
    thrust_min: float
    """Least total thrust [N]."""
    thrust_max: float
    """Greatest total thrust [N]."""
    torque_max: Vector
    """Greatest |U2|, |U3|, |U4| [N m]."""
    position_min: Vector
    """Lower corner of the flight volume [m]."""
    position_max: Vector
    """Upper corner of the flight volume [m]."""
    level_speed: float = 0.0
    """Greatest level speed, sqrt(vx² + vy²) [m/s]; 0: no limit."""
    acceleration: float = 0.0
    """Greatest level acceleration, sqrt(ax² + ay²) [m/s²]; 0: no limit."""
    acceleration_up: float = 0.0
    """Greatest az [m/s²]; 0: no limit."""
    acceleration_down: float = 0.0
    """Greatest -az [m/s²]; 0: no limit."""
    jerk: float = 0.0
    """Greatest length of the acceleration's rate [m/s³]; 0: no limit. Then thrust may
    jump; else it is continuous, and that of the hover at both ends of a leg."""

    @property
    def limits_acceleration(self) -> bool:
        """Whether any acceleration is limited."""
        return bool(self.acceleration or self.acceleration_up or self.acceleration_down)

    @property
    def rounds_speed(self) -> bool:
        """Whether the limit of level speed cuts corners off the box of velocities."""
        x, y = (
            max(-self.velocity_min[axis], self.velocity_max[axis]) for axis in (0, 1)
        )
        return 0.0 < self.level_speed < math.hypot(x, y)

    def upright(self, speed: float) -> Limits:
        """Return the limits of a vertical flight of at most ``speed`` [m/s].

        No tilt is left, so x and y are held.
        """
        return replace(
            self,
            velocity_min=(*self.velocity_min[:2], max(self.velocity_min[2], -speed)),
            velocity_max=(*self.velocity_max[:2], min(self.velocity_max[2], speed)),
            tilt=0.0,
        )


@dataclass(frozen=True, slots=True)
class Envelope:
    """What an autopilot was seen to follow on an airframe, and with which gains."""

    level_speed: float
    """Greatest level speed, sqrt(vx² + vy²) [m/s]."""
    acceleration: float
    """Greatest level acceleration, sqrt(ax² + ay²) [m/s²]."""
    acceleration_up: float
    """Greatest upward acceleration [m/s²]."""
    acceleration_down: float
    """Greatest downward acceleration [m/s²]."""
    airframe: str
    """What it was flown with, and how near to the trajectory."""
    parameters: tuple[tuple[str, float], ...]
    """Parameters of the autopilot that it was flown with: names and values."""

    def within(self, limits: Limits) -> Limits:
        """Return ``limits``, tightened to what the autopilot follows."""

        def tighter(own: float, most: float) -> float:
            return min(own or most, most)

        return replace(
            limits,
            level_speed=tighter(limits.level_speed, self.level_speed),
            acceleration=tighter(limits.acceleration, self.acceleration),
            acceleration_up=tighter(limits.acceleration_up, self.acceleration_up),
            acceleration_down=tighter(limits.acceleration_down, self.acceleration_down),
        )


@dataclass(frozen=True, slots=True)
class Separation:
    """How far two drones stay apart, at every instant.

    For a pair at difference (dx, dy, dz), with d the ``distance``:

    - ``sphere``: sqrt(dx² + dy² + dz²) >= d
    - ``ellipsoid``: sqrt(dx² + dy² + (dz / vertical_stretch)²) >= d (downwash)
    - ``any-axis``: max(|dx|, |dy|, |dz|) >= d
    - ``all-axes``: min(|dx|, |dy|, |dz|) >= d, as the literature sometimes prints it;
      no formation with two drones on one line or level can keep it
    """

    distance: float
    """The separation d [m]."""
    shape: SeparationShape = "sphere"
    """Which of the four forms holds."""
    vertical_stretch: float = 1.0
    """Stretch of the ellipsoid along z; 1 makes it a sphere."""

    @property
    def metric_scale(self) -> Vector:
        """Factors on (dx, dy, dz) that turn the ellipsoid into the sphere."""
        if self.shape == "ellipsoid":
            return 1.0, 1.0, 1.0 / self.vertical_stretch
        return 1.0, 1.0, 1.0
