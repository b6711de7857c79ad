"""Flights cut into pieces of one polynomial each, all drones in the same arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.trajectory import elevation_matrix, restrict

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

    def groups(self, size: int) -> Pieces:
        """Return every ``size`` pieces as one, in whose hull they are.

        What is left over in the end makes one with some pieces twice. These are no
        polynomials: no part of them may be taken.
        """
        count = -(-len(self) // size)
        rows = np.minimum(np.arange(count * size), len(self) - 1).reshape(count, size)
        state, control = (
            part[rows].reshape(count, -1, part.shape[2])
            for part in (self.state, self.control)
        )
        return Pieces(
            self.drone[rows[:, 0]],
            self.start[rows[:, 0]],
            self.end[rows[:, -1]],
            state,
            control,
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


def flight_pieces(logged: LoggedShow) -> Pieces:
    """Return the whole flight of all drones of a log, by segment and drone.

    Raises
    ------
    DamagedFileError
        If a trajectory makes no polynomials.
    """
    found = [
        (int(drone), segment.start, flown)
        for segment in logged.segments
        for drone, flown in zip(segment.drones, segment.trajectories, strict=True)
    ]
    counts = [flown.state.intervals for _, _, flown in found]
    breaks = [flown.state.breaks + start for _, start, flown in found]
    return Pieces(
        np.repeat(np.array([drone for drone, _, _ in found]), counts),
        np.concatenate([one[:-1] for one in breaks]),
        np.concatenate([one[1:] for one in breaks]),
        _together([flown.state.coefficients for _, _, flown in found]),
        _together([flown.control.coefficients for _, _, flown in found]),
    )


def _together(parts: list[FloatArray]) -> FloatArray:
    """Join coefficients (intervals, degree + 1, components), of one degree then."""
    ends = np.cumsum([len(part) for part in parts])
    degrees = np.array([part.shape[1] - 1 for part in parts])
    most = int(degrees.max())
    joined = np.empty((int(ends[-1]), most + 1, parts[0].shape[2]))
    for degree in np.unique(degrees).tolist():
        of_it = np.flatnonzero(degrees == degree)
        rows = np.concatenate(
            [np.arange(ends[k] - len(parts[k]), ends[k]) for k in of_it]
        )
        raised = elevation_matrix(degree, most)
        own = np.concatenate([parts[k] for k in of_it])
        joined[rows] = np.einsum("rk,ikc->irc", raised, own)
    return joined
