"""The optimal control problem of one drone on one leg.

Unknown functions: position, velocity, roll and pitch with their rates, and yaw with
its rate when it is free; thrust and angular accelerations, linear on each interval,
as inputs. Where jerk is limited, thrust is a state, and its rate, constant on each
interval, the input. The torques follow from these exactly (rates are polynomials, so
are the gyroscopic terms); with yaw held, yaw, its rate and U4 drop out: psi = heading,
r = 0, U4 = -(Ix - Iy) p q.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from showc.vehicle import STANDARD_GRAVITY, Limits, Quadrotor, Vector
from showc.vehicle.jerk import jerk_square, lean_factor

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.ocp.problem import Phase, Problem


Yaw = Literal["held", "free"]
Bounds = dict[tuple[str, str], tuple[float, float]]

POSITION = ("x", "y", "z")
ENDS = ("start", "goal")
TORQUES = ("torque_x", "torque_y", "torque_z")
SIGNALS = ("reference_x", "reference_y", "reference_z")

ROOM = 2e-3
"""Between the points at which a program's velocities follow its thrust, what is flown
goes beyond a limit of acceleration by up to so much of it."""
SPEED_ROOM = 0.1
"""The same for the level speed, over that for accelerations."""
UNREACHED = 1e3
"""Stands for a vertical acceleration without a limit [m/s²]: no aircraft reaches it."""
EXACT_GYROSCOPIC = 0.02
"""Share of a torque limit above which gyroscopic torques are bounded exactly, not by
their greatest value."""


@dataclass(frozen=True, slots=True)
class Scales:
    """What the quantities of a flight are divided by, to be near one.

    Those of a program that serves many moves are constants: its answers are the same
    whichever move it was built for.
    """

    length: float = 10.0
    """Of positions [m]; this and its derivatives are what shows fly."""
    speed: float = 5.0
    acceleration: float = 5.0
    jerk: float = 15.0
    angle: float = 0.35
    """Of attitudes [rad]; this and its derivatives are the usual limits."""
    rate: float = 1.7
    angular_acceleration: float = 20.0

    def raised(self, length: float, duration: float) -> Scales:
        """Return greater ones for a move [m] that is quicker than usual [s].

        It speeds up for half of the time and slows down for the other half; each
        derivative changes its sign within a quarter of that of the one before.
        """
        acceleration = 4.0 * length / duration**2
        angle = atan(acceleration / STANDARD_GRAVITY)
        per_time = 8.0 / duration
        return replace(
            self,
            acceleration=max(self.acceleration, acceleration),
            jerk=max(self.jerk, per_time * acceleration),
            angle=max(self.angle, angle),
            rate=max(self.rate, per_time * angle),
            angular_acceleration=max(self.angular_acceleration, per_time**2 * angle),
        )


USUAL_SCALES = Scales()
"""Those of programs that serve many moves."""


@dataclass(frozen=True, slots=True)
class Aircraft:
    """What flies, what it keeps, and how its yaw behaves."""

    vehicle: Quadrotor
    limits: Limits
    """State and control limits of the leg, the flight volume among them."""
    yaw: Yaw = "held"
    heading: float = 0.0
    """Yaw at both hovers, and throughout when held [rad]."""
    room: float = ROOM
    """Share of the limits of acceleration that a program leaves unused."""

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
    def exact_torques(self) -> bool:
        """Whether gyroscopic torques are large enough to be followed in time.

        Small ones are covered by their greatest value, which saves rows.
        """
        return any(
            share > EXACT_GYROSCOPIC * limit
            for share, limit in zip(
                self.gyroscopic_torque, self.limits.torque_max, strict=True
            )
        )

    def canonical(self) -> Aircraft:
        """Return the same aircraft with limits that stand for all of its kind.

        Limits enter a built program as bounds only, given anew for each solve; only
        whether torques are followed exactly changes its form.
        """
        # Torques beyond all need, or next to none: either way the same question of
        # exactness is answered as for the true limits.
        torque = 1e-12 if self.exact_torques else 1e9
        limits = Limits(
            velocity_min=(-1.0, -1.0, -1.0),
            velocity_max=(1.0, 1.0, 1.0),
            # The bound on jerk with yaw free is made with the tilt.
            tilt=self.limits.tilt if self.limits.jerk and self.yaw == "free" else 1.0,
            body_rate=(1.0, 1.0, 1.0),
            thrust_min=0.0,
            thrust_max=1.0,
            torque_max=(torque, torque, torque),
            position_min=(-1.0, -1.0, -1.0),
            position_max=(1.0, 1.0, 1.0),
            level_speed=1.0 if self.limits.rounds_speed else 0.0,
            acceleration=1.0 if self.limits.acceleration else 0.0,
            acceleration_up=1.0 if self._vertical else 0.0,
            jerk=1.0 if self.limits.jerk else 0.0,
        )
        return replace(self, limits=limits, room=ROOM)

    @property
    def _vertical(self) -> bool:
        """Whether vertical acceleration is limited, upward or downward."""
        return bool(self.limits.acceleration_up or self.limits.acceleration_down)

    def end(self, place: FloatArray) -> FloatArray:
        """State and thrust (13,) of an end of a flight.

        Parameters
        ----------
        place
            A place (3,) [m] to hover at, or a state and thrust (13,) as they are.

        Returns
        -------
        ndarray, shape (13,)
            The 12 states and the thrust [N], 0 where it may be any: where jerk is
            limited, a hover has its own.
        """
        hover = self.vehicle.hover_thrust if self.limits.jerk else 0.0
        state, thrust = place[:-1], place[-1]
        if place.size == len(POSITION):
            state, thrust = self.vehicle.hover_state(place, self.heading), 0.0
        return np.append(state, thrust or hover)

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


_AT_REST = [3, 4, 5, 6, 7, 9, 10, 11]
"""States that are zero at a hover: all but position and yaw."""


def in_motion(end: FloatArray) -> bool:
    """Whether an end of a flight, a place (3,) or a state (13,), is no hover."""
    return end.size > len(POSITION) and bool(end[_AT_REST].any())


def _axes(aircraft: Aircraft) -> tuple[tuple[str, str, str, int], ...]:
    """Angle, rate, angular acceleration and axis of each rotation that moves."""
    axes = (("roll", "p", "p_dot", 0), ("pitch", "q", "q_dot", 1))
    return axes if aircraft.yaw == "held" else (*axes, ("yaw", "r", "r_dot", 2))


def input_names(aircraft: Aircraft) -> tuple[str, ...]:
    """Names of the inputs: thrust or its rate, then angular accelerations."""
    first = "thrust_rate" if aircraft.limits.jerk else "thrust"
    return (first, *(axis[2] for axis in _axes(aircraft)))


def state_names(aircraft: Aircraft) -> tuple[str, ...]:
    """Names of the states in the order of the problem."""
    angles = tuple(axis[0] for axis in _axes(aircraft))
    rates = tuple(axis[1] for axis in _axes(aircraft))
    thrust = ("thrust",) if aircraft.limits.jerk else ()
    return (*POSITION, "vx", "vy", "vz", *angles, *rates, *thrust)


def limit_bounds(aircraft: Aircraft) -> Bounds:
    """Bounds of all states, inputs and path constraints of one drone.

    Keys are as ``CondensedTranscription.solve`` takes them.
    """
    limits = aircraft.limits
    bounds: Bounds = {}
    for k, axis in enumerate(POSITION):
        bounds["bounds", axis] = limits.position_min[k], limits.position_max[k]
        bounds["bounds", f"v{axis}"] = limits.velocity_min[k], limits.velocity_max[k]
    for angle, rate, _, number in _axes(aircraft):
        reach = limits.tilt if number < 2 else np.pi
        middle = aircraft.heading if number == 2 else 0.0
        bounds["bounds", angle] = middle - reach, middle + reach
        bounds["bounds", rate] = -limits.body_rate[number], limits.body_rate[number]
    bounds["bounds", "thrust"] = limits.thrust_min, limits.thrust_max
    exact = aircraft.exact_torques
    gyroscopic = np.array(aircraft.gyroscopic_torque)
    spare = np.zeros(3) if exact else gyroscopic
    for _, _, acceleration, k in _axes(aircraft):
        # Small gyroscopic torques are set aside; large ones can help as well.
        room = limits.torque_max[k] + (gyroscopic[k] if exact else -spare[k])
        most = room / aircraft.torque_per_acceleration[k]
        bounds["bounds", acceleration] = -most, most
    if exact:
        for k, name in enumerate(TORQUES):
            bounds["path", name] = -limits.torque_max[k], limits.torque_max[k]
    margin = np.abs(aircraft.vehicle.rotor_fractions()[:, 1:]) @ spare
    for rotor in range(4):
        share = float(margin[rotor])
        bounds["path", f"rotor_{rotor + 1}"] = share, 1.0 - share
    bounds |= _optional_bounds(aircraft)
    return bounds


def _optional_bounds(aircraft: Aircraft) -> Bounds:
    """Bounds of path constraints that are there only where a limit is given."""
    limits = aircraft.limits
    bounds: Bounds = {}
    if limits.acceleration:
        most = (1.0 - aircraft.room) * limits.acceleration
        bounds["path", "acceleration"] = -np.inf, most**2
    if limits.acceleration_up or limits.acceleration_down:
        bounds["path", "vertical_acceleration"] = (
            -(1.0 - aircraft.room) * (limits.acceleration_down or UNREACHED),
            (1.0 - aircraft.room) * (limits.acceleration_up or UNREACHED),
        )
    if limits.jerk:
        most = (1.0 - aircraft.room) * aircraft.vehicle.mass * limits.jerk
        bounds["path", "jerk"] = -np.inf, most**2
    if limits.rounds_speed:
        most = (1.0 - SPEED_ROOM * aircraft.room) * limits.level_speed
        bounds["path", "level_speed"] = -np.inf, most**2
    return bounds


def add_drone(
    phase: Phase, problem: Problem, aircraft: Aircraft, scales: Scales = USUAL_SCALES
) -> None:
    """Add states, inputs, dynamics and limits of one drone to a phase.

    The states at its start and goal are the parameters ``start_x`` ... ``goal_q``,
    hovers unless they are given.
    """
    import casadi  # noqa: PLC0415 - checking a script must not load it

    from showc.vehicle.motion import thrust_direction  # noqa: PLC0415

    vehicle, axes = aircraft.vehicle, _axes(aircraft)
    bounds = limit_bounds(aircraft)

    def state(name: str, scale: float, hover: float = 0.0) -> Any:  # noqa: ANN401
        start, end = (problem.parameter(f"{which}_{name}", hover) for which in ENDS)
        lower, upper = bounds["bounds", name]
        return phase.state(name, lower, upper, start=start, end=end, scale=scale)

    position = [state(axis, scales.length) for axis in POSITION]
    velocity = [state(f"v{axis}", scales.speed) for axis in POSITION]
    angles = {}
    for name, _, _, axis in axes:
        level = aircraft.heading if axis == 2 else 0.0
        angles[name] = state(name, scales.angle, level)
    rates = [state(rate, scales.rate) for _, rate, _, _ in axes]
    hover = vehicle.hover_thrust
    if aircraft.limits.jerk:
        thrust = state("thrust", hover, hover)
        scale = vehicle.mass * scales.jerk
        lean = lean_factor(aircraft.limits.tilt, aircraft.yaw)
        change = phase.control("thrust_rate", degree=0, scale=scale)
        phase.derivative(thrust, change)
        phase.constrain(
            jerk_square(thrust, change, rates, lean),
            *bounds["path", "jerk"],
            name="jerk",
            scale=scale**2,
        )
    else:
        lower, upper = bounds["bounds", "thrust"]
        thrust = phase.control("thrust", lower, upper, degree=1, scale=hover)
    accelerations = [
        phase.control(
            name,
            *bounds["bounds", name],
            degree=1,
            scale=scales.angular_acceleration,
        )
        for _, _, name, _ in axes
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
    _limit_torques(phase, aircraft, scales)
    for name, moved in (
        ("acceleration", velocity[:2]),
        ("vertical_acceleration", velocity[2:]),
    ):
        if pair := bounds.get(("path", name)):
            scale = scales.acceleration ** len(moved)
            phase.constrain_rate(moved, *pair, name=name, scale=scale)
    if pair := bounds.get(("path", "level_speed")):
        squared = velocity[0] ** 2 + velocity[1] ** 2
        phase.constrain(squared, *pair, name="level_speed", scale=scales.speed**2)


def _limit_torques(phase: Phase, aircraft: Aircraft, scales: Scales) -> None:
    """Keep torques and rotor speeds within their limits."""
    from showc.vehicle.motion import torques_for  # noqa: PLC0415

    def symbol(name: str) -> Any:  # noqa: ANN401
        held = aircraft.yaw == "held" and name in {"r", "r_dot"}
        table = phase.controls if name.endswith("dot") else phase.states
        return 0.0 if held else table[name].quantity.symbol

    vehicle = aircraft.vehicle
    bounds = limit_bounds(aircraft)
    rates = symbol("p"), symbol("q"), symbol("r")
    torques = torques_for(
        vehicle,
        rates if aircraft.exact_torques else (0.0, 0.0, 0.0),
        (symbol("p_dot"), symbol("q_dot"), symbol("r_dot")),
    )
    for k, name in enumerate(TORQUES):
        if pair := bounds.get(("path", name)):
            scale = aircraft.torque_per_acceleration[k] * scales.angular_acceleration
            phase.constrain(torques[k], *pair, name=name, scale=scale)
    fractions = vehicle.rotor_fractions()
    thrust = _thrust(phase)
    for rotor in range(4):
        name = f"rotor_{rotor + 1}"
        share = fractions[rotor, 0] * thrust + sum(
            fractions[rotor, 1 + k] * torques[k] for k in range(3)
        )
        phase.constrain(share, *bounds["path", name], name=name, scale=1.0)


def _thrust(phase: Phase) -> Any:  # noqa: ANN401
    """Return the thrust, a state or an input."""
    name = "thrust"
    table = phase.controls if name in phase.controls else phase.states
    return table[name].quantity.symbol


EFFORT_TORQUE = 1.0
"""Weight of squared angular acceleration (over its scale) in the effort."""


def effort(phase: Phase, aircraft: Aircraft) -> Any:  # noqa: ANN401
    """Squared inputs, off hover and scaled: what an effort term integrates."""
    controls, vehicle = phase.controls, aircraft.vehicle
    total = (_thrust(phase) / vehicle.hover_thrust - 1.0) ** 2
    for name in input_names(aircraft)[1:]:
        symbol = controls[f"{name}"].quantity.symbol
        total += EFFORT_TORQUE * (symbol / USUAL_SCALES.angular_acceleration) ** 2
    if rate := controls.get("thrust_rate"):
        total += (rate.quantity.symbol / (vehicle.mass * USUAL_SCALES.jerk)) ** 2
    return total


def single_problem(
    aircraft: Aircraft, *, minimum_time: bool, scales: Scales = USUAL_SCALES
) -> Problem:
    """State the problem of one drone.

    Parameters of the problem: start and goal; ``effort`` and ``nearness``, the weights
    of the squared inputs and of the squared distance to the reference [1/m²]; the
    reference, which varies along the leg, unless ``minimum_time``.
    """
    from showc.ocp.problem import Problem  # noqa: PLC0415

    problem = Problem("drone")
    phase = problem.phase("leg", duration=(0.05, 10_000.0))
    add_drone(phase, problem, aircraft, scales)
    weight = problem.parameter("effort", 1e-3)
    running = weight * effort(phase, aircraft)
    if minimum_time:
        problem.minimise(phase.duration + phase.integral(running))
        return problem
    nearness = problem.parameter("nearness", 0.0)
    reference = [problem.parameter(name) for name in SIGNALS]
    position = [phase.states[axis].quantity.symbol for axis in POSITION]
    distance = sum((a - b) ** 2 for a, b in zip(position, reference, strict=True))
    problem.minimise(phase.integral(running + nearness * distance))
    return problem
