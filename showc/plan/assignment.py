"""Which drone takes which place.

The assignment that minimises the sum of squared distances, in the metric of the
separation, has a proof: no exchange of two places improves the sum. So two drones that
share one time profile along straight lines never come nearer than the smaller spacing
over the square root of two (Turpin, Michael, Kumar 2014, Concurrent assignment and
planning of trajectories, section 4; the argument holds in every inner product). A
little is often to be gained by shortening the longest move; that loses the proof, so it
is taken only where the straight lines are measured to keep the separation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.vehicle.metric import measure, scaled

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.vehicle import Separation


WORTHWHILE = 0.97
"""A shorter longest move must be at most this fraction of the present one."""

BOTTLENECK_SLACK = 1.02
"""How far above the least possible longest move the second assignment may go."""

BOTTLENECK_RESOLUTION = 1e-3
"""How closely the least possible longest move is found, as a fraction."""

BOTTLENECK_LIMIT = 2500
"""Drones above which the search for a shorter longest move costs more than it gives."""


@dataclass(frozen=True, slots=True, eq=False)
class Assignment:
    """The place of each drone, and why it is this one."""

    places: IntArray
    """Place of each drone, shape (drones,)."""
    line_separation: float
    """Least distance of a pair on synchronised straight lines, metric [m]."""
    reason: str
    """In words, for the certificate."""


def assign(
    start: FloatArray,
    goals: FloatArray,
    separation: Separation,
    *,
    required: int | None = None,
) -> Assignment:
    """Give every drone a place.

    Parameters
    ----------
    start
        Positions of the drones, shape (drones, 3) [m].
    goals
        Places, shape (places, 3) [m], at least as many as drones.
    separation
        The metric to measure in.
    required
        Number of places, from the first on, that must be taken; None: no such rule.

    Returns
    -------
    Assignment
        Deterministic for given input.
    """
    cost = _squared_distances(start, goals, separation)
    if required is not None and required < goals.shape[0]:
        cost[:, :required] -= 2.0 * float(cost.max()) + 1.0
    places = _least_sum(cost)
    kept = line_separation(start, goals[places], separation)
    plain = Assignment(places, kept, "least sum of squared distances")
    if start.shape[0] > BOTTLENECK_LIMIT or start.shape[0] != goals.shape[0]:
        return plain
    return _shorter_longest(plain, start, goals, separation)


def in_order(
    start: FloatArray, goals: FloatArray, separation: Separation
) -> Assignment:
    """Drone i takes place i."""
    places = np.arange(start.shape[0])
    kept = line_separation(start, goals[places], separation)
    return Assignment(places, kept, "fixed by the script")


def _squared_distances(
    start: FloatArray, goals: FloatArray, separation: Separation
) -> FloatArray:
    """Squared metric distances (drones, places) [m²]."""
    first, last = scaled(start, separation), scaled(goals, separation)
    square = (
        np.einsum("ij,ij->i", first, first)[:, None]
        + np.einsum("ij,ij->i", last, last)[None, :]
        - 2.0 * first @ last.T
    )
    return np.asarray(np.maximum(square, 0.0))


def _least_sum(cost: FloatArray) -> IntArray:
    """Solve the linear assignment problem; ties fall as the solver's order has it."""
    import lap  # noqa: PLC0415 - not needed to check a script

    _, places = lap.lapjvr(cost, extend_cost=True, return_cost=False)
    return np.asarray(places, dtype=np.int64)


def _shorter_longest(
    plain: Assignment, start: FloatArray, goals: FloatArray, separation: Separation
) -> Assignment:
    """Take an assignment with a shorter longest move where that is safe."""
    length = np.linalg.norm(goals[None, :, :] - start[:, None, :], axis=-1)
    longest = float(length[np.arange(start.shape[0]), plain.places].max())
    least = _bottleneck(length, WORTHWHILE * longest)
    if least is None:
        return plain
    cost = _squared_distances(start, goals, separation)
    cost[length > BOTTLENECK_SLACK * least] = 1e3 * float(cost.max()) + 1.0
    places = _least_sum(cost)
    kept = line_separation(start, goals[places], separation)
    if kept < min(plain.line_separation, separation.distance):
        return plain
    return Assignment(
        places,
        kept,
        f"least sum of squared distances with no move over {least:.2f} m "
        f"+ {BOTTLENECK_SLACK - 1.0:.0%}",
    )


def _bottleneck(length: FloatArray, limit: float) -> float | None:
    """Least possible longest move [m], by bisection over perfect matchings.

    Parameters
    ----------
    length
        Of every drone's move to every place, shape (n, n) [m].
    limit
        Longest move that is of interest [m].

    Returns
    -------
    float or None
        With all moves at most this long everyone still gets a place; at most
        ``BOTTLENECK_RESOLUTION`` of itself above the least for which that is so.
        None if no assignment keeps ``limit``.
    """
    # Every drone needs a place that near, and every place a drone.
    low = max(float(length.min(axis=0).max()), float(length.min(axis=1).max()))
    if low > limit or not _can_match(length <= limit):
        return None
    high = limit
    if _can_match(length <= low):
        return low
    while high - low > BOTTLENECK_RESOLUTION * high:
        middle = 0.5 * (low + high)
        if _can_match(length <= middle):
            high = middle
        else:
            low = middle
    return high


def _can_match(allowed: BoolArray) -> bool:
    """Whether every row can have a column of its own among those ``allowed``."""
    places = _least_sum(np.where(allowed, 0.0, 1.0))
    return bool(allowed[np.arange(places.size), places].all())


@dataclass(frozen=True, slots=True)
class Meeting:
    """Two drones at their nearest while all share one profile along straight lines."""

    first: int
    """Row of one drone."""
    second: int
    """Row of the other."""
    share: float
    """Share of the way where they are, from 0 to 1."""
    distance: float
    """In the metric [m]."""


_BLOCK = 128
"""Rows of the pair matrix worked on at once: bounds the memory."""


def line_separation(
    start: FloatArray, goal: FloatArray, separation: Separation
) -> float:
    """Return the distance of :func:`nearest_on_lines`, or infinity [m]."""
    found = nearest_on_lines(start, goal, separation)
    return float("inf") if found is None else found.distance


def nearest_on_lines(
    start: FloatArray, goal: FloatArray, separation: Separation
) -> Meeting | None:
    """Nearest pair of drones that share one profile along straight lines.

    All drones are at ``start + s (goal - start)`` for a common s from 0 to 1. So the
    least distance of a pair is the distance of a segment to the origin: exact for the
    sphere and the ellipsoid. The axis forms are not convex; for them the distance is
    the least over s of a piecewise-linear function, taken at its corners.

    Parameters
    ----------
    start, goal
        Positions, shape (n, 3) [m].
    separation
        The metric.

    Returns
    -------
    Meeting or None
        None for fewer than two drones.
    """
    axis_form = separation.shape in ("any-axis", "all-axes")
    first, last = scaled(start, separation), scaled(goal, separation)
    nearest: Meeting | None = None
    columns = np.arange(start.shape[0])
    for top in range(0, start.shape[0] - 1, _BLOCK):
        rows = slice(top, top + _BLOCK)
        # Pairs with drones before these were looked at before.
        origin = first[rows, None] - first[None, top:]
        change = (last[rows, None] - last[None, top:]) - origin
        if axis_form:
            fraction, distance = _axis_form_least(origin, change, separation)
        else:
            square = np.einsum("ijk,ijk->ij", change, change)
            along = -np.einsum("ijk,ijk->ij", origin, change)
            fraction = np.clip(along / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
            offset = origin + fraction[..., None] * change
            distance = np.sqrt(np.einsum("ijk,ijk->ij", offset, offset))
        later = columns[None, top:] > columns[rows, None]
        distance = np.where(later, distance, np.inf)
        row, column = np.unravel_index(int(distance.argmin()), distance.shape)
        least = float(distance[row, column])
        if nearest is None or least < nearest.distance:
            share = float(fraction[row, column])
            nearest = Meeting(top + int(row), top + int(column), share, least)
    return nearest


def _axis_form_least(
    origin: FloatArray, change: FloatArray, separation: Separation
) -> tuple[FloatArray, FloatArray]:
    """Least of max or min of |origin + s change|: where, and how much, each (...)."""
    pairs = [(0, 1), (0, 2), (1, 2)]
    numerators, denominators = [-origin], [change]
    for sign in (1.0, -1.0):
        left = np.stack([origin[..., a] - sign * origin[..., b] for a, b in pairs], -1)
        rate = np.stack([change[..., a] - sign * change[..., b] for a, b in pairs], -1)
        numerators.append(-left)
        denominators.append(rate)
    numerator = np.concatenate(numerators, axis=-1)
    denominator = np.concatenate(denominators, axis=-1)
    safe = np.where(denominator == 0.0, 1.0, denominator)
    corners = np.clip(numerator / safe, 0.0, 1.0)
    ends = np.broadcast_to(np.array([0.0, 1.0]), (*corners.shape[:-1], 2))
    fractions = np.concatenate([corners, ends], axis=-1)
    values = origin[..., None, :] + fractions[..., :, None] * change[..., None, :]
    distances = np.asarray(measure(values, separation))
    least = distances.argmin(axis=-1)[..., None]
    return (
        np.take_along_axis(fractions, least, axis=-1)[..., 0],
        np.take_along_axis(distances, least, axis=-1)[..., 0],
    )
