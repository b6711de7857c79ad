"""Reading a file side by side, and the message indexes of its chunks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from verified import proved_flight, written

from showc.verify import DamagedLogError, unpack
from showc.verify.chunk import Messages
from showc.verify.damage import Damage
from showc.verify.indexes import MessageIndexes
from showc.verify.mcap import open_log


def messages(channels, times):
    count = len(channels)
    record = 100 * np.arange(count) + 9
    return Messages(
        channel=np.array(channels, dtype=np.uint16),
        sequence=np.zeros(count, dtype=np.int64),
        log_time=np.array(times, dtype=np.int64),
        publish_time=np.array(times, dtype=np.int64),
        record=record,
        payload=record + 31,
        size=np.full(count, 50),
    )


def entries(found, channel):
    mine = found.channel == channel
    return np.stack([found.log_time[mine], found.record[mine]], 1).astype("<u8")


STAMPED = st.lists(
    st.tuples(st.integers(0, 5), st.integers(0, 2**40)), min_size=1, max_size=30
)


@given(STAMPED, st.randoms(use_true_random=False))
def test_indexes_in_any_order_are_those_of_the_messages(stamped, random):
    found = messages(*zip(*stamped, strict=True))
    indexes = MessageIndexes(found)
    present = sorted({channel for channel, _ in stamped})
    for number, channel in enumerate(present):
        assert not indexes.complete
        rows = entries(found, channel)
        shuffled = random.sample(range(len(rows)), len(rows))
        indexes.take(channel, rows[shuffled].tobytes(), 7 * number)
    assert indexes.complete
    assert indexes.positions == {c: 7 * number for number, c in enumerate(present)}


@given(STAMPED, st.data())
def test_an_index_that_differs_in_one_bit_is_damage(stamped, data):
    found = messages(*zip(*stamped, strict=True))
    channel = data.draw(st.sampled_from([channel for channel, _ in stamped]))
    altered = bytearray(entries(found, channel).tobytes())
    place = data.draw(st.integers(0, 8 * len(altered) - 1))
    altered[place // 8] ^= 1 << place % 8
    with pytest.raises(Damage, match="does not say where"):
        MessageIndexes(found).take(channel, bytes(altered), 3)


def test_an_index_that_is_cut_double_or_of_another_channel_is_damage():
    found = messages([1, 2, 1], [5, 6, 7])
    indexes = MessageIndexes(found)
    whole = entries(found, 1).tobytes()
    with pytest.raises(Damage, match="malformed"):
        indexes.take(1, whole[:-1], 0)
    with pytest.raises(Damage, match="does not say where"):
        indexes.take(1, whole[:-16], 0)
    with pytest.raises(Damage, match="does not say where"):
        indexes.take(3, whole, 0)
    indexes.take(1, whole, 0)
    with pytest.raises(Damage, match="malformed"):
        indexes.take(1, whole, 0)


def test_an_empty_chunk_needs_no_index():
    assert MessageIndexes(messages([], [])).complete


def test_reading_side_by_side_finds_the_same(log_path, monkeypatch):
    alone = open_log(log_path)
    monkeypatch.setattr(unpack, "_WORTH", 0)
    shared = open_log(log_path, jobs=3)
    assert shared.contents == alone.contents
    channels = set(alone.channels)
    for (data, found, offset), (other, again, place) in zip(
        alone.read(channels), shared.read(channels), strict=True
    ):
        assert (data, offset) == (other, place)
        for name in Messages.__dataclass_fields__:
            assert np.array_equal(getattr(found, name), getattr(again, name))


def test_damage_in_a_chunk_is_named_alike_from_every_process(tmp_path, monkeypatch):
    path = written(proved_flight(drones=12), tmp_path / "whole.mcap")
    whole = path.read_bytes()
    chunks = open_log(path).contents.chunks
    assert len(chunks) > 2
    spoilt = bytearray(whole)
    for chunk in chunks[len(chunks) // 2 :]:
        spoilt[chunk.offset + chunk.length // 2] ^= 4
    path = tmp_path / "spoilt.mcap"
    path.write_bytes(spoilt)
    said = []
    for worth, jobs in ((0, 2), (len(whole) + 1, 1)):
        monkeypatch.setattr(unpack, "_WORTH", worth)
        with pytest.raises(DamagedLogError, match="chunk") as caught:
            open_log(path, jobs)
        said.append((str(caught.value), caught.value.offset, caught.value.good_until))
    assert said[0] == said[1]
    assert said[0][2] is not None
