"""Files beside a log: whatever lies there, a log opens."""

from __future__ import annotations

import json
from hashlib import sha256

import pytest

from showc.cli.beside import ABORT, WIND, place_of, read_beside, write_beside
from showc.simulate.campaign import Campaign

LOG = b"a log"
HASH = sha256(LOG).hexdigest()


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[" * 100_000,
        "3",
        "[1]",
        "{}",
        json.dumps({"sha256": HASH}),
        json.dumps({"sha256": HASH, "legs": [[]], "wind": "much"}),
        json.dumps({"sha256": "0" * 64}),
        "\udcff".encode("utf-8", "surrogateescape"),
    ],
)
def test_what_is_no_file_of_this_log_is_passed_over(tmp_path, content):
    log = tmp_path / "show.mcap"
    log.write_bytes(LOG)
    beside = content if isinstance(content, bytes) else content.encode()
    place_of(log, WIND).write_bytes(beside)
    assert read_beside(log, WIND, Campaign.from_json, None) is None


def test_a_file_is_read_for_the_log_that_it_was_written_for_and_no_other(tmp_path):
    log = tmp_path / "show.mcap"
    log.write_bytes(LOG)
    write_beside(log, place_of(log, ABORT), {"rows": 3})
    assert read_beside(log, ABORT, lambda content: content["rows"], 0) == 3
    log.write_bytes(b"another log")
    assert read_beside(log, ABORT, lambda content: content["rows"], 0) == 0
