"""Whether the polynomials solve the equations of motion: controls are flown again.

State x, y, z, vx, vy, vz (show frame, z up), roll, pitch, yaw, p, q, r; control thrust
U1 and torques U2, U3, U4. With f the torque factor of the vehicle:

    v'     = U1 / m (cos phi sin theta cos psi + sin phi sin psi,
                     cos phi sin theta sin psi - sin phi cos psi,
                     cos phi cos theta) - (0, 0, g)
    angles' = (p, q, r)
    p' = f U2 / Ix + (Iy - Iz) / Ix q r
    q' = f U3 / Iy + (Iz - Ix) / Iy p r
    r' =   U4 / Iz + (Ix - Iy) / Iz p q

Controls are limited to what four rotors can do: turned into squared rotor speeds,
clipped to [0, greatest squared speed], and turned back.

The method is Gauss-Legendre collocation with five points on each step (order 10;
Hairer, Nørsett, Wanner 1993, Solving Ordinary Differential Equations I, section II.7).
The equations form a cascade, so its implicit stages need a fixed-point iteration for
the body rates alone; angles, velocity and position follow by quadrature. A second run
with each step halved estimates the error of the integration itself, which is added to
the deviation that is reported.

Arrays of values have the shape (stages, components, drones, steps): a component of one
stage lies in one piece, and integrals over the stages are products of matrices.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from showc.verify.kernel.bernstein import basis
from showc.verify.pieces import Pieces, batches

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from showc.log.showc_pb2 import Vehicle
    from showc.verify.kernel.show import PieceTable, Segment

    FloatArray = NDArray[np.float64]

STAGES = 5
"""Gauss points on each step."""

_LARGEST_SPLIT = 64
"""Steps in each mesh interval at which the integration gives up halving."""

_WANTED_ERROR = 1e-5
"""Integration error [m] below which steps are not halved again: 1 % of the limit."""

_ROUNDS = 200
"""Fixed-point iterations of the body rates at most."""


class Deviation(NamedTuple):
    """Greatest distance between the flown controls and the logged polynomials."""

    value: float
    """Position [m] or attitude [rad], error of the integration included."""
    drone: int
    """Counting from 0."""
    time: float
    """Since the start of the segment [s]."""


@dataclass(frozen=True, slots=True)
class Replay:
    """Result for one segment."""

    position: Deviation
    """Of the position."""
    attitude: Deviation
    """Of any of the three angles."""
    integration_error: float
    """Estimated error of the integrated positions [m]."""
    clipped: float
    """By how much controls exceed the rotors, as a fraction of the squared speed."""


@lru_cache(maxsize=4)
def gauss(stages: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss-Legendre points in [0, 1], weights, and the matrix of partial integrals.

    Row i of the matrix integrates the interpolating polynomial from 0 to point i.
    """
    points, weights = np.polynomial.legendre.leggauss(stages)
    points, weights = 0.5 * (points + 1.0), 0.5 * weights
    powers = np.arange(stages)
    vandermonde = points[:, None] ** powers
    integrals = points[:, None] ** (powers + 1) / (powers + 1)
    return points, weights, integrals @ np.linalg.inv(vandermonde)


@lru_cache(maxsize=64)
def _weights(degree: int, split: int, *, ends: bool) -> FloatArray:
    """Bernstein basis at the Gauss points of ``split`` steps, and at their ``ends``.

    Shape (split, points, degree + 1).
    """
    points, _, _ = gauss(STAGES)
    if ends:
        points = np.append(points, 1.0)
    return basis(degree, (np.arange(split)[:, None] + points) / split)


def allocation(vehicle: Vehicle) -> FloatArray:
    """Matrix (4, 4) from squared rotor speeds [rad²/s²] to thrust and torques."""
    lift = vehicle.thrust_coefficient
    arm = lift * vehicle.arm_length
    drag = vehicle.torque_coefficient
    return np.array(
        [
            [lift, lift, lift, lift],
            [0.0, -arm, 0.0, arm],
            [arm, 0.0, -arm, 0.0],
            [drag, -drag, drag, -drag],
        ]
    )


def flyable(vehicle: Vehicle, control: FloatArray) -> tuple[FloatArray, float]:
    """Limit controls (..., 4) to what the rotors can do; say how much was cut.

    Returns
    -------
    ndarray
        Controls that four rotors between rest and full speed give.
    float
        Greatest excess of a squared rotor speed, over the greatest squared speed.
    """
    matrix = allocation(vehicle)
    top = vehicle.rotor_speed_max**2
    speeds = control @ np.linalg.inv(matrix).T / top
    clipped = np.clip(speeds, 0.0, 1.0)
    excess = float(np.max(np.abs(speeds - clipped), initial=0.0))
    if excess == 0.0:
        return control, 0.0
    return np.asarray(clipped @ matrix.T * top), excess


def replay(segment: Segment, vehicle: Vehicle) -> Replay:
    """Fly the controls of all drones of a segment from their first states.

    Parameters
    ----------
    segment
        What was logged.
    vehicle
        Physical parameters, from the log's rules.

    Returns
    -------
    Replay
        Greatest deviations over all drones, at all Gauss points and step ends.
    """
    result: Replay | None = None
    # A flight that runs away to infinity is reported as such, not as a warning.
    with np.errstate(all="ignore"):
        for table in segment.tables:
            cut = _cut(table, vehicle)
            for rows in batches(table):
                flown = _replay_rows(Pieces.of(table, rows, cut), vehicle)
                result = _worse(result, flown)
    if result is None:
        raise ValueError("a segment without drones")
    return result


def _worse(first: Replay | None, second: Replay) -> Replay:
    if first is None:
        return second
    return Replay(
        max(first.position, second.position),
        max(first.attitude, second.attitude),
        max(first.integration_error, second.integration_error),
        max(first.clipped, second.clipped),
    )


def _cut(table: PieceTable, vehicle: Vehicle) -> NDArray[np.bool_]:
    """Rows of which a control may ask the rotors for more than they give, (rows,).

    Those on which the hull of the coefficients leaves what the rotors can do.
    """
    share = np.linalg.inv(allocation(vehicle)) / vehicle.rotor_speed_max**2
    speeds = table.control @ share.T
    inside = np.all((speeds >= 0.0) & (speeds <= 1.0), axis=(1, 2))
    return np.asarray(~inside)


def _replay_rows(pieces: Pieces, vehicle: Vehicle) -> Replay:
    """Halve the steps until two runs agree, then compare the finer one."""
    split = 1
    coarse = _Run(pieces, vehicle, split)
    while True:
        fine = _Run(pieces, vehicle, 2 * split)
        change = np.abs(coarse.ends - fine.ends[:, :, 2 - 1 :: 2])
        # An infinite or undefined state must not pass for agreement.
        error = np.where(np.isfinite(change), change, np.inf).max(axis=2)
        worst = float(error[:3].max())
        if worst <= _WANTED_ERROR or 4 * split > _LARGEST_SPLIT:
            return fine.compare(error)
        split, coarse = 2 * split, fine


class _Run:
    """One integration of some drones, ``split`` steps in each mesh interval.

    Intervals that only fill up get steps of no length.
    """

    def __init__(self, pieces: Pieces, vehicle: Vehicle, split: int) -> None:
        self.pieces, self.split = pieces, split
        whole = (pieces.table.end - pieces.table.start)[pieces.piece]
        whole = np.where(pieces.valid, whole, 0.0)
        self.width = np.repeat(whole / split, split, axis=1)
        _, weights, partial = gauss(STAGES)
        control = self._logged(pieces.control)
        self.clipped = 0.0
        if pieces.cut:
            last, self.clipped = flyable(vehicle, np.moveaxis(control, 1, -1))
            control = np.moveaxis(last, -1, 1)
        self._integrate(pieces.first, control, vehicle, weights, partial)

    def _logged(self, coefficients: FloatArray, *, ends: bool = False) -> FloatArray:
        """Evaluate the log at the Gauss points of all steps, and at their ``ends``.

        ``coefficients`` has the shape (degree + 1, components, drones, intervals), the
        result (points, components, drones, steps).
        """
        weights = _weights(coefficients.shape[0] - 1, self.split, ends=ends)
        # (split, points, degree + 1) x (degree + 1, components, drones, intervals)
        values = np.tensordot(weights, coefficients, axes=(2, 0))
        _, points, components, drones, intervals = values.shape
        return np.moveaxis(values, 0, -1).reshape(
            points, components, drones, intervals * self.split
        )

    def _integrate(
        self,
        first: FloatArray,
        control: FloatArray,
        vehicle: Vehicle,
        weights: FloatArray,
        partial: FloatArray,
    ) -> None:
        width = self.width

        def advance(
            start: FloatArray, slope: FloatArray
        ) -> tuple[FloatArray, FloatArray]:
            """Values at stages and at step ends of what begins at ``start`` (c, n)."""
            slope = slope * width
            ends = np.cumsum(np.tensordot(weights, slope, axes=1), axis=-1)
            ends += start[..., None]
            inner = np.tensordot(partial, slope, axes=1)
            inner[..., 1:] += ends[..., :-1]
            inner[..., 0] += start
            return inner, ends

        rates, rate_ends = self._rates(first[9:], control, vehicle, advance)
        angles, angle_ends = advance(first[6:9], rates)
        push = _thrust_direction(angles)
        push *= control[:, :1] / vehicle.mass
        push[:, 2] -= vehicle.gravity
        velocity, velocity_ends = advance(first[3:6], push)
        position, position_ends = advance(first[:3], velocity)
        self.position, self.angles = position, angles
        self.ends = np.concatenate(
            [position_ends, velocity_ends, angle_ends, rate_ends]
        )

    def _rates(
        self,
        first: FloatArray,
        control: FloatArray,
        vehicle: Vehicle,
        advance: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
    ) -> tuple[FloatArray, FloatArray]:
        ix, iy, iz = vehicle.inertia.x, vehicle.inertia.y, vehicle.inertia.z
        factor = vehicle.torque_factor
        over = np.array([factor / ix, factor / iy, 1.0 / iz])
        torque = control[:, 1:] * over[:, None, None]
        coupling = ((iy - iz) / ix, (iz - ix) / iy, (ix - iy) / iz)
        rates = self._logged(self.pieces.state[:, 9:])
        ends = first
        for _ in range(_ROUNDS):
            slope = torque.copy()
            for axis, (one, other) in enumerate(((1, 2), (0, 2), (0, 1))):
                slope[:, axis] += coupling[axis] * rates[:, one] * rates[:, other]
            before, (rates, ends) = rates, advance(first, slope)
            change = float(np.max(np.abs(rates - before), initial=0.0))
            if change <= 1e-13 or not np.isfinite(change):
                break
        return rates, ends

    def compare(self, error: FloatArray) -> Replay:
        """Hold the run against the logged polynomials.

        Parameters
        ----------
        error
            Estimated error of the integration, shape (12, drones).
        """
        state = self.pieces.state
        found = []
        for part, flown in ((slice(0, 3), self.position), (slice(6, 9), self.angles)):
            gap = self._logged(state[:, part], ends=True)
            gap[:-1] -= flown
            gap[-1] -= self.ends[part]
            np.abs(gap, out=gap)
            gap += error[part, :, None]
            found.append(gap)
        position = np.sqrt(np.einsum("pcns,pcns->pns", found[0], found[0]))
        attitude = found[1].max(axis=1)
        return Replay(
            self._greatest(position),
            self._greatest(attitude),
            float(error[:3].max()),
            self.clipped,
        )

    def _greatest(self, gap: FloatArray) -> Deviation:
        """Greatest of the gaps (stages and end, drones, steps) that are flown."""
        gap = np.where(np.isfinite(gap), gap, np.inf)
        # Steps of no length only fill the array up; nothing is flown in them.
        gap = np.where(np.repeat(self.pieces.valid, self.split, axis=1), gap, 0.0)
        place, drone, step = np.unravel_index(int(np.argmax(gap)), gap.shape)
        points, _, _ = gauss(STAGES)
        share = np.append(points, 1.0)[place] + step % self.split
        piece = self.pieces.piece[drone, step // self.split]
        start, end = self.pieces.table.start[piece], self.pieces.table.end[piece]
        return Deviation(
            float(gap[place, drone, step]),
            int(self.pieces.drones[drone]),
            float(start + share / self.split * (end - start)),
        )


def _thrust_direction(angles: FloatArray) -> FloatArray:
    """Body z axis in the show frame for roll, pitch, yaw (stages, 3, n, steps)."""
    sine, cosine = np.sin(angles), np.cos(angles)
    s_roll, s_pitch, s_yaw = sine[:, 0], sine[:, 1], sine[:, 2]
    c_roll, c_pitch, c_yaw = cosine[:, 0], cosine[:, 1], cosine[:, 2]
    level = c_roll * s_pitch
    return np.stack(
        [
            level * c_yaw + s_roll * s_yaw,
            level * s_yaw - s_roll * c_yaw,
            c_roll * c_pitch,
        ],
        axis=1,
    )
