"""The itinerary is complete from ground to ground, and nobody is lost on the way."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from synthetic import formation, make_show

from showc.errors import PlanError
from showc.plan import build_itinerary
from showc.script.mark import Mark
from showc.script.show import Transition

MARK = Mark("show.yaml", 7, 5, 7, 12)


def transition(to, **keys):
    defaults = {
        "name": f"to {to}", "hold": 2.0, "assignment": "optimal", "mark": MARK,
    }  # fmt: skip
    return Transition(to=to, **(defaults | keys))


def grid(count, height, shift=0.0):
    return np.array([[2.0 * i + shift, 0.0, height] for i in range(count)])


def place(name, points):
    return formation(name, points, np.ones(3))


@pytest.fixture
def show():
    base = make_show(
        [
            place("pads", grid(4, 0.0)),
            place("line", grid(4, 10.0, 3.0)),
            place("pair", grid(2, 15.0)),
            place("wait", grid(4, 8.0) + [0.0, 5.0, 0.0]),
            place("left", grid(2, 12.0, -9.0)),
        ],
        4,
        holds=[1.0] * 4,
        altitude=5.0,
    )
    return replace(base, groups={"a": (0, 1), "b": (2, 3)}, parking="wait")


class Watching:
    """Remembers how much work it was told of, and how much is done."""

    told, done = None, 0

    def stage(self, title, total=None):
        assert title
        self.told = total

    def advance(self, steps=1):
        self.done += steps

    def note(self, text):
        pass


def test_whoever_watches_sees_it_come_to_its_end(show):
    flown = replace(show, transitions=(transition("line"), transition("wait")))
    watching = Watching()
    build_itinerary(flown, watching)
    assert watching.told == watching.done == 3


def test_from_ground_to_ground_without_a_jump(show):
    itinerary = build_itinerary(
        replace(show, transitions=(transition("line"), transition("pair")))
    )
    legs = itinerary.legs
    assert legs[0].kind == "launch" and legs[-1].kind == "land"
    pads = show.formations["pads"].points
    np.testing.assert_array_equal(legs[0].start, pads)
    assert {tuple(p) for p in legs[-1].goal} == {tuple(p) for p in pads}
    for before, after in pairwise(legs):
        np.testing.assert_array_equal(before.goal, after.start)
        assert after.after == (before.index,)
        assert before.to_formation == after.from_formation


def test_launch_and_landing_are_vertical_and_slow(show):
    itinerary = build_itinerary(replace(show, transitions=(transition("line"),)))
    for leg, speed in (
        (itinerary.legs[0], show.launch.climb_speed),
        (itinerary.legs[-1], show.landing.descent_speed),
    ):
        np.testing.assert_array_equal(leg.start[:, :2], leg.goal[:, :2])
        assert leg.limits.velocity_max[2] <= speed
        assert leg.limits.velocity_min[2] >= -speed


def test_places_name_where_each_drone_ends(show):
    itinerary = build_itinerary(replace(show, transitions=(transition("line"),)))
    formations = itinerary.show.formations
    for leg in itinerary.legs:
        points = formations[leg.to_formation].points
        np.testing.assert_allclose(points[leg.places], leg.goal)


def test_who_hovers_above_the_pads_lands_from_there(show):
    pads = show.formations["pads"].points
    above = place("above", pads[::-1] + [0.0, 0.0, show.landing.altitude])
    show = replace(show, formations={**show.formations, "above": above})
    itinerary = build_itinerary(
        replace(show, transitions=(transition("line"), transition("above")))
    )
    assert "approach" not in {leg.kind for leg in itinerary.legs}
    formations = itinerary.show.formations
    for leg in itinerary.legs:
        points = formations[leg.to_formation].points
        np.testing.assert_allclose(points[leg.places], leg.goal)
    land = itinerary.legs[-1]
    np.testing.assert_array_equal(land.start[:, :2], land.goal[:, :2])


def test_the_rest_parks_where_the_script_says(show):
    itinerary = build_itinerary(replace(show, transitions=(transition("pair"),)))
    leg = next(leg for leg in itinerary.legs if leg.kind == "transition")
    parked = leg.places == -1
    assert parked.sum() == 2
    assert sorted(leg.places[~parked].tolist()) == [0, 1]
    waiting = {tuple(p) for p in show.formations["wait"].points}
    assert {tuple(p) for p in leg.goal[parked]} <= waiting


def test_without_parking_the_error_names_the_line(show):
    alone = replace(show, parking=None, transitions=(transition("pair"),))
    with pytest.raises(PlanError, match=r"show\.yaml:7:5.*'pair' has 2 places for 4"):
        build_itinerary(alone)


def test_groups_side_by_side_share_a_leg(show):
    itinerary = build_itinerary(
        replace(
            show,
            transitions=(
                transition("line"),
                transition("pair", group="a"),
                transition("left", group="b"),
                transition("left", group="a"),
            ),
        )
    )
    moves = [leg for leg in itinerary.legs if leg.kind == "transition"]
    assert len(moves) == 3
    both, alone = moves[1], moves[2]
    ends = {tuple(p) for p in both.goal}
    assert ends == {
        tuple(p) for name in ("pair", "left") for p in show.formations[name].points
    }
    np.testing.assert_array_equal(alone.start[2:], alone.goal[2:])
    assert {tuple(p) for p in alone.goal[:2]} == {
        tuple(p) for p in show.formations["left"].points
    }


def test_two_groups_never_park_on_one_spot(show):
    one = replace(show, formations={
        **show.formations, "single": place("single", grid(1, 20.0)),
        "other": place("other", grid(1, 20.0, 9.0)),
    })  # fmt: skip
    itinerary = build_itinerary(
        replace(
            one,
            transitions=(
                transition("single", group="a"),
                transition("other", group="b"),
            ),
        )
    )
    leg = next(leg for leg in itinerary.legs if leg.kind == "transition")
    assert len({tuple(p) for p in leg.goal}) == 4


def test_a_group_sent_to_one_formation_twice_leaves_two_formations(show):
    far = replace(show, formations={
        **show.formations, "far": place("far", grid(2, 20.0, 30.0)),
    })  # fmt: skip
    itinerary = build_itinerary(
        replace(
            far,
            transitions=(
                transition("left", group="a"),
                transition("far", group="a"),
                transition("pair", group="b"),
                transition("left", group="a"),
            ),
        )
    )
    formations = itinerary.show.formations
    flown = [leg for leg in itinerary.legs if leg.kind == "transition"]
    assert [leg.to_formation for leg in flown] == [
        "a in left",
        "a in far + b in pair",
        "a in left (2)",
    ]
    for leg in flown:
        assert np.array_equal(formations[leg.to_formation].points, leg.goal)
