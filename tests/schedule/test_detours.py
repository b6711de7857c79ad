"""Ways up and down: the steepest clear one, and no more of them than needed."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.schedule import detours
from showc.schedule.distances import point_distance
from showc.schedule.headways import Gaps
from showc.vehicle import Separation


def looked_for(start, goal, drones, separation):
    """Return what looks for ways of ``drones`` among all others."""
    top = float(max(start[:, 2].max(), goal[:, 2].max()))
    around = SimpleNamespace(separation=separation)
    return detours._Ways(start, goal, np.array(drones), around, top)


def one_by_one(places, drone, top, separation):
    """Try each way up from a drone's place against all others at once."""
    apart = separation.distance + detours.MARGIN
    others = np.delete(places, drone, axis=0)
    foot = np.repeat(places[drone][None], len(others), axis=0)
    for slope in detours.SLOPES:
        for number in range(detours.BEARINGS if slope else 1):
            turn = 2.0 * np.pi * number / detours.BEARINGS
            way = np.array([slope * np.cos(turn), slope * np.sin(turn), 1.0])
            head = foot + (top + apart - foot[:, 2:]) * way
            if np.all(point_distance(others, (foot, head), separation) >= apart):
                return way[:2]
    return None


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
@pytest.mark.parametrize("shape", ["sphere", "any-axis"])
def test_the_ways_found_are_the_steepest_that_are_clear_of_all_others(shape, seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(*[(3, 61), (70, 91)][seed % 2]))
    side = rng.uniform(1.5, 4.5) * np.sqrt(count)
    places = rng.uniform(0.0, [side, side, rng.uniform(0.0, 5.0)], (2, count, 3))
    # Two are looked at; over them are some others, that far up that many are nearer.
    middle = places[:, : 2 + count // 15]
    middle[..., :2] = 0.25 * middle[..., :2] + 0.375 * side
    middle[:, 2:, 2] += rng.uniform(3.0, 20.0)
    order = rng.permutation(count)
    start, goal = places[:, order]
    drones = np.flatnonzero(order < 2)
    ways = looked_for(start, goal, drones, Separation(1.0, shape))
    for row, drone in enumerate(drones):
        found = ways.of(row)
        both = (
            one_by_one(places, drone, ways.top, ways.around.separation)
            for places in (start, goal)
        )
        if found is None:
            assert any(way is None for way in both)
            continue
        for way, steepest in zip(found, both, strict=True):
            assert steepest is not None
            assert way == pytest.approx(steepest, abs=1e-12)


def test_the_first_pair_of_which_neither_drone_has_a_way_ends_the_search():
    block = 1.2 * np.array(list(np.ndindex(5, 5, 4)), dtype=float)
    row = np.array([[3.0 * k, 20.0, 0.0] for k in range(60)])
    places = np.concatenate([block, row])
    # Lowest in the middle of the block, and beside it.
    inner = [int(np.ravel_multi_index((2, y, 0), (5, 5, 4))) for y in (2, 3)]
    outer = len(block) + np.arange(len(row)).reshape(-1, 2)
    pairs = np.concatenate([[inner], outer])

    def hop(chosen):
        ways = looked_for(places, places, range(len(places)), Separation(1.0))
        never = np.full(len(chosen), np.inf)
        gaps = Gaps(len(places), *chosen.T, never, never)
        return detours._who_hops(gaps, ways, set()), ways.found

    found, looked = hop(outer)
    assert found.size == len(outer) <= len(looked)
    found, looked = hop(pairs)
    assert found is None
    assert looked == dict.fromkeys(inner)
