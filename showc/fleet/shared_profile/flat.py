"""From positions to states and controls, in closed form, for a whole fleet at once.

With yaw held the model is differentially flat (Mellinger and Kumar 2011, Minimum snap
trajectory generation, section III): with u the acceleration plus g e_z, roll, pitch and
thrust follow from u, body rates from u', torques from u''. No optimisation is involved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.flight import Trajectory
from showc.trajectory import (
    PiecewisePolynomial,
    bernstein_basis,
    bernstein_basis_inverse,
    combined,
)
from showc.vehicle.jerk import greatest_jerk

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray
    from showc.vehicle import Limits, Quadrotor


STATE_DEGREE, CONTROL_DEGREE = 7, 12
"""Three derivatives of positions are given at both ends of a piece; rates then have
degree 6, so the torque that balances their product is exact."""
SLACK = 1e-9
"""How far rounding may carry a flight over a limit, of the limit or [SI]."""
JOINT = 1e-7
"""Greatest jump of a state at a joint (SI): a tenth of what the proof allows."""
_HERMITE_NODES: FloatArray = np.array([0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0])
"""Where a cubic is taken: its ends, and the places of its inner coefficients."""

_RAISE: FloatArray = np.array(
    [
        [(j == i) * (1.0 - i / 7.0) + (j == i - 1) * i / 7.0 for j in range(7)]
        for i in range(8)
    ]
)
"""From Bernstein coefficients of degree 6 to those of degree 7."""


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """Attitude that a thrust acceleration asks for; all arrays of one shape."""

    acceleration: FloatArray
    """|u| [m/s²]."""
    roll: tuple[FloatArray, FloatArray, FloatArray]
    """Roll [rad] and its first and second derivative."""
    pitch: tuple[FloatArray, FloatArray, FloatArray]
    """Pitch and its derivatives."""


def attitude(
    thrust: FloatArray, first: FloatArray, second: FloatArray, heading: float
) -> Attitude:
    """Roll, pitch and their derivatives from u and its derivatives.

    Parameters
    ----------
    thrust, first, second
        u, u', u'', shape (..., 3), show frame [m/s²] and per whatever they are
        derived by.
    heading
        Yaw that is held [rad].
    """
    cosine, sine = np.cos(heading), np.sin(heading)

    def turned(vector: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
        return cosine * x + sine * y, cosine * y - sine * x, z

    (x, y, z), (x1, y1, z1), (x2, y2, z2) = map(turned, (thrust, first, second))
    plane = np.hypot(x, z)
    plane_1 = (x * x1 + z * z1) / plane
    plane_2 = (x1**2 + z1**2 + x * x2 + z * z2 - plane_1**2) / plane
    pitch = _angle((x, x1, x2), (z, z1, z2))
    roll = _angle((-y, -y1, -y2), (plane, plane_1, plane_2))
    return Attitude(np.hypot(plane, y), roll, pitch)


def _angle(
    across: tuple[FloatArray, FloatArray, FloatArray],
    along: tuple[FloatArray, FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """atan2(across, along) and its first two derivatives."""
    (a, a1, a2), (b, b1, b2) = across, along
    square = a**2 + b**2
    rate = (a1 * b - a * b1) / square
    change = (a2 * b - a * b2) / square - 2.0 * rate * (a * a1 + b * b1) / square
    return np.arctan2(a, b), rate, change


@dataclass(frozen=True, slots=True, eq=False)
class FlatFlights:
    """Flights of many drones with common interval borders."""

    breaks: FloatArray
    """Shape (K + 1,) [s]."""
    state: FloatArray
    """Bernstein coefficients, shape (n, K, degree + 1, 12)."""
    control: FloatArray
    """Bernstein coefficients, shape (n, K, degree + 1, 4)."""

    def trajectory(self, index: int) -> Trajectory:
        """Return the flight of one of the drones."""
        return Trajectory(
            PiecewisePolynomial(self.breaks, self.state[index]),
            PiecewisePolynomial(self.breaks, self.control[index]),
        )


def fly(
    vehicle: Quadrotor, heading: float, breaks: FloatArray, position: FloatArray
) -> FlatFlights:
    """States and controls of flights along given positions, yaw held.

    Positions and velocities stay the exact polynomials. Roll and pitch are Hermite
    interpolants (value, rate and acceleration at the ends, two values between), rates
    and torques their exact derivatives, the gyroscopic torque included: flown
    open-loop, the torques do not drift away from the attitude. Thrust is interpolated
    at Chebyshev-Lobatto nodes.

    Parameters
    ----------
    breaks
        Shape (K + 1,) [s].
    position
        Bernstein coefficients of degree 4 to 6, shape (n, K, degree + 1, 3) [m], with
        a continuous acceleration; from hover to hover.
    """
    drones, pieces, size, _ = position.shape
    widths = np.diff(breaks)[None, :, None, None]
    curves = [position]
    for degree in range(size - 1, size - 5, -1):
        curves.append(degree * np.diff(curves[-1], axis=2) / widths)
    flat = PiecewisePolynomial(
        np.arange(drones * pieces + 1, dtype=np.float64),
        np.concatenate([position.reshape(-1, size, 3)]),
    )
    speed = PiecewisePolynomial(flat.breaks, curves[1].reshape(-1, size - 1, 3))
    state = np.zeros((drones, pieces, STATE_DEGREE + 1, 12))
    shape = (drones, pieces, STATE_DEGREE + 1, 3)
    state[..., :3] = flat.elevated(STATE_DEGREE).coefficients.reshape(shape)
    state[..., 3:6] = speed.elevated(STATE_DEGREE).coefficients.reshape(shape)
    state[..., 8] = heading

    inner = _attitude_at(vehicle, heading, curves, _HERMITE_NODES)
    angles = np.stack(
        [
            _hermite(_joined(angle, np.diff(breaks)), np.diff(breaks)[None, :, None])
            for angle in (inner.roll, inner.pitch)
        ],
        axis=-1,
    )
    rates = STATE_DEGREE * np.diff(angles, axis=2) / widths
    torques = (STATE_DEGREE - 1) * np.diff(rates, axis=2) / widths
    state[..., 6:8] = angles
    state[..., 9:11] = combined(_RAISE, rates)

    nodes = _lobatto(CONTROL_DEGREE)
    to_control = bernstein_basis_inverse(CONTROL_DEGREE, tuple(nodes)).T
    wanted = _attitude_at(vehicle, heading, curves, nodes)
    ix, iy, _ = vehicle.inertia
    turning = combined(bernstein_basis(STATE_DEGREE - 1, nodes), rates)
    raised = PiecewisePolynomial(flat.breaks, torques.reshape(-1, STATE_DEGREE - 1, 2))
    shape = (drones, pieces, CONTROL_DEGREE + 1, 2)
    about = raised.elevated(CONTROL_DEGREE).coefficients.reshape(shape)
    control = np.stack(
        [
            vehicle.mass * wanted.acceleration @ to_control,
            ix / vehicle.torque_factor * about[..., 0],
            iy / vehicle.torque_factor * about[..., 1],
            # The gyroscopic torque about z is balanced, so that yaw stays still.
            (iy - ix) * (turning[..., 0] * turning[..., 1]) @ to_control,
        ],
        axis=-1,
    )
    return FlatFlights(breaks, state, control)


def _attitude_at(
    vehicle: Quadrotor, heading: float, curves: list[FloatArray], nodes: FloatArray
) -> Attitude:
    """Attitude at ``nodes`` of each interval, arrays of shape (n, K, nodes)."""
    thrust, first, second = (
        combined(bernstein_basis(c.shape[2] - 1, nodes), c) for c in curves[2:]
    )
    thrust[..., 2] += vehicle.gravity
    return attitude(thrust, first, second, heading)


def keeps_limits(vehicle: Quadrotor, limits: Limits, flights: FlatFlights) -> BoolArray:
    """Whether flights keep every limit at every instant, by Bernstein coefficients.

    Returns
    -------
    ndarray of bool, shape (n,)
        False may also mean that the enclosure is too wide; True is certain up to
        rounding (1e-9 of each limit).
    """
    return np.asarray(use_of_limits(vehicle, limits, flights).greatest <= 1.0 + SLACK)


def joined(flights: FlatFlights) -> BoolArray:
    """Whether states are continuous over the joints, shape (n,).

    Rates are second differences of positions: on intervals of a few milliseconds their
    rounding alone can exceed what a joint may jump by.
    """
    jump = np.abs(flights.state[:, 1:, 0] - flights.state[:, :-1, -1])
    return np.asarray(jump.max(axis=(1, 2), initial=0.0) <= JOINT)


@dataclass(frozen=True, slots=True, eq=False)
class Use:
    """Greatest use of limits at any instant, as shares of them, each of shape (n,)."""

    velocity: FloatArray
    tilt: FloatArray
    rate: FloatArray
    power: FloatArray
    """Of the greatest thrust, torques and rotor speeds."""
    acceleration: FloatArray
    """Of level speed, of level and vertical acceleration, and of jerk."""
    outside: BoolArray
    """Whether the flight volume is left."""
    weak: BoolArray
    """Whether thrust or a rotor falls below its least."""

    @property
    def greatest(self) -> FloatArray:
        """At most 1 if all limits are kept; a breach without a share is infinite."""
        share = np.stack(
            [self.velocity, self.tilt, self.rate, self.power, self.acceleration]
        ).max(axis=0)
        return np.asarray(np.where(self.outside | self.weak, np.inf, share))


def use_of_limits(vehicle: Quadrotor, limits: Limits, flights: FlatFlights) -> Use:
    """How much of each limit flights use, bounded by their Bernstein coefficients."""
    state, control = flights.state, flights.control
    lower, upper = state.min(axis=(1, 2)), state.max(axis=(1, 2))
    size = np.maximum(np.abs(lower), np.abs(upper))
    torque = np.abs(control[..., 1:]).max(axis=(1, 2))
    rotors = control @ vehicle.rotor_fractions().T
    velocity = np.maximum(
        lower[:, 3:6] / np.asarray(limits.velocity_min),
        upper[:, 3:6] / np.asarray(limits.velocity_max),
    )
    power = np.column_stack(
        [
            control[..., 0].max(axis=(1, 2)) / limits.thrust_max,
            torque / np.asarray(limits.torque_max),
            rotors.max(axis=(1, 2, 3)),
        ]
    )
    outside = np.any(lower[:, :3] < np.asarray(limits.position_min) - SLACK, axis=1)
    outside |= np.any(upper[:, :3] > np.asarray(limits.position_max) + SLACK, axis=1)
    weak = control[..., 0].min(axis=(1, 2)) < limits.thrust_min - SLACK
    weak |= rotors.min(axis=(1, 2, 3)) < -SLACK
    return Use(
        velocity.max(axis=1),
        size[:, 6:8].max(axis=1) / limits.tilt,
        (size[:, 9:12] / np.asarray(limits.body_rate)).max(axis=1),
        power.max(axis=1),
        _round_use(vehicle, limits, flights),
        outside,
        weak,
    )


def _round_use(vehicle: Quadrotor, limits: Limits, flights: FlatFlights) -> FloatArray:
    """Greatest share of level speed, of accelerations and of jerk, shape (n,)."""
    velocity = flights.state[..., 3:6]
    use = np.zeros(velocity.shape[0])
    if limits.rounds_speed:
        speed = np.hypot(velocity[..., 0], velocity[..., 1]).max(axis=(1, 2))
        use = np.maximum(use, speed / limits.level_speed)
    if limits.jerk:
        jerk = greatest_jerk(
            vehicle, 0.0, flights.breaks, flights.state, flights.control
        )
        use = np.maximum(use, jerk.max(axis=(1, 2)) / limits.jerk)
    if not limits.limits_acceleration:
        return use
    widths = np.diff(flights.breaks)[None, :, None, None]
    rate = (velocity.shape[2] - 1) * np.diff(velocity, axis=2) / widths
    if limits.acceleration:
        level = np.hypot(rate[..., 0], rate[..., 1]).max(axis=(1, 2))
        use = np.maximum(use, level / limits.acceleration)
    if limits.acceleration_up:
        use = np.maximum(use, rate[..., 2].max(axis=(1, 2)) / limits.acceleration_up)
    if limits.acceleration_down:
        use = np.maximum(use, -rate[..., 2].min(axis=(1, 2)) / limits.acceleration_down)
    return use


def _joined(
    angle: tuple[FloatArray, FloatArray, FloatArray], widths: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Give angles and rates (n, K, nodes) one value at each joint.

    It is that of the longer interval. Rates follow from third differences of positions,
    whose rounding on intervals of a few milliseconds is 1e-8 rad/s and more: flown
    open-loop for 10 s, that moves a drone by half a millimetre.
    """
    value, first, second = angle
    longer = (widths[1:] > widths[:-1])[None]
    for some in (value, first):
        joint = np.where(longer, some[:, 1:, 0], some[:, :-1, -1])
        some[:, :-1, -1] = some[:, 1:, 0] = joint
    return value, first, second


def _hermite(
    angle: tuple[FloatArray, FloatArray, FloatArray], widths: FloatArray
) -> FloatArray:
    """Bernstein coefficients (n, K, 8) from values and derivatives at four nodes.

    Derivatives at both ends fix three coefficients on each side; the two in the middle
    follow from the values at the inner nodes.
    """
    value, first, second = angle
    degree = STATE_DEGREE
    result = np.empty((*value.shape[:2], degree + 1))
    for end, sign in ((0, 1.0), (-1, -1.0)):
        order = (0, 1, 2) if end == 0 else (degree, degree - 1, degree - 2)
        step = sign * widths[..., 0] * first[..., end] / degree
        bend = widths[..., 0] ** 2 * second[..., end] / (degree * (degree - 1))
        result[..., order[0]] = value[..., end]
        result[..., order[1]] = value[..., end] + step
        result[..., order[2]] = value[..., end] + 2.0 * step + bend
    basis = bernstein_basis(degree, _HERMITE_NODES[1:3])
    outer = [0, 1, 2, 5, 6, 7]
    rest = value[..., 1:3] - result[..., outer] @ basis[:, outer].T
    result[..., 3:5] = rest @ np.linalg.inv(basis[:, 3:5]).T
    return result


def _lobatto(degree: int) -> FloatArray:
    """Chebyshev-Lobatto nodes on [0, 1], ends included, shape (degree + 1,)."""
    return np.asarray(0.5 * (1.0 - np.cos(np.pi * np.arange(degree + 1) / degree)))
