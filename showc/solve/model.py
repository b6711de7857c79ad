"""The optimal control problem of one drone on one leg.

Unknown functions: position, velocity, roll and pitch with their rates, and yaw with
its rate when it is free; thrust and angular accelerations, linear on each interval,
as inputs. The torques follow from these exactly (rates are polynomials, so are the
gyroscopic terms); with yaw held, yaw, its rate and U4 drop out:
psi = heading, r = 0, U4 = -(Ix - Iy) p q.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from showc.vehicle import Limits, Quadrotor, Vector

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.ocp.problem import Phase, Problem

    FloatArray = NDArray[np.float64]

Yaw = Literal["held", "free"]

POSITION = ("x", "y", "z")
SIGNALS = ("reference_x", "reference_y", "reference_z")
HALF_SPACES = "half_spaces"

LENGTH_SCALE = 10.0
ANGULAR_ACCELERATION_SCALE = 20.0
EXACT_GYROSCOPIC = 0.02
"""Share of a torque limit above which gyroscopic torques are bounded exactly, not by
their greatest value."""


@dataclass(frozen=True, slots=True)
class Aircraft:
    """What flies, what it keeps, and how its yaw behaves."""

    vehicle: Quadrotor
    limits: Limits
    """State and control limits of the leg, the flight volume among them."""
    yaw: Yaw = "held"
    heading: float = 0.0
    """Yaw at both hovers, and throughout when held [rad]."""

    @property
    def gyroscopic_torque(self) -> Vector:
        """Greatest |(Iy - Iz) q r| / k, |(Iz - Ix) p r| / k and |(Ix - Iy) p q| [N m].

        With k the vehicle's ``torque_factor``, and r = 0 when yaw is held.
        """
        ix, iy, iz = self.vehicle.inertia
        p, q, r = self.limits.body_rate
        factor = self.vehicle.torque_factor
        r = 0.0 if self.yaw == "held" else r
        return (
            abs(iy - iz) * q * r / factor,
            abs(iz - ix) * p * r / factor,
            abs(ix - iy) * p * q,
        )

    @property
    def torque_per_acceleration(self) -> Vector:
        """Torques U2, U3, U4 for a unit of angular acceleration [N m s²/rad]."""
        ix, iy, iz = self.vehicle.inertia
        factor = self.vehicle.torque_factor
        return ix / factor, iy / factor, iz

    @property
    def acceleration_limits(self) -> Vector:
        """Greatest angular accelerations that always keep the torque limits [rad/s²]."""
        return tuple(  # type: ignore[return-value]
            max(limit - gyroscopic, 0.0) / inertia
            for limit, gyroscopic, inertia in zip(
                self.limits.torque_max,
                self.gyroscopic_torque,
                self.torque_per_acceleration,
                strict=True,
            )
        )

    def conflict(self) -> str:
        """Say why these limits allow no hover at all; empty when they do."""
        hover = self.vehicle.hover_thrust
        limits = self.limits
        if not limits.thrust_min <= hover <= limits.thrust_max:
            return (
                f"hovering takes {hover:.3g} N of thrust; the limits allow "
                f"{limits.thrust_min:.3g} to {limits.thrust_max:.3g} N"
            )
        if hover > self.vehicle.thrust_max:
            return (
                f"hovering takes {hover:.3g} N of thrust; the rotors give at most "
                f"{self.vehicle.thrust_max:.3g} N"
            )
        return ""


def _axes(aircraft: Aircraft) -> tuple[tuple[str, str, str, int], ...]:
    """Angle, rate, angular acceleration and axis of each rotation that moves."""
    axes = (("roll", "p", "p_dot", 0), ("pitch", "q", "q_dot", 1))
    return axes if aircraft.yaw == "held" else (*axes, ("yaw", "r", "r_dot", 2))


def input_names(aircraft: Aircraft) -> tuple[str, ...]:
    """Names of the inputs: thrust, then angular accelerations."""
    return ("thrust", *(axis[2] for axis in _axes(aircraft)))


def state_names(aircraft: Aircraft) -> tuple[str, ...]:
    """Names of the states in the order of the problem."""
    angles = tuple(axis[0] for axis in _axes(aircraft))
    rates = tuple(axis[1] for axis in _axes(aircraft))
    return (*POSITION, "vx", "vy", "vz", *angles, *rates)


def add_drone(
    phase: Phase, problem: Problem, aircraft: Aircraft, tag: str = ""
) -> None:
    """Add states, inputs, dynamics and limits of one drone to a phase.

    Its start and goal are the parameters ``start_x`` ... ``goal_z``. ``tag`` is added
    to every name, for several drones in one problem.
    """
    import casadi  # noqa: PLC0415 - checking a script must not load it

    from showc.vehicle.motion import thrust_direction  # noqa: PLC0415

    vehicle, limits = aircraft.vehicle, aircraft.limits
    axes = _axes(aircraft)
    starts = [problem.parameter(f"start_{axis}{tag}") for axis in POSITION]
    goals = [problem.parameter(f"goal_{axis}{tag}") for axis in POSITION]
    position = [
        phase.state(
            f"{axis}{tag}",
            limits.position_min[k],
            limits.position_max[k],
            start=starts[k],
            end=goals[k],
            scale=LENGTH_SCALE,
        )
        for k, axis in enumerate(POSITION)
    ]
    velocity = [
        phase.state(
            f"v{axis}{tag}",
            limits.velocity_min[k],
            limits.velocity_max[k],
            start=0.0,
            end=0.0,
            scale=max(-limits.velocity_min[k], limits.velocity_max[k]),
        )
        for k, axis in enumerate(POSITION)
    ]
    angles = {}
    for name, _, _, axis in axes:
        bound = limits.tilt if axis < 2 else np.pi
        hover = aircraft.heading if axis == 2 else 0.0
        angles[name] = phase.state(
            f"{name}{tag}",
            hover - bound,
            hover + bound,
            start=hover,
            end=hover,
            scale=min(bound, 1.0),
        )
    rates = [
        phase.state(
            f"{rate}{tag}",
            -limits.body_rate[axis],
            limits.body_rate[axis],
            start=0.0,
            end=0.0,
            scale=limits.body_rate[axis],
        )
        for _, rate, _, axis in axes
    ]
    thrust = phase.control(
        f"thrust{tag}",
        limits.thrust_min,
        limits.thrust_max,
        degree=1,
        scale=vehicle.hover_thrust,
    )
    accelerations = [
        phase.control(
            f"{acceleration}{tag}", degree=1, scale=ANGULAR_ACCELERATION_SCALE
        )
        for _, _, acceleration, _ in axes
    ]
    for place, speed in zip(position, velocity, strict=True):
        phase.derivative(place, speed)
    direction = thrust_direction(
        angles["roll"],
        angles["pitch"],
        angles.get("yaw", aircraft.heading),
        sin=casadi.sin,
        cos=casadi.cos,
    )
    for axis, speed in enumerate(velocity):
        weight = vehicle.gravity if axis == 2 else 0.0
        phase.derivative(speed, thrust * (direction[axis] / vehicle.mass) - weight)
    for (name, _, _, _), rate, acceleration in zip(
        axes, rates, accelerations, strict=True
    ):
        phase.derivative(angles[name], rate)
        phase.derivative(rate, acceleration)
    _limit_torques(phase, aircraft, thrust, rates, accelerations, tag)


def _limit_torques(
    phase: Phase,
    aircraft: Aircraft,
    thrust: object,
    rates: list,  # type: ignore[type-arg]
    accelerations: list,  # type: ignore[type-arg]
    tag: str,
) -> None:
    """Keep torques and rotor speeds within their limits."""
    from showc.vehicle.motion import torques_for  # noqa: PLC0415

    vehicle, limits = aircraft.vehicle, aircraft.limits
    gyroscopic = aircraft.gyroscopic_torque
    exact = any(
        share > EXACT_GYROSCOPIC * limit
        for share, limit in zip(gyroscopic, limits.torque_max, strict=True)
    )
    held = aircraft.yaw == "held"
    yaw_rate, yaw_acceleration = (0.0, 0.0) if held else (rates[2], accelerations[2])
    moving = (rates[0], rates[1], yaw_rate)
    turning = (accelerations[0], accelerations[1], yaw_acceleration)
    torques: list = list(  # type: ignore[type-arg]
        torques_for(vehicle, moving if exact else (0.0, 0.0, 0.0), turning)
    )
    spare = np.zeros(3) if exact else np.array(gyroscopic)
    for k, name in enumerate(("torque_x", "torque_y", "torque_z")):
        if k == 2 and held and not exact:
            continue
        room = limits.torque_max[k] - spare[k]
        scale = aircraft.torque_per_acceleration[k] * ANGULAR_ACCELERATION_SCALE
        phase.constrain(
            torques[k], -room, room, name=f"{name}{tag}", scale=min(scale, room)
        )
    fractions = vehicle.rotor_fractions()
    margin = np.abs(fractions[:, 1:]) @ spare
    for rotor in range(4):
        share = fractions[rotor, 0] * thrust + sum(
            fractions[rotor, 1 + k] * torques[k] for k in range(3)
        )
        phase.constrain(
            share,
            margin[rotor],
            1.0 - margin[rotor],
            name=f"rotor_{rotor + 1}{tag}",
            scale=1.0,
        )


EFFORT_TORQUE = 1.0
"""Weight of squared angular acceleration (over its scale) in the effort."""


def effort(phase: Phase, aircraft: Aircraft, tag: str = "") -> object:
    """Squared inputs, off hover and scaled: what an effort term integrates."""
    controls = phase.controls
    thrust = controls[f"thrust{tag}"].quantity.symbol
    total = (thrust / aircraft.vehicle.hover_thrust - 1.0) ** 2
    for name in input_names(aircraft)[1:]:
        symbol = controls[f"{name}{tag}"].quantity.symbol
        total += EFFORT_TORQUE * (symbol / ANGULAR_ACCELERATION_SCALE) ** 2
    return total


def single_problem(
    aircraft: Aircraft, *, minimum_time: bool, half_spaces: int = 0
) -> Problem:
    """State the problem of one drone.

    Parameters of the problem: start and goal; ``effort`` and ``nearness``, the weights
    of the squared inputs and of the squared distance to the reference [1/m²]; the
    reference, which varies along the leg, unless ``minimum_time``.

    Parameters
    ----------
    half_spaces
        Number of half-spaces on the position for each interval.
    """
    from showc.ocp.problem import Problem  # noqa: PLC0415

    problem = Problem("drone")
    phase = problem.phase("leg", duration=(0.05, 10_000.0))
    add_drone(phase, problem, aircraft)
    weight = problem.parameter("effort", 1e-3)
    running = weight * effort(phase, aircraft)
    position = [phase.states[axis].quantity.symbol for axis in POSITION]
    if half_spaces:
        phase.half_space(HALF_SPACES, position, half_spaces)
    if minimum_time:
        problem.minimise(phase.duration + phase.integral(running))
        return problem
    nearness = problem.parameter("nearness", 0.0)
    reference = [problem.parameter(name) for name in SIGNALS]
    distance = sum((a - b) ** 2 for a, b in zip(position, reference, strict=True))
    problem.minimise(phase.integral(running + nearness * distance))
    return problem
