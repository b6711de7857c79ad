"""A falling drone meets those below it, and no drone that is not named."""

import numpy as np
import pytest
from safety.falls import MASS, landings

from showc.log.reader import read_log
from showc.safety.failure import failures
from showc.safety.fall import Fall
from showc.safety.ground import Footing, Stopping, least, within
from showc.safety.pieces import flight_pieces, flown_legs
from showc.trajectory import PiecewisePolynomial

DRAG = (0.02, 0.04)


def hovering(*places, speed=(0.0, 0.0, 0.0), duration=6.0):
    """States of drones that stand, or all move on at one speed."""
    states = []
    for place in places:
        end = np.array(place) + duration * np.array(speed)
        values = [[*place, *speed], [*end, *speed]]
        states.append(
            PiecewisePolynomial(np.array([0.0, duration]), np.array([values]))
        )
    return states


def met(wind, *places, **more):
    fall = Fall(MASS, DRAG, wind)
    return failures(hovering(*places, **more), fall, 0.4, 0.0)


def named(found):
    """Pairs of a falling drone and one that it may meet, at any second."""
    return {(drone, other) for (_, drone), row in found.meetings() for other in row}


def test_in_calm_air_only_the_drone_below_is_met():
    found = met(0.0, (0.0, 0.0, 30.0), (0.0, 0.0, 10.0), (5.0, 0.0, 10.0))
    assert named(found) == {(0, 1)}
    assert found.below(0, 0) == [1]
    assert found.share == pytest.approx(1.0 / 3.0, abs=0.12)


@pytest.mark.parametrize(("drag", "height"), [(DRAG, 900.0), ((0.5, 1.0), 150.0)])
def test_the_longest_falls_are_followed_to_the_ground(drag, height):
    # The first ends after a minute, the second, under a parachute, after as long.
    fleet = hovering((0.0, 0.0, height), (1.0, 0.0, 3.0))
    found = failures(fleet, Fall(MASS, drag, 1.0), 0.4, 0.0)
    assert (0, 1) in named(found)


def test_wind_widens_the_cone():
    places = (0.0, 0.0, 40.0), (5.0, 0.0, 5.0)
    assert not named(met(0.0, *places))
    assert named(met(8.0, *places))


def test_every_meeting_is_of_its_own_second_and_drone(monkeypatch):
    rng = np.random.default_rng(4)
    fleet = hovering(*rng.uniform((-9.0, -9.0, 2.0), (9.0, 9.0, 30.0), (40, 3)))
    fall = Fall(MASS, DRAG, 3.0)
    found = failures(fleet, fall, 0.4, 0.0)
    for (step, drone), row in found.meetings():
        assert found.below(step, drone) == row
        assert found.met[step, drone] == len(row)
    assert sum(len(row) for _, row in found.meetings()) == found.others.size
    # Neither copies of the process nor what they look at together change anything.
    monkeypatch.setattr("showc.safety.failure.ALONE", 0)
    monkeypatch.setattr("showc.safety.failure.TOGETHER", 1)
    monkeypatch.setattr("showc.safety.failure.ROWS", 3)
    again = failures(fleet, fall, 0.4, 0.0)
    assert (again.met == found.met).all()
    assert (again.others == found.others).all()


def test_a_drone_that_moves_falls_ahead():
    # From 20 m a fall takes 2.1 s; at 4 m/s it ends 7 to 8 m ahead.
    fleet = hovering((0.0, 0.0, 20.0), speed=(4.0, 0.0, 0.0))
    fleet += hovering((7.0, 0.0, 1.0), (-7.0, 0.0, 1.0))
    found = failures(fleet, Fall(MASS, DRAG, 0.0), 0.4, 0.0)
    assert found.below(0, 0) == [1]


def test_no_sampled_fall_meets_a_drone_that_is_not_named():
    rng = np.random.default_rng(3)
    places = np.column_stack(
        [rng.uniform(-6.0, 6.0, (8, 2)), rng.uniform(2.0, 30.0, 8)]
    )
    found = met(6.0, *places, duration=2.0)
    pairs = named(found)
    for falling, place in enumerate(places):
        for other, there in enumerate(places):
            drop = place[2] - there[2]
            if drop <= 0.5 or falling == other:
                continue
            angle = rng.uniform(0.0, 2.0 * np.pi, 200)
            wind = 6.0 * np.column_stack([np.cos(angle), np.sin(angle)])
            ways = landings(
                np.zeros((200, 3)), np.full(200, drop), wind, rng.choice(DRAG, 200)
            )
            gap = np.linalg.norm(place[:2] + ways - there[:2], axis=1)
            assert gap.min() > 0.4 or (falling, other) in pairs


def test_braking_needs_the_way_of_its_own_speed(compiled):
    pieces = flight_pieces(flown_legs(read_log(compiled("swap"))))
    wall = within(
        np.array([[-90.0, -90.0], [90.0, -90.0], [90.0, 90.0], [-90.0, 90.0]])
    )
    stop = Stopping(0.5, 4.0)
    braked = least(pieces, Footing(stop=stop), wall).bound
    flown = least(pieces, Footing(), wall).bound
    speed = np.linalg.norm(pieces.velocity[:, :, :2], axis=2).max()
    assert flown - (0.5 * speed + speed**2 / 8.0) - 0.1 <= braked <= flown + 0.1
    ends = (
        pieces.position[:, -1, :2]
        + (0.5 + np.linalg.norm(pieces.velocity[:, -1, :2], axis=1) / 8.0)[:, None]
        * pieces.velocity[:, -1, :2]
    )
    assert wall(ends).distance.min() >= braked
