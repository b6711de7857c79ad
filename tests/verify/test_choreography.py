"""How a show joins up: each rule broken alone is found alone."""

from dataclasses import replace

import numpy as np
import pytest
from verified import with_table

from showc.log import showc_pb2 as pb
from showc.verify.kernel.bernstein import elevate
from showc.verify.kernel.choreography import joined_up

HOVER = "VRF331"
REACHED = "VRF333"
INSIDE = "VRF335"
COVERED = "VRF336"
JOINED = "VRF337"
PADS = "VRF338"
YAW = "VRF332"


@pytest.fixture
def show(log_and_show):
    return log_and_show[1]


def failures(show):
    return {one.code for one in joined_up(show) if not one.holds}


def moved(show, number, component, shift, *, drone=1, begin=True, end=True):
    """Change the first or last coefficients of one drone's state."""
    table = show.segments[number].table
    state = table.state.copy()
    if begin:
        state[table.first[drone], 0, component] += shift
    if end:
        state[table.first[drone + 1] - 1, -1, component] += shift
    return with_table(show, number, state=state)


def remade(show, number, **fields):
    """Change fields of a segment's message."""
    segment = show.segments[number]
    message = pb.Segment()
    message.CopyFrom(segment.message)
    for name, value in fields.items():
        if isinstance(value, list):
            del getattr(message, name)[:]
            getattr(message, name).extend(value)
        else:
            setattr(message, name, value)
    segments = list(show.segments)
    segments[number] = replace(segment, message=message)
    return replace(show, segments=tuple(segments))


def test_the_exact_flight_joins_up(show):
    assert failures(show) == set()


@pytest.mark.parametrize("component", [3, 5, 6, 7, 9, 11])
def test_moving_at_a_joint(show, component):
    assert HOVER in failures(moved(show, 2, component, 2e-6, begin=False))


@pytest.mark.parametrize("component", range(12))
def test_a_jump_at_a_joint(show, component):
    found = failures(moved(show, 2, component, 2e-6, begin=False))
    assert JOINED in found
    assert JOINED not in failures(moved(show, 2, component, 5e-7, begin=False))


def test_a_goal_missed_by_two_millimetres(show):
    found = failures(moved(show, 2, 0, 2e-3, begin=False))
    assert {REACHED, JOINED} <= found


def test_a_gap_in_time(show):
    start = show.segments[3].start
    assert COVERED in failures(remade(show, 3, start=start + 0.001))


def test_a_segment_that_is_shorter_than_it_says(show):
    duration = show.segments[3].duration
    found = failures(remade(show, 3, duration=duration + 0.001))
    assert INSIDE in found


def test_a_jump_inside_a_segment(show):
    table = show.segments[2].table
    middle = 0.5 * table.end[0]
    count = table.drones.size
    state = np.repeat(table.state, 2, axis=0)
    state[::2] = table.state[:, :1]
    state[1::2] = table.state[:, -1:]
    broken = with_table(
        show,
        2,
        first=2 * table.first,
        start=np.tile([0.0, middle], count),
        end=np.tile([middle, table.end[0]], count),
        state=state,
        control=np.repeat(table.control, 2, axis=0),
    )
    assert failures(broken) == {INSIDE}


def test_yaw_that_moves_though_held(show):
    table = show.segments[2].table
    state = table.state.copy()
    state[1, 2, 8] += 1e-4
    assert failures(with_table(show, 2, state=state)) == {YAW}


def test_free_yaw_may_move_between_hovers(show):
    rules = pb.Rules()
    rules.CopyFrom(show.rules)
    rules.yaw_held = False
    table = show.segments[2].table
    state = table.state.copy()
    state[1, 2, 8] += 1.0
    free = with_table(replace(show, rules=rules), 2, state=state)
    assert failures(free) == set()


def crept(show, component, size):
    """Let drone 1 leave the end of a hold in its middle, and come back."""
    number = next(k for k, one in enumerate(show.segments) if one.holds)
    table = show.segments[number].table
    state = elevate(table.state, 3)
    state[table.first[1], 1:-1, component] += size
    return with_table(show, number, state=state)


def test_a_drone_that_creeps_away_in_a_hold_and_back(show):
    assert failures(crept(show, 0, 2e-3)) == {REACHED}
    assert failures(crept(show, 2, 5e-4)) == set()


def test_free_yaw_that_turns_in_a_hold_and_back(show):
    rules = pb.Rules()
    rules.CopyFrom(show.rules)
    rules.yaw_held = False
    assert failures(crept(replace(show, rules=rules), 8, 4e-3)) == {YAW}


def test_a_first_segment_that_is_no_launch(show):
    assert PADS in failures(remade(show, 0, kind=pb.Segment.TRANSITION))


def test_a_last_segment_that_is_no_landing(show):
    last = len(show.segments) - 1
    assert PADS in failures(remade(show, last, kind=pb.Segment.HOLD))


def test_pads_that_are_no_formation(show):
    assert PADS in failures(remade(show, 0, from_formation="nowhere"))


def test_landing_beside_the_pads(show):
    last = len(show.segments) - 1
    assert PADS in failures(moved(show, last, 0, 2e-3, begin=False))


def test_a_launch_from_anothers_pad(show):
    table = show.segments[0].table
    state = table.state.copy()
    first = table.first[:2]
    state[first, 0] = state[first[::-1], 0]
    assert failures(with_table(show, 0, state=state)) == {PADS}
