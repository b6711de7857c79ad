"""Collocation points integrate what their rule promises."""

from __future__ import annotations

import numpy as np
import pytest

from showc.ocp.nodes import bernstein_derivative, bernstein_values, collocation
from showc.trajectory import PiecewisePolynomial

EXACT = {"gauss": -1, "radau": -2, "lobatto": -3}


@pytest.mark.parametrize("scheme", EXACT)
@pytest.mark.parametrize("points", [2, 3, 5, 9])
def test_quadrature_is_exact_up_to_its_degree_and_no_further(scheme, points):
    nodes, weights = collocation(scheme, points)
    highest = 2 * points + EXACT[scheme]
    for degree in range(highest + 1):
        assert weights @ nodes**degree == pytest.approx(1.0 / (degree + 1), abs=1e-13)
    beyond = highest + 1
    assert abs(weights @ nodes**beyond - 1.0 / (beyond + 1)) > 1e-13


@pytest.mark.parametrize("points", [2, 4, 7])
def test_ends_belong_to_radau_and_lobatto_as_their_names_say(points):
    assert collocation("gauss", points)[0].min() > 0.0
    assert collocation("gauss", points)[0].max() < 1.0
    assert collocation("radau", points)[0][0] > 0.0
    assert collocation("radau", points)[0][-1] == 1.0
    lobatto = collocation("lobatto", points)[0]
    assert lobatto[0] == 0.0 and lobatto[-1] == 1.0


def test_unknown_scheme_and_too_few_points_are_refused():
    with pytest.raises(ValueError, match="wanted 'gauss', 'radau' or 'lobatto'"):
        collocation("chebyshev", 3)
    with pytest.raises(ValueError, match="1 points; wanted 2"):
        collocation("lobatto", 1)


def test_bernstein_matrices_agree_with_the_polynomial_they_belong_to():
    rng = np.random.default_rng(3)
    coefficients = rng.normal(size=6)
    curve = PiecewisePolynomial(np.array([0.0, 1.0]), coefficients[None, :, None])
    places = (0.0, 0.2, 0.77, 1.0)
    assert bernstein_values(5, places) @ coefficients == pytest.approx(
        curve(places)[:, 0]
    )
    slope = bernstein_derivative(5, places) @ coefficients
    assert slope == pytest.approx(curve.derivative()(places)[:, 0])
