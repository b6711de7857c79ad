"""Every kind of damage is recognised, with its place, and nothing else escapes."""

import struct
import zlib
from contextlib import suppress

import pytest
import zstandard
from findings import failed
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from showc.errors import DamagedFileError, UsageError
from showc.log.container import open_log
from showc.log.records import Damage, inflate
from showc.verify import DamagedLogError, verify_log

HEAD = struct.Struct("<BQ")
MAGIC = b"\x89MCAP0\r\n"


def records(data):
    """Opcode, start and end of every record of a whole file."""
    position = len(MAGIC)
    while position < len(data) - len(MAGIC):
        opcode, size = HEAD.unpack_from(data, position)
        yield opcode, position, position + HEAD.size + size
        position += HEAD.size + size


def find(data, opcode, number=0):
    found = [(start, end) for kind, start, end in records(data) if kind == opcode]
    return found[number]


def flipped(data, position, bit=0x10):
    return data[:position] + bytes([data[position] ^ bit]) + data[position + 1 :]


def in_chunk(data):
    start, end = find(data, 0x06)
    return flipped(data, (start + end) // 2)


def message_index_offset(data):
    start, _ = find(data, 0x07)
    return flipped(data, start + HEAD.size + 2 + 4 + 8)


def without_chunk(data):
    start, end = find(data, 0x06, 1)
    return data[:start] + data[end:]


def attachment_data(data):
    _, end = find(data, 0x09)
    return flipped(data, end - 6)


def metadata_value(data):
    _, end = find(data, 0x0C)
    return flipped(data, end - 2)


# Kind, how it is made, and where it shows: (bytes of the whole file) -> offset.
KINDS = {
    "empty": (lambda _: b"", lambda _: 0),
    "only the magic": (lambda data: data[:8], lambda _: 8),
    "not MCAP": (lambda data: b"PK\x03\x04" + data[4:], lambda _: 0),
    "cut at 60 %": (lambda data: data[: len(data) * 6 // 10], None),
    "cut inside the footer": (
        lambda data: data[:-20],
        lambda data: len(data) - 20,
    ),
    "end magic missing": (lambda data: data[:-8], lambda data: len(data) - 8),
    "bytes after the end": (lambda data: data + b"more", len),
    "bit flip in a compressed chunk": (in_chunk, None),
    "chunk CRC wrong": (
        lambda data: flipped(data, find(data, 0x06)[0] + HEAD.size + 24),
        None,
    ),
    "chunk start time wrong": (
        lambda data: flipped(data, find(data, 0x06)[0] + HEAD.size + 2),
        lambda data: find(data, 0x06)[0],
    ),
    "message index offset wrong": (
        message_index_offset,
        lambda data: find(data, 0x07)[0] + HEAD.size + 2 + 4 + 8,
    ),
    "data end CRC wrong": (
        lambda data: flipped(data, find(data, 0x0F)[0] + HEAD.size),
        lambda data: find(data, 0x0F)[0],
    ),
    "statistics flipped": (
        lambda data: flipped(data, find(data, 0x0B)[0] + HEAD.size),
        lambda data: find(data, 0x0B)[0] + HEAD.size,
    ),
    "footer CRC wrong": (
        lambda data: flipped(data, len(data) - 9),
        lambda data: len(data) - 9,
    ),
    "a chunk removed": (without_chunk, None),
    "attachment flipped": (attachment_data, lambda data: find(data, 0x09)[0]),
    "metadata flipped": (metadata_value, lambda data: find(data, 0x0F)[0]),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Bytes of a log with several chunks."""
    from synthetic import gliding_flight
    from verified import written

    path = tmp_path_factory.mktemp("whole") / "output.mcap"
    data = written(gliding_flight(drones=8, moves=2), path).read_bytes()
    assert sum(kind == 0x06 for kind, _, _ in records(data)) > 2
    return data


@pytest.mark.parametrize("kind", KINDS)
def test_damage_is_recognised_at_its_place(kind, whole, tmp_path):
    damage, place = KINDS[kind]
    path = tmp_path / "output.mcap"
    path.write_bytes(damage(whole))
    with pytest.raises(DamagedLogError) as caught:
        verify_log(path, missions=False)
    assert caught.value.exit_code == 2
    assert f"{caught.value.offset:,}" in str(caught.value)
    assert 0 <= caught.value.offset <= len(whole)
    if place is not None:
        assert caught.value.offset == place(whole)
    assert isinstance(caught.value, DamagedFileError)


def test_a_flipped_chunk_is_named_and_what_is_before_it_counts(whole, tmp_path):
    start, end = find(whole, 0x06, 2)
    path = tmp_path / "output.mcap"
    path.write_bytes(flipped(whole, (start + end) // 2))
    with pytest.raises(DamagedLogError) as caught:
        verify_log(path, missions=False)
    assert start <= caught.value.offset < end
    epoch, _ = chunk_times(whole, 0)
    _, last = chunk_times(whole, 1)
    assert caught.value.good_until == pytest.approx((last - epoch) * 1e-9)
    assert "whole up to" in str(caught.value)


def chunk_times(data, number):
    start, _ = find(data, 0x06, number)
    return struct.unpack_from("<QQ", data, start + HEAD.size)


def test_the_removed_chunk_shows_where_it_was(whole, tmp_path):
    path = tmp_path / "output.mcap"
    path.write_bytes(without_chunk(whole))
    with pytest.raises(DamagedLogError) as caught:
        verify_log(path, missions=False)
    start, _ = find(whole, 0x06, 1)
    # The indexes of the removed chunk now follow those of the first.
    assert caught.value.offset >= find(whole, 0x06, 0)[1]
    assert caught.value.offset <= start + 200_000


def mended(data):
    """Set all CRCs right again, so that only the content is wrong."""
    data = bytearray(data)
    for kind, start, end in list(records(bytes(data))):
        if kind == 0x09:
            crc = zlib.crc32(data[start + HEAD.size : end - 4])
            data[end - 4 : end] = struct.pack("<I", crc)
    start, _ = find(bytes(data), 0x0F)
    data[start + HEAD.size : start + HEAD.size + 4] = struct.pack(
        "<I", zlib.crc32(data[:start])
    )
    begin = start + HEAD.size + 4
    data[-12:-8] = struct.pack("<I", zlib.crc32(data[begin:-12]))
    return bytes(data)


@pytest.mark.parametrize(
    ("kind", "position", "text"),
    [
        ("statistics", lambda d: find(d, 0x0B)[0] + HEAD.size, "statistics"),
        ("chunk index", lambda d: find(d, 0x08, 1)[0] + HEAD.size + 16, "chunk index"),
        ("metadata index", lambda d: find(d, 0x0D)[0] + HEAD.size, "metadata index"),
        (
            "summary offset",
            lambda d: find(d, 0x0E)[0] + HEAD.size + 1,
            "summary offset",
        ),
        ("chunk time", lambda d: find(d, 0x06)[0] + HEAD.size + 8, "times"),
        ("message index", lambda d: find(d, 0x07)[0] + HEAD.size + 6, "message index"),
        ("channel", lambda d: find(d, 0x04, -1)[0] + HEAD.size + 12, "the channel"),
    ],
)
def test_content_is_checked_beyond_its_crc(kind, position, text, whole, tmp_path):
    path = tmp_path / "output.mcap"
    path.write_bytes(mended(flipped(whole, position(whole))))
    try:
        verification = verify_log(path, missions=False)
    except DamagedLogError as error:
        assert text in str(error), kind  # noqa: PT017
    else:
        assert not verification.passed
        bad = [check for check in verification.checks if check.verdict == "fail"]
        assert any(text in note for check in bad for note in (*check.notes, check.name))


def test_a_manifest_is_checked_beyond_its_crc(log_path, tmp_path):
    data, path = log_path.read_bytes(), tmp_path / "output.mcap"
    path.write_bytes(mended(flipped(data, find(data, 0x09, 1)[1] - 90)))
    verification = verify_log(path, missions=False)
    assert {"VRF105", "VRF107"} <= failed(verification)
    assert "manifest_sha256" in verification.check("VRF105").notes[0]


def test_mending_changes_nothing_by_itself(whole):
    assert mended(whole) == whole


@pytest.mark.parametrize("opcode", [0x0F, 0x02])
def test_a_crc_left_out_is_damage(opcode, log_path, tmp_path):
    data = log_path.read_bytes()
    start, end = find(data, opcode)
    path = tmp_path / "output.mcap"
    path.write_bytes(data[: end - 4] + bytes(4) + data[end:])
    with pytest.raises(DamagedLogError) as damage:
        verify_log(path, missions=False)
    assert start <= damage.value.offset < end


def test_bytes_behind_the_fields_of_a_record_are_damage(whole, tmp_path):
    start, end = find(whole, 0x0F)
    longer = HEAD.pack(0x0F, 12) + bytes(8) + whole[end - 4 : end]
    path = tmp_path / "output.mcap"
    path.write_bytes(whole[:start] + longer + whole[end:])
    with pytest.raises(DamagedLogError, match="bytes that its fields have not"):
        verify_log(path, missions=False)


def test_a_bomb_is_not_unpacked(whole, tmp_path):
    start, _ = find(whole, 0x06)
    position = start + HEAD.size + 16
    data = whole[:position] + struct.pack("<Q", 1 << 40) + whole[position + 8 :]
    path = tmp_path / "output.mcap"
    path.write_bytes(data)
    with pytest.raises(DamagedLogError, match="refused"):
        verify_log(path, missions=False)


FRAME = zstandard.ZstdCompressor().compress(b"place" * 9)
EMPTY = zstandard.ZstdCompressor().compress(b"")


@pytest.mark.parametrize(
    ("packed", "size"),
    [
        (FRAME + b"x", 45),
        (FRAME + FRAME, 45),
        (FRAME + FRAME, 90),
        (FRAME[:-1], 45),
        (FRAME, 44),
        (EMPTY, 0),
        (EMPTY + b"x", 0),
        (b"", 0),
    ],
)
def test_a_chunk_is_a_single_frame_of_its_size(packed, size):
    assert inflate(memoryview(FRAME), (0, len(FRAME)), 45) == b"place" * 9
    with pytest.raises(Damage):
        inflate(memoryview(b"--" + packed), (2, 2 + len(packed)), size)


@pytest.mark.parametrize(
    "limit",
    [
        *("LARGEST_UNPACKED", "LARGEST_ATTACHED", "LARGEST_MESSAGE"),
        *("MOST_MESSAGES", "MOST_RECORDS"),
    ],
)
def test_a_log_beyond_all_sizes_is_refused(log_path, monkeypatch, limit):
    monkeypatch.setattr(f"showc.log.container.{limit}", 3)
    monkeypatch.setattr("showc.log.container.MORE_EACH", 0)
    with pytest.raises(
        DamagedLogError, match=r"more than|too large in sum|larger than"
    ):
        verify_log(log_path, missions=False)


def test_another_writers_file_is_not_ours(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(library="somebody")
        writer.finish()
    with pytest.raises(DamagedLogError, match="not a log of showc"):
        verify_log(path)


@pytest.mark.parametrize("name", ["missing.mcap", "."])
def test_what_cannot_be_read_is_wrong_usage(name, tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        verify_log(tmp_path / name)


SETTINGS = settings(
    max_examples=120,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def exit_code(path):
    try:
        return int(not verify_log(path, missions=False).passed)
    except DamagedFileError as error:
        return error.exit_code


@SETTINGS
@given(st.integers(min_value=0), st.integers(min_value=0, max_value=7))
@example(0, 0)
@example(8, 0)
def test_a_flipped_bit_never_passes(log_path, tmp_path, place, bit):
    data = log_path.read_bytes()
    path = tmp_path / "output.mcap"
    path.write_bytes(flipped(data, place % len(data), 1 << bit))
    assert exit_code(path) == 2


@SETTINGS
@given(st.integers(min_value=0))
def test_a_cut_never_passes(log_path, tmp_path, place):
    data = log_path.read_bytes()
    path = tmp_path / "output.mcap"
    path.write_bytes(data[: place % len(data)])
    assert exit_code(path) == 2


@SETTINGS
@given(st.integers(min_value=0), st.binary(min_size=1, max_size=40))
def test_altered_bytes_with_all_crcs_right_raise_nothing_else(
    log_path, tmp_path, place, new
):
    """Beyond CRCs: whatever stands in the file, only our own errors come out."""
    data = log_path.read_bytes()
    place %= len(data)
    altered = (data[:place] + new + data[place + len(new) :])[: len(data)]
    with suppress(Exception):
        altered = mended(altered)
    path = tmp_path / "output.mcap"
    path.write_bytes(altered)
    if altered != data:
        assert exit_code(path) in {0, 1, 2}


def test_shares_of_messages_are_all_of_them(log_path):
    log = open_log(log_path)
    asked = {number for number in log.channels if number % 2}
    everything = [*log.messages(asked)]
    assert {one.channel for one in everything} == asked
    for shares in (1, 3, 7, len(everything), len(everything) + 5):
        parts = [[*log.messages(asked, share, shares)] for share in range(shares)]
        assert [one for part in parts for one in part] == everything
        sizes = {len(part) for part in parts}
        assert max(sizes) - min(sizes) <= 1
