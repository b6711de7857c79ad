"""Energy: charge and voltage along the flight, from the power of each rotor.

The power follows :mod:`showc.vehicle.power`; the battery is an open-circuit voltage
behind a resistance. All of it is a model and an estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.safety.pieces import Place
from showc.trajectory import bernstein_basis
from showc.vehicle.power import rotor_thrusts

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from showc.arrays import FloatArray
    from showc.safety.pieces import Flown
    from showc.vehicle import Battery, Quadrotor
    from showc.vehicle.power import Power

STEP = 1.0
"""Time over which power is averaged for the charge [s]."""
# Charge left of the whole, for the voltages below.
_LEFT = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
_CELL = np.array(
    [3.27, 3.61, 3.69, 3.73, 3.77, 3.80, 3.84, 3.87, 3.95, 4.02, 4.11, 4.20]
)
"""Open-circuit voltage of a lithium polymer cell by the charge left [V]: the common
table of makers of models; single cells differ by 0.05 V."""


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
    def empty(self) -> float | None:
        """When the first battery is empty [s]; None: none is."""
        flat = (self.left <= 0.0).any(axis=1)
        return float(self.times[int(flat.argmax())]) if flat.any() else None

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


def hover_endurance(battery: Battery, hover_power: float) -> float:
    """How long a full battery hovers until it is empty or its voltage too low [s]."""
    left, time = 1.0, 0.0
    power = np.array(hover_power)
    while left > 0.0:
        drawn = float(current(battery, np.array(left), power))
        under_load = hover_power / drawn
        if not under_load >= battery.voltage_min:
            break
        left -= drawn * STEP / battery.capacity
        time += STEP
    return time


class Draw:
    """What the rotors of a fleet take, summed while its legs go by.

    Parameters
    ----------
    vehicle
        Allocation of the rotors, and the weight that the hover power carries.
    model
        Power of rotors.
    drones
        Size of the fleet.
    duration
        Of the show [s].
    """

    def __init__(
        self, vehicle: Quadrotor, model: Power, drones: int, duration: float
    ) -> None:
        self.vehicle, self.model = vehicle, model
        shape = max(int(np.ceil(duration / STEP)), 1), drones
        self.joules, self.peak = np.zeros(shape), np.zeros(shape)
        self.thrust = 0.0
        """Greatest thrust of a rotor so far [N]: a bound."""
        self.place = Place(0, 0.0)
        """Where that is."""

    def along(self, legs: Iterable[Flown]) -> Iterator[Flown]:
        """Yield the legs that are given, and add up what they take."""
        for leg in legs:
            self._add(leg)
            yield leg

    def _add(self, leg: Flown) -> None:
        asked = rotor_thrusts(self.vehicle, leg.control).max(axis=(1, 2))
        most = int(asked.argmax())
        if asked[most] > self.thrust:
            self.thrust = float(asked[most])
            middle = 0.5 * float(leg.start[most] + leg.end[most])
            self.place = Place(int(leg.drone[most]), middle)
        # Parts no longer than a step: their power is then that step's, or a
        # neighbour's.
        counts = np.ceil((leg.end - leg.start) / STEP).astype(int)
        nodes, weights = np.polynomial.legendre.leggauss(3)
        for count in np.unique(counts).tolist():
            rows = np.flatnonzero(counts == count)
            state, control = leg.state[rows], leg.control[rows]
            start, width = leg.start[rows], (leg.end - leg.start)[rows] / count
            drone = leg.drone[rows]
            for part in range(count):
                for node, weight in zip(
                    0.5 * (nodes + 1.0), 0.5 * weights, strict=True
                ):
                    share = float(part + node) / count
                    power = self.model.flown(
                        self.vehicle, _at(state, share), _at(control, share)
                    )
                    moment = start + (part + node) * width
                    step = np.minimum(moment / STEP, len(self.joules) - 1).astype(int)
                    np.add.at(self.joules, (step, drone), power * weight * width)
                    np.maximum.at(self.peak, (step, drone), power)


def flight_energy(draw: Draw, battery: Battery, abort: float) -> Energy:
    """Empty the batteries of a fleet along its flight.

    Parameters
    ----------
    draw
        What the whole flight takes.
    battery
        What it flies on, full at the start.
    abort
        How long the longest abort takes after the flight, hovering [s].
    """
    power = draw.joules / STEP
    steps, drones = power.shape
    left, voltage = np.ones((2, steps, drones))
    now = np.ones(drones)
    for step in range(steps):
        most = np.maximum(draw.peak[step], power[step])
        # A last step may be so short that no part of a leg has its middle in it.
        with np.errstate(invalid="ignore", divide="ignore"):
            voltage[step] = np.where(
                most > 0.0,
                most / current(battery, now, most),
                open_circuit(battery, now),
            )
        drawn = np.nan_to_num(current(battery, now, power[step]), nan=np.inf)
        now = np.maximum(now - drawn * STEP / battery.capacity, 0.0)
        left[step] = now
    hovering = draw.model.hover(draw.vehicle)
    taken = current(battery, np.array(float(now.min())), np.array(hovering))
    share = float(np.nan_to_num(taken, nan=np.inf)) * abort / battery.capacity
    times = np.asarray(STEP * (1.0 + np.arange(steps)))
    endurance = hover_endurance(battery, hovering)
    return Energy(times, power, left, voltage, endurance, share)


def _at(coefficients: FloatArray, share: float) -> FloatArray:
    """Values at a share of each interval, shape (n, components)."""
    basis = bernstein_basis(coefficients.shape[1] - 1, share)
    return np.asarray(np.einsum("k,nkc->nc", basis, coefficients))
