"""What is added to a log: bound to it, in one order, and nothing else changes."""

import json
import shutil

import pytest
from findings import failed

from showc.errors import DamagedFileError, UsageError
from showc.log import showc_pb2 as pb
from showc.log.additions import add, digest_of
from showc.log.reader import read_log
from showc.log.schema import ABORT_NAME, WIND_NAME
from showc.verify import verify_log


@pytest.fixture
def log(compiled, tmp_path):
    place = tmp_path / "swap.mcap"
    shutil.copyfile(compiled("swap"), place)
    return place


def wind(digest, said="calm"):
    return json.dumps({"data_sha256": digest, "said": said}).encode()


def table(digest):
    return pb.AbortTable(data_sha256=digest, every=1.0).SerializeToString()


def test_the_order_in_which_things_are_added_changes_nothing(log):
    compiled, digest = log.read_bytes(), digest_of(log)
    add(log, ABORT_NAME, table(digest), digest)
    add(log, WIND_NAME, wind(digest, "a gale"), digest)
    add(log, WIND_NAME, wind(digest), digest)
    first = log.read_bytes()
    log.write_bytes(compiled)
    add(log, WIND_NAME, wind(digest), digest)
    add(log, ABORT_NAME, table(digest), digest)
    assert log.read_bytes() == first
    assert digest_of(log) == digest
    logged = read_log(log)
    assert logged.added == {ABORT_NAME: table(digest), WIND_NAME: wind(digest)}
    assert logged.aborts.every == 1.0
    assert logged.read_script().show is not None


def test_a_log_to_which_something_was_added_is_the_same_show(log):
    before, digest = verify_log(log, missions=False), digest_of(log)
    add(log, WIND_NAME, wind(digest), digest)
    after = verify_log(log, missions=False)
    assert after.proved
    assert "estimate" in "".join(after.check("VRF108").notes)
    codes = [check.code for check in after.checks if check.code != "VRF108"]
    assert codes == [check.code for check in before.checks]


def test_what_was_made_of_another_log_is_left_out_and_found(log):
    digest = digest_of(log)
    add(log, WIND_NAME, wind("0" * 64), digest)
    assert read_log(log).added == {}
    assert failed(verify_log(log, missions=False)) == {"VRF108"}
    # The next command that adds something takes it away.
    add(log, ABORT_NAME, table(digest), digest)
    assert set(read_log(log).added) == {ABORT_NAME}


@pytest.mark.parametrize("content", [b"", b"[" * 100_000, b"[]", b"\xff", b"{}"])
def test_what_is_no_addition_is_left_out(log, content):
    digest = digest_of(log)
    add(log, WIND_NAME, content, digest)
    assert read_log(log).added == {}


def test_nothing_is_added_to_a_log_that_was_compiled_again(log):
    before = log.read_bytes()
    with pytest.raises(UsageError, match="compiled again meanwhile"):
        add(log, WIND_NAME, wind("0" * 64), "0" * 64)
    assert log.read_bytes() == before
    assert [one.name for one in log.parent.iterdir()] == [log.name]


@pytest.mark.parametrize("content", [b"", b"no log", b"\x89MCAP0\r\n" * 9])
def test_a_file_that_is_no_log_is_named_as_damaged(tmp_path, content):
    place = tmp_path / "night.mcap"
    place.write_bytes(content)
    with pytest.raises(DamagedFileError, match="night"):
        digest_of(place)
