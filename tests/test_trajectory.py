"""Piecewise polynomials keep their values whatever is done to their form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from showc.trajectory import PiecewisePolynomial, combined, concatenate, evaluated


@st.composite
def polynomials(draw):
    intervals = draw(st.integers(1, 4))
    degree = draw(st.integers(0, 5))
    widths = draw(hnp.arrays(float, intervals, elements=st.floats(0.01, 10.0)))
    coefficients = draw(
        hnp.arrays(
            float,
            (intervals, degree + 1, 2),
            elements=st.floats(-100.0, 100.0),
        )
    )
    return PiecewisePolynomial(np.concatenate([[0.0], np.cumsum(widths)]), coefficients)


fractions = st.lists(st.floats(0.001, 0.999), min_size=1, max_size=5)


@given(polynomials(), fractions)
def test_split_keeps_every_value(polynomial, where):
    parts = polynomial.split(np.array(where) * polynomial.end)
    times = np.linspace(0.0, polynomial.end, 57)
    inside = ~np.isclose(times[:, None], polynomial.breaks[None, 1:-1]).any(axis=1)
    np.testing.assert_allclose(
        parts(times[inside]), polynomial(times[inside]), atol=1e-8
    )


@given(polynomials(), fractions)
def test_split_never_widens_the_enclosure(polynomial, where):
    lower, upper = polynomial.bounds()
    part_lower, part_upper = polynomial.split(np.array(where) * polynomial.end).bounds()
    assert (part_lower >= lower - 1e-9).all()
    assert (part_upper <= upper + 1e-9).all()


@given(polynomials())
def test_coefficients_enclose_all_values(polynomial):
    lower, upper = polynomial.bounds()
    values = polynomial(np.linspace(0.0, polynomial.end, 201))
    assert (values >= lower - 1e-9).all()
    assert (values <= upper + 1e-9).all()


@given(polynomials(), st.integers(0, 4))
def test_elevation_keeps_every_value(polynomial, more):
    raised = polynomial.elevated(polynomial.degree + more)
    times = np.linspace(0.0, polynomial.end, 31)
    np.testing.assert_allclose(raised(times), polynomial(times), atol=1e-9)
    assert raised.degree == polynomial.degree + more


def test_derivative_of_a_known_polynomial():
    # t^3 on [0, 2]: Bernstein coefficients 0, 0, 0, 8
    cubic = PiecewisePolynomial(
        np.array([0.0, 2.0]), np.array([[[0.0], [0.0], [0.0], [8.0]]])
    )
    times = np.linspace(0.0, 2.0, 11)
    np.testing.assert_allclose(cubic(times)[:, 0], times**3, atol=1e-12)
    np.testing.assert_allclose(
        cubic.derivative()(times)[:, 0], 3.0 * times**2, atol=1e-12
    )


def test_concatenation_refuses_a_gap():
    first = PiecewisePolynomial.constant([1.0], 0.0, 1.0)
    with pytest.raises(ValueError, match=r"gap between 1\.0 s and 1\.5 s"):
        concatenate([first, PiecewisePolynomial.constant([1.0], 1.5, 2.0)])


def test_arrays_cannot_be_written():
    polynomial = PiecewisePolynomial.constant([1.0], 0.0, 1.0)
    with pytest.raises(ValueError, match="read-only"):
        polynomial.coefficients[0, 0, 0] = 2.0


@pytest.mark.parametrize("breaks", [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0, 2.0]])
def test_breaks_must_fit_and_increase(breaks):
    with pytest.raises(ValueError, match="breaks"):
        PiecewisePolynomial(np.array(breaks), np.zeros((1, 2, 1)))


def test_polynomials_evaluated_together_are_those_evaluated_alone():
    random = np.random.default_rng(3)
    borders = [np.array([0.0, 1.0, 2.5]), np.array([0.0, 2.5])]
    paths = [
        PiecewisePolynomial(breaks, random.normal(size=(breaks.size - 1, size, 3)))
        for breaks, size in zip(borders * 3, (4, 4, 6, 1, 4, 4), strict=True)
    ]
    times = np.linspace(-0.5, 3.0, 12).reshape(3, 4)
    alone = np.stack([path(times) for path in paths])
    assert np.array_equal(evaluated(paths, times), alone)


@pytest.mark.parametrize("many", [(), (1,), (2, 3)])
def test_coefficients_are_combined_as_a_matrix_says(many):
    random = np.random.default_rng(4)
    matrix, values = random.normal(size=(5, 4)), random.normal(size=(*many, 4, 2))
    assert np.allclose(
        combined(matrix, values), matrix @ values, rtol=1e-14, atol=1e-14
    )
