"""Flights plus smooth changes of them, in closed form: nothing is solved.

Straight flights and splines are piecewise polynomials in position, and so is a change
that begins and ends at rest. Their sum is flown as it is where it keeps all limits;
drones with time to spare need no program of their own then.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.shared_profile.flat import fly, joined, keeps_limits
from showc.fleet.single_drone.basis import DEGREE
from showc.fleet.single_drone.judgement import leads
from showc.trajectory import (
    bernstein_basis,
    bernstein_basis_inverse,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.flight import Trajectory
    from showc.trajectory import PiecewisePolynomial


_WIDEST = 0.08
"""Widest interval [s]: on it, angles differ from the polynomials for them by so little
that controls alone, integrated, were measured to miss positions by 1e-9 m."""
_SAME = 1e-6
"""Breaks this near each other are one [s]."""
_NODES: FloatArray = 0.5 * (1.0 - np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE))
"""Where positions are taken on an interval, as fractions of it."""


def fly_changed(
    aircraft: Aircraft,
    flights: Sequence[PiecewisePolynomial],
    change: FloatArray,
) -> list[Trajectory | None]:
    """Fly the sums of flights and changes.

    Parameters
    ----------
    flights
        Positions first, polynomials of degree 5 at most, with a continuous jerk.
    change
        Bernstein coefficients on even intervals, from rest at zero to rest at zero,
        shape (n, K, 6, 3) [m].

    Returns
    -------
    list
        For each flight the changed one; None where that breaks a limit, or is not
        smooth enough, or turns too quickly for its polynomials.
    """
    alike: dict[bytes, list[int]] = {}
    for index, before in enumerate(flights):
        alike.setdefault(before.breaks.tobytes(), []).append(index)
    found: list[Trajectory | None] = [None] * len(flights)
    for members in alike.values():
        state = [flights[index] for index in members]
        breaks = state[0].breaks
        even = np.linspace(0.0, breaks[-1], change.shape[1] + 1)
        fine = _joint_breaks(breaks, even)
        at = fine[:-1, None] + np.diff(fine)[:, None] * _NODES
        whole = np.stack([one.coefficients[..., :3] for one in state])
        values = _values(breaks, whole, at) + _values(even, change[members], at)
        inverse = bernstein_basis_inverse(DEGREE, tuple(_NODES))
        position = np.einsum("jk,nika->nija", inverse, values)
        # From hover to hover, exactly: on a last interval of a few milliseconds the
        # rounding of positions turns the drone by more than a proof allows. Upward it
        # may leap: a spline need not begin with the thrust of a hover.
        for axes, order in ((slice(0, 2), 4), (slice(2, 3), 2)):
            position[:, 0, :order, axes] = whole[:, 0, :1, axes]
            position[:, -1, -order:, axes] = whole[:, -1, -1:, axes]
        flown = fly(aircraft.vehicle, aircraft.heading, fine, position)
        good = keeps_limits(aircraft.vehicle, aircraft.limits, flown) & joined(flown)
        rows = np.nonzero(good)[0].tolist()
        sums = [flown.trajectory(row) for row in rows]
        kept = leads(aircraft.vehicle, sums).tolist()
        for row, flight, keeps in zip(rows, sums, kept, strict=True):
            found[members[row]] = flight if keeps else None
    return found


def _joint_breaks(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return breaks of both, and more where these are far apart."""
    both = np.union1d(first, second)
    both = both[np.append(True, np.diff(both) > _SAME)]
    both[-1] = first[-1]
    parts = np.ceil(np.diff(both) / _WIDEST).astype(np.int64)
    share = [np.arange(count) / count for count in parts.tolist()]
    inner = [
        left + (right - left) * part
        for left, right, part in zip(both[:-1], both[1:], share, strict=True)
    ]
    return np.append(np.concatenate(inner), both[-1])


def _values(breaks: FloatArray, whole: FloatArray, at: FloatArray) -> FloatArray:
    """Values of curves (n, K, degree + 1, 3) at nodes of intervals, (n, m, ., 3)."""
    middle = 0.5 * (at[:, 0] + at[:, -1])
    piece: IntArray = np.searchsorted(breaks, middle, side="right") - 1
    width = np.diff(breaks)[piece][:, None]
    share = (at - breaks[piece][:, None]) / width
    basis = bernstein_basis(whole.shape[2] - 1, np.clip(share, 0.0, 1.0))
    return np.asarray(np.einsum("mjk,nmka->nmja", basis, whole[:, piece]))
