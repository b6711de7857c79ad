"""The mesh: how each phase is cut into intervals, arcs and points.

A phase is a sequence of arcs; the duration of each arc is an unknown of the
problem. An arc is cut into mesh intervals at fixed fractions. With one arc this is
the ordinary mesh; with several, the borders between arcs are switch times.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Mapping, Sequence

    from showc.arrays import FloatArray, IntArray

Key = TypeVar("Key", bound="Hashable")


@dataclass(frozen=True, slots=True)
class PhaseMesh:
    """The mesh of one phase."""

    fractions: tuple[float, ...]
    """Width of each interval as a fraction of its arc; each arc's sum to 1."""
    points: tuple[int, ...]
    """Number of collocation points N of each interval; the state's degree."""
    arcs: tuple[int, ...] = ()
    """Arc of each interval, 0, ..., rising by 0 or 1; empty means one arc."""
    control_degrees: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Degree of a control on each interval, where it differs from the problem's; -1
    for one less than the number of points."""
    path_points: tuple[tuple[float, ...], ...] = ()
    """Fractions of each interval where path constraints hold besides the
    collocation points; empty means none."""
    path_margins: tuple[float, ...] = ()
    """By how much, in their scale, path constraints are tightened on each interval so
    that they hold between the points; empty means not at all."""
    path_held: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """For path constraints that are active on whole arcs: on each interval 1 where it
    is an equation at its upper bound, -1 at its lower, 0 where it is not held. What is
    an equation holds at the collocation points alone: at more places than the controls
    have coefficients it would contradict itself."""

    def __post_init__(self) -> None:
        if not self.arcs:
            object.__setattr__(self, "arcs", (0,) * len(self.fractions))
        if not self.path_points:
            object.__setattr__(self, "path_points", ((),) * len(self.fractions))
        if not self.path_margins:
            object.__setattr__(self, "path_margins", (0.0,) * len(self.fractions))
        count = len(self.fractions)
        if count == 0 or len(self.points) != count or len(self.arcs) != count:
            raise ValueError(
                f"mesh with {count} widths, {len(self.points)} point counts and "
                f"{len(self.arcs)} arcs; wanted one of each for every interval"
            )
        sums = np.bincount(self.arcs, weights=self.fractions)
        if min(self.fractions) <= 0.0 or np.abs(sums - 1.0).max() > 1e-9:
            raise ValueError(
                f"interval fractions sum to {sums} over the arcs; wanted positive "
                "fractions that sum to 1 on every arc"
            )

    @classmethod
    def uniform(cls, intervals: int, points: int) -> PhaseMesh:
        """Equal ``intervals`` with ``points`` collocation points each."""
        return cls((1.0 / intervals,) * intervals, (points,) * intervals)

    @classmethod
    def from_breaks(
        cls, breaks: Sequence[float] | FloatArray, points: Sequence[int]
    ) -> PhaseMesh:
        """One arc with the given relative ``breaks`` (any affine scale)."""
        widths = np.diff(np.asarray(breaks, dtype=np.float64))
        widths = widths / widths.sum()
        return cls(tuple(float(w) for w in widths), tuple(int(n) for n in points))

    @property
    def intervals(self) -> int:
        """Number of mesh intervals K."""
        return len(self.fractions)

    @property
    def arc_count(self) -> int:
        """Number of arcs."""
        return max(self.arcs) + 1

    @property
    def point_count(self) -> int:
        """Number of collocation points in all."""
        return sum(self.points)

    def widths(self, durations: FloatArray) -> FloatArray:
        """Width of each interval for arc ``durations`` (arcs,), shape (K,) [s]."""
        return np.asarray(np.asarray(self.fractions) * durations[list(self.arcs)])


@dataclass(frozen=True, slots=True)
class Mesh:
    """The meshes of all phases, in the order of the problem's phases."""

    phases: tuple[PhaseMesh, ...]

    @classmethod
    def uniform(cls, intervals: int, points: int, phases: int = 1) -> Mesh:
        """Give each phase equal ``intervals`` with ``points`` points each."""
        return cls((PhaseMesh.uniform(intervals, points),) * phases)

    @property
    def point_count(self) -> int:
        """Number of collocation points in all phases."""
        return sum(phase.point_count for phase in self.phases)

    @property
    def interval_count(self) -> int:
        """Number of mesh intervals in all phases."""
        return sum(phase.intervals for phase in self.phases)


def alike(keys: Iterable[Key]) -> list[tuple[Key, IntArray]]:
    """Numbers of the intervals that have the same key, in order of first appearance."""
    found: dict[Key, list[int]] = {}
    for number, key in enumerate(keys):
        found.setdefault(key, []).append(number)
    return [(key, np.array(numbers)) for key, numbers in found.items()]
