"""Planes between agents, and whether these are apart at every instant.

Positions are polynomials on the intervals of a common mesh, measured in a metric
diag(m) in which agents keep a distance d. Let n be a unit vector and, on one interval,
c_j the Bernstein coefficients of an agent that is planned, o_j those of another that
is given. If

    n . m c_j >= max_j n . m o_j + d   for all j,

the two are d apart throughout the interval, by the hull property (Farouki 2012).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Literal

import numpy as np

from showc.ocp.audit.couplings import greatest
from showc.ocp.nodes import fitting_points
from showc.trajectory import bernstein_basis, bernstein_basis_inverse

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    BoolArray = NDArray[np.bool_]

NEAR = 1.6
"""Distance, over the wanted one, within which planes are laid."""
EXPECTED = 2.6
"""The same for those that are planned later, which are bent aside to where they are
expected."""
ASIDE = 0.9
"""How far a way is bent to the agent's right where several meet, over the distance."""
SPARE = 1e-5
"""How much more than the distance is kept, over it; the solver's tolerance is less."""
Side = Literal["right", "over", "ring"]
_SAMPLES = np.linspace(0.0, 1.0, 5)


@dataclass(frozen=True, slots=True)
class Apart:
    """How far agents are to stay from each other."""

    distance: float
    metric: tuple[float, ...]
    """Factors on the components of a difference before its length is taken."""

    def lacking(self, first: FloatArray, second: FloatArray) -> float:
        """By how much two ways come too near; 0 if they never do.

        Parameters
        ----------
        first, second
            Bernstein coefficients on the same intervals, shape (K, degree + 1, n).

        Returns
        -------
        float
            Distance wanted minus least distance, at every instant; never too small.
        """
        # The squared distance is quadratic in the positions, so twice their degree.
        difference = (first - second) * np.asarray(self.metric)
        degree = 2 * (difference.shape[1] - 1)
        nodes = fitting_points(degree)
        basis = bernstein_basis(difference.shape[1] - 1, np.array(nodes))
        values = np.einsum("sj,kjc->ksc", basis, difference)
        squared = np.einsum("ksc,ksc->ks", values, values)
        inverse = bernstein_basis_inverse(degree, nodes)
        noise = 4.0 * np.finfo(np.float64).eps * np.abs(inverse).sum() * squared.max()
        excess = self.distance**2 + noise - squared @ inverse.T
        found = greatest(excess, 1e-9 * self.distance**2)
        if found is None:
            return 0.0
        least = np.sqrt(max(self.distance**2 - found.value, 0.0))
        return float(self.distance - least)


def clusters(pairs: Iterable[tuple[int, int]]) -> list[tuple[int, ...]]:
    """Group agents that are connected by pairs; each group sorted."""
    groups: list[set[int]] = []
    for pair in pairs:
        touched = [group for group in groups if group & set(pair)]
        groups = [group for group in groups if group not in touched]
        groups.append(set(pair).union(*touched))
    return sorted(tuple(sorted(group)) for group in groups)


def conflicts(
    ways: Mapping[int, FloatArray], apart: Apart, among: Iterable[int] | None = None
) -> list[tuple[int, int]]:
    """Pairs that come too near, at any instant; only those with one of ``among``."""
    chosen = set(ways) if among is None else set(among)
    low = {k: (way * apart.metric).min(axis=(0, 1)) for k, way in ways.items()}
    high = {k: (way * apart.metric).max(axis=(0, 1)) for k, way in ways.items()}
    return [
        (i, j)
        for i, j in combinations(sorted(ways), 2)
        if (i in chosen or j in chosen)
        and np.all(low[i] - high[j] < apart.distance)
        and np.all(low[j] - high[i] < apart.distance)
        and apart.lacking(ways[i], ways[j]) > 0.0
    ]


def bent(
    ways: Mapping[int, FloatArray],
    breaks: FloatArray,
    group: Sequence[int],
    apart: Apart,
    *,
    side: Side = "right",
    aside: float = ASIDE,
) -> dict[int, FloatArray]:
    """Sample ways of a group, bent so that they pass each other.

    Parameters
    ----------
    breaks
        Of the mesh, as fractions of the duration, shape (K + 1,).
    side
        ``right``: each to its right as seen from their middle, in the first two
        components. ``over``: along the third, to one side those that come from one
        half of the directions, to the other side the rest. ``ring``: all in different
        directions, across the component with the longest ways.
    aside
        How far, over the distance.

    Returns
    -------
    dict
        Places at five instants of each interval, shape (K, 5, n).
    """
    metric = np.asarray(apart.metric)
    moves = np.stack([(ways[k][-1, -1] - ways[k][0, 0]) * metric for k in group])
    relative = moves - moves.mean(axis=0)
    small = 1e-6 * apart.distance
    if side == "ring" and metric.size > 2:
        directions = _ring(moves, relative)
    elif side == "over" and metric.size > 2:
        directions = np.zeros_like(moves)
        for row, way in enumerate(relative):
            leading = way[np.abs(way) > small]
            directions[row, 2] = np.sign(leading[0]) if leading.size else 0.0
    else:
        directions = np.zeros_like(moves)
        for row, way in enumerate(relative):
            level = float(np.hypot(*way[:2])) if metric.size > 1 else 0.0
            if level > small:
                directions[row, :2] = way[1] / level, -way[0] / level
            elif np.linalg.norm(way) > small:
                directions[row, 0] = 1.0
    at = breaks[:-1, None] + np.diff(breaks)[:, None] * _SAMPLES
    bump = aside * apart.distance * 16.0 * (at * (1.0 - at)) ** 2
    return {
        k: sampled(ways[k]) + bump[:, :, None] * direction / metric
        for k, direction in zip(group, directions, strict=True)
    }


def _ring(moves: FloatArray, relative: FloatArray) -> FloatArray:
    """Directions evenly about a circle, in the order in which the agents come."""
    longest = np.abs(moves).max(axis=0)
    first, second = sorted(np.argsort(longest, kind="stable")[:2].tolist())
    wide = np.argsort(-np.abs(relative).max(axis=0), kind="stable")
    angle = np.arctan2(relative[:, wide[1]], relative[:, wide[0]])
    rank = np.argsort(np.argsort(np.round(angle, 9), kind="stable"), kind="stable")
    turn = 2.0 * np.pi * rank / rank.size
    best = np.zeros_like(moves)
    least = np.inf
    for quarter in (0.0, 0.5 * np.pi):
        directions = np.zeros_like(moves)
        directions[:, first] = np.cos(turn + quarter)
        directions[:, second] = np.sin(turn + quarter)
        # Aside is across the way, not along it.
        along = float(np.sum(np.einsum("kc,kc->k", directions, relative) ** 2))
        if along < least - 1e-9:
            best, least = directions, along
    return best


def sampled(way: FloatArray) -> FloatArray:
    """Places at five instants of each interval, shape (K, 5, n)."""
    basis = bernstein_basis(way.shape[1] - 1, _SAMPLES)
    return np.asarray(np.einsum("sj,kjc->ksc", basis, way))


class Walls:
    """Planes between one agent and others, kept once they are laid.

    Parameters
    ----------
    others
        Ways that are given: Bernstein coefficients, shape (K, degree + 1, n).
    apart
        What is to be kept.
    rows
        Greatest number of planes on an interval.
    later
        Places (K, 5, n) where others are expected that are planned later: planes half
        way to them leave them room.
    """

    def __init__(
        self,
        others: Sequence[FloatArray],
        apart: Apart,
        rows: int,
        later: Sequence[FloatArray] = (),
    ) -> None:
        self._others, self._later = others, later
        self._apart, self._rows = apart, rows
        count = max((way.shape[0] for way in (*others, *later)), default=0)
        size = len(others) + len(later)
        self._laid: BoolArray = np.zeros((size, count), dtype=np.bool_)

    def about(self, place: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Lay planes about the present places (K, 5, n) of the agent.

        Returns
        -------
        tuple or None
            Normals (K, rows, n) and lower bounds (K, rows); ``None``: none needed.
            Where there are more others than rows, the nearest count.
        """
        metric, wanted = np.asarray(self._apart.metric), self._apart.distance
        count, _, size = place.shape
        total, given = self._laid.shape[0], len(self._others)
        distance = np.full((total, count), np.inf)
        normal = np.zeros((total, count, size))
        bound = np.zeros((total, count))
        places = [*map(sampled, self._others), *self._later]
        for j, expected in enumerate(places):
            relative = (place - expected) * metric
            length = np.linalg.norm(relative, axis=2)
            distance[j] = length.min(axis=1)
            near = NEAR if j < given else EXPECTED
            self._laid[j] |= distance[j] < near * wanted
            normal[j] = _toward(relative[:, 0], relative[:, -1]) * metric
            if j < given:
                reach = np.einsum("kjc,kc->kj", self._others[j], normal[j]).max(axis=1)
                bound[j] = reach + wanted * (1.0 + SPARE)
            else:
                between = 0.5 * (place + expected)[:, _SAMPLES.size // 2]
                bound[j] = np.einsum("kc,kc->k", between, normal[j]) + 0.5 * wanted
        if not self._laid.any():
            return None
        normals = np.zeros((count, self._rows, size))
        lower = np.full((count, self._rows), -np.inf)
        far = np.where(self._laid, distance, np.inf)
        order = np.argsort(far, axis=0, kind="stable")
        for row in range(min(self._rows, total)):
            chosen = order[row], np.arange(count)
            on = self._laid[chosen]
            normals[on, row] = normal[chosen][on]
            lower[on, row] = bound[chosen][on]
        return normals, lower


def _toward(first: FloatArray, last: FloatArray) -> FloatArray:
    """Give unit vectors from the origin to the nearest points of segments, (K, n).

    The plane across such a vector is the one farthest from the origin that leaves the
    whole segment on its far side.
    """
    way = last - first
    square = np.einsum("kc,kc->k", way, way)
    share = -np.einsum("kc,kc->k", first, way) / np.where(square > 0.0, square, 1.0)
    nearest = first + np.clip(share, 0.0, 1.0)[:, None] * way
    length = np.linalg.norm(nearest, axis=1)
    return np.asarray(nearest / np.maximum(length, 1e-12)[:, None])
