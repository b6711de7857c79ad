"""Legs of an itinerary: side by side, once for all alike, kept whatever happens."""

from dataclasses import replace

import numpy as np
import pytest
from fleet.handmade import Listening, make_itinerary, make_leg, make_options

from showc.errors import SolveError
from showc.fleet import itinerary as module
from showc.fleet import solve_itinerary
from showc.fleet.execution.cache import Cache, leg_key
from showc.progress import Silent

START = np.array([[0.0, 0.0, 10.0], [3.0, 0.0, 10.0]])
ACROSS = START + [0.0, 6.0, 1.0]


def there_and_back(**more):
    return [
        make_leg(START, ACROSS, index=0, duration=4.0, name="out", **more),
        make_leg(ACROSS, START, index=1, duration=4.5, name="back", **more),
        make_leg(START, ACROSS, index=2, duration=4.0, name="out", **more),
    ]


def coefficients(flight):
    return [t.state.coefficients for leg in flight.legs for t in leg.trajectories]


def test_legs_side_by_side_are_those_solved_alone(monkeypatch):
    legs = make_itinerary(there_and_back())
    together = solve_itinerary(legs, make_options(jobs=2, use_cache=False), Silent())
    monkeypatch.setattr(module, "SMALL", 0)
    alone = solve_itinerary(legs, make_options(jobs=1, use_cache=False), Silent())
    assert together.starts.tolist() == alone.starts.tolist() == [0.0, 4.0, 8.5]
    for one, other in zip(coefficients(together), coefficients(alone), strict=True):
        assert np.array_equal(one, other)
    assert [flown.leg.index for flown in together.legs] == [0, 1, 2]


def test_large_legs_overlap_and_are_those_solved_alone(monkeypatch):
    legs, listening = make_itinerary(there_and_back()), Listening()
    alone = solve_itinerary(legs, make_options(jobs=1, use_cache=False), Silent())
    monkeypatch.setattr(module, "LARGE", 1)
    overlapping = solve_itinerary(
        legs, make_options(jobs=2, use_cache=False), listening
    )
    assert ("solving 2 legs, 2 at once", 2) in listening.stages
    for one, other in zip(coefficients(overlapping), coefficients(alone), strict=True):
        assert np.array_equal(one, other)


def test_first_large_leg_without_solution_is_named(monkeypatch):
    monkeypatch.setattr(module, "LARGE", 1)
    legs = there_and_back()
    legs[1] = replace(legs[1], duration=0.5, name="too quick")
    with pytest.raises(SolveError, match=r"too quick: needs >= \d"):
        solve_itinerary(
            make_itinerary(legs), make_options(jobs=2, use_cache=False), Silent()
        )


def test_legs_alike_are_solved_once():
    listening = Listening()
    options = make_options(use_cache=False)
    flight = solve_itinerary(make_itinerary(there_and_back()), options, listening)
    (stage,) = [stage for stage in listening.stages if "in parallel" in stage[0]]
    assert stage == ("solving 2 legs in parallel", 2)
    assert flight.legs[0].trajectories is flight.legs[2].trajectories
    assert flight.legs[2].leg.index == 2


def test_a_leg_without_solution_is_named_and_the_others_are_kept(tmp_path):
    legs = there_and_back()
    legs[1] = replace(legs[1], duration=0.5, name="too quick")
    legs[2] = replace(legs[2], goal=ACROSS + 1.0, duration=0.6, name="later")
    itinerary, options = (
        make_itinerary(legs),
        make_options(use_cache=True, cache=tmp_path),
    )
    with pytest.raises(SolveError, match=r"too quick: needs >= \d"):
        solve_itinerary(itinerary, options, Silent())
    cache, show = Cache.of(options), itinerary.show
    found = [cache.find(leg_key(leg, show, options), leg) for leg in legs]
    assert [flight is None for flight in found] == [False, True, True]
