"""Ways round: along the solved flight's bend, or apart in height."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.mission.conflicts import conflict_colours

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from showc.flight import LegFlight
    from showc.mission.stage import Lines, Stage, StageBuilder
    from showc.mission.surroundings import Surroundings
    from showc.plan.itinerary import Leg

    FloatArray = NDArray[np.float64]

BENDS = (1.0, 1.15, 1.3, 1.6, 2.0, 2.5, 3.2, 4.0)
"""Factors on the sideways part of the solved flight's bend."""

STRAIGHT = 0.05
"""A solved flight that leaves the straight line by less has no bend to follow [m]."""


def bends(
    leg: Leg,
    flight: LegFlight,
    builder: StageBuilder,
    around: Surroundings,
    stops: int,
) -> list[tuple[str, list[Lines]]]:
    """Straight legs along the solved flight, or outside it, with some ``stops``."""
    start, goal = around.positions[leg.drones], leg.goal
    low, high = np.array(leg.limits.position_min), np.array(leg.limits.position_max)
    solved = [
        np.array(
            [
                trajectory.state(stop / (stops + 1) * flight.duration)[:3]
                for trajectory in flight.trajectories
            ]
        )
        for stop in range(1, stops + 1)
    ]
    lines = [_nearest_on_line(places, start, goal) for places in solved]
    aside = [
        np.linalg.norm(a - b, axis=1).max() for a, b in zip(solved, lines, strict=True)
    ]
    if max(aside) < STRAIGHT:
        return []
    corners = [
        [
            np.clip(line + bend * (places - line), low, high)
            for places, line in zip(solved, lines, strict=True)
        ]
        for bend in BENDS
    ]
    names = [f"{stops + 1} legs, bend x {bend:g}" for bend in BENDS]
    ways = [[start, *places, goal] for places in corners]
    found = builder.ways(leg.drones, ways, leg.limits)
    return list(zip(names, found, strict=True))


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
