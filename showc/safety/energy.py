"""Energy: power from the thrust of each rotor, charge and voltage along the flight.

A rotor of disc area A with thrust T that climbs at c takes the ideal power

    T (c + v),    v = -c / 2 + sqrt(c² / 4 + T / (2 rho A))

by momentum theory (Leishman 2006, Principles of Helicopter Aerodynamics, 2.13); going
down it is taken to need what hovering needs. The electrical power is an idle part and
the ideal power over an efficiency, which follows from the power of hovering. The
battery is an open-circuit voltage behind a resistance. All of this is a model: hover
power within some per cent where it was measured, and an estimate elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.safety.fall import AIR_DENSITY
from showc.trajectory import bernstein_basis
from showc.vehicle.motion import thrust_direction

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.safety.pieces import Pieces
    from showc.vehicle import Battery, Quadrotor

STEP = 1.0
"""Time over which power is averaged for the charge [s]."""
_LEFT = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
_CELL = np.array(
    [3.27, 3.61, 3.69, 3.73, 3.77, 3.80, 3.84, 3.87, 3.95, 4.02, 4.11, 4.20]
)
"""Open-circuit voltage of a lithium polymer cell by the charge left [V]: the common
table of makers of models; single cells differ by 0.05 V."""


@dataclass(frozen=True, slots=True)
class Power:
    """What rotors take."""

    idle: float
    """Power without thrust [W]."""
    efficiency: float
    """Ideal power over the electrical power beyond the idle one."""
    disc: float
    """Area of one rotor's disc [m²]."""

    @classmethod
    def of(cls, battery: Battery, vehicle: Quadrotor) -> Power:
        """Fit the efficiency to the hover power."""
        disc = float(np.pi * battery.rotor_radius**2)
        quarter = vehicle.hover_thrust / 4.0
        ideal = 4.0 * quarter**1.5 / np.sqrt(2.0 * AIR_DENSITY * disc)
        return cls(
            battery.idle_power,
            float(ideal / (battery.hover_power - battery.idle_power)),
            disc,
        )

    def __call__(self, thrust: FloatArray, climb: FloatArray) -> FloatArray:
        """Electrical power [W].

        Parameters
        ----------
        thrust
            Of each rotor, shape (..., 4) [N].
        climb
            Velocity along the rotors' axis, shape (...) [m/s].
        """
        pull, rise = np.maximum(thrust, 0.0), np.maximum(climb, 0.0)[..., None]
        flow = 0.5 * rise + np.sqrt(
            0.25 * rise**2 + pull / (2.0 * AIR_DENSITY * self.disc)
        )
        return np.asarray(self.idle + np.sum(pull * flow, axis=-1) / self.efficiency)


@dataclass(frozen=True, slots=True, eq=False)
class Energy:
    """How the batteries of a fleet empty; an estimate."""

    times: FloatArray
    """Ends of the steps, shape (n,) [s]."""
    power: FloatArray
    """Mean over each step, shape (n, drones) [W]."""
    left: FloatArray
    """Part of the capacity left, shape (n, drones)."""
    voltage: FloatArray
    """Least under load in each step, shape (n, drones) [V]; NaN: the power cannot be
    drawn."""
    hover_endurance: float
    """How long a full battery hovers until it is empty or too low [s]."""
    abort: float
    """Part of the capacity that the longest abort takes after the flight."""

    @property
    def used(self) -> FloatArray:
        """Part of the capacity that each drone takes, (drones,)."""
        return np.asarray(1.0 - self.left[-1])

    @property
    def energy(self) -> FloatArray:
        """What each drone takes, (drones,) [J]."""
        return np.asarray(self.power.sum(axis=0) * STEP)

    @property
    def worst(self) -> int:
        """Which drone takes most."""
        return int(self.used.argmax())


def open_circuit(battery: Battery, left: FloatArray) -> FloatArray:
    """Voltage without load by the part of the capacity that is ``left`` [V]."""
    return np.asarray(battery.voltage / _CELL[-1] * np.interp(left, _LEFT, _CELL))


def current(battery: Battery, left: FloatArray, power: FloatArray) -> FloatArray:
    """Return the current that gives a power [A]; NaN where none does."""
    source = open_circuit(battery, left)
    square = source**2 - 4.0 * battery.resistance * power
    with np.errstate(invalid="ignore"):
        root = np.sqrt(np.where(square >= 0.0, square, np.nan))
    # Stable for small resistances: 2 P / (V + sqrt(V² - 4 R P)).
    return np.asarray(2.0 * power / (source + root))


def hover_endurance(battery: Battery) -> float:
    """How long a full battery hovers until it is empty or its voltage too low [s]."""
    left, time = 1.0, 0.0
    power = np.array(battery.hover_power)
    while left > 0.0:
        drawn = float(current(battery, np.array(left), power))
        under_load = battery.hover_power / drawn
        if not under_load >= battery.voltage_min:
            break
        left -= drawn * STEP / battery.capacity
        time += STEP
    return time


def rotor_thrusts(vehicle: Quadrotor, control: FloatArray) -> FloatArray:
    """Thrust of each rotor, shape (..., 4) [N], of controls U1..U4 (..., 4)."""
    most = vehicle.thrust_coefficient * vehicle.rotor_speed_max**2
    return np.asarray(control @ vehicle.rotor_fractions().T * most)


def flight_energy(
    pieces: Pieces, vehicle: Quadrotor, battery: Battery, abort: float
) -> Energy:
    """Empty the batteries of a fleet along its flight.

    Parameters
    ----------
    pieces
        The flight of all drones.
    vehicle
        Allocation of the rotors, and the weight that the hover power carries.
    battery
        What it flies on, full at the start.
    abort
        How long the longest abort takes after the flight, hovering [s].
    """
    model = Power.of(battery, vehicle)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    drones = int(pieces.drone.max()) + 1
    steps = int(np.ceil(pieces.end.max() / STEP))
    joules, peak = np.zeros((2, steps, drones))
    # Pieces no longer than a step: their power is then that step's, or a neighbour's.
    count = int(np.ceil((pieces.end - pieces.start).max() / STEP))
    for part in _cut(pieces, count):
        for node, weight in zip(0.5 * (nodes + 1.0), 0.5 * weights, strict=True):
            state = _at(part.state, float(node))
            direction = np.stack(
                thrust_direction(state[:, 6], state[:, 7], state[:, 8]), axis=1
            )
            power = model(
                rotor_thrusts(vehicle, _at(part.control, float(node))),
                np.sum(direction * state[:, 3:6], axis=1),
            )
            width = part.end - part.start
            moment = part.start + node * width
            step = np.minimum((moment / STEP).astype(int), steps - 1)
            np.add.at(joules, (step, part.drone), power * weight * width)
            np.maximum.at(peak, (step, part.drone), power)
    power = joules / STEP
    left, voltage = np.ones((2, steps, drones))
    now = np.ones(drones)
    for step in range(steps):
        most = np.maximum(peak[step], power[step])
        with np.errstate(invalid="ignore", divide="ignore"):
            voltage[step] = np.where(
                most > 0.0, most / current(battery, now, most), np.inf
            )
        drawn = np.nan_to_num(current(battery, now, power[step]), nan=np.inf)
        now = np.maximum(now - drawn * STEP / battery.capacity, 0.0)
        left[step] = now
    hovering = np.array(battery.hover_power)
    taken = current(battery, np.array(float(now.min())), hovering)
    share = float(np.nan_to_num(taken, nan=np.inf)) * abort / battery.capacity
    times = np.asarray(STEP * (1.0 + np.arange(steps)))
    endurance = hover_endurance(battery)
    return Energy(times, power, left, voltage, endurance, share)


def _cut(pieces: Pieces, count: int) -> list[Pieces]:
    """Return the pieces, the long ones cut into parts no longer than a step."""
    long = pieces.end - pieces.start > STEP
    found = [pieces.select(~long)]
    if long.any():
        found.append(pieces.select(long).parts(count))
    return [part for part in found if len(part)]


def _at(coefficients: FloatArray, share: float) -> FloatArray:
    """Values at a share of each interval, shape (n, components)."""
    basis = bernstein_basis(coefficients.shape[1] - 1, share)
    return np.asarray(np.einsum("k,nkc->nc", basis, coefficients))
