"""The equations of motion against physics that they were not written from."""

from __future__ import annotations

from dataclasses import replace

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from showc.vehicle import PRESETS
from showc.vehicle.flatness import attitude_and_thrust
from showc.vehicle.motion import (
    angular_acceleration,
    energy,
    state_derivative,
    thrust_direction,
    torques_for,
)

VEHICLE = PRESETS["formation-625g"].vehicle
angles = st.floats(-1.2, 1.2)
yaws = st.floats(-3.1, 3.1)


@given(angles, angles, yaws)
def test_thrust_points_along_the_body_axis_of_a_rotation_matrix(roll, pitch, yaw):
    axis = Rotation.from_euler("ZYX", [yaw, pitch, roll]).apply([0.0, 0.0, 1.0])
    assert thrust_direction(roll, pitch, yaw) == pytest.approx(axis, abs=1e-14)


def test_symbols_and_numbers_take_the_same_formula():
    symbols = casadi.SX.sym("a", 3)
    direction = thrust_direction(
        symbols[0], symbols[1], symbols[2], sin=casadi.sin, cos=casadi.cos
    )
    function = casadi.Function("f", [symbols], [casadi.vertcat(*direction)])
    value = np.array(function([0.3, -0.2, 1.1])).ravel()
    assert value == pytest.approx(thrust_direction(0.3, -0.2, 1.1), abs=1e-15)


@given(st.integers(0, 2**31))
def test_symbolic_derivatives_agree_with_finite_differences(seed):
    random = np.random.default_rng(seed)
    state, control = random.uniform(-0.5, 0.5, 12), random.uniform(0.0, 3.0, 4)
    x = casadi.SX.sym("x", 3)
    thrust = casadi.vertcat(
        *thrust_direction(x[0], x[1], x[2], sin=casadi.sin, cos=casadi.cos)
    )
    exact = np.array(
        casadi.Function("j", [x], [casadi.jacobian(thrust, x)])(state[6:9])
    )
    exact *= control[0] / VEHICLE.mass
    step = 1e-6
    for k in range(3):
        up, down = state.copy(), state.copy()
        up[6 + k] += step
        down[6 + k] -= step
        numeric = (
            state_derivative(VEHICLE, up, control)
            - state_derivative(VEHICLE, down, control)
        ) / (2.0 * step)
        assert numeric[3:6] == pytest.approx(exact[:, k], abs=1e-7)


def test_hover_is_an_equilibrium():
    state = VEHICLE.hover_state(np.array([1.0, -2.0, 30.0]), yaw=0.7)
    assert (
        np.abs(state_derivative(VEHICLE, state, VEHICLE.hover_control())).max() < 1e-14
    )


def test_energy_grows_by_the_work_of_the_thrust():
    random = np.random.default_rng(1)
    state, control = random.uniform(-0.4, 0.4, (50, 12)), random.uniform(0, 5, (50, 4))
    rate = state_derivative(VEHICLE, state, control)
    step = 1e-6
    gain = (
        energy(VEHICLE, state + step * rate) - energy(VEHICLE, state - step * rate)
    ) / (2.0 * step)
    direction = np.stack(thrust_direction(*state[:, 6:9].T), axis=1)
    work = control[:, 0] * np.sum(direction * state[:, 3:6], axis=1)
    assert gain == pytest.approx(work, abs=1e-7)


def test_free_rotation_keeps_energy_and_angular_momentum():
    inertia = np.array(VEHICLE.inertia)
    rates = np.array([1.1, -0.7, 1.9])
    turning = np.array(angular_acceleration(VEHICLE, tuple(rates), (0.0, 0.0, 0.0)))
    assert np.dot(inertia * rates, turning) == pytest.approx(0.0, abs=1e-16)
    assert np.dot(inertia**2 * rates, turning) == pytest.approx(0.0, abs=1e-18)


triples = st.tuples(*[st.floats(-5.0, 5.0)] * 3)


@given(triples, triples)
def test_torques_give_the_accelerations_they_were_asked_for(rates, wanted):
    for vehicle in (VEHICLE, replace(VEHICLE, torque_arm="multiplied")):
        torques = torques_for(vehicle, rates, wanted)
        back = angular_acceleration(vehicle, rates, torques)
        assert back == pytest.approx(wanted, abs=1e-12)


def test_the_printed_form_counts_the_arm_twice():
    printed = replace(VEHICLE, torque_arm="multiplied")
    rest = (0.0, 0.0, 0.0)
    torques = (0.1, 0.2, 0.05)
    true = angular_acceleration(VEHICLE, rest, torques)
    weaker = angular_acceleration(printed, rest, torques)
    assert weaker[0] == pytest.approx(true[0] * VEHICLE.arm_length)
    assert weaker[1] == pytest.approx(true[1] * VEHICLE.arm_length)
    assert weaker[2] == true[2]


@given(st.floats(-6.0, 6.0), st.floats(-6.0, 6.0), st.floats(-8.0, 15.0), yaws)
def test_flatness_gives_back_the_acceleration(ax, ay, az, yaw):
    wanted = np.array([ax, ay, az])
    roll, pitch, thrust = attitude_and_thrust(VEHICLE, wanted, yaw)
    state = np.zeros(12)
    state[6:9] = roll, pitch, yaw
    rate = state_derivative(VEHICLE, state, np.array([thrust, 0.0, 0.0, 0.0]))
    assert rate[3:6] == pytest.approx(wanted, abs=1e-12)


def test_flatness_of_hovering_is_level_with_the_weight_as_thrust():
    roll, pitch, thrust = attitude_and_thrust(VEHICLE, np.zeros((4, 3)), 0.4)
    assert not roll.any() and not pitch.any()
    assert thrust == pytest.approx(VEHICLE.hover_thrust)
