"""Messages taken apart by hand are what protobuf says they are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from showc.log import showc_pb2 as pb
from showc.verify.damage import Damage
from showc.verify.wire import numbers_and_runs

DOUBLES = st.lists(st.floats(allow_nan=False), max_size=20)
NUMBER = st.integers(0, 2**32 - 1)


MESSAGES = st.builds(
    pb.Trajectory,
    segment=NUMBER,
    drone=NUMBER,
    breaks=DOUBLES,
    state_degree=NUMBER,
    state=DOUBLES,
    control_degree=NUMBER,
    control=DOUBLES,
)


@given(MESSAGES, st.binary())
def test_a_trajectory_is_found_in_its_bytes(message, before):
    packed = message.SerializeToString()
    data = before + packed + b"\xff"
    integers, runs = numbers_and_runs(data, len(before), len(before) + len(packed))
    for field in pb.Trajectory.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        if isinstance(value, int):
            assert integers.get(field.number, 0) == value
            continue
        spans = runs.get(field.number, [])
        found = [np.frombuffer(data[begin:end], "<f8") for begin, end in spans]
        assert np.array_equal(np.concatenate([[], *found]), list(value))


def test_a_run_in_several_pieces_stays_in_order():
    first = pb.Trajectory(breaks=[1.0, 2.0]).SerializeToString()
    second = pb.Trajectory(breaks=[3.0]).SerializeToString()
    data = first + second
    _, runs = numbers_and_runs(data, 0, len(data))
    numbers = [np.frombuffer(data[a:b], "<f8").tolist() for a, b in runs[3]]
    assert numbers == [[1.0, 2.0], [3.0]]


@given(st.integers(1, 60))
def test_a_cut_message_is_damage(cut):
    packed = pb.Trajectory(drone=3, state=[1.0] * 8).SerializeToString()
    kept = packed[: max(1, len(packed) - cut)]
    if kept != pb.Trajectory(drone=3).SerializeToString():
        with pytest.raises(Damage):
            numbers_and_runs(kept, 0, len(kept))
