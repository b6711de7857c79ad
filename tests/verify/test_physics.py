"""The replay, against an integrator of another library and against spoilt logs."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from verified import with_table

from showc.log import showc_pb2 as pb
from showc.verify.kernel.bernstein import basis
from showc.verify.kernel.show import PieceTable, Segment
from showc.verify.physics import allocation, flyable, gauss, replay

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


def flown_elsewhere(vehicle, controls, breaks, nodes):
    """States at ``nodes`` of each interval by DOP853, controls linear on each."""
    state, states = np.zeros(12), []
    for k, (low, high) in enumerate(pairwise(breaks)):

        def right(time, state, k=k, low=low, high=high):
            share = (time - low) / (high - low)
            control = (1 - share) * controls[k][0] + share * controls[k][1]
            return slope(vehicle, state, control)

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
    return Segment(message, (table,), np.array([0]), np.zeros((1, 3)))


@pytest.mark.parametrize("factor", [1.0, 0.1275])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_agrees_with_another_integrator(seed, factor):
    vehicle = pb.Vehicle()
    vehicle.CopyFrom(VEHICLE)
    vehicle.torque_factor = factor
    result = replay(tumbling(vehicle, seed), vehicle)
    assert result.clipped == 0.0
    assert result.position.value < 2e-9
    assert result.attitude.value < 1e-8
    assert result.integration_error < 1e-9


def test_gauss_points_integrate_exactly_to_order_ten():
    points, weights, partial = gauss(5)
    for power in range(10):
        assert weights @ points**power == pytest.approx(1.0 / (power + 1), abs=1e-15)
    for power in range(5):
        np.testing.assert_allclose(
            partial @ points**power, points ** (power + 1) / (power + 1), atol=1e-15
        )


def test_rotors_do_not_push_more_than_they_can():
    matrix = allocation(VEHICLE)
    top = VEHICLE.rotor_speed_max**2
    within = matrix @ (np.array([0.2, 0.4, 0.6, 0.8]) * top)
    same, excess = flyable(VEHICLE, within)
    assert excess == 0.0
    np.testing.assert_array_equal(same, within)
    beyond = matrix @ (np.array([0.2, 1.3, 0.6, -0.1]) * top)
    cut, excess = flyable(VEHICLE, beyond)
    assert excess == pytest.approx(0.3)
    np.testing.assert_allclose(cut, matrix @ (np.array([0.2, 1.0, 0.6, 0.0]) * top))


def test_controls_beyond_the_rotors_leave_the_logged_path(log_and_show):
    """A log whose polynomials solve the equations, but with impossible thrust."""
    _, show = log_and_show
    weak = pb.Vehicle()
    weak.CopyFrom(show.rules.vehicle)
    # Rotors that carry the weight, but not the climb.
    weak.rotor_speed_max = np.sqrt(
        1.05 * weak.mass * weak.gravity / (4 * weak.thrust_coefficient)
    )
    result = replay(show.segments[0], weak)
    assert result.clipped > 0.05
    assert result.position.value > 0.1


@pytest.mark.parametrize(
    ("component", "shift", "least"),
    [(2, 2e-3, 1.9e-3), (5, 2e-3, 1e-3), (0, 1.1e-3, 1.0e-3)],
)
def test_a_bent_polynomial_is_found(log_and_show, component, shift, least):
    _, show = log_and_show
    state = show.segments[0].tables[0].state.copy()
    # Raise the middle of the third drone's polynomial, its ends untouched.
    state[2, 2:4, component] += 3.0 * shift
    spoilt = with_table(show, 0, state=state)
    result = replay(spoilt.segments[0], show.rules.vehicle)
    if component < 3:
        assert result.position.value > least
        assert result.position.drone == 2
    else:
        # Velocity is not compared itself; position follows the controls.
        assert result.position.value < 1e-9


def test_attitude_is_compared_too(log_and_show):
    _, show = log_and_show
    state = show.segments[0].tables[0].state.copy()
    state[1, 2:4, 6] += np.radians(0.05)
    result = replay(with_table(show, 0, state=state).segments[0], show.rules.vehicle)
    assert result.attitude.value > np.radians(0.01)
    assert result.attitude.drone == 1


def test_a_control_between_the_nodes_counts(log_and_show):
    """A spike in thrust that averages out over an interval still bends the path."""
    _, show = log_and_show
    control = show.segments[0].tables[0].control.copy()
    control[0, 1, 0] += 0.5
    control[0, 2, 0] -= 0.5
    result = replay(
        with_table(show, 0, control=control).segments[0], show.rules.vehicle
    )
    assert result.position.value > 1e-3


@pytest.mark.parametrize(("few", "many"), [(8, 9), (8, 10), (9, 21)])
def test_meshes_of_different_sizes_fly_together(few, many):
    first, second = tumbling(seed=4, intervals=few), tumbling(seed=5, intervals=many)
    a, b = first.tables[0], second.tables[0]
    table = PieceTable(
        np.array([0, 1]),
        np.array([0, few, few + many]),
        np.concatenate([a.start, b.start]),
        np.concatenate([a.end, b.end]),
        np.concatenate([a.state, b.state]),
        np.concatenate([a.control, b.control]),
    )
    result = replay(replace(first, tables=(table,)), VEHICLE)
    assert result.position.value < 2e-8
    assert result.attitude.value < 2e-8


def test_a_flight_to_infinity_is_reported_not_raised(log_and_show):
    _, show = log_and_show
    control = show.segments[0].tables[0].control.copy()
    state = show.segments[0].tables[0].state.copy()
    state[:, :, 9:] = 1e200
    result = replay(
        with_table(show, 0, control=control, state=state).segments[0],
        show.rules.vehicle,
    )
    assert not result.position.value < 1e-3
