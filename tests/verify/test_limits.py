"""Limits at every instant: enclosures against dense sampling, and what nodes miss."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from verified import with_table

from showc.verify.kernel.bernstein import (
    basis,
    elevate,
    halves,
    part,
    square_sum,
    values,
)
from showc.verify.kernel.show import PieceTable
from showc.verify.limits import (
    RESOLUTION,
    Bound,
    _greatest,
    _Hulls,
    bounds,
    extremes,
    rotor_shares,
)

COEFFICIENTS = st.lists(
    st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=9), min_size=1, max_size=4
).filter(lambda rows: len({len(row) for row in rows}) == 1)


def table(rows):
    coefficients = np.array(rows)
    state = np.zeros((*coefficients.shape, 12))
    state[:, :, 4] = coefficients
    count = len(rows)
    return PieceTable(
        np.array([7]),
        np.array([0, count]),
        np.arange(count, dtype=float),
        np.arange(1, count + 1, dtype=float),
        state,
        np.zeros((count, 1, 4)),
    )


@settings(deadline=None, max_examples=150, derandomize=True)
@given(COEFFICIENTS, st.sampled_from([1.0, -1.0]))
def test_greatest_value_is_enclosed(logged, sign):
    bound = Bound("velocity", "vy", 4, sign, 5.0, 10.0, "m/s")
    found = _greatest(_Hulls.of(table(logged), np.eye(4)), bound)
    rows = sign * np.array(logged)
    fraction = np.linspace(0.0, 1.0, 2001)
    sampled = basis(len(rows[0]) - 1, fraction) @ np.array(rows).T
    assert found.upper >= sampled.max() - 1e-12
    assert found.upper - found.lower <= RESOLUTION * bound.span * 1.001
    # The lower end is a value that is reached where and when it says.
    row = min(int(found.time), len(rows) - 1)
    reached = basis(len(rows[0]) - 1, found.time - row) @ np.array(rows[row])
    other = reached
    if found.time == row and row > 0:
        other = rows[row - 1][-1]
    assert min(abs(found.lower - reached), abs(found.lower - other)) < 1e-9
    assert found.drone == 7


@settings(deadline=None, max_examples=80, derandomize=True)
@given(
    st.lists(st.floats(-9.0, 9.0), min_size=2, max_size=10),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
)
def test_parts_halves_and_products_are_the_same_polynomials(row, one, other):
    low, high = sorted((one, other))
    whole = np.array(row)[None, :, None]
    inner = part(whole, np.array([low]), np.array([high]))
    left, right = halves(whole)
    raised = elevate(whole, whole.shape[1] + 2)
    squared = square_sum(np.concatenate([whole, 2.0 * whole], axis=2))
    for share in (0.0, 0.3, 1.0):
        at = np.array([share])
        expected = values(whole, low + at * (high - low))
        np.testing.assert_allclose(values(inner, at), expected, atol=1e-11)
        np.testing.assert_allclose(
            values(left, at), values(whole, 0.5 * at), atol=1e-11
        )
        np.testing.assert_allclose(
            values(right, at), values(whole, 0.5 + 0.5 * at), atol=1e-11
        )
        np.testing.assert_allclose(values(raised, at), values(whole, at), atol=1e-11)
        np.testing.assert_allclose(
            values(squared[:, :, None], at), 5.0 * values(whole, at) ** 2, atol=1e-9
        )


def test_a_limit_broken_between_nodes_alone_is_found(log_and_show):
    """Values at ends and middle keep the limit; in between the tilt leaves it."""
    _, show = log_and_show
    tilt = show.rules.limits[0].tilt
    table = show.segments[0].tables[0]
    state = table.state.copy()
    # A quintic that is zero at 0, 1/2 and 1 and has a bump on each side.
    shares = np.linspace(0.0, 1.0, 6)
    bump = np.sin(2 * np.pi * shares) * 1.3 * tilt
    state[3, :, 7] = np.linalg.solve(basis(5, shares), bump)
    spoilt = with_table(show, 0, state=state).segments[0]
    nodes = basis(5, [0.0, 0.5, 1.0]) @ state[3, :, 7]
    assert np.all(np.abs(nodes) < tilt)
    worst = min(
        (e for e in extremes(spoilt, show.rules) if e.bound.quantity == "tilt"),
        key=lambda e: e.margin,
    )
    dense = np.abs(basis(5, np.linspace(0, 1, 100_001)) @ state[3, :, 7]).max()
    assert worst.margin < -0.05
    assert worst.upper == pytest.approx(dense, abs=1e-7)
    assert worst.drone == 3


def test_every_limit_of_the_rules_is_looked_at(log_and_show):
    """Tighten one number at a time: exactly its family must fail."""
    from showc.log import showc_pb2 as pb

    _, show = log_and_show
    segment = show.segments[0]
    fields = {
        "volume": ["position_min", "position_max"],
        "velocity": ["velocity_min", "velocity_max"],
        "body rates": ["body_rate"],
        "torques": ["torque_max"],
    }
    for family, names in fields.items():
        for name in names:
            for axis in "xyz":
                rules = pb.Rules()
                rules.CopyFrom(show.rules)
                sign = 1.0 if name.endswith("_min") else -1.0
                for limits in rules.limits:
                    setattr(getattr(limits, name), axis, sign * 1e3)
                broken = {
                    e.bound.quantity
                    for e in extremes(segment, rules)
                    if e.margin < -1e-6
                }
                assert broken == {family}, (name, axis)


def test_rotor_speeds_follow_the_allocation(log_and_show):
    _, show = log_and_show
    rotors = [
        bound
        for bound in bounds(show.rules, show.rules.limits[0])
        if bound.quantity == "rotor speeds" and bound.name.startswith("greatest")
    ]
    assert [bound.component for bound in rotors] == [16, 17, 18, 19]
    shares = rotor_shares(show.rules)
    vehicle = show.rules.vehicle
    hover = np.array([vehicle.mass * vehicle.gravity, 0.0, 0.0, 0.0])
    full = 4 * vehicle.thrust_coefficient * vehicle.rotor_speed_max**2
    np.testing.assert_allclose(shares @ hover, hover[0] / full)
    # One rotor alone at full speed, as the allocation is printed: kF, kF l, kM.
    thrust = full / 4
    arm = thrust * vehicle.arm_length
    drag = thrust * vehicle.torque_coefficient / vehicle.thrust_coefficient
    alone = [
        (thrust, 0.0, arm, drag),
        (thrust, -arm, 0.0, -drag),
        (thrust, 0.0, -arm, drag),
        (thrust, arm, 0.0, -drag),
    ]
    for rotor, control in enumerate(alone):
        np.testing.assert_allclose(
            shares @ np.array(control), np.eye(4)[rotor], atol=1e-12
        )
