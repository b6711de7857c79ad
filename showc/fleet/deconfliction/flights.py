"""The flights of a fleet over one common time, as they are while they are changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.conflicts import conflicts
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.deconfliction.walls import NODES, interpolated
from showc.fleet.single_drone.common_time import OPTIMAL, SPLINE, STRAIGHT
from showc.fleet.single_drone.model import in_motion
from showc.plan.itinerary import STILL
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.deconfliction.changes import Untangled
    from showc.fleet.deconfliction.conflicts import Encounters
    from showc.fleet.deconfliction.enclosure import Detour
    from showc.fleet.execution.pool import Workers
    from showc.fleet.shared_profile.profile import Profile
    from showc.fleet.single_drone.common_time import Outcome
    from showc.fleet.single_drone.model import Aircraft
    from showc.flight import Trajectory
    from showc.progress import Progress
    from showc.script.fence import Fence
    from showc.vehicle import Separation


TOLERANCE = 1e-7
"""How much nearer than the separation a pair may come by rounding [m]."""
_INTERVAL = 0.15
"""Length of a spline's interval [s], as far as their number allows."""
FINE, _FINEST = 200, 36
"""Drones below which changes have as many intervals as splines, and how many these are
at most: a change that turns quickly takes short ones."""
PRODUCTS = 5e8
"""Products of numbers in an untangling that take as long as one flight's solve."""
_FEWEST, _MOST = 10, 36
"""Half the number of a spline's intervals."""


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """Ways of drones in one common time, and what they would fly alone."""

    bent: Mapping[int, PiecewisePolynomial]
    """Positions, by row, of those that leave what they would fly alone."""
    alone: Sequence[PiecewisePolynomial]
    """Positions and velocities of all drones, each on its own; none where those of
    another time do not tell."""

    def slowed(self, row: int, duration: float) -> PiecewisePolynomial:
        """Return what a drone flies alone, so slow that it takes a ``duration`` [s]."""
        one = self.alone[row]
        slower = duration / one.end
        pace = np.repeat([1.0, 1.0 / slower], 3)
        return PiecewisePolynomial(one.breaks * slower, one.coefficients * pace)


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """What a fleet is to fly in one common time."""

    name: str
    """For people."""
    aircraft: Aircraft
    separation: Separation
    start: FloatArray
    """Shape (n, 3) [m]."""
    goal: FloatArray
    """Shape (n, 3) [m]."""
    ends: Sequence[tuple[FloatArray, FloatArray]]
    """Start and goal of each drone: places (3,) to hover at, or states (13,)."""
    parked: FloatArray | None
    """Positions of drones that stand still and take no part, shape (m, 3) [m]."""
    names: IntArray
    """Numbers of the drones, from 0, shape (n,)."""
    shared: Profile | None
    """A profile that all drones can fly straight, however slow; None where some do not
    hover at an end."""
    detours: Mapping[int, Detour]
    """Ways of the drones, by row, that go round the fence's corners."""
    fence: Fence | None
    rounds: int
    """Rounds of half-spaces at most."""
    work: float
    """What may be done at most, as :attr:`Work.done` counts it."""
    known: Ways | None = None
    """Ways that kept apart in another common time."""
    others: Sequence[PiecewisePolynomial] = ()
    """Positions over the common time of drones that fly, and take no part."""
    free: bool = False
    """Whether ways would be as good in more time."""
    draft: bool = False
    """Whether a crowd that hardly parts is left to a flight in closed form."""
    most: float = np.inf
    """Pairs too near, from which on this time is not worth a search."""


class Work:
    """What flights are found with, and how much of it was done.

    Parameters
    ----------
    name
        Of the move, for people.
    """

    def __init__(self, name: str, workers: Workers, progress: Progress) -> None:
        self.name, self.workers, self.progress = name, workers, progress
        self.counts: dict[str, float] = {}
        """How often what was done, by name."""
        self.done = 0.0
        """All in all; the unit is a flight behind half-spaces that is solved."""

    def count(self, name: str, value: float = 1.0) -> None:
        """Count what was done."""
        self.counts[name] = self.counts.get(name, 0.0) + value

    def solve(
        self,
        name: str,
        function: Callable[..., Outcome],
        tasks: Sequence[tuple[object, ...]],
        title: str = "",
    ) -> list[Outcome]:
        """Solve flights, each on its own, and count them under ``name``.

        Without a ``title`` the watcher hears of no stage.
        """
        if title:
            self.progress.stage(f"{self.name}: {title}", len(tasks))
        heard = self.progress.advance if title else _unheard
        found: list[Outcome] = self.workers.run(function, tasks, heard)
        self.count(name, len(tasks))
        self.done += len(tasks)
        return found

    def untangle(self, function: Callable[..., Untangled], *task: object) -> Untangled:
        """Let a worker change a crowd: other legs' threads go on beside it."""
        found: Untangled
        (found,) = self.workers.run(function, [task], _unheard)
        self.count("untangled")
        return self.worked(found)

    def worked(self, found: Untangled) -> Untangled:
        """Add what changes of a crowd took to what was done."""
        self.done += found.work / PRODUCTS
        return found


def _unheard(steps: int) -> None:
    """Say nothing of a single drone's progress."""


class Flights:
    """Flights of all drones over one common time, each known by its row.

    Parameters
    ----------
    move
        What is to be flown.
    duration
        The common time [s].
    """

    def __init__(self, move: Move, duration: float) -> None:
        self.move, self.duration = move, duration
        self.aircraft, self.separation = move.aircraft, move.separation
        self.flown: list[Trajectory] = []
        self.kind: list[str] = []
        """How each drone is flown."""
        standing = () if move.parked is None else move.parked
        self.others = [
            *move.others,
            *(PiecewisePolynomial.constant(one, 0.0, duration) for one in standing),
        ]
        """Positions over time of all that take no part; their rows are the last."""
        half = np.clip(np.ceil(0.5 * duration / _INTERVAL), _FEWEST, _MOST)
        self.intervals = 2 * int(half)
        """Of splines."""
        self.few = len(move.start) < FINE
        """Whether time is left to look at every drone more closely."""
        fine = self.few and self.intervals <= _FINEST
        self.changes = self.intervals // (1 if fine else 2)
        """Of changes: as many, or half of them, so that both fit together."""
        self.hovers = np.linalg.norm(move.goal - move.start, axis=1) < STILL
        """Drones that do not move, and are flown around, shape (n,)."""
        for row, ends in enumerate(move.ends):
            self.hovers[row] &= not any(in_motion(end) for end in ends)
        self.reference: PiecewisePolynomial | None = None
        """Fraction of the way over time that all follow; None: each on its own."""
        self.strayed: dict[int, int] = {}
        """How often each drone was found outside the fence."""
        self._inside: set[int] = set()
        self._ways: dict[int, PiecewisePolynomial] = {}
        self._sampled: dict[int, FloatArray] = {}

    @property
    def bent(self) -> dict[int, PiecewisePolynomial]:
        """Ways that leave their lines, by row."""
        kinds = zip(self.flown, self.kind, strict=True)
        return {
            row: flight.state.select(slice(0, 3))
            for row, (flight, kind) in enumerate(kinds)
            if kind != STRAIGHT
        }

    @property
    def said(self) -> str:
        """How drones are flown, in words."""
        words = {
            STRAIGHT: "straight on the shared profile",
            SPLINE: "by splines",
            OPTIMAL: "by optimal control",
        }
        return ", ".join(
            f"{self.kind.count(kind)} {how}"
            for kind, how in words.items()
            if kind in self.kind
        )

    def take(self, row: int, kind: str, flight: Trajectory) -> None:
        """Let a drone fly something else."""
        self.flown[row], self.kind[row] = flight, kind
        self.forget(row)

    def forget(self, row: int) -> None:
        """Forget where a drone was wanted, and that it keeps within the fence."""
        self._sampled.pop(row, None)
        self._inside.discard(row)

    def aim(self, row: int, positions: FloatArray, way: PiecewisePolynomial) -> None:
        """Want a drone elsewhere than it flies: at ``positions``, near ``way``."""
        self._sampled[row], self._ways[row] = positions, way

    @property
    def nodes(self) -> FloatArray:
        """Times of the nodes of the splines' intervals, shape (K, 7) [s]."""
        width = self.duration / self.intervals
        return np.asarray(width * (np.arange(self.intervals)[:, None] + NODES))

    def sampled(self, row: int) -> FloatArray:
        """Positions at these times, or where it is wanted then, shape (K, 7, 3) [m]."""
        if row not in self._sampled:
            if row < len(self.flown):
                position = self.flown[row].state.select(slice(0, 3))
            else:
                position = self.others[row - len(self.flown)]
            self._sampled[row] = position(self.nodes)
        return self._sampled[row]

    def way(self, row: int) -> PiecewisePolynomial:
        """Return what a drone that leaves its line flies near to."""
        if row not in self._ways and self.reference is not None:
            return self.reference
        if row not in self._ways:
            self._ways[row] = interpolated(self.sampled(row), self.duration)
        return self._ways[row]

    def conflicts(self) -> Encounters:
        """Find the pairs that come too near."""
        return self._found(self.flown)

    def lack(self, flight: Trajectory, near: Sequence[int]) -> float:
        """Sum of what a flight's distances to some drones lack [m]."""
        others = [self.flown[row] for row in near if row < len(self.flown)]
        found = self._found([flight, *others])
        own = found.distance[found.first == 0]
        return float(np.sum(self.separation.distance - own))

    def lacking(self, found: Encounters) -> float:
        """Sum of what the distances of pairs that come too near lack [m]."""
        return float(np.sum(self.separation.distance - found.distance))

    def _found(self, flights: Sequence[Trajectory]) -> Encounters:
        return conflicts(
            tracks_of(flights, others=self.others),
            self.separation,
            self.separation.distance - TOLERANCE,
        )

    def astray(self) -> dict[int, float]:
        """Rows of drones outside the fence's margin, and when that is found [s]."""
        fence = self.move.fence
        found: dict[int, float] = {}
        for row, flight in enumerate(self.flown if fence is not None else ()):
            assert fence is not None  # noqa: S101 - the line above says so
            if row in self._inside:
                continue
            state = flight.state
            time = fence.first_breach(state.coefficients[..., :2], state.breaks)
            if time is None:
                self._inside.add(row)
            else:
                found[row] = time
                self.strayed[row] = self.strayed.get(row, 0) + 1
        return found

    def wrong(self, found: Encounters, astray: Mapping[int, float]) -> str:
        """Say what comes too near, or leaves the fence."""
        fence = self.move.fence
        if fence is not None and not len(found):
            row = min(astray)
            return (
                f"drone {self.move.names[row] + 1} {fence.breach} at "
                f"{astray[row]:.2f} s (drones that do: {len(astray)})"
            )
        worst = int(np.argmin(found.distance))
        first, second = int(found.first[worst]), int(found.second[worst])
        pair = f"drone {self.move.names[first] + 1} and another drone"
        if second < len(self.flown):
            names = self.move.names[first] + 1, self.move.names[second] + 1
            pair = f"drones {names[0]} and {names[1]}"
        return (
            f"{pair} come within {found.distance[worst]:.3f} m "
            f"at {found.time[worst]:.2f} s, the separation is "
            f"{self.separation.distance:.3f} m ({len(found)} pairs in all)"
        )
