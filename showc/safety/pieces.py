"""Flights cut into pieces of one polynomial each, all drones in the same arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.trajectory import PiecewisePolynomial, restrict

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.log.reader import LoggedShow


@dataclass(frozen=True, slots=True)
class Place:
    """Where in a show something is at its worst."""

    drone: int
    """Counting from 0."""
    time: float
    """Show time [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Polynomial pieces of flights, show frame."""

    drone: IntArray
    """Of each piece, counting from 0, shape (n,)."""
    start: FloatArray
    """Show time, shape (n,) [s]."""
    end: FloatArray
    """Show time, shape (n,) [s]."""
    state: FloatArray
    """Bernstein coefficients of the state, shape (n, degree + 1, 12)."""
    control: FloatArray
    """Bernstein coefficients of U1..U4, shape (n, control degree + 1, 4)."""

    def __len__(self) -> int:
        return int(self.drone.size)

    @property
    def position(self) -> FloatArray:
        """Bernstein coefficients of the position, shape (n, degree + 1, 3) [m]."""
        return self.state[:, :, :3]

    @property
    def velocity(self) -> FloatArray:
        """Bernstein coefficients of the velocity, shape (n, degree + 1, 3) [m/s]."""
        return self.state[:, :, 3:6]

    def select(self, chosen: BoolArray | IntArray) -> Pieces:
        """Return the ``chosen`` pieces: a mask (n,), or indices."""
        return Pieces(
            self.drone[chosen],
            self.start[chosen],
            self.end[chosen],
            self.state[chosen],
            self.control[chosen],
        )

    def parts(self, count: int) -> Pieces:
        """Return every piece cut into ``count`` parts of equal length, in order."""
        if count == 1:
            return self
        share = np.tile(np.arange(count) / count, len(self))[:, None, None]
        step = np.repeat((self.end - self.start) / count, count)
        start = np.repeat(self.start, count) + step * np.tile(
            np.arange(count), len(self)
        )
        return Pieces(
            np.repeat(self.drone, count),
            start,
            start + step,
            *(
                restrict(np.repeat(part, count, axis=0), share, share + 1.0 / count)
                for part in (self.state, self.control)
            ),
        )

    def middle(self, piece: int) -> Place:
        """Return the drone of a piece and the middle of its time."""
        time = 0.5 * (self.start[piece] + self.end[piece])
        return Place(int(self.drone[piece]), float(time))

    def starts(self) -> Pieces:
        """Return the points at which the pieces start, as pieces without length."""
        return Pieces(
            self.drone, self.start, self.start, self.state[:, :1], self.control[:, :1]
        )

    @classmethod
    def joined(cls, parts: list[Pieces]) -> Pieces:
        """Return the pieces of all ``parts``, which are of the same degrees."""
        return cls(
            np.concatenate([part.drone for part in parts]),
            np.concatenate([part.start for part in parts]),
            np.concatenate([part.end for part in parts]),
            np.concatenate([part.state for part in parts]),
            np.concatenate([part.control for part in parts]),
        )


def flight_pieces(logged: LoggedShow) -> Pieces:
    """Return the whole flight of all drones of a log, by segment and drone.

    Raises
    ------
    DamagedFileError
        If a trajectory makes no polynomials.
    """
    found = []
    for segment in logged.segments:
        for drone, flown in zip(segment.drones, segment.trajectories, strict=True):
            found.append((int(drone), segment.start, flown.state, flown.control))
    degree = max(state.degree for _, _, state, _ in found)
    control_degree = max(control.degree for _, _, _, control in found)
    parts = [
        Pieces(
            np.full(state.intervals, drone, dtype=np.int64),
            state.breaks[:-1] + start,
            state.breaks[1:] + start,
            _of_degree(state, degree),
            _of_degree(control, control_degree),
        )
        for drone, start, state, control in found
    ]
    return Pieces.joined(parts)


def _of_degree(flown: PiecewisePolynomial, degree: int) -> FloatArray:
    return flown.elevated(degree).coefficients
