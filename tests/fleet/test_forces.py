"""Forces push places, speeds and accelerations to where rows ask them to be."""

import numpy as np
import pytest

from showc.fleet.deconfliction.forces import Reach, Rows, raised, scales

SAMPLES, COEFFICIENTS = 6, 4


@pytest.mark.parametrize("fast", [0, 3, 9])
def test_rows_of_places_and_of_rates_are_met_by_the_forces_found(fast):
    draw = np.random.default_rng(fast)
    reach = draw.standard_normal((3 * SAMPLES, COEFFICIENTS))
    pairs = np.array([[0, 1], [2, 3], [7, 4], [8, 0]])
    drone = np.repeat(pairs, 2, axis=1)
    sample = np.tile(draw.integers(0, SAMPLES - 1, 4)[:, None], (1, 4)) + [0, 1, 0, 1]
    value = draw.standard_normal((4, 4, 3))
    # One of these pairs is nearest at a sample, and one drone cannot move.
    value[1, [1, 3]] = value[2, :2] = 0.0
    chosen = draw.permutation(9)[:fast, None]
    rates = draw.integers(SAMPLES, 3 * SAMPLES, (fast, 1))
    single = Rows(chosen, rates, draw.standard_normal((fast, 1, 3)))
    rows = Rows.joined(Rows(drone, sample, value), single)
    lack = draw.uniform(0.5, 1.0, rows.count)
    size, close = scales(rows, Reach(reach, SAMPLES)), 1e-3
    program = rows, Reach(reach, SAMPLES), lack * size, size, np.zeros(rows.count)
    found = raised(*program, close, 5000)
    assert np.all(found.force >= 0.0)
    inner = np.zeros((9, COEFFICIENTS, 3))
    inner[found.drones] = found.push
    more = rows.on(reach @ inner) - lack
    assert more.min() > -20.0 * close
    # Where there is more than is asked for, nothing pushes.
    assert more[found.force > 0.0] == pytest.approx(0.0, abs=20.0 * close)
    # They push the drones of rows, and of each pair only those that can move.
    assert set(found.drones.tolist()) == {0, 1, 2, 3, 4, 8} | set(chosen[:, 0].tolist())
    assert found.work > 0.0
