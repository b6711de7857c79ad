"""Limits at every instant: enclosures against dense sampling, and what nodes miss."""

import numpy as np
import pytest
from findings import failed
from hypothesis import given, settings
from hypothesis import strategies as st
from lies import Log
from verified import loaded, proved_flight, script_of, with_table, written

from showc.foreign.motion import values
from showc.log import showc_pb2 as pb
from showc.vehicle.motion import thrust_direction
from showc.verify import verify_log
from showc.verify.kernel.bernstein import (
    basis,
    elevate,
    halves,
    part,
    square_sum,
)
from showc.verify.kernel.choreography import joined_up
from showc.verify.kernel.dynamics import allocation, rotor_shares
from showc.verify.kernel.limits import (
    RESOLUTION,
    Bound,
    _coefficients,
    _greatest,
    bounds,
    extremes,
    kept,
)
from showc.verify.kernel.show import PieceTable

RULES = pb.Rules(
    vehicle=pb.Vehicle(
        mass=1.0,
        arm_length=0.2,
        thrust_coefficient=2e-6,
        torque_coefficient=3e-8,
        rotor_speed_max=1500.0,
    )
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


def greatest(table, rules, bound):
    """What is enclosed of a limit's quantity, as of each quantity of a segment."""
    curves = np.asfortranarray(_coefficients(table, rules, bound.quantity))
    return _greatest(table, curves, bound)


@settings(deadline=None, max_examples=150, derandomize=True)
@given(COEFFICIENTS, st.sampled_from([1.0, -1.0]))
def test_greatest_value_is_enclosed(logged, sign):
    bound = Bound("velocity", "vy", sign, 5.0, 10.0, "m/s")
    found = greatest(table(logged), RULES, bound)
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
    tilt = 0.35
    rules = pb.Rules()
    rules.CopyFrom(show.rules)
    for limits in rules.limits:
        limits.tilt = tilt
    table = show.segments[0].table
    state = table.state.copy()
    # A quintic that is zero at 0, 1/2 and 1 and has a bump on each side.
    shares = np.linspace(0.0, 1.0, 6)
    bump = np.sin(2 * np.pi * shares) * 1.3 * tilt
    state[3, :, 7] = np.linalg.solve(basis(5, shares), bump)
    spoilt = with_table(show, 0, state=state).segments[0]
    nodes = basis(5, [0.0, 0.5, 1.0]) @ state[3, :, 7]
    assert np.all(np.abs(nodes) < tilt)
    worst = min(
        (e for e in extremes(spoilt, rules) if e.bound.family == "tilt"),
        key=lambda e: e.margin,
    )
    dense = np.abs(basis(5, np.linspace(0, 1, 100_001)) @ state[3, :, 7]).max()
    assert worst.margin < -0.05
    assert worst.upper == pytest.approx(dense, abs=1e-7)
    assert worst.drone == 3


def test_every_limit_of_the_rules_is_looked_at(log_and_show):
    """Tighten one number at a time: exactly its family must fail."""
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
                    e.bound.family for e in extremes(segment, rules) if e.margin < -1e-6
                }
                assert broken == {family}, (name, axis)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.integers(0, 10_000), st.integers(1, 7))
def test_level_speed_and_accelerations_are_enclosed(seed, degree):
    rng = np.random.default_rng(seed)
    state = np.zeros((3, degree + 1, 12))
    state[:, :, 3:6] = rng.normal(0.0, 2.0, (3, degree + 1, 3))
    edges = np.cumsum(rng.uniform(0.1, 2.0, 4))
    moving = PieceTable(
        np.array([0]),
        np.array([0, 3]),
        edges[:-1],
        edges[1:],
        state,
        np.zeros((3, 1, 4)),
    )
    limits = pb.Limits(
        level_speed=3.0, acceleration=4.0, acceleration_up=2.0, acceleration_down=1.0
    )
    named = {one.name: one for one in bounds(RULES, limits)}
    shares = np.linspace(0.0, 1.0, 1001)
    weights, slopes = basis(degree, shares), basis(degree - 1, shares)
    speed = weights @ state[:, :, 3:6]
    width = np.diff(edges)[:, None, None]
    push = slopes @ (degree * np.diff(state[:, :, 3:6], axis=1) / width)
    truth = {
        "greatest level speed": np.hypot(speed[..., 0], speed[..., 1]).max(),
        "greatest level acceleration": np.hypot(push[..., 0], push[..., 1]).max(),
        "greatest az": push[..., 2].max(),
        "least az": -push[..., 2].min(),
    }
    for name, value in truth.items():
        found = greatest(moving, RULES, named[name])
        most = value**2 if found.bound.squared else value
        size = max(most, found.bound.span**2, 1.0)
        assert most - 1e-12 * size <= found.upper <= most + 1e-4 * size


@settings(deadline=None, max_examples=30, derandomize=True)
@given(
    st.integers(0, 10_000),
    st.integers(0, 4),
    st.sampled_from(["held", "free", "free but still"]),
)
def test_jerk_is_enclosed_whatever_turns(seed, degree, yaw):
    rng = np.random.default_rng(seed)
    width = rng.uniform(0.2, 2.0)
    state, control = np.zeros((1, 5, 12)), np.zeros((1, degree + 1, 4))
    angles = rng.normal(0.0, 0.15, (5, 3)) * [1.0, 1.0, 3.0 if yaw == "free" else 0.0]
    state[0, :, 6:9] = angles
    state[:, :, 9:] = elevate(4 * np.diff(angles[None], axis=1) / width, 4)
    control[0, :, 0] = rng.uniform(5.0, 15.0, degree + 1)
    flown = PieceTable(
        np.array([0]), np.array([0, 1]), np.zeros(1), np.full(1, width), state, control
    )
    rules = pb.Rules(vehicle=RULES.vehicle, yaw_held=yaw == "held")
    # What thrust and attitude give, differentiated by samples.
    shares = np.linspace(0.0, 1.0, 4001)
    thrust = basis(degree, shares) @ control[0, :, 0]
    direction = np.stack(thrust_direction(*(basis(4, shares) @ angles).T), axis=-1)
    change = np.diff(thrust[:, None] * direction, axis=0) / (shares[1] * width)
    truth = np.linalg.norm(change, axis=1).max()
    found = greatest(flown, rules, Bound("jerk", "jerk", 1.0, 9.0, 9.0, "m/s³"))
    assert truth <= np.sqrt(found.upper) * (1.0 + 1e-9)
    if yaw != "free":
        # What the bound leaves out is the cosine of the roll.
        assert np.sqrt(found.upper) * np.cos(np.abs(angles).max()) <= truth * 1.01


def jerky(limit, folder):
    script = script_of(2).replace(b"\npads", b"\nlimits: {jerk: %g}\npads" % limit)
    return loaded(written(proved_flight(2, script), folder / "jerky.mcap"))[1]


def test_a_jerk_beyond_the_limit_and_a_thrust_that_jumps_are_found(tmp_path):
    show = jerky(300.0, tmp_path)

    def stated(show):
        found = [extremes(one, show.rules) for one in show.segments]
        radii = [np.zeros((2, 12))] * len(show.segments)
        every = [*kept(show, radii, found), *joined_up(show)]
        return {one.code: one for one in every}

    before = stated(show)
    assert before["VRF320"].holds
    assert before["VRF334"].holds
    peak = before["VRF320"].value
    low = stated(jerky(np.floor(peak), tmp_path))
    assert not low["VRF320"].holds
    assert low["VRF334"].holds
    # A push that neither mean nor node shows; a start and an end that are no hover.
    for number, row, column in (
        (2, 0, -1),
        (0, 0, 0),
        (len(show.segments) - 1, -1, -1),
    ):
        control = show.segments[number].table.control.copy()
        control[row, column, 0] += 2e-6
        lie = stated(with_table(show, number, control=control))
        assert not lie["VRF334"].holds
        assert lie["VRF334"].value == pytest.approx(2e-6, rel=1e-3)


def test_a_log_that_hides_its_scripts_limit_of_jerk_is_found(tmp_path):
    jerky(300.0, tmp_path)
    path = tmp_path / "jerky.mcap"
    log = Log.read(path.read_bytes())
    before = verify_log(path, missions=False)
    assert not failed(before)
    for claimed in (0.0, 400.0):

        def change(rules, claimed=claimed):
            for limits in rules.limits:
                limits.jerk = claimed

        log.edit("/show/rules", 0, pb.Rules, change)
        path.write_bytes(log.bytes())
        assert failed(verify_log(path, missions=False))


def test_thrust_may_jump_where_jerk_is_not_limited(log_and_show):
    _, show = log_and_show
    control = show.segments[2].table.control.copy()
    control[0] *= 1.001
    found = joined_up(with_table(show, 2, control=control))
    assert "VRF334" not in {one.code for one in found}


def test_rotor_speeds_follow_the_allocation(log_and_show):
    _, show = log_and_show
    rotors = [
        bound
        for bound in bounds(show.rules, show.rules.limits[0])
        if bound.family == "rotor speeds" and bound.name.startswith("greatest")
    ]
    assert [bound.quantity for bound in rotors] == [
        f"rotor {k} (squared)" for k in (1, 2, 3, 4)
    ]
    vehicle = show.rules.vehicle
    shares = rotor_shares(vehicle)
    np.testing.assert_allclose(shares @ allocation(vehicle), np.eye(4), atol=1e-14)
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
