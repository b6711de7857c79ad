"""Chunks of many messages at a time, byte for byte those of the mcap library."""

import io

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer

from showc.log.chunks import ChunkWriter

CHANNELS = 7
FIRST = 1_780_000_000_000_000_000

steps = st.lists(
    st.tuples(
        st.integers(0, 5_000_000_000),
        st.lists(st.binary(max_size=300), max_size=3),
        st.integers(0, CHANNELS - 1),
        st.integers(1, 90),
    ),
    max_size=30,
)


def by_the_library(stream, seed, chosen, size):
    writer = Writer(
        stream,
        chunk_size=size,
        compression=CompressionType.ZSTD,
        index_types=IndexType.ALL,
        enable_crcs=True,
        enable_data_crcs=True,
    )
    writer.start(profile="", library="showc")
    writer.add_metadata("about", {"drones": "7"})
    writer.add_attachment(FIRST, FIRST, "show.yaml", "text/plain", b"showc: 1\n")
    schema = writer.register_schema("state", "protobuf", b"as it is")
    channels = [
        writer.register_channel(f"/drone/{k}", "protobuf", schema)
        for k in range(CHANNELS)
    ]
    count = 0
    for step, (ns, single, several, length) in enumerate(chosen):
        time = FIRST + ns
        for message in single:
            writer.add_message(channels[0], time, message, time, count)
            count += 1
        states = messages_of(seed, step, several, length)
        for channel, state in zip(channels[:several], states, strict=True):
            writer.add_message(channel, time, state.tobytes(), time, step)
    writer.finish()


def messages_of(seed, step, count, length):
    """Messages of a step, all of one length."""
    content = np.random.default_rng([seed, step]).bytes(count * length)
    return np.frombuffer(content, dtype=f"V{length}")


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), chosen=steps, size=st.integers(50, 4000))
def test_the_same_messages_give_the_same_bytes(seed, chosen, size):
    wanted, found = io.BytesIO(), io.BytesIO()
    by_the_library(wanted, seed, chosen, size)
    writer = ChunkWriter(found, size)
    writer.begin("showc")
    writer.add_metadata("about", {"drones": "7"})
    writer.add_attachment(FIRST, "show.yaml", "text/plain", b"showc: 1\n")
    schema = writer.register_schema("state", "protobuf", b"as it is")
    channels = [
        writer.register_channel(f"/drone/{k}", "protobuf", schema)
        for k in range(CHANNELS)
    ]
    count = 0
    for step, (ns, single, several, length) in enumerate(chosen):
        for message in single:
            writer.add_message(channels[0], count, FIRST + ns, message)
            count += 1
        writer.add_messages(
            channels[:several],
            step,
            FIRST + ns,
            messages_of(seed, step, several, length),
        )
    writer.finish()
    assert found.getvalue() == wanted.getvalue()
