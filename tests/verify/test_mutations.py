"""Random bytes of a log altered: nothing but a verdict, and nothing moved passes.

Half of the mutations are made in the file as it is, where CRCs find them; half inside
messages, attachments and metadata, and every CRC, index and hash is made to fit.
``SHOWC_MUTATIONS`` says how many are made; the short form is for every day.
"""

import hashlib
import os
import random
from copy import deepcopy

import numpy as np
import pytest
from lies import Log
from verified import loaded, proved_flight, written

from showc.errors import ShowError
from showc.verify import verify_log

COUNT = int(os.environ.get("SHOWC_MUTATIONS", "60"))
SHARES = 16
MOVED = np.repeat([1e-3, 1e-3, np.radians(0.01), np.radians(0.01)], 3)
"""What may not pass: metres, metres a second, radians, radians a second."""


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    path = written(proved_flight(2), tmp_path_factory.mktemp("truth") / "output.mcap")
    return path, Log.read(path.read_bytes())


def mutated(content, chance):
    """Bytes flipped, set, cut out, doubled or put in."""
    data = bytearray(content)
    for _ in range(chance.choice((1, 1, 1, 2, 5))):
        at = chance.randrange(len(data) + 1)
        kind = chance.randrange(5)
        if kind == 0 and at < len(data):
            data[at] ^= 1 << chance.randrange(8)
        elif kind == 1:
            data[at : at + 1] = chance.choice((b"\x00", b"\xff", b"\x7f", b"\x80"))
        elif kind == 2:
            del data[at : at + chance.choice((1, 2, 8, 64))]
        elif kind == 3:
            data[at:at] = data[at : at + chance.choice((1, 8, 64))]
        else:
            data[at:at] = chance.randbytes(chance.choice((1, 4, 8)))
    return bytes(data)


def fitting(log, chance):
    """Return a log in which one content is altered and everything else fits."""
    found = deepcopy(log)
    kind = chance.randrange(8)
    if kind == 0:
        entry = chance.choice(found.attachments)
        entry[3] = mutated(entry[3], chance)
        for key, name in (
            ("script_sha256", found.facts["script"]),
            ("manifest_sha256", "manifest.json"),
        ):
            content = found.attachment(name)[3]
            found.facts[key] = hashlib.sha256(content).hexdigest()
    elif kind == 1:
        key = chance.choice(list(found.facts))
        value = mutated(found.facts[key].encode(), chance)
        found.facts[key] = value.decode("utf-8", "replace")
    else:
        topics = sorted({message.topic for message in found.messages})
        message = chance.choice(found.of(chance.choice(topics)))
        message.data = mutated(message.data, chance)
    return found.bytes()


def tables(path):
    _, show = loaded(path)
    return [segment.table for segment in show.segments]


@pytest.mark.parametrize("share", range(SHARES))
def test_nothing_that_moves_a_state_passes(truth, tmp_path, share):
    original, log = truth
    whole, before = original.read_bytes(), tables(original)
    path = tmp_path / "output.mcap"
    for number in range(share, COUNT, SHARES):
        chance = random.Random(number)
        content = fitting(log, chance) if number % 2 else mutated(whole, chance)
        path.write_bytes(content)
        try:
            passed = verify_log(path, missions=False).passed
        except ShowError:
            continue
        if not passed:
            continue
        for old, new in zip(before, tables(path), strict=True):
            assert old.state.shape == new.state.shape, number
            assert np.all(np.abs(old.state - new.state) <= MOVED), number
            assert np.allclose(old.start, new.start, rtol=0.0, atol=1e-6), number
