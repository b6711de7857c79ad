"""Ways round: along the solved flight's bend, or apart in height."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from showc.schedule.distances import conflict_colours, point_distance
from showc.schedule.releases import ordered

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from showc.arrays import FloatArray, IntArray
    from showc.autopilot.stage import Lines, Stage, StageBuilder
    from showc.flight import LegFlight
    from showc.plan.itinerary import Leg
    from showc.schedule.headways import Gaps
    from showc.schedule.surroundings import Surroundings


BENDS = (1.0, 1.15, 1.3, 1.6, 2.0, 2.5, 3.2, 4.0)
"""Factors on the sideways part of the solved flight's bend."""

STRAIGHT = 0.05
"""A solved flight that leaves the straight line by less has no bend to follow [m]."""


def bends(
    leg: Leg, flight: LegFlight, builder: StageBuilder, around: Surroundings
) -> list[tuple[str, list[Lines]]]:
    """Two straight legs along the solved flight, or outside it."""
    start, goal = around.positions[leg.drones], leg.goal
    low, high = np.array(leg.limits.position_min), np.array(leg.limits.position_max)
    middle = 0.5 * flight.duration
    solved = np.array([path.state(middle)[:3] for path in flight.trajectories])
    line = _nearest_on_line(solved, start, goal)
    if np.linalg.norm(solved - line, axis=1).max() < STRAIGHT:
        return []
    ways = [
        [start, np.clip(line + bend * (solved - line), low, high), goal]
        for bend in BENDS
    ]
    names = [f"2 legs, bend x {bend:g}" for bend in BENDS]
    return list(zip(names, builder.ways(leg.drones, ways, leg.limits), strict=True))


def layers(
    leg: Leg, builder: StageBuilder, around: Surroundings, straight: Stage
) -> Iterator[tuple[str, list[Lines]]]:
    """Apart in height, across, and back: drones whose lines meet get other layers."""
    colour = conflict_colours(straight, around.separation, around.required)
    separation = around.separation
    step = 1.05 * separation.distance / separation.metric_scale[2] + 0.05
    low, high = leg.limits.position_min[2], leg.limits.position_max[2]
    rank = np.searchsorted(leg.drones, straight.drones)
    start, goal = around.positions[leg.drones], leg.goal
    # Upwards, downwards, alternately above and below.
    sides = (
        colour,
        -colour,
        np.where(colour % 2, (colour + 1) // 2, -(colour // 2)),
    )
    for side in sides:
        rise = np.zeros((leg.drones.size, 3))
        rise[rank, 2] = side * step
        heights = np.concatenate([(start + rise)[:, 2], (goal + rise)[:, 2]])
        if heights.min() < low or heights.max() > high:
            continue
        places = [start, start + rise, goal + rise, goal]
        name = f"{int(colour.max()) + 1} layers"
        (found,) = builder.ways(leg.drones, [places], leg.limits)
        yield name, found


def _nearest_on_line(
    points: FloatArray, start: FloatArray, goal: FloatArray
) -> FloatArray:
    """Feet (n, 3) of ``points`` on the straight lines from ``start`` to ``goal``."""
    along = goal - start
    length = np.sum(along**2, axis=1)
    part = np.sum((points - start) * along, axis=1) / np.where(length > 0, length, 1.0)
    return np.asarray(start + np.clip(part, 0.0, 1.0)[:, None] * along)


ROOM = 0.3
"""How much farther than the separation the lowest layer is above all others [m]."""

MARGIN = 0.05
"""How much farther than the separation ways up and down stay from drones there [m]."""

BEARINGS = 40
"""Slanted ways up and down that are tried for each slope."""

SLOPES = tuple(0.1 * step for step in range(16))
"""Level over vertical part of ways up and down."""

ABOUT = 64
"""Nearest drones, of which ways are kept clear first."""


def hops(
    leg: Leg,
    builder: StageBuilder,
    around: Surroundings,
    straight: Stage,
    gaps: Gaps,
) -> Iterator[tuple[str, list[Lines]]]:
    """Return the encoding with the fewest drones above the others, if there is one.

    ``straight`` is the stage of straight lines, ``gaps`` which drone may pass which.
    """
    start, goal = around.positions.copy(), around.positions.copy()
    goal[leg.drones] = leg.goal
    low = float(max(start[:, 2].max(), goal[:, 2].max()))
    ways = _Ways(start, goal, straight.drones, around, low)
    chosen = _who_hops(gaps, ways, barred(straight, start, around))
    if chosen is None or not chosen.size:
        return
    drones = straight.drones[chosen]
    both = np.array([ways.of(int(row)) for row in chosen])
    up, down = both[:, 0], both[:, 1]
    step = 1.05 * around.separation.distance / around.separation.metric_scale[2] + 0.05
    height = np.full(drones.size, low + step + ROOM)
    crossing = builder.build(
        drones,
        _raised(start[drones], up, height),
        _raised(goal[drones], down, height),
        leg.limits,
    )
    colour = conflict_colours(crossing, around.separation, around.required)
    height[np.searchsorted(drones, crossing.drones)] += step * colour
    above, across = start.copy(), goal.copy()
    above[drones] = _raised(start[drones], up, height)
    across[drones] = _raised(goal[drones], down, height)
    stops = [side[leg.drones] for side in (start, above, across, goal)]
    box_low, box_high = leg.limits.position_min, leg.limits.position_max
    if np.any(np.min(stops, axis=(0, 1)) < box_low) or np.any(
        np.max(stops, axis=(0, 1)) > box_high
    ):
        return
    name = f"{drones.size} of {straight.drones.size} drones above the others"
    (found,) = builder.ways(leg.drones, [stops], leg.limits)
    yield name, found


def _raised(places: FloatArray, ways: FloatArray, height: FloatArray) -> FloatArray:
    """Follow ``ways`` (n, 2) from ``places`` (n, 3) up to ``height`` (n,) [m]."""
    rise = (height - places[:, 2])[:, None]
    return np.asarray(places + rise * np.column_stack([ways, np.ones(len(ways))]))


def barred(stage: Stage, places: FloatArray, around: Surroundings) -> set[int]:
    """Return which of a stage's drones have lines that come too near one that rests.

    ``places`` (drones, 3) [m] is where everyone is; what returns are positions in the
    stage.
    """
    resting = np.delete(places, stage.drones, axis=0)
    if not len(resting):
        return set()
    row, other = np.divmod(np.arange(stage.drones.size * len(resting)), len(resting))
    rest = resting[other]
    line = stage.begin[row], stage.farthest[row]
    near = point_distance(rest, line, around.separation) < around.required
    return set(row[near].tolist())


def _who_hops(gaps: Gaps, ways: _Ways, blocked: set[int]) -> IntArray | None:
    """Positions in the stage of drones without which the others can be put in order.

    Those that are ``blocked``, and greedily: of each pair that meets in either order
    the busier one, then the drone in most orders that go round in circles.
    None if some of them cannot hop.
    """
    before, hopeless = gaps.order(), gaps.hopeless()
    chosen = set(blocked)
    # Of each of these groups one drone has to hop.
    groups = [*((drone,) for drone in sorted(blocked)), *hopeless]
    if not all(any(map(ways.of, group)) for group in groups):
        return None

    def take(counts: Mapping[int, int]) -> bool:
        for drone in sorted(counts, key=lambda drone: (-counts[drone], drone)):
            if ways.of(drone) is not None:
                chosen.add(drone)
                return True
        return False

    while left := [pair for pair in hopeless if chosen.isdisjoint(pair)]:
        if not take(Counter(drone for pair in left for drone in pair)):
            return None
    rank = range(gaps.drones)
    while True:
        before = [pair for pair in before if chosen.isdisjoint(pair)]
        stuck = set(ordered(gaps.drones, before, rank)[1])
        # Backwards, too: what is only behind a circle is in none.
        inside = [pair for pair in before if stuck.issuperset(pair)]
        turned = [(later, earlier) for earlier, later in inside]
        stuck = set(ordered(gaps.drones, turned, rank)[1])
        if not stuck:
            return np.array(sorted(chosen), dtype=np.int64)
        inside = [pair for pair in inside if stuck.issuperset(pair)]
        first = Counter(earlier for earlier, _ in inside)
        second = Counter(later for _, later in inside)
        if not take({drone: first[drone] * second[drone] for drone in stuck}):
            return None


class _Ways:
    """Clear ways up from the starts of a stage's drones, and down to their ends."""

    def __init__(
        self,
        start: FloatArray,
        goal: FloatArray,
        drones: IntArray,
        around: Surroundings,
        top: float,
    ) -> None:
        self.sides = start, goal
        self.drones = drones
        self.around = around
        self.top = top
        self.found: dict[int, tuple[FloatArray, FloatArray] | None] = {}
        angle = np.arange(BEARINGS) * 2.0 * np.pi / BEARINGS
        # Those of one slope together, the steepest first.
        self.all = [
            slope * np.column_stack([np.cos(turns), np.sin(turns)])
            for slope in SLOPES
            for turns in (angle if slope else angle[:1],)
        ]

    def of(self, row: int) -> tuple[FloatArray, FloatArray] | None:
        """Level over vertical part (2,) of the ways up and down of a stage's drone."""
        if row not in self.found:
            up, down = (self._clear(row, places) for places in self.sides)
            self.found[row] = None if up is None or down is None else (up, down)
        return self.found[row]

    def _clear(self, row: int, places: FloatArray) -> FloatArray | None:
        """Return the steepest way that stays clear of all others' ``places``."""
        separation = self.around.separation
        needed = separation.distance + MARGIN
        own = places[self.drones[row]]
        rest = np.delete(places, self.drones[row], axis=0)
        # Hardly a way that is barred gets past the drones about it.
        rest = rest[np.argsort(np.linalg.norm(rest - own, axis=1), kind="stable")]
        rise = self.top + needed - own[2]
        for ways in self.all:
            clear = ways
            for others in (rest[:ABOUT], rest[ABOUT:]):
                ends = own + rise * np.column_stack([clear, np.ones(len(clear))])
                end = np.repeat(ends, len(others), axis=0)
                line = np.broadcast_to(own, end.shape), end
                near = point_distance(np.tile(others, (len(ends), 1)), line, separation)
                apart = near.reshape(len(ends), len(others)) >= needed
                clear = clear[apart.all(axis=1)]
            if len(clear):
                return np.asarray(clear[0])
        return None
