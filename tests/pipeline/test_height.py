"""The greatest height of a show is that of its coefficients as the log has them."""

from types import SimpleNamespace

import numpy as np

from showc.pipeline.compile import _greatest_height
from showc.trajectory import PiecewisePolynomial
from showc.verify.kernel.show import PieceTable


def state(heights):
    coefficients = np.zeros((1, len(heights), 12))
    coefficients[0, :, 2] = heights
    return PiecewisePolynomial(np.array([0.0, 2.0]), coefficients)


def test_flights_of_two_degrees_count_in_the_greater_one():
    states = [state([0.0, 9.0, 0.0]), state([0.0, 1.0, 2.0, 1.0, 0.0])]
    leg = SimpleNamespace(trajectories=[SimpleNamespace(state=one) for one in states])
    found = _greatest_height(SimpleNamespace(legs=[leg]))
    tables = [
        PieceTable(
            np.array([drone]),
            np.array([0, 1]),
            *(np.array([time]) for time in (0.0, 2.0)),
            one.coefficients,
            np.zeros((1, 1, 4)),
        )
        for drone, one in enumerate(states)
    ]
    logged = PieceTable.joined(tables).state[:, :, 2].max()
    assert abs(found - logged) < 1e-12
    assert 4.5 <= found < 9.0
