"""The enclosure of what is flown, against other integrators and spoilt logs."""

import tracemalloc
from dataclasses import replace
from itertools import pairwise

import flint
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from verified import with_table

from showc.fleet.single_drone.judgement import _WINDOW, leads
from showc.flight import Trajectory
from showc.log import showc_pb2 as pb
from showc.trajectory import PiecewisePolynomial
from showc.vehicle import PRESETS
from showc.verify.kernel import dynamics
from showc.verify.kernel.bernstein import basis, rows_last
from showc.verify.kernel.dynamics import (
    ANGLE,
    GAMMA,
    POSITION,
    RATE,
    VELOCITY,
    WINDOW,
    _chebyshev,
    _refined,
    _scheme,
    _sides,
    _transform,
    _truncation,
    allocation,
    radius,
    ties,
)
from showc.verify.kernel.show import PieceTable, Segment

VEHICLE = pb.Vehicle(
    mass=0.625,
    arm_length=0.1275,
    thrust_coefficient=2.103e-6,
    torque_coefficient=2.091e-8,
    inertia=pb.Vector3(x=2.3e-3, y=2.4e-3, z=2.6e-3),
    rotor_speed_max=1581.0,
    gravity=9.80665,
    torque_factor=1.0,
)
TOLERANCES = np.repeat([POSITION, VELOCITY, ANGLE, RATE], 3)


def slope(vehicle, state, control):
    """Equations of motion as the literature prints them, written out once more."""
    _, _, _, *velocity, phi, theta, psi, p, q, r = state
    thrust, u2, u3, u4 = control
    m, f = vehicle.mass, vehicle.torque_factor
    ix, iy, iz = vehicle.inertia.x, vehicle.inertia.y, vehicle.inertia.z
    c, s = np.cos, np.sin
    return [
        *velocity,
        thrust / m * (c(phi) * s(theta) * c(psi) + s(phi) * s(psi)),
        thrust / m * (c(phi) * s(theta) * s(psi) - s(phi) * c(psi)),
        thrust / m * c(phi) * c(theta) - vehicle.gravity,
        *(p, q, r),
        f * u2 / ix + (iy - iz) / ix * q * r,
        f * u3 / iy + (iz - ix) / iy * p * r,
        u4 / iz + (ix - iy) / iz * p * q,
    ]


def clipped(vehicle, control):
    """What rotors between rest and full speed give."""
    matrix = allocation(vehicle)
    return matrix @ np.clip(np.linalg.solve(matrix, control), 0.0, 1.0)


def flown_elsewhere(vehicle, controls, breaks, nodes, first=None):
    """States at ``nodes`` of each interval by DOP853; controls (K, degree + 1, 4)."""
    state, states = np.zeros(12) if first is None else first, []
    for k, (low, high) in enumerate(pairwise(breaks)):

        def right(time, state, k=k, low=low, high=high):
            weights = basis(len(controls[k]) - 1, (time - low) / (high - low))
            return slope(vehicle, state, clipped(vehicle, weights @ controls[k]))

        times = low + (high - low) * nodes
        times[-1] = high
        run = solve_ivp(
            right, (low, high), state, "DOP853", times, rtol=1e-12, atol=1e-13
        )
        states.append(run.y.T)
        state = run.y[:, -1]
    return states


def tumbling(vehicle=VEHICLE, seed=1, intervals=8, degree=13):
    """Drone with all three rates in play, its true motion fitted by polynomials."""
    rng = np.random.default_rng(seed)
    breaks = np.linspace(0.0, 1.2, intervals + 1)
    weight = vehicle.mass * vehicle.gravity
    corner = rng.uniform(-1.0, 1.0, (intervals + 1, 4))
    corner *= np.array([2.0, 0.02, 0.02, 0.01])
    corner[:, 0] += weight
    controls = [np.stack(pair) for pair in pairwise(corner)]
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
    states = flown_elsewhere(vehicle, controls, breaks, nodes)
    fit = np.linalg.inv(basis(degree, nodes))
    state = np.stack([fit @ values for values in states])
    table = PieceTable(
        np.array([0]),
        np.array([0, intervals]),
        breaks[:-1],
        breaks[1:],
        state,
        np.stack(controls),
    )
    message = pb.Segment(name="tumble", duration=1.2, drones=[0])
    return Segment(message, table, np.zeros((1, 3)))


def with_state(segment, state):
    table = replace(segment.table, state=state)
    return replace(segment, table=table)


@pytest.mark.parametrize("factor", [1.0, 0.1275])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_solves_the_equations_is_tied_closely(seed, factor):
    """The polynomials are another integrator's, fitted to 1e-9."""
    vehicle = pb.Vehicle()
    vehicle.CopyFrom(VEHICLE)
    vehicle.torque_factor = factor
    found = radius(tumbling(vehicle, seed), vehicle)[0]
    assert np.all(found < 1e-7)
    assert np.all(found < TOLERANCES)


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.floats(1e-9, 3e-4),
    component=st.integers(0, 11),
)
def test_the_tube_holds_the_true_flight(seed, size, component):
    """Logged polynomials are spoilt at random; the truth stays within the tube."""
    rng = np.random.default_rng(seed)
    exact = tumbling(seed=seed % 7, intervals=3, degree=9)
    table = exact.table
    state = table.state.copy()
    state[:, 1:, component] += size * rng.uniform(-1.0, 1.0, state[:, 1:, 0].shape)
    nodes = np.linspace(0.0, 1.0, 12)
    breaks = np.append(table.start, table.end[-1])
    true = flown_elsewhere(VEHICLE, table.control, breaks, nodes, state[0, 0])
    logged = basis(state.shape[1] - 1, nodes) @ state
    away = np.abs(np.stack(true) - logged).max(axis=(0, 1))
    found = radius(with_state(exact, state), VEHICLE)[0]
    # The other integrator itself is right to 1e-9.
    assert np.all(away <= found + 1e-9)


@pytest.mark.parametrize("component", range(12))
@pytest.mark.parametrize("row", [0, 3, 7])
def test_no_state_moves_by_two_tolerances_on_any_interval(component, row):
    exact = tumbling()
    state = exact.table.state.copy()
    # The middle of one interval alone, raised by just over two tolerances.
    bump = basis(state.shape[1] - 1, 0.5)
    state[row, 1:-1, component] += 2.05 * TOLERANCES[component] / bump[1:-1].sum()
    found = radius(with_state(exact, state), VEHICLE)[0]
    assert found[component] > 2.0 * TOLERANCES[component]


def test_defects_that_cancel_are_not_added_up():
    """A wave in the velocity moves the position by far less than its size."""
    exact = tumbling(degree=7, intervals=12)
    found = radius(exact, VEHICLE)[0]
    state = exact.table.state.copy()
    wave = 1e-4 * np.array([0.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 0.0])
    state[:, :, 3] += wave
    spoilt = radius(with_state(exact, state), VEHICLE)[0]
    assert spoilt[3] > 1e-5
    np.testing.assert_allclose(spoilt[:3], found[:3], rtol=1e-6, atol=1e-12)


def test_controls_beyond_the_rotors_are_flown_as_rotors_can(log_and_show):
    """A log whose polynomials solve the equations, but with impossible thrust."""
    _, show = log_and_show
    weak = pb.Vehicle()
    weak.CopyFrom(show.rules.vehicle)
    # Rotors that carry the weight, but not the climb.
    weak.rotor_speed_max = np.sqrt(
        1.05 * weak.mass * weak.gravity / (4 * weak.thrust_coefficient)
    )
    assert radius(show.segments[0], weak)[:, 2].max() > 0.1


def test_rough_flights_of_many_intervals_are_not_cut_without_end():
    """Else a file of a few kilobytes takes gigabytes."""
    many = 5_000
    times = np.linspace(0.0, 1.0, many + 1)
    control = np.tile([[9.0, 0.0, 0.0, 0.0], [-9.0, 0.0, 0.0, 0.0]], (many, 1, 1))
    state, first = np.zeros((many, 1, 12)), np.array([0, many])
    table = PieceTable(np.array([0]), first, times[:-1], times[1:], state, control)
    assert many < _refined(table, VEHICLE)[0].start.size <= 4 * many


def test_a_long_window_beside_thousands_of_short_ones_takes_no_more_memory():
    """Each interval in which a drone hovers is a window; all others are one."""
    many = 4_000
    times = np.linspace(0.0, 1.0, 2 * many + 1)
    state, control = np.zeros((2 * many, 2, 12)), np.zeros((2 * many, 1, 4))
    state[many:, 1, 0] = 1e-3
    columns = times[:-1], times[1:], state, control
    table = PieceTable(np.array([0]), np.array([0, 2 * many]), *columns)
    segment = Segment(pb.Segment(), table, np.zeros((1, 3)))
    tracemalloc.start()
    radius(segment, VEHICLE)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 200e6


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_tube_holds_the_flight_of_clipped_controls(seed):
    weak = pb.Vehicle()
    weak.CopyFrom(VEHICLE)
    weak.rotor_speed_max = 870.0
    exact = tumbling(seed=seed % 5, intervals=3, degree=9)
    table = exact.table
    nodes = np.linspace(0.0, 1.0, 9)
    breaks = np.append(table.start, table.end[-1])
    true = flown_elsewhere(weak, table.control, breaks, nodes)
    logged = basis(table.state.shape[1] - 1, nodes) @ table.state
    away = np.abs(np.stack(true) - logged).max(axis=(0, 1))
    found = radius(exact, weak)[0]
    assert away.max() > 1e-2
    # Rates that leave their hypothesis leave nothing proved.
    assert np.all(away <= found + 1e-5)


@pytest.mark.parametrize(
    ("code", "spoil"),
    [
        ("VRF303", lambda state: state[:, :, 3:6].fill(0.0)),
        ("VRF304", lambda state: state[:, 1:, 9:].fill(1e-3)),
        ("VRF302", lambda state: state[:, 1:, 6].fill(1e-3)),
        ("VRF301", lambda state: np.add.at(state, (2, slice(2, 4), 2), 6e-3)),
    ],
)
def test_each_lie_about_states_is_named(log_and_show, code, spoil):
    _, show = log_and_show
    state = show.segments[0].table.state.copy()
    spoil(state)
    spoilt = with_table(show, 0, state=state)
    radii = [radius(segment, show.rules.vehicle) for segment in spoilt.segments]
    failed = {one.code for one in ties(spoilt, radii) if not one.holds}
    assert code in failed


def test_a_control_between_the_nodes_counts(log_and_show):
    """A spike in thrust that averages out over an interval still bends the path."""
    _, show = log_and_show
    control = show.segments[0].table.control.copy()
    control[0, 1, 0] += 0.5
    control[0, 2, 0] -= 0.5
    spoilt = with_table(show, 0, control=control)
    assert radius(spoilt.segments[0], show.rules.vehicle)[0, 2] > 1e-3


@pytest.mark.parametrize(("few", "many"), [(8, 9), (8, 10), (9, 21)])
def test_meshes_of_different_sizes_fly_together(few, many):
    first, second = tumbling(seed=4, intervals=few), tumbling(seed=5, intervals=many)
    a, b = first.table, second.table
    table = PieceTable(
        np.array([0, 1]),
        np.array([0, few, few + many]),
        np.concatenate([a.start, b.start]),
        np.concatenate([a.end, b.end]),
        np.concatenate([a.state, b.state]),
        np.concatenate([a.control, b.control]),
    )
    both = radius(replace(first, table=table, goals=np.zeros((2, 3))), VEHICLE)
    alone = [radius(one, VEHICLE)[0] for one in (first, second)]
    np.testing.assert_allclose(both, alone, rtol=1e-6, atol=1e-12)


def test_a_jump_between_intervals_is_part_of_the_deviation():
    exact = tumbling()
    state = exact.table.state.copy()
    state[4:, :, 1] += 2e-3
    assert radius(with_state(exact, state), VEHICLE)[0, 1] >= 2e-3


def test_jumps_at_restarts_add_up_over_the_whole_segment():
    """A drone that hovers in many places, each too near the last to be a jump."""
    count, step = 700, 9e-7
    edges = 0.25 * np.arange(count + 1)
    state, control = np.zeros((count, 2, 12)), np.zeros((count, 2, 4))
    state[:, :, 0] = step * np.arange(count)[:, None]
    control[:, :, 0] = VEHICLE.mass * VEHICLE.gravity
    first = np.array([0, count])
    table = PieceTable(np.array([0]), first, edges[:-1], edges[1:], state, control)
    message = pb.Segment(duration=float(edges[-1]))
    found = radius(Segment(message, table, np.zeros((1, 3))), VEHICLE)
    assert found[0, 0] == pytest.approx(step * (count - 1), rel=1e-6)
    assert found[0, 0] > POSITION


def test_a_flight_to_infinity_is_not_proved(log_and_show):
    _, show = log_and_show
    state = show.segments[0].table.state.copy()
    state[:, :, 9:] = 1e200
    spoilt = with_table(show, 0, state=state)
    with np.errstate(all="ignore"):
        found = radius(spoilt.segments[0], show.rules.vehicle)
    assert np.all(np.isinf(found[:, :3]))


def bernstein_ball(coefficients, share):
    """Value of a polynomial, by de Casteljau on balls."""
    row = [flint.arb(float(one)) for one in coefficients]
    while len(row) > 1:
        row = [(1 - share) * a + share * b for a, b in pairwise(row)]
    return row[0]


def chebyshev_ball(coefficients, share):
    """Value of a sum of Chebyshev polynomials of 2 s - 1, by Clenshaw on balls."""
    x = 2 * share - 1
    one, two = flint.arb(0), flint.arb(0)
    for coefficient in reversed(coefficients[1:]):
        one, two = flint.arb(float(coefficient)) + 2 * x * one - two, one
    return flint.arb(float(coefficients[0])) + x * one - two


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    degree=st.integers(1, 8),
    turn=st.sampled_from([1e-3, 0.1, 0.6]),
)
def test_what_interpolation_leaves_out_is_bounded_in_balls(seed, degree, turn):
    """Accelerations in 200 bits, against the interpolant and its two error terms."""
    rng = np.random.default_rng(seed)
    state = np.zeros((1, degree + 1, 12))
    state[0, :, 6:9] = rng.uniform(-turn, turn, (degree + 1, 3))
    state[0, :, 9:] = rng.uniform(-1.7, 1.7, (degree + 1, 3))
    control = np.zeros((1, 5, 4))
    control[0, :, 0] = rng.uniform(3.0, 9.0, 5)
    table = PieceTable(
        np.array([0]), np.array([0, 1]), np.zeros(1), np.ones(1), state, control
    )
    scheme = _scheme(degree, 4)
    logged, pushed = rows_last(table.state), rows_last(table.control)
    value, size = _sides(logged, pushed, VEHICLE, scheme)
    error = _truncation(logged, pushed, VEHICLE.mass, scheme[0])
    found = np.tensordot(_transform(scheme[0]), value, axes=1)[:, :3, 0]
    allowed = (error + GAMMA * scheme[-1] * size[:3])[:, 0]
    flint.ctx.prec = 200
    for share in (flint.arb(float(one)) for one in rng.uniform(0.0, 1.0, 12)):
        push = bernstein_ball(control[0, :, 0], share) / flint.arb(VEHICLE.mass)
        roll, pitch, yaw = (
            bernstein_ball(state[0, :, 6 + axis], share) for axis in range(3)
        )
        level = roll.cos() * pitch.sin()
        true = (
            push * (level * yaw.cos() + roll.sin() * yaw.sin()),
            push * (level * yaw.sin() - roll.sin() * yaw.cos()),
            push * roll.cos() * pitch.cos() - flint.arb(VEHICLE.gravity),
        )
        for axis in range(3):
            away = abs(true[axis] - chebyshev_ball(found[:, axis], share))
            assert away < flint.arb(float(allowed[axis]))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), degree=st.integers(0, 12))
def test_integrals_and_coefficients_are_right_in_balls(seed, degree):
    """Integrals of a polynomial from its values, against exact ones."""
    rng = np.random.default_rng(seed)
    logged = rng.uniform(-5.0, 5.0, degree + 1)
    _, (states, _), integrals, gain = _scheme(degree, 0)
    flint.ctx.prec = 200
    value = states @ logged
    rounding = GAMMA * gain * 5.0
    share = flint.arb(float(rng.uniform()))
    integral, again = logged, None
    for matrix in integrals:
        # The integral of a Bernstein polynomial has the mean of partial sums.
        integral = [
            sum((flint.arb(float(one)) for one in integral[:k]), flint.arb(0))
            if again is None
            else sum(integral[:k], flint.arb(0))
            for k in range(len(integral) + 1)
        ]
        integral = [one / (len(integral) - 1) for one in integral]
        again = integral
        row = list(integral)
        while len(row) > 1:
            row = [(1 - share) * a + share * b for a, b in pairwise(row)]
        away = abs(row[0] - chebyshev_ball(matrix @ value, share))
        assert away < flint.arb(rounding)
    direct = chebyshev_ball(_chebyshev(degree) @ logged, share)
    assert abs(direct - bernstein_ball(logged, share)) < flint.arb(rounding)


def test_what_a_planner_accepts_is_proved_however_its_attitude_errs():
    """An error of the attitude that cancels out on the way still counts in a proof."""
    planned, breaks, verdicts = PRESETS["formation-625g"].vehicle, np.arange(41.0), []
    assert planned.thrust_max == pytest.approx(allocation(VEHICLE)[0].sum(), rel=1e-3)
    state = np.zeros((40, 2, 12))
    state[:, :, 0] = 0.5 * np.stack([breaks[:-1], breaks[1:]], axis=1)
    state[:, :, 3] = 0.5
    for size in (1e-9, 1e-8, 1e-7, 1e-6):
        control = np.zeros((40, 1, 4))
        control[:, 0, 0] = VEHICLE.mass * VEHICLE.gravity
        # The roll rises and falls by turns: the way is hardly another one.
        turns = np.tile([1.0, -1.0, -1.0, 1.0], 10)
        control[:, 0, 1] = turns * size * VEHICLE.inertia.x
        curves = (PiecewisePolynomial(breaks, one) for one in (state, control))
        first = np.array([0]), np.array([0, 40])
        table = PieceTable(*first, breaks[:-1], breaks[1:], state, control)
        segment = Segment(pb.Segment(duration=40.0), table, np.zeros((1, 3)))
        proved = bool(radius(segment, VEHICLE)[0, :3].max() <= POSITION)
        accepted = bool(leads(planned, [Trajectory(*curves)])[0])
        verdicts.append((accepted, proved))
    assert _WINDOW == WINDOW
    assert verdicts[0] == (True, True)
    assert verdicts[-1] == (False, False)
    assert (True, False) not in verdicts


def cruise(length):
    """One interval at 0.5 m/s, with a little more thrust than the weight."""
    state, control = np.zeros((1, 2, 12)), np.zeros((1, 1, 4))
    state[0, 1, 0], state[0, :, 3] = 0.5 * length, 0.5
    control[0, 0, 0] = VEHICLE.mass * (VEHICLE.gravity + 1e-7)
    ends = np.array([0.0]), np.array([length])
    table = PieceTable(np.array([0]), np.array([0, 1]), *ends, state, control)
    return Segment(pb.Segment(duration=length), table, np.zeros((1, 3)))


def test_an_interval_longer_than_a_window_is_taken_in_windows():
    """What is left out grows with the square of the time without feedback."""
    for length, most in ((WINDOW, 3e-5), (10.0 * WINDOW, 6e-5)):
        assert 1e-5 < radius(cruise(length), VEHICLE)[0, 2] < most


def test_intervals_of_weeks_are_not_halved(monkeypatch):
    """Whatever their time, they take as long to be refused as others to be proved."""
    halved = []
    monkeypatch.setattr(dynamics, "_halved", lambda *given: halved.append(given))
    assert radius(cruise(1e8), VEHICLE)[0, 2] > POSITION
    assert not halved
