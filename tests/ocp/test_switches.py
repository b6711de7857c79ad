"""Arcs are read off coarse solutions, ramps and noise notwithstanding."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc import ocp
from showc.ocp.refinement.switches import detect
from showc.ocp.solution import PhaseSolution
from showc.trajectory import PiecewisePolynomial


def phase_of(breaks, controls, states=None) -> PhaseSolution:
    """Linear controls given by their values at both ends of every interval."""
    breaks = np.asarray(breaks, dtype=float)
    table = np.asarray(controls, dtype=float)
    if table.ndim == 2:
        table = table[:, :, None]
    count = breaks.size - 1
    if states is None:
        states = np.zeros((count, 2, 1))
    names = tuple(f"u{i}" for i in range(table.shape[2]))
    return PhaseSolution(
        "p",
        ocp.PhaseMesh.from_breaks(breaks, [3] * count),
        np.array([breaks[-1]]),
        tuple(f"x{i}" for i in range(np.shape(states)[2])),
        names,
        PiecewisePolynomial(breaks, states),
        PiecewisePolynomial(breaks, table),
        np.zeros(0),
        np.zeros((0, 1)),
    )


def found(part, bound=1.0, state_bound=np.inf):
    n, m = len(part.control_names), len(part.state_names)
    return detect(
        part,
        (np.full(n, -bound), np.full(n, bound)),
        (np.full(m, -np.inf), np.full(m, state_bound)),
    )


@settings(max_examples=80, deadline=None)
@given(st.floats(0.25, 0.75), st.integers(5, 24))
def test_one_switch_is_found_where_the_impulse_says(switch, count):
    """Coarse solutions hold the impulse; the ramp lies in the switch's interval."""
    breaks = np.linspace(0.0, 1.0, count + 1)
    values = np.ones((count, 2))
    for k in range(count):
        a, b = breaks[k], breaks[k + 1]
        if a >= switch:
            values[k] = -1.0
        elif b > switch:
            mean = (2.0 * switch - a - b) / (b - a)
            # A linear piece of that mean, inside the bounds.
            slope = min(1.0 - abs(mean), 1.0)
            values[k] = mean + slope, mean - slope
    structure = found(phase_of(breaks, values))
    if structure.times.size == 1:
        assert structure.times[0] == pytest.approx(switch, abs=0.51 / count)
        assert structure.classes.tolist() == [[1], [-1]]
    else:
        pytest.fail(f"{structure.times.size} switches for one")


def test_a_switch_in_the_first_interval_leaves_an_arc_to_decide():
    breaks = np.linspace(0.0, 1.0, 6)
    values = np.full((5, 2), -1.0)
    values[0] = 1.0, -0.5
    structure = found(phase_of(breaks, values))
    assert structure.classes.ravel().tolist() == [0, -1]
    assert 0.1 < structure.times[0] < 0.21


def test_bang_off_bang_has_three_arcs():
    breaks = np.linspace(0.0, 1.0, 11)
    values = np.repeat([1, 1, 1, 0, 0, 0, 0, -1, -1, -1], 2).reshape(10, 2)
    structure = found(phase_of(breaks, values))
    assert structure.times == pytest.approx([0.3, 0.7], abs=1e-9)
    assert structure.classes.ravel().tolist() == [1, 0, -1]


def test_a_control_inside_its_bounds_has_no_arcs():
    breaks = np.linspace(0.0, 1.0, 9)
    values = 0.5 * np.sin(np.stack([breaks[:-1], breaks[1:]], axis=1) * 6.0)
    assert found(phase_of(breaks, values)).times.size == 0


def test_a_small_dip_from_the_bound_is_noise():
    breaks = np.linspace(0.0, 1.0, 11)
    values = np.ones((10, 2))
    values[4] = 0.9, 0.96
    assert found(phase_of(breaks, values)).times.size == 0


def test_two_controls_share_the_arcs():
    breaks = np.linspace(0.0, 1.0, 11)
    first = np.repeat([1.0] * 4 + [-1.0] * 6, 2).reshape(10, 2)
    second = np.repeat([-1.0] * 7 + [1.0] * 3, 2).reshape(10, 2)
    structure = found(phase_of(breaks, np.stack([first, second], axis=2)))
    assert structure.times == pytest.approx([0.4, 0.7])
    assert structure.classes.tolist() == [[1, -1], [-1, -1], [-1, 1]]


def test_a_state_on_its_bound_makes_an_arc_of_its_own():
    breaks = np.linspace(0.0, 1.0, 11)
    states = np.full((10, 2, 1), 0.2)
    states[:, 0, 0] = np.minimum(3.0 * breaks[:-1], 1.0)
    states[:, 1, 0] = np.minimum(3.0 * breaks[1:], 1.0)
    states[7:] = np.linspace(1.0, 0.0, 4)[[[0, 1], [1, 2], [2, 3]]][:, :, None]
    part = phase_of(breaks, np.zeros((10, 2)), states)
    structure = found(part, bound=np.inf, state_bound=1.0)
    assert structure.times == pytest.approx([0.4, 0.7], abs=0.02)
