"""Model predictive control: each step the best way ahead, on the core's own stages.

Every 10 ms an optimal control problem is solved for each drone: over a short horizon
squared distance to the reference and effort are least, rotors within their limits.
Speeds, thrust and body rates have those of the show. Roll and pitch have that of all
controllers, for a plan at its greatest tilt leaves none for the wind; so it is with
accelerations, which are the plan's. What gusts and the estimator's errors add to what
was looked ahead is a reserve, and limits of states have a price: there is always a best
way, even from beyond one. Where a plan is faster than the reserve leaves, the reference
is the nearest motion that is not (:func:`followable`).
Intervals are stages of the condensed transcription
(:mod:`showc.ocp.transcription.condensed`), solved by a structured interior-point method
from the solution of the step before. The state from which it looks ahead is the
estimate, carried over the time that commands need to become thrust; what the air adds
is the same observer's as that of the flatness controller, taken for constant.

Yaw is kept by a loop of its own: it moves no drone aside.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.simulate.tracking import Gains, Observer
from showc.vehicle.motion import angular_acceleration, state_derivative, torques_for

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from showc.arrays import FloatArray
    from showc.ocp.solution import Solution
    from showc.ocp.transcription.condensed.transcription import CondensedTranscription
    from showc.simulate.tracking import Course
    from showc.vehicle import Limits, Quadrotor

STATES = ("x", "y", "z", "vx", "vy", "vz", "roll", "pitch", "p", "q")
"""States of the horizon: all but yaw and its rate."""
PLACES = (0, 1, 2, 3, 4, 5, 6, 7, 9, 10)
"""Where they stand among the twelve."""
INPUTS = ("thrust", "p_dot", "q_dot")
"""Constant on each interval: thrust [N] and angular accelerations [rad/s²]."""
SPARE = 0.03
"""Share of each rotor's range that is left to the yaw."""
RESERVE_ANGLE, RESERVE_RATE, RESERVE_SPEED = 0.04, 0.1, 0.2
"""What is left to limits of roll and pitch [rad], body rates [rad/s] and speeds [m/s]:
of speeds four times what estimates err; gusts move the others."""
FASTEST = 60.0
"""Greatest angular acceleration that is asked for [rad/s²]: beyond it rotors that lag
by 30 ms only overshoot."""


@dataclass(frozen=True, slots=True)
class Horizon:
    """How far, and for what, the controller looks ahead."""

    intervals: int = 10
    """Mesh intervals."""
    time: float = 0.8
    """Whole length [s]: a drone turns its thrust aside within 0.2 s."""
    position: float = 100.0
    """Price of squared distance [1/m²]."""
    velocity: float = 5.0
    """Of squared difference of velocity [s²/m²]."""
    rate: float = 0.2
    """Of squared difference of body rates [s²/rad²]."""
    thrust: float = 0.3
    """Of squared difference of thrust over that of hovering."""
    turning: float = 0.003
    """Of squared difference of angular accelerations [s⁴/rad²]."""
    limit: float = 2e5
    """Of squared excess over a limit, as a share of it."""


class Predictor:
    """Controls n drones along a course by looking ahead.

    Parameters
    ----------
    vehicle
        What flies.
    course
        References of all drones at the times of commands.
    late
        Time from an estimate to the thrust that follows from it [s]: delay and lag.
    step
        Time between two commands [s].
    limits
        What is kept, but for the tilt: that is the controllers' own.
    """

    def __init__(
        self,
        vehicle: Quadrotor,
        course: Course,
        late: float,
        step: float,
        *,
        limits: Limits,
        gains: Gains | None = None,
        horizon: Horizon | None = None,
    ) -> None:
        self.vehicle, self.course, self.step = vehicle, course, step
        self.gains, self.horizon = gains or Gains(), horizon or Horizon()
        bound = replace(limits, tilt=self.gains.lean)
        self.observer = Observer(vehicle, self.gains.observer, course.state[0, :, 3:6])
        self._program = program(vehicle, bound, self.horizon)
        self._sent = [course.control[0]] * max(1, round(late / step))
        self._guesses: list[Solution | None] = [None] * course.state.shape[1]
        planned = angular_acceleration(
            vehicle,
            _columns(course.state[:, :, 9:12]),
            _columns(course.control[:, :, 1:4]),
        )
        wanted = course.state[:, :, PLACES].copy()
        wanted[:, :, :6] = followable(wanted[:, :, :6], limits, step)
        self._wanted = np.concatenate(
            [wanted, course.control[:, :, :1]]
            + [one[:, :, None] for one in planned[:2]],
            axis=2,
        )

    def command(self, estimate: FloatArray, number: int) -> FloatArray:
        """Return the controls U1..U4, (n, 4), for estimated states (n, 12).

        ``number`` is that of the command, counting from 0.
        """
        ahead = self._carried(estimate)
        signals = self._signals(number + len(self._sent))
        found = np.empty((estimate.shape[0], 4))
        for drone, state in enumerate(ahead):
            thrust, *turning = self._solved(drone, state, signals[:, drone])
            found[drone, 0] = thrust
            found[drone, 1:] = self._torques(drone, state, turning, number)
            found[drone, 3] = self._left(found[drone])
        self._sent = [*self._sent[1:], found]
        return found

    def observe(self, estimate: FloatArray, control: FloatArray) -> None:
        """Learn what the air adds from estimates (n, 12) and controls flown (n, 4)."""
        self.observer.learn(estimate, control, self.step)

    def _carried(self, estimate: FloatArray) -> FloatArray:
        """Return where the commands that are under way will have brought the drones."""
        state = estimate
        for control in self._sent:
            slope = state_derivative(self.vehicle, state, control)
            slope[:, 3:6] += self.observer.disturbance
            middle = state + 0.5 * self.step * slope
            slope = state_derivative(self.vehicle, middle, control)
            slope[:, 3:6] += self.observer.disturbance
            state = state + self.step * slope
        return state

    def _signals(self, first: int) -> FloatArray:
        """Return the references on each interval, (intervals, n, 13)."""
        count = self.horizon.intervals
        middle = (np.arange(count) + 0.5) * (self.horizon.time / count)
        at = np.rint(first + middle / self.step).astype(np.int64)
        return np.asarray(self._wanted[np.minimum(at, len(self._wanted) - 1)])

    def _solved(
        self, drone: int, state: FloatArray, signals: FloatArray
    ) -> tuple[float, ...]:
        """Return thrust and angular accelerations of the first interval."""
        from showc.ocp.guess import Guess  # noqa: PLC0415 - heavy

        horizon, start = self.horizon, state[list(PLACES)]
        guess = self._guesses[drone] or Guess(
            dict(zip(STATES, start.tolist(), strict=True))
            | {"thrust": self.vehicle.hover_thrust}
        )
        parameters = dict(
            zip((f"start_{name}" for name in STATES), start.tolist(), strict=True)
        )
        parameters["heading"] = float(state[8])
        for axis, push in zip("xyz", self.observer.disturbance[drone], strict=True):
            parameters[f"push_{axis}"] = float(push)
        solution = self._program.solve(
            widths=np.full(horizon.intervals, horizon.time / horizon.intervals),
            guess=guess,
            parameters=parameters,
            signals=signals[:, None],
        )
        inputs = solution.phases[0].controls.coefficients
        if not np.isfinite(inputs).all():
            # The next step starts afresh; this one hovers.
            self._guesses[drone] = None
            return self.vehicle.hover_thrust, 0.0, 0.0
        self._guesses[drone] = solution
        return tuple(inputs[0, 0].tolist())

    def _torques(
        self, drone: int, state: FloatArray, turning: list[float], number: int
    ) -> FloatArray:
        wanted = self.course.state[number, drone]
        gap = (wanted[8] - state[8] + np.pi) % (2.0 * np.pi) - np.pi
        rate = wanted[11] + self.gains.attitude * gap
        yaw = self.gains.rate * (rate - state[11])
        rates = (state[9], state[10], state[11])
        return np.array(torques_for(self.vehicle, rates, (*turning, yaw)))

    def _left(self, control: FloatArray) -> float:
        """Return the yaw torque of a control (4,), as far as rotors have it left."""
        share = self.vehicle.rotor_fractions()
        others = share[:, :3] @ control[:3]
        room = max(0.0, float(np.minimum(others, 1.0 - others).min()))
        most = room / float(np.abs(share[:, 3]).max())
        return float(np.clip(control[3], -most, most))


def followable(state: FloatArray, limits: Limits, step: float) -> FloatArray:
    """Return the nearest motion that leaves a reserve to the limits of speed.

    A plan at its greatest speed cannot be caught up with. With the speed c that is left
    in an axis, x - c t may never grow: of such motions isotonic regression finds that
    with the least sum of squared distances (Barlow et al. 1972, Statistical Inference
    under Order Restrictions). It is ahead of the plan at first, and behind it later.

    Parameters
    ----------
    state
        Positions and velocities, shape (times, n, 6) [m, m/s].
    limits
        Of flight.
    step
        Time between two of them [s].
    """
    from scipy.optimize import isotonic_regression  # noqa: PLC0415 - heavy

    found, time = state.copy(), step * np.arange(len(state))
    for axis, bounds in enumerate(
        zip(limits.velocity_min, limits.velocity_max, strict=True)
    ):
        for sign, bound in zip((-1.0, 1.0), bounds, strict=True):
            drift = (bound - sign * RESERVE_SPEED) * time
            for drone in np.flatnonzero(
                (sign * state[:, :, 3 + axis] > abs(bound) - RESERVE_SPEED).any(axis=0)
            ):
                over = sign * (found[:, drone, axis] - drift)
                kept = isotonic_regression(over, increasing=False).x
                found[:, drone, axis] = sign * kept + drift
                found[:, drone, 3 + axis] = np.gradient(found[:, drone, axis], step)
    return found


def program(
    vehicle: Quadrotor, limits: Limits, horizon: Horizon
) -> CondensedTranscription:
    """State the problem of a horizon within limits, and put it on its mesh."""
    import casadi  # noqa: PLC0415 - the core loads it where something is solved

    from showc.ocp.problem import Problem  # noqa: PLC0415 - as above
    from showc.ocp.transcription.condensed.transcription import (  # noqa: PLC0415
        CondensedOptions,
        CondensedTranscription,
    )
    from showc.ocp.transcription.solver import SolverOptions  # noqa: PLC0415
    from showc.vehicle.motion import thrust_direction  # noqa: PLC0415

    problem = Problem("horizon")
    phase = problem.phase("ahead", duration=(0.01, 100.0))
    scales = dict(zip(STATES, (1.0,) * 6 + (0.35,) * 2 + (2.0,) * 2, strict=True))
    state: dict[str, Any] = {
        name: phase.state(name, start=problem.parameter(f"start_{name}"), scale=scale)
        for name, scale in scales.items()
    }
    most = min(limits.thrust_max, vehicle.thrust_max)
    thrust = phase.control(
        "thrust", limits.thrust_min, most, degree=0, scale=vehicle.hover_thrust
    )
    turning = [
        phase.control(name, -FASTEST, FASTEST, degree=0, scale=20.0)
        for name in INPUTS[1:]
    ]
    direction = thrust_direction(
        state["roll"],
        state["pitch"],
        problem.parameter("heading"),
        sin=casadi.sin,
        cos=casadi.cos,
    )
    for axis, along in zip("xyz", direction, strict=True):
        phase.derivative(state[axis], state[f"v{axis}"])
        weight = vehicle.gravity if axis == "z" else 0.0
        push = thrust * (along / vehicle.mass) + problem.parameter(f"push_{axis}")
        phase.derivative(state[f"v{axis}"], push - weight)
    for angle, rate, change in zip(("roll", "pitch"), "pq", turning, strict=True):
        phase.derivative(state[angle], state[rate])
        phase.derivative(state[rate], change)
    torques = torques_for(vehicle, (0.0, 0.0, 0.0), (*turning, 0.0))
    for number, fractions in enumerate(vehicle.rotor_fractions()):
        share = fractions[0] * thrust + sum(
            float(part) * torque
            for part, torque in zip(fractions[1:3], torques[:2], strict=True)
        )
        phase.constrain(
            share, SPARE, 1.0 - SPARE, name=f"rotor {number + 1}", scale=1.0
        )
    signals = [f"wanted_{name}" for name in (*STATES, *INPUTS)]
    wanted = dict(zip((*STATES, *INPUTS), map(problem.parameter, signals), strict=True))
    costs = dict.fromkeys("xyz", horizon.position)
    costs |= dict.fromkeys(("vx", "vy", "vz"), horizon.velocity)
    costs |= dict.fromkeys("pq", horizon.rate)
    running = sum(
        cost * (state[name] - wanted[name]) ** 2 for name, cost in costs.items()
    )
    off = (thrust - wanted["thrust"]) / vehicle.hover_thrust
    running += horizon.thrust * off**2
    for name, change in zip(INPUTS[1:], turning, strict=True):
        running += horizon.turning * (change - wanted[name]) ** 2
    for value, low, high in _kept(state, limits):
        # Both sides at once: the distance from the middle of what is allowed.
        half = 0.5 * (high - low)
        over = casadi.fmax(casadi.fabs(value - 0.5 * (low + high)) / half - 1.0, 0.0)
        running += horizon.limit * over**2
    problem.minimise(phase.integral(running))
    return CondensedTranscription(
        problem,
        horizon.intervals,
        signals=signals,
        options=CondensedOptions(
            # A few steps from the last solution; what is left, the next step mends.
            SolverOptions("fatrop", tolerance=1e-3, iterations=15, barrier=1e-3),
            points=3,
            cost_points=1,
            inset=0.0,
        ),
    )


def _kept(
    state: Mapping[str, Any], limits: Limits
) -> Iterator[tuple[Any, float, float]]:
    """Each state that has limits, with the least and the greatest value wanted."""
    tilt = limits.tilt - RESERVE_ANGLE
    yield from ((state[name], -tilt, tilt) for name in ("roll", "pitch"))
    for name, most in zip("pq", limits.body_rate, strict=False):
        rate = most - RESERVE_RATE
        yield state[name], -rate, rate
    ranges = zip(limits.velocity_min, limits.velocity_max, strict=True)
    for axis, (low, high) in zip("xyz", ranges, strict=True):
        yield state[f"v{axis}"], low + RESERVE_SPEED, high - RESERVE_SPEED
    if limits.level_speed:
        square = (limits.level_speed - RESERVE_SPEED) ** 2
        yield state["vx"] ** 2 + state["vy"] ** 2, -square, square


def _columns(rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return rows[..., 0], rows[..., 1], rows[..., 2]
