"""Falls lie within their enclosures."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safety.falls import MASS, landings

from showc.safety.discs import Boxes
from showc.safety.fall import Fall, falls
from showc.safety.ground import Footing
from showc.safety.landing import Courses, FallTable
from showc.safety.pieces import Pieces
from showc.vehicle.power import SEA_LEVEL

DRAG, WIND = (0.02, 0.04), 8.0


@pytest.fixture(scope="module")
def table():
    return FallTable.covering(Fall(MASS, DRAG, WIND), (-5.0, 5.0), 8.0, 60.0)


def box(speed, climb, height):
    points = (climb, climb, speed, speed, height, height)
    return Boxes(*(np.array([value]) for value in points))


def impacts(table, speed, climb, height):
    return table(box(speed, climb, height))


@settings(max_examples=60)
@given(
    st.floats(0.0, 8.0), st.floats(-5.0, 5.0), st.floats(0.0, 60.0), st.integers(0, 9)
)
def test_every_fall_ends_in_its_disc(table, speed, climb, height, seed):
    found = impacts(table, speed, climb, height)
    rng = np.random.default_rng(seed)
    count = 200
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    size = WIND * np.where(rng.random(count) < 0.5, 1.0, rng.random(count))
    wind = size[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    drag = rng.choice([DRAG[0], 0.5 * sum(DRAG), DRAG[1]], count)
    velocity = np.tile([speed, 0.0, climb], (count, 1))
    ground = landings(velocity, np.full(count, height), wind, drag)
    away = np.hypot(ground[:, 0] - speed * found.carry[0], ground[:, 1])
    assert (away <= found.radius[0]).all()


@settings(max_examples=40)
@given(st.integers(0, 100_000))
def test_every_fall_from_a_box_ends_in_its_disc(table, seed):
    rng = np.random.default_rng(seed)
    low = rng.uniform([-5.0, 0.0, 0.0], [3.0, 6.0, 50.0])
    high = low + rng.uniform(0.0, 1.0) * np.array([2.0, 2.0, 10.0])
    sides = (low[0], high[0], low[1], high[1], low[2], high[2])
    found = table(Boxes(*(np.array([value]) for value in sides)))
    count = 300
    states = rng.uniform(low, high, (count, 3))
    states[: count // 2] = np.where(rng.random((count // 2, 3)) < 0.5, low, high)
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    wind = WIND * np.column_stack([np.cos(angle), np.sin(angle)])
    velocity = np.column_stack([states[:, 1], np.zeros(count), states[:, 0]])
    drag = rng.choice(DRAG, count)
    ground = landings(velocity, states[:, 2], wind, drag)
    away = np.hypot(ground[:, 0] - states[:, 1] * found.carry[0], ground[:, 1])
    assert (away <= found.radius[0]).all()


def corner_of(low, high):
    """Courses of one box of climbs, heights and two level velocities."""
    sides = [np.array([side]) for pair in zip(low, high, strict=True) for side in pair]
    velocity = np.array(
        [[[x, y] for x in (low[1], high[1]) for y in (low[3], high[3])]]
    )
    climbs, _, heights, _ = (sides[2 * k : 2 * k + 2] for k in range(4))
    speed = np.linalg.norm(velocity[0], axis=1).max(keepdims=True)
    return Boxes(*climbs, 0.0 * speed, speed, *heights), velocity


@settings(max_examples=60)
@given(st.integers(0, 100_000), st.sampled_from([0.0, 0.02, 0.5]))
def test_no_fall_from_a_box_goes_beyond_its_reach(table, seed, size):
    # Climb, one level velocity, height, the other level velocity.
    rng = np.random.default_rng(seed)
    low = rng.uniform([-5.0, -5.0, 0.0, -5.0], [4.5, 4.5, 50.0, 4.5])
    if seed % 3 == 0:
        low[2] *= 0.05
    high = low + size * np.array([1.0, 1.0, 8.0, 1.0])
    boxes, velocity = corner_of(low, high)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    direction = np.array([[np.cos(angle), np.sin(angle)]])
    # Places that go with the velocities, as on a way.
    moved = rng.normal(size=(2, 2))
    rest = velocity @ moved, velocity, np.zeros(1), direction
    bound = table.reach(Courses(boxes, *rest))[0]
    count = 400
    states = np.where(rng.random((count, 4)) < 0.5, low, high)
    bearing = angle + rng.normal(0.0, 0.6, count)
    share = np.where(rng.random(count) < 0.7, 1.0, rng.random(count))
    wind = (WIND * share)[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    drag = rng.choice([DRAG[0], 0.5 * sum(DRAG), DRAG[1]], count)
    # Down to the ground, or to a head above it.
    end = np.minimum(rng.choice([0.0, 1.0, 2.0], count), states[:, 2])
    ground = landings(states[:, [1, 3, 0]], states[:, 2] - end, wind, drag)
    farthest = ((states[:, [1, 3]] @ moved + ground) @ direction[0]).max()
    assert farthest <= bound + 1e-3
    if size == 0.0 and states[0, 2] > 5.0:
        assert bound <= farthest + 0.5 + 0.03 * abs(farthest)


def test_the_place_of_a_drone_that_brakes_is_taken_with_its_velocity(table):
    # From 3 m/s in a second: the place is greatest where the velocity is least.
    state = np.zeros((1, 3, 6))
    state[0, :, [0, 2, 3]] = [0.0, 1.5, 1.5], np.full(3, 15.0), [3.0, 1.5, 0.0]
    whole = Pieces(np.zeros(1, dtype=int), np.zeros(1), np.ones(1), state)
    footing = Footing(table)
    bound, reached = (
        footing.reach(whole.parts(parts), np.tile([1.0, 0.0], (parts, 1))).max()
        for parts in (1, 64)
    )
    assert reached <= bound <= reached + 1.0


def test_a_hovering_drone_is_enclosed_closely(table):
    found = impacts(table, 0.0, 0.0, 60.0)
    ground = landings(
        np.zeros((1, 3)), np.array([60.0]), np.array([[WIND, 0.0]]), np.array([DRAG[1]])
    )
    assert ground[0, 0] <= found.radius[0] <= 1.04 * ground[0, 0]


def test_without_wind_the_carry_is_that_of_the_literature():
    # 625 g, 0.03 m² and 8 m/s from 60 m in calm air: 18.7 m by plain integration.
    table = FallTable.covering(Fall(MASS, (0.03, 0.03), 0.0), (0.0, 0.1), 8.0, 60.0)
    found = impacts(table, 8.0, 0.0, 60.0)
    farthest = 8.0 * found.carry[0] + found.radius[0]
    assert 18.7 <= farthest <= 1.05 * 18.7


def test_no_impact_is_faster_than_the_bound(table):
    # Terminal speed of the least drag area, and the wind.
    found = table.impact_speed(box(0.0, 0.0, 60.0))
    terminal = np.sqrt(2.0 * MASS * 9.81 / (SEA_LEVEL * DRAG[0]))
    assert 20.0 < found[0] <= np.hypot(terminal, WIND)


def test_a_state_outside_the_table_is_refused(table):
    with pytest.raises(ValueError, match="outside the bounds"):
        impacts(table, 0.0, 0.0, 61.0)


def test_falls_under_a_parachute_are_those_of_a_finer_integration(monkeypatch):
    grid = np.array([-4.0, 3.0]), np.array([0.0, 22.0]), np.array([0.5, 10.0])
    levels = np.array([0.0, 0.2, 2.0, 20.0])
    coarse = falls(*grid, levels, 9.81)
    monkeypatch.setattr("showc.safety.fall.STIFF", 0.005)
    fine = falls(*grid, levels, 9.81)
    for one, other in zip(coarse, fine, strict=True):
        assert one == pytest.approx(other, abs=1e-4)
