"""A tracking controller: differential flatness with a disturbance observer.

The reference's accelerations, attitudes, rates and torques are fed forward (Mellinger
and Kumar 2011, Minimum snap trajectory generation and control for quadrotors); what the
air adds is estimated by a Luenberger observer on the velocity and taken off.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.simulate.results import LEAN
from showc.vehicle.motion import (
    angular_acceleration,
    thrust_direction,
    torques_for,
)

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.vehicle import Quadrotor


@dataclass(frozen=True, slots=True)
class Gains:
    """Of the loops; the inner ones are several times as fast as the outer."""

    position: float = 3.0
    """[1/s²]."""
    velocity: float = 3.0
    """[1/s]."""
    attitude: float = 8.0
    """[1/s]."""
    rate: float = 16.0
    """[1/s]."""
    observer: float = 3.0
    """Both poles of the observer [1/s]; 0: none."""
    lean: float = LEAN
    """Greatest roll and pitch that are asked for [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """What n drones are to do, at the times of commands."""

    times: FloatArray
    """Shape (commands,) [s]."""
    state: FloatArray
    """Shape (commands, n, 12)."""
    control: FloatArray
    """Shape (commands, n, 4)."""
    acceleration: FloatArray
    """Shape (commands, n, 3) [m/s²]."""


class Observer:
    """Estimates what the air adds to the acceleration of n drones.

    Parameters
    ----------
    pole
        Both poles [1/s]; 0: nothing is estimated.
    velocity
        At the start, shape (n, 3) [m/s].
    """

    def __init__(self, vehicle: Quadrotor, pole: float, velocity: FloatArray) -> None:
        self.vehicle, self.pole = vehicle, pole
        self.disturbance = np.zeros_like(velocity)
        """Shape (n, 3) [m/s²]."""
        self._velocity = velocity.copy()

    def learn(self, estimate: FloatArray, control: FloatArray, step: float) -> None:
        """Take estimates (n, 12), and controls (n, 4) flown for a ``step`` [s]."""
        if not self.pole:
            return
        axis = np.stack(
            thrust_direction(estimate[:, 6], estimate[:, 7], estimate[:, 8]), axis=1
        )
        own = control[:, :1] / self.vehicle.mass * axis
        own[:, 2] -= self.vehicle.gravity
        gap = estimate[:, 3:6] - self._velocity
        self._velocity += step * (own + self.disturbance + 2.0 * self.pole * gap)
        self.disturbance += step * self.pole**2 * gap


class Tracker:
    """Controls n drones along their course, ``step`` [s] between two commands.

    The course of each is flown ``flights`` times side by side: all drones of the first
    flight, then those of the next.
    """

    def __init__(
        self,
        vehicle: Quadrotor,
        course: Course,
        step: float,
        gains: Gains,
        flights: int = 1,
    ) -> None:
        self.vehicle, self.gains, self.course, self.step = vehicle, gains, course, step
        self._tiles = flights, 1
        velocity = np.tile(course.state[0, :, 3:6], self._tiles)
        self.observer = Observer(vehicle, gains.observer, velocity)

    def command(self, estimate: FloatArray, number: int) -> FloatArray:
        """Return the controls U1..U4, (n, 4), for estimated states (n, 12).

        ``number`` is that of the command, counting from 0.
        """
        gains, vehicle, course = self.gains, self.vehicle, self.course
        state, control, planned_push = (
            np.tile(part[number], self._tiles)
            for part in (course.state, course.control, course.acceleration)
        )
        push = (
            planned_push
            + gains.position * (state[:, :3] - estimate[:, :3])
            + gains.velocity * (state[:, 3:6] - estimate[:, 3:6])
            - self.observer.disturbance
        )
        push[:, 2] += vehicle.gravity
        push[:, 2] = np.maximum(push[:, 2], 0.2 * vehicle.gravity)
        axis = np.stack(
            thrust_direction(estimate[:, 6], estimate[:, 7], estimate[:, 8]), axis=1
        )
        thrust = vehicle.mass * np.sum(push * axis, axis=1)
        # Thrust points where the drone has its nose: while rotors are at their limits,
        # the yaw is let go (see `Plant.allotted`).
        yaw = estimate[:, 8]
        unit = push / np.linalg.norm(push, axis=1)[:, None]
        roll = np.arcsin(unit[:, 0] * np.sin(yaw) - unit[:, 1] * np.cos(yaw))
        ahead = unit[:, 0] * np.cos(yaw) + unit[:, 1] * np.sin(yaw)
        pitch = np.arctan2(ahead, unit[:, 2])
        missing = np.stack(
            [
                np.clip(roll, -gains.lean, gains.lean) - estimate[:, 6],
                np.clip(pitch, -gains.lean, gains.lean) - estimate[:, 7],
                (state[:, 8] - yaw + np.pi) % (2.0 * np.pi) - np.pi,
            ],
            axis=1,
        )
        rates = body_rates(estimate[:, 6:9], state[:, 9:12] + gains.attitude * missing)
        turning = gains.rate * (rates - estimate[:, 9:12])
        planned = angular_acceleration(
            vehicle, _columns(state[:, 9:12]), _columns(control[:, 1:4])
        )
        torques = torques_for(
            vehicle,
            _columns(estimate[:, 9:12]),
            _columns(turning + np.stack(planned, axis=1)),
        )
        return np.stack([thrust, *torques], axis=1)

    def observe(self, estimate: FloatArray, control: FloatArray) -> None:
        """Learn what the air adds from estimates (n, 12) and controls flown (n, 4)."""
        self.observer.learn(estimate, control, self.step)


def body_rates(attitude: FloatArray, change: FloatArray) -> FloatArray:
    """Return the body rates (n, 3) that change roll, pitch and yaw as wanted [rad/s].

    The inverse of the kinematics of :mod:`showc.simulate.plant`.

    Parameters
    ----------
    attitude
        Roll, pitch and yaw, shape (n, 3) [rad].
    change
        Their wanted rates, shape (n, 3) [rad/s].
    """
    roll, pitch, _ = attitude.T
    rolling, pitching, yawing = change.T
    across = yawing * np.cos(pitch)
    return np.stack(
        [
            rolling - yawing * np.sin(pitch),
            pitching * np.cos(roll) + across * np.sin(roll),
            across * np.cos(roll) - pitching * np.sin(roll),
        ],
        axis=1,
    )


def _columns(rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return rows[:, 0], rows[:, 1], rows[:, 2]
