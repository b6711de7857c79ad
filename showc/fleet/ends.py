"""Ends of a leg: whether drones may stand there, and whether any flight joins them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.errors import SolveError
from showc.fleet.deconfliction.conflicts import standing
from showc.fleet.deconfliction.walls import reversed_order
from showc.plan.itinerary import STILL
from showc.script.fence import Fence
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.plan.itinerary import Leg
    from showc.script.show import Show
    from showc.vehicle import Separation

TOLERANCE = 1e-6
"""How much nearer than the separation a pair may come by rounding [m]."""


def check_ends(leg: Leg, show: Show) -> None:
    """Refuse places that break the separation, the flight volume or the fence.

    Raises
    ------
    SolveError
        Naming the drone or the pair, where they stand, and what to do.
    """
    limits, separation = leg.limits, show.separation
    fence = Fence.of(show.site)
    ends = [(leg.start, leg.from_formation), (leg.goal, leg.to_formation)]
    if np.array_equal(leg.start, leg.goal):
        del ends[1]
    for points, formation in ends:
        low, high = points - limits.position_min, limits.position_max - points
        outside = (np.minimum(low, high) < -STILL).any(axis=1)
        if outside.any():
            drone = int(leg.drones[int(np.argmax(outside))])
            x, y, z = points[int(np.argmax(outside))]
            raise SolveError(
                f"{place(leg)}: drone {drone + 1} at ({x:.2f}, {y:.2f}, {z:.2f}) m "
                f"in {formation!r} is outside the flight volume; move the "
                "formation or widen the volume"
            )
        if fence is not None and not fence.keeps(points[:, :2]).all():
            clearance = fence.clearance(points[:, :2])
            drone = int(leg.drones[int(np.argmin(clearance))])
            raise SolveError(
                f"{place(leg)}: drone {drone + 1} in {formation!r} is "
                f"{clearance.min():.2f} m within the fence; the margin is "
                f"{fence.margin:.2f} m; move the formation or the fence"
            )
        parked = leg.others_parked
        found = standing(
            points if parked is None else np.vstack([points, parked]),
            len(points),
            separation,
            separation.distance - TOLERANCE,
        )
        if len(found):
            first, second = int(found.first[0]), int(found.second[0])
            stays = np.ones(len(points) + (0 if parked is None else len(parked)), bool)
            stays[: len(points)] = (leg.start == leg.goal).all(axis=1)
            waits = first if stays[first] else second
            advice = "spread the formation"
            if stays[first] != stays[second]:
                name = pair_names(leg, first, second).split(" and ")[waits == second]
                advice = (
                    f"{name} waits there: move the formation away, or move it first"
                )
            raise SolveError(
                f"{place(leg)}: {pair_names(leg, first, second)} stand "
                f"{found.distance[0]:.3f} m apart in {formation!r}, the separation "
                f"is {separation.distance:.3f} m; {advice}"
            )
    _check_order(leg, separation)


def _check_order(leg: Leg, separation: Separation) -> None:
    """Refuse what no flight can do: change order where there is no room to pass."""
    across = _across(leg, separation)
    axes = np.flatnonzero(across < separation.distance - TOLERANCE).tolist()
    found = reversed_order(leg.start, leg.goal, leg.others_parked, axes)
    if found is None:
        return
    first, second, axis = found
    name = "xyz"[axis]
    head = (
        f"{place(leg)}: {pair_names(leg, first, second)} stand in one order along "
        f"{name} in {leg.from_formation!r} and in the other in {leg.to_formation!r}, "
    )
    if separation.shape == "all-axes":
        raise SolveError(
            f"{head}but have to be {separation.distance:.3f} m "
            "apart along all three axes at every instant: no time is enough; let "
            "'any-axis' or 'sphere' hold, or choose another assignment"
        )
    raise SolveError(
        f"{head}but the flight volume has {across[axis]:.3f} m across {name} and the "
        f"separation is {separation.distance:.3f} m (both as {separation.shape!r} "
        "measures): no time is enough; widen the volume, or choose another assignment"
    )


def _across(leg: Leg, separation: Separation) -> FloatArray:
    """Greatest distances of two drones side by side along each axis, shape (3,) [m].

    Drones that change their order along an axis are side by side at some instant.
    """
    if separation.shape == "all-axes":
        return np.zeros(3)
    low = np.asarray(leg.limits.position_min)
    high = np.asarray(leg.limits.position_max)
    if leg.others_parked is not None:
        low = np.minimum(low, leg.others_parked.min(axis=0))
        high = np.maximum(high, leg.others_parked.max(axis=0))
    return measure(np.where(np.eye(3) > 0.0, 0.0, high - low), separation)


def place(leg: Leg) -> str:
    """Where the script asks for the leg, as ``path:line:column: name``."""
    return leg.name if leg.mark is None else f"{leg.mark}: {leg.name}"


def pair_names(leg: Leg, first: int, second: int) -> str:
    """Names of two drones for people; after ``leg.drones`` come those of no part."""
    one = f"drone {int(leg.drones[first]) + 1}"
    every = [*leg.drones.tolist(), *leg.others_drones]
    if second < len(every):
        return f"{one} and drone {every[second] + 1}"
    return f"{one} and another drone"
