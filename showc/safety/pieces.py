"""Flights as pieces of one polynomial each, all drones in the same arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.trajectory import PiecewisePolynomial, elevation_matrix, restrict

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

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
    """Bernstein coefficients of position and velocity, shape (n, degree + 1, 6)."""

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

    def select(self, chosen: BoolArray | IntArray | slice) -> Pieces:
        """Return the ``chosen`` pieces: a mask (n,), indices, or a slice."""
        return Pieces(
            self.drone[chosen],
            self.start[chosen],
            self.end[chosen],
            self.state[chosen],
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
            restrict(np.repeat(self.state, count, axis=0), share, share + 1.0 / count),
        )

    def middle(self, piece: int) -> Place:
        """Return the drone of a piece and the middle of its time."""
        time = 0.5 * (self.start[piece] + self.end[piece])
        return Place(int(self.drone[piece]), float(time))

    def starts(self) -> Pieces:
        """Return the points at which the pieces start, as pieces without length."""
        return Pieces(self.drone, self.start, self.start, self.state[:, :1])

    def ends(self) -> Pieces:
        """Return the points at which they end, likewise."""
        return Pieces(self.drone, self.end, self.end, self.state[:, -1:])

    def flights(self) -> list[PiecewisePolynomial]:
        """Return position and velocity of each drone over the whole show.

        For pieces of whole flights, as :func:`flight_pieces` has them.
        """
        order = np.lexsort((self.start, self.drone))
        counts = np.bincount(self.drone)
        return [
            PiecewisePolynomial(
                np.append(self.start[own], self.end[own[-1]]), self.state[own]
            )
            for own in np.split(order, np.cumsum(counts)[:-1])
        ]


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """Polynomial pieces of one leg, with all that drones are and do."""

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


def flown_legs(logged: LoggedShow) -> Iterator[Flown]:
    """Yield the flights of all drones, leg by leg.

    Raises
    ------
    DamagedFileError
        If a trajectory makes no polynomials.
    """
    for segment in logged.segments:
        flown = [segment.trajectory(k) for k in range(segment.drones.size)]
        breaks = [one.state.breaks + segment.start for one in flown]
        yield Flown(
            np.repeat(segment.drones, [one.state.intervals for one in flown]),
            np.concatenate([one[:-1] for one in breaks]),
            np.concatenate([one[1:] for one in breaks]),
            _together([one.state.coefficients for one in flown]),
            _together([one.control.coefficients for one in flown]),
        )


def flight_pieces(legs: Iterable[Flown]) -> Pieces:
    """Return the whole flight of all drones, leg by leg."""
    parts = [
        Pieces(leg.drone, leg.start, leg.end, leg.state[:, :, :6].copy())
        for leg in legs
    ]
    return Pieces(
        np.concatenate([one.drone for one in parts]),
        np.concatenate([one.start for one in parts]),
        np.concatenate([one.end for one in parts]),
        _together([one.state for one in parts]),
    )


def _together(parts: list[FloatArray]) -> FloatArray:
    """Join coefficients (intervals, degree + 1, components), of one degree then."""
    ends = np.cumsum([len(part) for part in parts])
    degrees = np.array([part.shape[1] - 1 for part in parts])
    most = int(degrees.max())
    joined = np.empty((int(ends[-1]), most + 1, parts[0].shape[2]))
    for degree in np.unique(degrees).tolist():
        if degree == most and (degrees == most).all():
            return np.concatenate(parts)
        of_it = np.flatnonzero(degrees == degree)
        rows = np.concatenate(
            [np.arange(ends[k] - len(parts[k]), ends[k]) for k in of_it]
        )
        raised = elevation_matrix(degree, most)
        own = np.concatenate([parts[k] for k in of_it])
        joined[rows] = np.einsum("rk,ikc->irc", raised, own)
    return joined
