"""Evaluate a whole fleet at many times, leg by leg, without a loop over samples."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.flight import Flight
    from showc.trajectory import PiecewisePolynomial


BLOCK = 8192
"""Samples evaluated at a time, so that their coefficients stay in the cache."""


def _bernstein(degree: int, s: FloatArray) -> FloatArray:
    """Bernstein polynomials by running products, shape (degree + 1, samples)."""
    basis = np.empty((degree + 1, s.size))
    basis[0] = 1.0
    for k in range(1, degree + 1):
        np.multiply(basis[k - 1], s, out=basis[k])
    rest = np.ones_like(s)
    for k in range(degree, -1, -1):
        basis[k] *= comb(degree, k) * rest
        rest *= 1.0 - s
    return basis


class _Bundle:
    """Polynomials of one degree, of several drones, in one array."""

    def __init__(self, rows: Sequence[int], parts: list[PiecewisePolynomial]) -> None:
        self.rows = np.array(rows)
        self.degree = parts[0].degree
        # Of a great fleet many drones have the same mesh.
        names = [part.breaks.tobytes() for part in parts]
        number = {name: row for row, name in enumerate(dict.fromkeys(names))}
        self.meshes = [np.frombuffer(name) for name in number]
        self.mesh = np.array([number[name] for name in names])
        counts = np.array([part.intervals for part in parts])
        self.first = np.concatenate([[0], np.cumsum(counts)[:-1]])
        self.left = np.concatenate([part.breaks[:-1] for part in parts])
        self.width = np.concatenate([part.breaks[1:] for part in parts]) - self.left
        # Coefficient index first: the sum over it then runs over whole arrays.
        self.coefficients = np.ascontiguousarray(
            np.concatenate([part.coefficients for part in parts]).transpose(1, 0, 2)
        )

    def __call__(self, time: FloatArray) -> FloatArray:
        """Values at leg times (T,) [s], shape (T, drones of the bundle, components)."""
        within = [
            np.searchsorted(breaks[1:-1], time, side="right") for breaks in self.meshes
        ]
        index = (np.stack(within, axis=1)[:, self.mesh] + self.first).ravel()
        moment = np.repeat(time, self.rows.size)
        fraction = np.clip((moment - self.left[index]) / self.width[index], 0.0, 1.0)
        components = self.coefficients.shape[2]
        result = np.zeros((index.size, components))
        for begin in range(0, index.size, BLOCK):
            part = slice(begin, begin + BLOCK)
            basis = _bernstein(self.degree, fraction[part])
            for k in range(self.degree + 1):
                # Taken, not indexed: other threads go on meanwhile.
                taken = self.coefficients[k].take(index[part], axis=0)
                taken *= basis[k][:, None]
                result[part] += taken
        return result.reshape(time.size, self.rows.size, components)


def _bundles(parts: list[PiecewisePolynomial]) -> list[_Bundle]:
    degrees = sorted({part.degree for part in parts})
    return [
        _Bundle(rows, [parts[row] for row in rows])
        for degree in degrees
        for rows in [[row for row, part in enumerate(parts) if part.degree == degree]]
    ]


@dataclass(slots=True)
class _ActiveLeg:
    start: float
    end: float
    drones: IntArray
    state: list[_Bundle]
    control: list[_Bundle]


class FleetSampler:
    """Evaluates a flight at rising times; keeps only the legs that are under way."""

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        self._active: dict[int, _ActiveLeg] = {}
        drones = flight.itinerary.show.drones
        self._state = np.zeros((drones, 12))
        self._control = np.zeros((drones, 4))

    def __call__(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """States (T, drones, 12) and controls (T, drones, 4) at show times (T,) [s].

        Where one leg ends and the next begins, the later one counts; after its last
        leg a drone stays as it was. Calls must come in the order of time.
        """
        state = np.empty((times.size, *self._state.shape))
        control = np.empty((times.size, *self._control.shape))
        state[:], control[:] = self._state, self._control
        for number, (start, flown) in enumerate(
            zip(self._flight.starts, self._flight.legs, strict=True)
        ):
            end = float(start) + flown.duration
            if end < times[0]:
                self._active.pop(number, None)
                continue
            begin = int(np.searchsorted(times, start))
            if begin == times.size:
                continue
            stop = int(np.searchsorted(times, end, side="right"))
            leg = self._activate(number)
            moment = times[begin:stop] - float(start)
            for bundles, values in ((leg.state, state), (leg.control, control)):
                for bundle in bundles:
                    drones = leg.drones[bundle.rows]
                    # A moment past the end gives what the drone has from there on.
                    found = bundle(np.append(moment, flown.duration))
                    values[begin:stop, drones] = found[:-1]
                    values[stop:, drones] = found[-1]
        self._state, self._control = state[-1].copy(), control[-1].copy()
        return state, control

    def _activate(self, number: int) -> _ActiveLeg:
        if number not in self._active:
            flown = self._flight.legs[number]
            start = float(self._flight.starts[number])
            self._active[number] = _ActiveLeg(
                start,
                start + flown.duration,
                flown.leg.drones,
                _bundles([trajectory.state for trajectory in flown.trajectories]),
                _bundles([trajectory.control for trajectory in flown.trajectories]),
            )
        return self._active[number]
