"""The course of one drone over one leg: everything a drawing of it needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import UsageError
from showc.trajectory import PiecewisePolynomial
from showc.vehicle import Quadrotor
from showc.vehicle.motion import state_derivative
from showc.view.digest import metric_scale

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.flight import Trajectory
    from showc.log import showc_pb2 as pb
    from showc.log.reader import LoggedSegment, LoggedShow


POINTS = 400
"""Points of a curve, about; at least a dozen on each interval."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """States and controls at many times, each by the polynomial of its interval."""

    segment: LoggedSegment
    """The leg."""
    trajectory: Trajectory
    """The exact flight."""
    limits: pb.Limits
    """What holds on the leg."""
    vehicle: Quadrotor
    """What flies."""
    separation: float
    """Least distance between two drones, in the separation's metric [m]."""
    times: FloatArray
    """Since the start of the leg, shape (n,) [s]; both ends of every interval."""
    interval: IntArray
    """Interval of each time, shape (n,)."""
    state: FloatArray
    """Shape (n, 12)."""
    control: FloatArray
    """Shape (n, 4)."""
    distance: FloatArray | None
    """To the nearest other drone of the leg, shape (n,) [m]; None if it is alone."""

    @property
    def breaks(self) -> FloatArray:
        """Borders of the mesh intervals [s]."""
        return self.trajectory.state.breaks

    @property
    def rotors(self) -> FloatArray:
        """Squared rotor speeds over the greatest, shape (n, 4)."""
        return np.asarray(self.control @ self.vehicle.rotor_fractions().T)

    def defects(self) -> FloatArray:
        """Greatest defect of the acceleration on each interval, (K,) [m/s²].

        It is the difference between the derivative of the velocity's polynomial and
        the equations of motion at the polynomials' states and controls.
        """
        slope = self._values(self.trajectory.state.derivative())[:, 3:6]
        wanted = state_derivative(self.vehicle, self.state, self.control)[:, 3:6]
        return self._greatest(np.abs(slope - wanted).max(axis=1))

    def curvature_ratios(self) -> FloatArray:
        """Greatest over mean curvature of the velocity on each interval, (K,).

        Where it is high the solution bends in one place, and more intervals help more
        than a higher degree (Darby, Hager, Rao 2011); 1 where nothing bends.
        """
        bend = self._values(self.trajectory.state.derivative().derivative())[:, 3:6]
        size = np.linalg.norm(bend, axis=1)
        count = np.bincount(self.interval)
        mean = np.bincount(self.interval, weights=size) / count
        greatest = self._greatest(size)
        straight = greatest < 1e-9
        return np.where(straight, 1.0, greatest / np.where(straight, 1.0, mean))

    def _greatest(self, values: FloatArray) -> FloatArray:
        result = np.zeros(self.trajectory.state.intervals)
        np.maximum.at(result, self.interval, values)
        return result

    def _values(self, part: PiecewisePolynomial) -> FloatArray:
        return _evaluate(part, self.times, self.interval)


def course_of(logged: LoggedShow, segment: int, drone: int) -> Course:
    """Evaluate the solution of one drone, counting from 0, over one leg.

    Raises
    ------
    UsageError
        If there is no such leg, or the drone takes no part in it.
    """
    if not 0 <= segment < len(logged.segments):
        raise UsageError(
            f"there is no leg {segment}; the log has legs 0 to "
            f"{len(logged.segments) - 1}"
        )
    chosen = logged.segments[segment]
    position = int(np.searchsorted(chosen.drones, drone))
    if position == chosen.drones.size or chosen.drones[position] != drone:
        raise UsageError(
            f"drone {drone + 1} takes no part in leg {segment} "
            f"({chosen.message.name}); choose another drone or leg"
        )
    trajectory = chosen.trajectory(position)
    breaks = trajectory.state.breaks
    count = max(12, POINTS // (breaks.size - 1))
    share = np.linspace(0.0, 1.0, count)
    times = (breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel()
    interval = np.repeat(np.arange(breaks.size - 1), count)
    return Course(
        segment=chosen,
        trajectory=trajectory,
        limits=logged.rules.limits[chosen.message.limits],
        vehicle=_vehicle(logged.rules.vehicle),
        separation=float(logged.rules.separation.distance),
        times=times,
        interval=interval,
        state=_evaluate(trajectory.state, times, interval),
        control=_evaluate(trajectory.control, times, interval),
        distance=_nearest(logged, chosen, position, times),
    )


def _evaluate(
    part: PiecewisePolynomial, times: FloatArray, interval: IntArray
) -> FloatArray:
    """Values (n, components), each by the polynomial of its own interval."""
    values = np.empty((times.size, part.components))
    for k in range(part.intervals):
        one = slice(k, k + 1)
        piece = PiecewisePolynomial(part.breaks[k : k + 2], part.coefficients[one])
        values[interval == k] = piece(times[interval == k])
    return values


def _vehicle(message: pb.Vehicle) -> Quadrotor:
    inertia = (message.inertia.x, message.inertia.y, message.inertia.z)
    return Quadrotor(
        name=message.name,
        mass=message.mass,
        arm_length=message.arm_length,
        thrust_coefficient=message.thrust_coefficient,
        torque_coefficient=message.torque_coefficient,
        inertia=inertia,
        rotor_speed_max=message.rotor_speed_max,
        torque_arm="included" if message.torque_factor == 1.0 else "multiplied",
        gravity=message.gravity,
    )


def _nearest(
    logged: LoggedShow, segment: LoggedSegment, position: int, times: FloatArray
) -> FloatArray | None:
    """Distance to the nearest other drone of the leg, in the separation's metric."""
    if segment.drones.size < 2:
        return None
    scale = metric_scale(logged.rules.separation)
    own = segment.trajectory(position).state.select([0, 1, 2])(times) * scale
    least = np.full(times.size, np.inf)
    for other in range(segment.drones.size):
        if other != position:
            place = segment.trajectory(other).state.select([0, 1, 2])(times) * scale
            least = np.minimum(least, np.linalg.norm(place - own, axis=1))
    return least
