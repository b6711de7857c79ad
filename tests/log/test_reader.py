"""The reader gives back what was written, and names damage without a traceback."""

from __future__ import annotations

import hashlib
from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from synthetic import vertical_flight

from showc.errors import DamagedFileError, UsageError
from showc.log.reader import read_log
from showc.log.writer import write_log


def small_log() -> bytes:
    stream = BytesIO()
    write_log(vertical_flight(2), stream, manifest=b"{}")
    return stream.getvalue()


SMALL = small_log()


def test_whole_flights_come_back(gliding, gliding_log):
    times = np.linspace(0.0, gliding.duration, 301)
    for drone in (0, 9):
        ours, theirs = gliding_log.trajectory(drone), gliding.drone(drone)
        assert np.allclose(ours.state(times), theirs.state(times), atol=1e-12)
        assert np.allclose(ours.control(times), theirs.control(times), atol=1e-12)


def test_shape_of_what_is_read(gliding_log):
    assert gliding_log.samples.shape == (gliding_log.times.size, 16)
    assert gliding_log.positions.shape == (gliding_log.times.size, 16, 3)
    assert [segment.kind for segment in gliding_log.segments][:3] == [
        "launch",
        "hold",
        "transition",
    ]
    assert gliding_log.manifest == {"files": {}}
    digest = hashlib.sha256(gliding_log.script).hexdigest()
    assert digest == gliding_log.metadata["script_sha256"]


def test_missing_file_is_a_usage_error(tmp_path):
    with pytest.raises(UsageError, match=r"nothing\.mcap: cannot be read"):
        read_log(tmp_path / "nothing.mcap")


@pytest.mark.parametrize("size", [0, 1, 8, 100, 3000, len(SMALL) - 9, len(SMALL) - 1])
def test_torn_file_is_damaged(size):
    with pytest.raises(DamagedFileError, match=r"at byte [\d,]+"):
        read_log(SMALL[:size])


def test_other_file_is_damaged():
    with pytest.raises(DamagedFileError):
        read_log(b"format: 1\nname: not a log\n" * 100)


def test_other_mcap_is_not_ours():
    stream = BytesIO()
    writer = Writer(stream)
    writer.start()
    writer.finish()
    with pytest.raises(DamagedFileError, match="not a log of showc"):
        read_log(stream.getvalue())


def data_end() -> int:
    summary = make_reader(BytesIO(SMALL)).get_summary()
    return max(c.chunk_start_offset + c.chunk_length for c in summary.chunk_indexes)


@given(st.integers(0, data_end() * 8 - 1))
def test_any_flipped_bit_of_the_data_is_found(bit):
    damaged = bytearray(SMALL)
    damaged[bit // 8] ^= 1 << (bit % 8)
    with pytest.raises(DamagedFileError):
        read_log(bytes(damaged))


def test_fewer_samples_are_those_of_the_log_from_end_to_end(compiled):
    whole = read_log(compiled("swap"))
    some = read_log(compiled("swap"), 2.5)
    assert some.times[0] == whole.times[0]
    assert some.times[-1] == whole.times[-1]
    assert (np.diff(some.times)[:-1] >= 0.4 - 1e-9).all()
    assert np.diff(some.times).max() < 0.5
    rows = np.searchsorted(whole.times, some.times)
    assert (whole.samples[rows] == some.samples).all()
