"""The relaxed drone of the lower bound: what it may do at every instant.

Velocity in its box, thrust acceleration in the set U(t) that thrust, tilt, body rates
and angular accelerations allow at time t after one end and T - t before the other: a
superset of what the aircraft can do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray
    from showc.vehicle import Limits, Quadrotor


Push = Literal["along", "round", "across"]
"""Where a drone pushes on its move: along it, or all round, as into and out of a motion
and past others, where fewer directions do."""
Span = tuple["FloatArray", "FloatArray"]
"""Least and greatest value, of one shape."""

_AT_REST, _STILL = [3, 4, 5, 6, 7, 9, 10, 11], 1e-6
"""States that are zero at a hover, and how far off they may be: what a proof allows."""
HOVERS: FloatArray = np.zeros((2, 12))
"""States at the ends of a move from hover to hover; places do not count."""


def hovering(ends: FloatArray) -> BoolArray:
    """Which of the states at both ends (2, 12 or more) are hovers, shape (2,)."""
    return np.asarray(np.abs(ends[:, _AT_REST]).max(axis=1) <= _STILL)


@dataclass(frozen=True, slots=True)
class Relaxation:
    """What the bound lets a drone do: a superset of what it can do."""

    vehicle: Quadrotor
    limits: Limits
    yaw: Literal["held", "free"] = "held"
    heading: float = 0.0
    """Yaw at both hovers [rad]."""

    @property
    def specific_thrust(self) -> tuple[float, float]:
        """Least and greatest thrust over mass [m/s²]."""
        mass = self.vehicle.mass
        most = min(self.limits.thrust_max, self.vehicle.thrust_max)
        return self.limits.thrust_min / mass, most / mass

    @property
    def angular_acceleration(self) -> tuple[float, float]:
        """Greatest |p'| and |q'| [rad/s²], by torque and rotor limits."""
        ix, iy, iz = self.vehicle.inertia
        p, q, r = self.limits.body_rate
        gyroscopic = (abs(iy - iz) / ix * q * r, abs(iz - ix) / iy * p * r)
        torque = [
            min(self.limits.torque_max[axis], self.vehicle.torque_max[axis])
            * self.vehicle.torque_factor
            / self.vehicle.inertia[axis]
            for axis in (0, 1)
        ]
        if self.yaw == "held":
            return torque[0], torque[1]
        return torque[0] + gyroscopic[0], torque[1] + gyroscopic[1]

    def caps(
        self, after: FloatArray, before: FloatArray, ends: FloatArray
    ) -> tuple[Span, Span]:
        """Least and greatest roll and pitch [rad] so long after and before the ends.

        They widen with both times.

        Parameters
        ----------
        after, before
            Times since the start and until the goal, shape (...) [s].
        ends
            States at the start and at the goal, shape (2, 12 or more).
        """
        rate, alpha = self.limits.body_rate, self.angular_acceleration
        found: list[Span] = []
        for axis in (0, 1):
            low = np.full(np.shape(after), -self.limits.tilt)
            high = -low
            for since, end, sign in ((after, ends[0], 1.0), (before, ends[1], -1.0)):
                swing = np.minimum(rate[axis] * since, 0.5 * alpha[axis] * since**2)
                angle, speed = end[6 + axis], sign * end[9 + axis]
                high = np.minimum(high, angle + max(speed, 0.0) * since + swing)
                low = np.maximum(low, angle + min(speed, 0.0) * since - swing)
            found.append((low, high))
        return found[0], found[1]

    def turned(self, vectors: FloatArray) -> FloatArray:
        """Vectors (..., 3) of the show frame in the frame of the heading."""
        if self.yaw == "free":
            return vectors
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0, 0, 1]])
        return np.asarray(vectors @ rotation)

    def thrust_supports(
        self, multiplier: FloatArray, roll: Span, pitch: Span
    ) -> list[FloatArray]:
        """Greatest ``multiplier . u`` over each of the sets that U lies in, (...).

        The first is the cone of thrusts with the given caps. Where accelerations are
        limited, the second is the cone of directions within the cylinder of these
        limits. An integral takes the least of both, cell by cell.

        Parameters
        ----------
        multiplier
            Shape (..., 3), show frame.
        roll, pitch
            Least and greatest roll and pitch, shape (...) [rad], below 90 degrees.
        """
        most_roll, most_pitch = _greatest(roll), _greatest(pitch)
        turned = self.turned(multiplier)
        lx, ly, lz = turned[..., 0], turned[..., 1], turned[..., 2]
        if self.yaw == "free":
            across = np.hypot(lx, ly)
            cone = np.arccos(np.clip(np.cos(most_roll) * np.cos(most_pitch), -1.0, 1.0))
            most = _arc(lz, across, (0.0 * cone, cone))
        else:
            # The thrust leans left by a negative roll.
            most = _arc(_arc(lz, lx, pitch), -ly, roll)
        least_thrust, most_thrust = self.specific_thrust
        found = [np.asarray(np.maximum(most_thrust * most, least_thrust * most))]
        if not self.limits.limits_acceleration:
            return found
        low, high = self.vertical(most_roll, most_pitch)
        radius = min(self.limits.acceleration or most_thrust, most_thrust)
        if self.yaw == "free":
            turned = np.stack([across, np.zeros_like(lz), lz], axis=-1)
            slopes = np.tan(cone), np.zeros_like(lz)
        else:
            # On the side of the multiplier; upright is let be.
            lean = np.maximum(np.where(ly > 0.0, -roll[0], roll[1]), 0.0)
            tip = np.maximum(np.where(lx > 0.0, pitch[1], -pitch[0]), 0.0)
            slopes = np.tan(tip), np.tan(lean) / np.cos(most_pitch)
        found.append(_cut_cone(turned, slopes, radius, (low, high)))
        return found

    def vertical(
        self, roll: FloatArray, pitch: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Least and greatest vertical part of the thrust over mass [m/s²]."""
        limits, gravity = self.limits, self.vehicle.gravity
        least, most = self.specific_thrust
        level = min(limits.acceleration or most, most)
        # What thrust there is at least and does not go level goes up.
        low = np.maximum(
            least * np.cos(roll) * np.cos(pitch),
            math.sqrt(max(least**2 - level**2, 0.0)),
        )
        low = np.maximum(low, gravity - (limits.acceleration_down or np.inf))
        high = min(most, gravity + (limits.acceleration_up or math.inf))
        return low, np.full_like(low, high)

    def velocity_support(self, multiplier: FloatArray) -> FloatArray:
        """Greatest ``multiplier . v`` over the velocities allowed, shape (...)."""
        each = np.maximum(
            multiplier * np.asarray(self.limits.velocity_max),
            multiplier * np.asarray(self.limits.velocity_min),
        )
        box = np.asarray(each.sum(axis=-1))
        if not self.limits.rounds_speed:
            return box
        level = np.hypot(multiplier[..., 0], multiplier[..., 1])
        round_off = self.limits.level_speed * level + each[..., 2]
        return np.asarray(np.minimum(box, round_off))

    def vertices(
        self,
        roll: Span,
        pitch: Span,
        steps: int = 3,
        displacement: FloatArray | None = None,
        *,
        push: Push = "along",
    ) -> FloatArray:
        """Points of U, shape (k, m, 3) [m/s²], whose hull nearly fills U's.

        Parameters
        ----------
        roll, pitch
            Least and greatest roll and pitch, shape (k,) [rad].
        steps
            Angles of each kind that points are taken at without an envelope.
        displacement
            The move, shape (3,) [m]: with an envelope, points lie densest along it.
        push
            Whether drones push along the move, turn on the way or cross another's.
        """
        if self.limits.limits_acceleration:
            way = self.turned(np.zeros(3) if displacement is None else displacement)
            toward = math.atan2(way[1], way[0])
            bearing = toward + np.radians(_BEARINGS[push])
            return self._envelope_vertices(_greatest(roll), _greatest(pitch), bearing)
        least_thrust, most_thrust = self.specific_thrust
        if self.yaw == "free":
            cone = np.cos(_greatest(roll)) * np.cos(_greatest(pitch))
            cone = np.arccos(cone)[:, None]
            turn = 2.0 * np.pi * np.arange(12) / 12
            up = np.array([0.0, 0.0, 1.0])
            rim = np.stack(
                [
                    np.cos(turn) * np.sin(cone),
                    np.sin(turn) * np.sin(cone),
                    np.broadcast_to(np.cos(cone), (cone.size, turn.size)),
                ],
                axis=-1,
            )
            top = np.broadcast_to(up, (cone.size, 1, 3))
            directions = np.concatenate([rim, top], axis=1)
        else:
            grid = np.linspace(-1.0, 1.0, steps)
            phi = _spread(roll, np.tile(grid, steps))
            theta = _spread(pitch, np.repeat(grid, steps))
            directions = np.stack(
                [
                    np.cos(phi) * np.sin(theta),
                    -np.sin(phi),
                    np.cos(phi) * np.cos(theta),
                ],
                axis=-1,
            )
            cosine, sine = math.cos(self.heading), math.sin(self.heading)
            rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
            directions = directions @ rotation.T
        return np.concatenate(
            [most_thrust * directions, least_thrust * directions], axis=1
        )

    def _envelope_vertices(
        self, roll: FloatArray, pitch: FloatArray, bearing: FloatArray
    ) -> FloatArray:
        """Points of U where accelerations are limited, shape (k, m, 3) [m/s²].

        Parameters
        ----------
        bearing
            Directions in which points are taken, shape (b,), in the frame of the
            heading [rad].
        """
        least, most = self.specific_thrust
        low, high = (side[:, None, None] for side in self.vertical(roll, pitch))
        radius = min(self.limits.acceleration or most, most)
        if self.yaw == "free":
            cone = np.arccos(np.cos(roll) * np.cos(pitch))[:, None]
            slope = np.broadcast_to(np.tan(cone), (roll.size, bearing.size))
        else:
            ahead = np.tan(pitch)[:, None] / np.maximum(np.abs(np.cos(bearing)), 1e-12)
            left = np.tan(roll) / np.cos(pitch)
            left = left[:, None] / np.maximum(np.abs(np.sin(bearing)), 1e-12)
            slope = np.minimum(ahead, left)
        slope = slope[..., None]
        # Tilts that bear corners of U: parts of the greatest one, and those at which
        # the greatest level thrust meets the least and the greatest vertical one.
        share = np.broadcast_to(_SHARES, (*slope.shape[:2], _SHARES.size)) * slope
        meeting = np.minimum(
            np.concatenate([radius / high, radius / np.maximum(low, 1e-9)], -1), slope
        )
        tilt = np.arctan(np.concatenate([share, meeting], axis=-1))
        up, level = np.cos(tilt), np.sin(tilt)
        longest = np.minimum(high / up, radius / np.maximum(level, 1e-12))
        longest = np.minimum(longest, most)
        # Where no thrust fits a tilt, the nearest one stands in.
        shortest = np.minimum(np.maximum(low / up, least), longest)
        length = np.stack([longest, shortest], axis=-1)
        x = length * (level * np.cos(bearing)[:, None])[..., None]
        y = length * (level * np.sin(bearing)[:, None])[..., None]
        points = np.stack([x, y, length * up[..., None]], axis=-1)
        points = points.reshape(roll.size, -1, 3)
        if self.yaw == "free":
            return np.asarray(points)
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0, 0, 1]])
        return np.asarray(points @ rotation.T)


_BEARINGS: dict[Push, FloatArray] = {
    "along": np.array([0, 15, -15, 40, -40, 75, -75, 120, -120, 165, -165, 180]),
    "round": np.arange(0.0, 360.0, 15.0),
    "across": np.arange(0.0, 360.0, 45.0),
}
"""Directions about that of the move in which points of U are taken [deg], for each way
to push. What is left out the multipliers suffer from, not the bound."""
_SHARES: FloatArray = np.array([0.0, 0.5, 1.0])
"""Parts of the greatest tilt at which points of U are taken."""


def _cut_cone(
    multiplier: FloatArray,
    slopes: tuple[FloatArray, FloatArray],
    radius: float,
    heights: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Greatest ``multiplier . u`` over a cone within a cylinder, shape (...).

    The set: low <= u_z <= high, u_x <= p u_z, u_y <= q u_z and u_x² + u_y² <= r², x
    and y pointing along the multiplier.
    At height z the greatest level part is that of a rectangle cut by a disc; as a
    function of z it is concave, linear where the corner (p z, q z) counts, constant
    where the disc's own point does, and an ellipse's arc between. So the greatest lies
    at a border of these stretches or where the slope of an arc vanishes.

    Parameters
    ----------
    multiplier
        Shape (..., 3), frame of the heading.
    slopes
        p and q, shape (...), at least 0.
    radius
        r [m/s²].
    heights
        low and high, shape (...) [m/s²], positive.
    """
    x, y = np.abs(multiplier[..., 0]), np.abs(multiplier[..., 1])
    z, (p, q), (low, high) = multiplier[..., 2], slopes, heights
    size, tiny = np.hypot(x, y), 1e-300
    corner = radius / np.maximum(np.hypot(p, q), tiny)
    stretches = [
        low,
        high,
        corner,
        radius * x / np.maximum(size * p, tiny),
        radius * y / np.maximum(size * q, tiny),
    ]
    for own, other, slope in ((x, y, p), (y, x, q)):
        # own slope z + other sqrt(r² - slope² z²) + multiplier_z z is greatest here.
        gain = own * slope + z
        arc = np.hypot(gain, other * slope)
        stretches.append(radius * gain / np.maximum(arc * slope, tiny))
    best = np.full(np.broadcast_shapes(size.shape, p.shape), -np.inf)
    for place in stretches:
        at = np.clip(place, low, high)
        ahead, left = p * at, q * at
        wide = np.minimum(ahead, np.sqrt(np.maximum(radius**2 - left**2, 0.0)))
        deep = np.minimum(left, np.sqrt(np.maximum(radius**2 - ahead**2, 0.0)))
        free_x = radius * x / np.maximum(size, tiny)
        free_y = radius * y / np.maximum(size, tiny)
        disc = (free_x <= ahead) & (free_y <= left)
        level = np.where(
            np.hypot(ahead, left) <= radius,
            x * ahead + y * left,
            np.where(
                disc,
                radius * size,
                np.maximum(
                    x * np.minimum(ahead, radius) + y * deep,
                    x * wide + y * np.minimum(left, radius),
                ),
            ),
        )
        best = np.maximum(best, z * at + level)
    return np.asarray(best)


def _arc(ahead: FloatArray, across: FloatArray, span: Span) -> FloatArray:
    """Greatest ``ahead cos(x) + across sin(x)`` over a span of x within half a turn."""
    best = np.arctan2(across, ahead)
    low, high = (ahead * np.cos(x) + across * np.sin(x) for x in span)
    inside = (span[0] <= best) & (best <= span[1])
    ends = np.maximum(low, high)
    return np.asarray(np.where(inside, np.hypot(ahead, across), ends))


def _greatest(span: Span) -> FloatArray:
    """Greatest size within a span."""
    return np.asarray(np.maximum(-span[0], span[1]))


def _spread(span: Span, shares: FloatArray) -> FloatArray:
    """Values at shares (m,) from -1, the least, to 1, the greatest, (k, m)."""
    low, high = span
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    return np.asarray(middle[:, None] + half[:, None] * shares)
