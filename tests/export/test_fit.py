"""Flights as cubics on a grid: continuous, within the error that is stated."""

from dataclasses import replace

import numpy as np
import pytest

from showc.errors import ExportError
from showc.export.fit import (
    LONGEST,
    STEPS,
    decoded,
    fit_fleet,
    tracks_of,
)
from showc.foreign.motion import derivative, jumps, place_at
from showc.foreign.showmode import FITTED, FOLLOWED, UP, joint_accelerations
from showc.trajectory import PiecewisePolynomial


@pytest.fixture(scope="module", params=["vertical", "gliding"])
def show(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def fitted(show):
    return fit_fleet(show, lead=10.0, tolerance=0.01)


def test_velocity_is_continuous_exactly_in_whole_steps(fitted):
    for drone in range(fitted.drones):
        points = fitted.points[fitted.rows(drone)]
        lengths = fitted.lengths[fitted.rows(drone), None]
        before = (points[:-1, 3] - points[:-1, 2]) * lengths[1:]
        after = (points[1:, 1] - points[1:, 0]) * lengths[:-1]
        assert np.array_equal(points[:-1, 3], points[1:, 0])
        assert np.array_equal(before, after)


def test_no_sample_is_further_off_than_stated(show, fitted):
    exact, written = tracks_of(show), decoded(fitted)
    slope, other = derivative(exact), derivative(written)
    for time in np.linspace(0.0, show.duration, 501):
        off = place_at(exact, time)[:, :3] - place_at(written, time + 10.0)
        assert np.sqrt((off**2).sum(axis=1)).max() <= fitted.error.position.upper
        off = place_at(slope, time)[:, :3] - place_at(other, time + 10.0)
        assert np.sqrt((off**2).sum(axis=1)).max() <= fitted.error.velocity.upper


def test_the_stated_error_is_reached(show, fitted):
    worst = fitted.error.position
    off = (
        place_at(tracks_of(show), worst.time - 10.0)[worst.drone, :3]
        - place_at(decoded(fitted), worst.time)[worst.drone]
    )
    assert np.linalg.norm(off) == pytest.approx(worst.lower, abs=1e-6)
    assert worst.upper <= 0.01


def test_every_drone_passes_the_takeoff_height_at_a_node(fitted):
    for drone in range(fitted.drones):
        grid = fitted.scale[drone]
        height = fitted.points[fitted.rows(drone), 0, 2] * grid
        wanted = height[0] + 2500
        assert np.any((height >= wanted) & (height < wanted + grid))


def test_shorter_pieces_are_taken_for_a_smaller_error(gliding):
    # Four times as quick, so that pieces of a quarter of a second miss something.
    flights = tuple(
        PiecewisePolynomial(0.25 * flight.breaks, flight.coefficients)
        for flight in gliding.flights
    )
    quick = replace(gliding, flights=flights)
    coarse = fit_fleet(quick, lead=10.0, tolerance=0.5)
    fine = fit_fleet(quick, lead=10.0, tolerance=0.01)
    assert fine.shortest < coarse.shortest
    assert fine.error.position.upper <= 0.01 < coarse.error.position.lower


def test_what_no_piece_reaches_is_refused_with_its_drone(show):
    with pytest.raises(ExportError, match=r"drone \d+ at .* wanted at most 0.01 mm"):
        fit_fleet(show, lead=10.0, tolerance=1e-5)


def test_the_fleet_stands_before_and_after(show, fitted):
    written = decoded(fitted)
    assert np.ptp(written.position[written.first[:-1]], axis=1).max() == 0.0
    assert fitted.duration >= show.duration + 10.0
    _, off = jumps(derivative(written))
    assert np.abs(off).max() < 1e-9


def test_drones_that_need_shorter_pieces_do_not_shorten_those_of_others(gliding):
    flights = list(gliding.flights)
    quick = PiecewisePolynomial(0.25 * flights[0].breaks, flights[0].coefficients)
    flights[0] = quick
    fitted = fit_fleet(replace(gliding, flights=tuple(flights)), lead=10.0)
    shortest = [fitted.lengths[fitted.rows(drone)].min() for drone in range(9)]
    assert shortest[0] < 250
    assert min(shortest[1:]) >= 250 - 10_000 % 250
    assert fitted.error.position.upper <= 0.01


def climbing(acceleration, far):
    """Return a drone that climbs from rest as steeply as said, ``far`` m away."""
    times = np.array([0.0, 1.0, 2.5, 4.0, 5.0])
    place = np.zeros((4, 3, 4))
    place[:, :, 0] = far
    rise = acceleration * 1.5**2 / 2.0
    place[1, :, 2] = [0.0, 0.0, rise]
    place[2, :, 2] = [rise, 2.0 * rise, 2.0 * rise]
    place[3, :, 2] = 2.0 * rise
    return PiecewisePolynomial(times, place)


@pytest.mark.parametrize("far", [0.0, 60.0, 160.0, 250.0])
@pytest.mark.parametrize("acceleration", [2.985, 3.0])
def test_rounding_asks_for_no_more_than_was_flown(gliding, far, acceleration):
    # A quarter of a second on a grid of 5 mm knows 2.88 and 3.12 m/s², nothing between.
    flights = tuple(climbing(acceleration, far + 0.7 * one) for one in range(9))
    show = replace(gliding, flights=flights)
    fitted = fit_fleet(show, lead=10.0, followed=FOLLOWED)
    _, up, _ = joint_accelerations(derivative(decoded(fitted)))
    assert up.upper <= UP + FITTED
    assert fitted.error.position.upper <= 0.01


def test_lengths_of_pieces_are_those_the_server_keeps():
    for step in STEPS:
        for count in range(1, LONGEST // step + 1):
            whole = step * count
            assert int(round(whole / 1000.0, 3) * 1000.0) == whole
    # The first that it shortens.
    assert int(round(4020 / 1000.0, 3) * 1000.0) == 4019
