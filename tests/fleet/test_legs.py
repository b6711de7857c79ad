"""Legs: least times, kept apart, certified; or an error that says what is missing."""

from dataclasses import replace

import numpy as np
import pytest
from fleet.handmade import (
    LIMITS,
    VEHICLE,
    Listening,
    make_itinerary,
    make_leg,
    make_options,
    make_show,
)

from showc.errors import SolveError
from showc.fleet import solve_itinerary, solve_leg
from showc.fleet.ends import check_ends
from showc.fleet.execution.pool import InProcess
from showc.fleet.lower_bound.bound import surplus
from showc.fleet.lower_bound.relaxation import Relaxation
from showc.fleet.single_drone.replay import replay
from showc.progress import Silent
from showc.vehicle import Separation
from showc.vehicle.metric import measure

GRID = np.array([(2.0 * x, 2.0 * y, 10.0) for x in range(3) for y in range(2)])


def solve(leg, progress=None, options=None, **show):
    return solve_leg(
        leg,
        make_show(leg.drones.size, **show),
        options or make_options(),
        InProcess(),
        progress or Silent(),
    )


def assert_flies(flight, separation, limits=LIMITS):
    """Physics, limits and separation by code that shares nothing with the solver."""
    leg = flight.leg
    assert round(flight.duration * 1000.0, 6).is_integer()
    times = np.linspace(0.0, flight.duration, 3001)
    positions = []
    for row, trajectory in enumerate(flight.trajectories):
        state, control = trajectory.state(times), trajectory.control(times)
        assert trajectory.state.end == flight.duration
        assert np.array_equal(trajectory.state.breaks, trajectory.control.breaks)
        assert np.abs(state[0, :3] - leg.start[row]).max() < 1e-9
        assert np.abs(state[-1, :3] - leg.goal[row]).max() < 1e-9
        assert np.abs(np.delete(state[[0, -1], 3:], 5, axis=1)).max() < 1e-7
        assert np.all(state[:, 3:6] <= np.array(limits.velocity_max) + 1e-6)
        assert np.all(state[:, 3:6] >= np.array(limits.velocity_min) - 1e-6)
        assert np.abs(state[:, 6:8]).max() <= limits.tilt + 1e-8
        assert np.all(np.abs(state[:, 9:12]) <= np.array(limits.body_rate) + 1e-7)
        rotors = control @ VEHICLE.rotor_fractions().T
        assert rotors.min() >= -1e-7 and rotors.max() <= 1.0 + 1e-7
        positions.append(state[:, :3])
    errors = replay(VEHICLE, flight.trajectories)
    assert errors.position.max() < 1e-3
    for i in range(len(positions)):
        for j in range(i):
            gap = measure(positions[i] - positions[j], separation)
            assert gap.min() >= separation.distance - 1e-6
            claimed = flight.certificate.closest.distance
            assert gap.min() >= claimed - 1e-6


def assert_certified(flight):
    certificate = flight.certificate
    assert certificate.duration == flight.duration
    assert 0.0 < certificate.dual_bound <= certificate.single_drone_minimum
    assert certificate.single_drone_minimum <= flight.duration
    witness = certificate.witness
    assert witness.time == certificate.dual_bound
    way = (flight.leg.goal - flight.leg.start)[witness.drone]
    proof = surplus(
        Relaxation(VEHICLE, flight.leg.limits),
        way,
        witness.time * (1.0 - 1e-6),
        np.array(witness.beta),
        np.array(witness.knots),
        np.array(witness.multipliers),
    )
    assert proof > 0.0


@pytest.mark.slow
def test_a_grid_that_shifts_costs_one_move_and_is_within_a_percent():
    progress = Listening()
    leg = make_leg(GRID, GRID + [30.0, 20.0, 10.0])
    flight = solve(leg, progress)
    assert_flies(flight, Separation(1.0))
    assert_certified(flight)
    certificate = flight.certificate
    assert flight.duration <= 1.01 * certificate.single_drone_minimum + 1e-3
    assert flight.duration <= 1.015 * certificate.dual_bound + 1e-3
    assert certificate.closest.distance == pytest.approx(2.0, abs=1e-6)
    assert certificate.statistics["solves_without_slack"] == 1.0
    shapes = {t.state.coefficients.shape for t in flight.trajectories}
    assert len(shapes) == 1
    assert any("minimum" in title for title, _ in progress.stages)


def test_drones_that_swap_places_pass_on_the_right():
    angle = 2.0 * np.pi * np.arange(4) / 4
    start = np.column_stack([9 * np.cos(angle), 9 * np.sin(angle), np.full(4, 20.0)])
    goal = start * [-1.0, -1.0, 1.0]
    progress = Listening()
    flight = solve(make_leg(start, goal, duration=5.6), progress)
    assert_flies(flight, Separation(1.0))
    assert_certified(flight)
    assert flight.certificate.statistics["first_conflicts"] >= 2
    assert any("conflicts left at" in note for note in progress.notes)
    # Each keeps its partner on its left: it passes on its own right.
    middle = flight.duration / 2.0
    at = np.array([t.state(middle)[:2] for t in flight.trajectories])
    way = (goal - start)[:, :2]
    aside = at[:, 0] * way[:, 1] - at[:, 1] * way[:, 0]
    assert np.all(aside > 0.0)


@pytest.mark.slow
def test_a_script_s_time_is_kept_exactly_if_it_is_enough():
    leg = make_leg(GRID, GRID + [6.0, 0.0, 3.0], duration=4.2504)
    flight = solve(leg)
    assert flight.duration == 4.251
    assert_flies(flight, Separation(1.0))


def test_too_little_time_is_refused_with_what_it_needs():
    leg = make_leg(GRID, GRID + [30.0, 20.0, 10.0], duration=5.0)
    with pytest.raises(SolveError) as caught:
        solve(leg)
    message = str(caught.value)
    assert message.startswith("show.yaml:12:5: move: needs >= 6.8")
    assert "script gives 5.000 s" in message
    assert "drone 1" in message and "37.42 m" in message
    assert caught.value.exit_code == 1


def test_drones_that_hover_stay_where_they_are():
    start = np.array([[0.0, 0.0, 10.0], [9.0, 0.0, 10.0], [4.5, 0.0, 10.0]])
    goal = start.copy()
    goal[[0, 1]] = start[[1, 0]]
    flight = solve(make_leg(start, goal, duration=7.0))
    assert_flies(flight, Separation(1.0))
    still = flight.trajectories[2].state(np.linspace(0.0, 7.0, 50))
    assert np.abs(still[:, :3] - start[2]).max() < 1e-9


def test_parked_drones_are_flown_around():
    start, goal = np.array([[0.0, 0.0, 10.0]]), np.array([[14.0, 0.0, 10.0]])
    parked = np.array([[7.0, 0.1, 10.0], [7.0, 40.0, 10.0]])
    flight = solve(make_leg(start, goal, duration=7.0, parked=parked))
    track = flight.trajectories[0].state(np.linspace(0.0, 7.0, 4000))[:, :3]
    assert np.linalg.norm(track - parked[0], axis=1).min() >= 1.0
    assert track[:, 1].min() < -0.5


@pytest.mark.parametrize(
    "separation",
    [Separation(1.0, "ellipsoid", 3.0), Separation(1.0, "any-axis")],
)
def test_other_forms_of_separation_are_kept(separation):
    start = np.array([[0.0, 0.0, 10.0], [12.0, 0.3, 10.2]])
    goal = start[::-1].copy()
    flight = solve(make_leg(start, goal, duration=6.5), separation=separation)
    assert_flies(flight, separation)


def test_a_hold_is_exact():
    leg = make_leg(GRID, GRID, kind="hold", duration=2.5)
    flight = solve(leg)
    assert flight.duration == 2.5 and flight.certificate.dual_bound == 0.0
    for row, trajectory in enumerate(flight.trajectories):
        assert np.array_equal(trajectory.state(1.7)[:3], GRID[row])
        assert trajectory.control(1.0)[0] == VEHICLE.hover_thrust


def test_a_formation_too_tight_is_refused():
    tight = GRID * [0.4, 1.0, 1.0]
    with pytest.raises(SolveError, match=r"drone 1 and drone 3 .* 0\.800 m .*'to'"):
        solve(make_leg(GRID, tight))


def test_a_place_outside_the_volume_is_refused():
    limits = replace(LIMITS, position_max=(200.0, 200.0, 11.0))
    with pytest.raises(SolveError, match=r"drone 1 .*outside the flight volume"):
        solve(make_leg(GRID, GRID + [0.0, 0.0, 2.0], limits=limits))


def test_legs_follow_each_other_and_come_from_the_cache(tmp_path):
    up = GRID + [0.0, 0.0, 4.0]
    legs = [
        make_leg(GRID, up, index=0, duration=4.0, name="up"),
        make_leg(up, up, index=1, kind="hold", duration=1.5),
        make_leg(up, GRID, index=2, duration=4.0, name="down"),
    ]
    options = make_options(use_cache=True, cache=tmp_path)
    first = solve_itinerary(make_itinerary(legs), options, Silent())
    assert first.starts.tolist() == [0.0, 4.0, 5.5]
    progress = Listening()
    again = solve_itinerary(make_itinerary(legs), options, progress)
    assert "3 of 3 legs taken from the cache" in progress.notes
    for one, other in zip(first.legs, again.legs, strict=True):
        for a, b in zip(one.trajectories, other.trajectories, strict=True):
            assert np.array_equal(a.state.coefficients, b.state.coefficients)
    whole = again.drone(3)
    assert whole.state.end == 9.5
    # Changing one leg solves that leg only.
    legs[2] = replace(legs[2], duration=5.0)
    progress = Listening()
    solve_itinerary(make_itinerary(legs), options, progress)
    assert "2 of 3 legs taken from the cache" in progress.notes


@pytest.mark.slow
def test_the_number_of_jobs_changes_nothing():
    rng = np.random.default_rng(3)
    start = np.vstack([GRID, GRID + [0.0, 0.0, 3.0]])
    goal = rng.permutation(start) + [8.0, 0.0, 2.0]
    leg = make_leg(start, goal, duration=5.0)
    alone = solve_itinerary(make_itinerary([leg]), make_options(jobs=1), Silent())
    crew = solve_itinerary(make_itinerary([leg]), make_options(jobs=2), Silent())
    for a, b in zip(alone.legs[0].trajectories, crew.legs[0].trajectories, strict=True):
        assert np.array_equal(a.state.coefficients, b.state.coefficients)
        assert np.array_equal(a.control.coefficients, b.control.coefficients)
    assert alone.legs[0].certificate == crew.legs[0].certificate
    assert_flies(crew.legs[0], Separation(1.0))


def test_drones_that_change_order_along_an_axis_cannot_keep_all_axes_apart():
    start = np.array([[0.0, 0.0, 10.0], [4.0, 9.0, 12.0], [9.0, 3.0, 14.0]])
    goal = start[[0, 2, 1]] + [30.0, 0.0, 0.0]
    with pytest.raises(SolveError, match=r"drone 2 and drone 3 .*order along x"):
        solve(make_leg(start, goal), separation=Separation(1.0, "all-axes"))
    parked = np.array([[20.0, 40.0, 40.0]])
    with pytest.raises(SolveError, match=r"drone 1 and another drone .*any-axis"):
        solve(
            make_leg(start[:1], goal[:1], parked=parked),
            separation=Separation(1.0, "all-axes"),
        )


@pytest.mark.slow
def test_all_axes_are_kept_apart_where_the_order_allows_it():
    row = np.arange(4)[:, None]
    start = np.array([0.0, 0.0, 10.0]) + row * [1.005, 1.005, 1.005]
    goal = np.array([14.0, 9.0, 12.0]) + row * [1.4, 1.005, 1.3]
    separation = Separation(1.0, "all-axes")
    flight = solve(make_leg(start, goal), separation=separation)
    assert_flies(flight, separation)
    statistics = flight.certificate.statistics
    assert statistics["first_conflicts"] > 0.0
    assert flight.certificate.gap < 0.03


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(
    ("separation", "wide"),
    [
        (Separation(1.0), (0.6, 0.8)),
        (Separation(1.0, "ellipsoid", 2.0), (0.6, 0.8)),
        (Separation(1.0, "any-axis"), (1.0, 1.0)),
    ],
    ids=lambda one: getattr(one, "shape", ""),
)
def test_drones_that_cannot_pass_each_other_are_refused_at_once(axis, separation, wide):
    """A volume is as wide as two drones side by side need, or a millimetre less."""
    sides = np.delete(np.arange(3), axis)
    low, high = np.full(3, -9.0), np.full(3, 9.0)
    wide = np.array(wide) / np.asarray(separation.metric_scale)[sides]
    low[sides], high[sides] = 0.0, wide
    ends = np.array([np.zeros(3), np.zeros(3)])
    ends[0, axis], ends[1, axis] = -4.0, 4.0
    for less, refused in ((-1e-3, False), (1e-3, True)):
        high[sides] = wide - less
        limits = replace(
            LIMITS, position_min=tuple(low.tolist()), position_max=tuple(high.tolist())
        )
        leg = make_leg(ends, ends[::-1], limits=limits)
        show = make_show(2, separation=separation)
        if not refused:
            check_ends(leg, show)
            continue
        with pytest.raises(SolveError, match=f"across {'xyz'[axis]} and the sep"):
            check_ends(leg, show)
        # Drones that keep their order may fly.
        check_ends(make_leg(ends, ends, limits=limits), show)
