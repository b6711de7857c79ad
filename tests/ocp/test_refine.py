"""Meshes change where and how they should, and stay meshes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc import ocp
from showc.ocp.refinement.refine import (
    MOST_POINTS,
    IntervalErrors,
    cells_of,
    cut_places,
    decay_rate,
    mesh_of,
    not_helped,
    refine,
    summary,
)
from showc.ocp.solution import PhaseSolution
from showc.trajectory import PiecewisePolynomial, bernstein_basis_inverse


def fitted(function, breaks, degree) -> PiecewisePolynomial:
    places = tuple(0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree))
    inverse = bernstein_basis_inverse(degree, places)
    breaks = np.asarray(breaks, dtype=float)
    pieces = []
    for a, b in pairwise(breaks):
        pieces.append(inverse @ function(a + (b - a) * np.array(places))[:, None])
    return PiecewisePolynomial(breaks, np.stack(pieces))


def solution_of(function, breaks, degree) -> PhaseSolution:
    curve = fitted(function, breaks, degree)
    mesh = ocp.PhaseMesh.from_breaks(breaks, [degree] * (len(breaks) - 1))
    control = PiecewisePolynomial(curve.breaks, curve.coefficients[:, :1])
    return PhaseSolution(
        "p", mesh, np.array([breaks[-1] - breaks[0]]), ("x",), ("u",), curve, control,
        np.zeros(0), np.zeros((0, 1)),
    )  # fmt: skip


def apply(part, indicator, must_cut=None, jumps=(), **options):
    none = np.zeros(part.mesh.intervals, dtype=bool)
    cut = none if must_cut is None else must_cut
    errors = IntervalErrors(np.asarray(indicator, dtype=float), cut, jumps)
    return refine(part.mesh, part, errors, **{"scale": np.ones(1)} | options)


def test_smooth_intervals_get_a_higher_degree_and_kinks_are_cut():
    smooth = solution_of(np.exp, [0.0, 1.0, 2.0], 6)
    mesh, decisions = apply(smooth, [50.0, 0.5])
    assert mesh.points[0] > 6 and mesh.points[1] == 6 and mesh.intervals == 2
    assert [d.step for d in decisions] == [ocp.Step.RAISED, ocp.Step.KEPT]
    assert "decades a degree" in decisions[0].reason and not decisions[1].reason
    assert "raised the degree on 1" in summary(decisions)
    kinked = solution_of(lambda t: np.abs(t - 0.5), [0.0, 1.0, 2.0], 6)
    mesh, decisions = apply(kinked, [50.0, 0.5])
    assert mesh.intervals > 2
    assert decisions[0].step is ocp.Step.CUT
    assert "cut 1 intervals" in summary(decisions)


def test_a_given_control_degree_forces_a_cut():
    smooth = solution_of(np.exp, [0.0, 1.0, 2.0], 6)
    mesh, decisions = apply(smooth, [50.0, 0.5], must_cut=np.array([True, False]))
    assert mesh.intervals > 2
    assert "degree is given" in decisions[0].reason


def test_an_interval_that_a_higher_degree_did_not_help_is_cut():
    former = solution_of(np.exp, [0.0, 1.0, 2.0], 4).mesh
    smooth = solution_of(np.exp, [0.0, 1.0, 2.0], 6)
    before, after = np.array([1e-3, 1e-3]), np.array([9e-4, 1e-5])
    stubborn = not_helped(smooth.mesh, after, former, before)
    assert stubborn.tolist() == [True, False]
    assert not not_helped(former, after, former, before).any()
    errors = IntervalErrors(
        np.full(2, 50.0), np.zeros(2, dtype=bool), stubborn=stubborn
    )
    mesh, decisions = refine(smooth.mesh, smooth, errors, scale=np.ones(1))
    assert [d.step for d in decisions] == [ocp.Step.CUT, ocp.Step.RAISED]
    assert "did not help" in decisions[0].reason
    assert mesh.intervals > 2


def test_needless_intervals_are_merged_and_needed_ones_kept():
    line = solution_of(lambda t: 2.0 * t, [0.0, 1.0, 2.0, 3.0], 4)
    merged, decisions = apply(line, [1e-6, 1e-6, 1e-6])
    assert merged.intervals == 2
    assert sum(d.step is ocp.Step.MERGED for d in decisions) == 1
    kink = solution_of(lambda t: np.abs(t - 1.0), [0.0, 1.0, 2.0], 4)
    assert apply(kink, [1e-6, 1e-6])[0].intervals == 2
    assert apply(line, [1e-6, 0.5, 1e-6])[0].intervals == 3


def test_cuts_go_to_the_boundary_layer():
    layer = fitted(lambda t: np.exp(-30.0 * t), [0.0, 1.0], 8).coefficients[0]
    places = cut_places(layer, np.ones(1), 4)
    assert np.all(np.diff(places) > 0.0)
    assert places[0] < 0.1
    straight = fitted(lambda t: t, [0.0, 1.0], 4).coefficients[0]
    assert cut_places(straight, np.ones(1), 4) == pytest.approx([0.25, 0.5, 0.75])


def test_decay_and_curvature_tell_smooth_from_rough():
    one = np.ones(1)
    smooth = fitted(np.exp, [0.0, 1.0], 8).coefficients[0]
    rough = fitted(lambda t: np.abs(t - 0.4), [0.0, 1.0], 8).coefficients[0]
    assert decay_rate(smooth, one) > 1.0
    assert decay_rate(rough, one) < 0.4


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(0.05, 3.0), min_size=1, max_size=12),
    st.data(),
)
def test_any_refinement_of_any_mesh_is_a_mesh_of_the_same_span(widths, data):
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    count = len(widths)
    degree = data.draw(st.integers(3, 8))
    part = solution_of(lambda t: np.sin(3.0 * t) + np.abs(t - 1.0), breaks, degree)
    indicator = data.draw(
        st.lists(st.floats(1e-9, 1e9), min_size=count, max_size=count)
    )
    mesh, _ = apply(part, indicator)
    assert sum(mesh.fractions) == pytest.approx(1.0)
    assert min(mesh.fractions) > 0.0
    assert max(mesh.points) <= MOST_POINTS
    flagged = sum(value > 1.0 for value in indicator)
    if flagged == count:
        assert mesh.point_count > part.mesh.point_count


def test_taking_a_mesh_apart_and_together_changes_nothing():
    mesh = ocp.PhaseMesh(
        (0.25, 0.75, 1.0), (3, 4, 5), (0, 0, 1), {"u": (0, 1, 2)}, ((), (0.5,), ()),
        (0.0, 1e-5, 0.0),
    )  # fmt: skip
    assert mesh_of(cells_of(mesh)) == mesh


@pytest.mark.parametrize(
    "arguments",
    [((0.5, 0.4), (3, 3)), ((), ()), ((1.0,), (3, 4)), ((1.5, -0.5), (3, 3))],
)
def test_impossible_meshes_are_refused(arguments):
    with pytest.raises(ValueError, match="wanted"):
        ocp.PhaseMesh(*arguments)


def test_the_worst_intervals_come_first_where_points_are_few():
    rough = solution_of(lambda t: np.abs(t - 1.5), [0.0, 1.0, 2.0, 3.0, 4.0], 6)
    mesh, decisions = apply(rough, [5.0, 20.0, 10.0, 0.5], most=20.0)
    steps = [d.step for d in decisions]
    assert steps == [ocp.Step.KEPT, ocp.Step.CUT, ocp.Step.KEPT, ocp.Step.KEPT]
    assert "worse ones first" in decisions[0].reason
    assert mesh.intervals == 5
    # At least one interval is refined, however few points are allowed.
    assert apply(rough, [5.0, 20.0, 10.0, 0.5], most=0.0)[0].intervals == 5
