"""The container: what a log may unpack to, and that honest ones stay within it."""

import struct
from io import BytesIO

import numpy as np
import pytest
from google.protobuf.empty_pb2 import Empty
from google.protobuf.internal.encoder import _VarintBytes
from google.protobuf.unknown_fields import UnknownFieldSet
from hypothesis import given
from hypothesis import strategies as st

from showc.log import container, records
from showc.log.chunks import ChunkWriter
from showc.log.reader import read_log
from showc.log.records import DamagedLogError
from showc.log.sample import POINT
from showc.log.scene import point_cloud
from showc.log.writer import CHUNK_SIZE

FIRST = 1_780_000_000_000_000_000
STEP = 50_000_000


def written(messages):
    """A whole log of one topic."""
    stream = BytesIO()
    writer = ChunkWriter(stream, CHUNK_SIZE)
    writer.begin("showc")
    schema = writer.register_schema("cloud", "protobuf", b"as it is")
    channel = writer.register_channel("/fleet/state", "protobuf", schema)
    for number, message in enumerate(messages):
        writer.add_message(channel, number, FIRST + STEP * number, message)
    writer.finish()
    return stream.getvalue()


@pytest.fixture(scope="module")
def bomb():
    return written([bytes(1 << 24)] * 12)


@pytest.mark.parametrize("drones", [110, 400, 1000])
def test_a_long_hold_of_dark_drones_is_read(drones):
    """Clouds that are all the same pack best; the ground before them adds nothing."""
    points = np.zeros(drones, dtype=POINT)
    side = np.arange(drones)
    points["x"], points["y"], points["z"] = side % 32 * 3, side // 32 * 3, 20
    clouds = 100_000_000 // points.nbytes
    data = written(
        point_cloud(FIRST + STEP * k, points).SerializeToString(deterministic=True)
        for k in range(clouds)
    )
    log = container.open_log(data)
    unpacked = sum(chunk.size for chunk in log.chunks)
    assert log.times(1).size == clouds
    assert 150 < unpacked / len(data) < 0.7 * container.GREATEST_RATIO


def test_chunks_of_zeros_are_refused_before_they_are_unpacked(bomb, monkeypatch):
    assert len(bomb) < 20_000
    unpacked = []

    def inflate(view, span, size):
        unpacked.append(size)
        return original(view, span, size)

    original = records.inflate
    monkeypatch.setattr(records, "inflate", inflate)
    with pytest.raises(DamagedLogError, match=r"1,000 times the file") as damage:
        container.open_log(bomb)
    most = container.ANY_UNPACKED + container.GREATEST_RATIO * len(bomb)
    # The next chunk may be unpacked while one is gone through.
    ahead = unpacked.pop()
    assert 0 < sum(unpacked) <= most
    assert ahead <= records.LARGEST_CHUNK
    offset = damage.value.offset
    assert f"at byte {offset:,}" in str(damage.value)
    # There is the chunk that would have been unpacked next.
    opcode, _, _, _, size = struct.unpack_from("<BQQQQ", bomb, offset)
    assert opcode == 0x06
    assert (size, sum(unpacked) + size > container.ANY_UNPACKED) == (ahead, True)


def test_the_reader_refuses_chunks_of_zeros(bomb):
    with pytest.raises(DamagedLogError, match=r"1,000 times the file"):
        read_log(bomb)


def test_one_great_chunk_may_pack_well():
    data = written([bytes(12_000_000)])
    assert len(data) < 3_000
    assert container.open_log(data).chunks[0].size > 12_000_000


@pytest.mark.parametrize("between", [1, 2, 1 << 16])
def test_chunks_are_unpacked_ahead_of_the_walk_and_taken_in_turn(monkeypatch, between):
    """However few records are looked at for the next chunk."""
    monkeypatch.setattr(records, "_BETWEEN", between)
    data = written([bytes([k]) * CHUNK_SIZE for k in range(8)])
    chunks = container.open_log(data).chunks
    with records.UnpackedAhead(memoryview(data)) as unpacked:
        position = len(records.MAGIC)
        found = []
        while (record := records.next_record(memoryview(data), position)).opcode != (
            records.Opcode.DATA_END
        ):
            if record.opcode == records.Opcode.CHUNK:
                found.append(unpacked.take(record.position))
            position = record.stop
    assert len(found) == len(chunks) >= 8
    wanted = [records.inflate(memoryview(data), c.span, c.size) for c in chunks]
    assert found == wanted


def test_what_is_wrong_ahead_is_said_in_its_turn():
    """A chunk that does not unpack, where the walk is at the one before."""
    data = bytearray(written([bytes([k]) * CHUNK_SIZE for k in range(4)]))
    chunks = container.open_log(bytes(data)).chunks
    begin, end = chunks[2].span
    data[begin:end] = bytes(end - begin)
    with pytest.raises(DamagedLogError) as damage:
        container.open_log(bytes(data))
    assert damage.value.offset == begin


FIELDS = st.one_of(
    st.integers(0, (1 << 64) - 1).map(lambda n: b"\x08" + _VarintBytes(n)),
    st.binary(max_size=300).map(lambda some: b"\x12" + _VarintBytes(len(some)) + some),
    st.binary(min_size=8, max_size=8).map(lambda some: b"\x19" + some),
    st.binary(min_size=4, max_size=4).map(lambda some: b"\xa5\x06" + some),
)


@given(st.lists(FIELDS, max_size=30), st.integers(0, 32))
def test_the_fields_of_a_message_are_those_that_its_parser_finds(parts, most):
    message = b"".join(parts)
    assert len(UnknownFieldSet(Empty.FromString(message))) == len(parts)
    assert records.has_more_fields(message, most) is (len(parts) > most)


@given(st.binary(max_size=200), st.integers(0, 50))
def test_fields_of_garbage_are_counted_without_an_error(message, most):
    assert records.has_more_fields(message, most) in {True, False}
