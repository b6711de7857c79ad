"""Frames among noise, halves of frames, and signatures."""

import hashlib

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as m
from vehicle_link.vehicle import heartbeat_of

from showc.vehicle_link.frames import LONGEST_FRAME, Codec, Framer

KEY = hashlib.sha256(b"a key of the tests").digest()

JUNK = st.one_of(
    st.binary(max_size=400),
    st.integers(1, 300).map(lambda count: b"\xfd" * count),
    st.integers(1, 300).map(lambda count: b"\xfe" * count),
    st.integers(1, 20).map(lambda count: heartbeat_of(9)[:count]),
)


def frames(count):
    """Different frames of one vehicle, of both versions of the protocol."""
    codec = m.MAVLink(None, 7, 1)
    found = []
    for number in range(count):
        codec.seq = number % 256
        message = m.MAVLink_local_position_ned_message(number, *[number / 7.0] * 6)
        found.append(message.pack(codec, force_mavlink1=number % 3 == 2))
    return found


def stamps(found):
    return [message.time_boot_ms for message, _ in found if hasattr(message, "x")]


@given(st.lists(st.one_of(JUNK, st.none()), max_size=40))
def test_a_whole_frame_is_found_whatever_noise_comes_between(datagrams):
    framer, given_, seen = Framer(Codec()), iter(frames(40)), []
    sent = 0
    for junk in datagrams:
        data = next(given_) if junk is None else junk
        sent += junk is None
        seen += stamps(framer.feed(data))
    assert seen == list(range(sent))


@given(st.lists(st.integers(1, 60), min_size=1, max_size=60))
def test_frames_cut_anywhere_are_whole_again(cuts):
    stream = b"".join(frames(12))
    framer, seen = Framer(Codec()), []
    place = 0
    for size in [*cuts, len(stream)]:
        if stream[place : place + size]:
            seen += stamps(framer.feed(stream[place : place + size]))
        place += size
    assert seen == list(range(12))


@given(st.binary(max_size=2000))
def test_what_is_kept_is_no_longer_than_a_frame(data):
    framer = Framer(Codec())
    for _ in range(3):
        framer.feed(data)
        assert len(framer.kept) <= LONGEST_FRAME


def signed(key, number=0):
    codec = Codec(key)
    return codec.pack(m.MAVLink_heartbeat_message(2, 3, number, 0, 4, 3))


def test_a_right_signature_is_taken_once():
    frame, codec = signed(KEY), Codec(KEY)
    assert codec.trusted(frame)
    assert not codec.trusted(frame)
    assert codec.trusted(signed(KEY))


@given(st.data())
def test_a_changed_byte_breaks_the_signature(data):
    frame = bytearray(signed(KEY))
    place = data.draw(st.integers(1, len(frame) - 1))
    frame[place] ^= data.draw(st.integers(1, 255))
    assert not Codec(KEY).trusted(bytes(frame))


def test_without_a_key_nothing_is_asked_and_with_one_all_is():
    assert Codec().trusted(heartbeat_of(1))
    assert not Codec(KEY).trusted(heartbeat_of(1))
    assert not Codec(KEY).trusted(signed(bytes(32)))


def test_frames_are_numbered():
    codec = Codec()
    numbers = [
        codec.pack(m.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))[4] for _ in range(300)
    ]
    assert numbers == [number % 256 for number in range(300)]
