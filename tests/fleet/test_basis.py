"""The splines of the convex program, against SciPy's."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from showc.fleet.single_drone.basis import DEGREE, LOCAL, spline_basis
from showc.trajectory import bernstein_basis


@pytest.mark.parametrize("intervals", [1, 2, 7, 40])
def test_bernstein_coefficients_are_those_of_the_spline(intervals):
    duration = 5.0
    knots = duration * np.concatenate(
        [np.zeros(DEGREE), np.linspace(0.0, 1.0, intervals + 1), np.ones(DEGREE)]
    )
    chosen = np.random.default_rng(intervals).normal(size=intervals + DEGREE)
    spline = BSpline(knots, chosen, DEGREE)
    basis = spline_basis(intervals, duration)
    part = np.linspace(0.02, 0.98, 9)
    for k in range(intervals):
        local = chosen[k : k + LOCAL]
        at = (k + part) * duration / intervals
        for matrix, degree, order in (
            (basis.position, DEGREE, 0),
            (basis.velocity, DEGREE - 1, 1),
            (basis.acceleration, DEGREE - 2, 2),
            (basis.jerk, DEGREE - 2, 3),
        ):
            found = bernstein_basis(degree, part) @ (matrix[k] @ local)
            wanted = spline.derivative(order)(at) if order else spline(at)
            scale = 1.0 + np.abs(wanted).max()
            assert found == pytest.approx(wanted, abs=1e-11 * scale)
