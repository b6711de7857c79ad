"""Many instants evaluated piece by piece are what one at a time gives."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.verify.kernel.bernstein import basis
from showc.verify.kernel.show import PieceTable
from showc.verify.samples import evaluate


def random_table(seed):
    """Drones over the same time, some on meshes of their own, some on common ones."""
    random = np.random.default_rng(seed)
    meshes = [
        np.concatenate([[0.0], np.sort(random.uniform(0.1, 3.9, count - 1)), [4.0]])
        for count in random.integers(1, 6, size=random.integers(1, 5))
    ]
    drones = random.integers(1, 15)
    # The first mesh has most of them; the last shares one of its intervals.
    meshes += [np.unique(np.concatenate([meshes[0][:2], meshes[-1][-2:]]))]
    breaks = [meshes[k] for k in random.geometric(0.6, drones).clip(1, len(meshes)) - 1]
    counts = np.array([one.size - 1 for one in breaks])
    rows = int(counts.sum())
    return PieceTable(
        np.arange(drones) * 3,
        np.concatenate([[0], np.cumsum(counts)]),
        np.concatenate([one[:-1] for one in breaks]),
        np.concatenate([one[1:] for one in breaks]),
        random.normal(size=(rows, random.integers(1, 8), 12)),
        random.normal(size=(rows, random.integers(1, 6), 4)),
    )


def one_by_one(table, drone, time):
    """By the definition: the last piece that has begun, its basis summed up."""
    first, last = table.first[drone], table.first[drone + 1]
    begun = np.flatnonzero(table.start[first:last] <= time)
    row = first + (begun[-1] if begun.size else 0)
    share = (time - table.start[row]) / (table.end[row] - table.start[row])
    share = min(max(share, 0.0), 1.0)
    return np.concatenate(
        [
            basis(part.shape[1] - 1, share) @ part[row]
            for part in (table.state, table.control)
        ]
    )


@settings(deadline=None, max_examples=100, derandomize=True)
@given(
    st.integers(0, 10_000),
    st.lists(st.floats(-1.0, 5.0), min_size=1, max_size=12),
    st.booleans(),
)
def test_all_at_once_is_one_by_one(seed, times, joints):
    table = random_table(seed)
    if joints:
        times = [*times, *table.start, *table.end]
    instants = np.sort(np.array(times))
    together = evaluate(table, instants)
    for drone in range(table.drones.size):
        for number, time in enumerate(instants):
            single = one_by_one(table, drone, time)
            np.testing.assert_allclose(together[number, drone], single, atol=1e-12)


@given(st.integers(0, 12), st.lists(st.floats(0.0, 1.0), min_size=1, max_size=5))
def test_basis_is_its_definition(degree, fractions):
    from math import comb

    s = np.array(fractions)
    wanted = [
        comb(degree, j) * s**j * (1.0 - s) ** (degree - j) for j in range(degree + 1)
    ]
    np.testing.assert_allclose(basis(degree, s), np.stack(wanted, -1), atol=1e-13)
