"""Parameters, rotor allocation and presets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from showc.vehicle import PRESETS

shares = st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4)


@pytest.mark.parametrize("preset", PRESETS.values(), ids=PRESETS)
@given(share=shares)
def test_allocation_round_trip(preset, share):
    vehicle = preset.vehicle
    squared = np.array(share) * vehicle.rotor_speed_max**2
    control = vehicle.allocation() @ squared
    assert vehicle.rotor_fractions() @ control == pytest.approx(share, abs=1e-12)


@pytest.mark.parametrize("preset", PRESETS.values(), ids=PRESETS)
def test_hovering_takes_the_same_of_every_rotor(preset):
    vehicle = preset.vehicle
    fractions = vehicle.rotor_fractions() @ vehicle.hover_control()
    expected = vehicle.hover_thrust / vehicle.thrust_max
    assert fractions == pytest.approx([expected] * 4)
    assert 0.1 < expected < 0.8


def test_the_formation_quadrotor_has_the_printed_limits():
    preset = PRESETS["formation-625g"]
    vehicle, limits = preset.vehicle, preset.limits
    assert vehicle.thrust_max == pytest.approx(21.03, abs=1e-9)
    assert vehicle.torque_max == pytest.approx((0.67, 0.67, 0.105), rel=6e-3)
    assert limits.thrust_max == 21.03 and limits.torque_max == (0.67, 0.67, 0.105)
    assert np.rad2deg(limits.tilt) == pytest.approx(20.0)
    assert limits.velocity_max == (5.0, 5.0, 5.0)
    assert limits.body_rate == (1.7, 1.7, 1.7)


def test_turning_thrust_and_torque_signs():
    vehicle = PRESETS["formation-625g"].vehicle
    matrix = vehicle.allocation()
    assert (matrix[0] > 0.0).all()
    assert matrix[1:].sum(axis=1) == pytest.approx([0.0, 0.0, 0.0], abs=1e-18)
    assert np.count_nonzero(matrix) == 12


def test_upright_limits_leave_no_tilt_and_no_more_than_the_speed():
    limits = PRESETS["formation-625g"].limits.upright(2.0)
    assert limits.velocity_max == (5.0, 5.0, 2.0)
    assert limits.velocity_min == (-5.0, -5.0, -2.0)
    assert limits.tilt == 0.0
    assert limits.upright(9.0) == limits


def test_an_envelope_tightens_limits_and_never_loosens_them():
    preset = PRESETS["formation-625g"]
    own = replace(preset.limits, acceleration=2.0, acceleration_up=50.0)
    limits = preset.envelope.within(own)
    assert limits.acceleration == 2.0
    assert limits.acceleration_up == preset.envelope.acceleration_up
    assert limits.acceleration_down == preset.envelope.acceleration_down
    assert limits.level_speed == preset.envelope.level_speed
    assert limits.velocity_max == own.velocity_max
