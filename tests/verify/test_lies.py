"""No lie passes: every change of a log with fitting checksums is caught."""

import pytest
from findings import failed
from lies import DAMAGE, TABLE, Log, all_lies
from verified import proved_flight, script_of, written

from showc.verify import DamagedLogError, verify_log

LEAST = 250
"""Lies that must be in the table at least."""


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    path = written(proved_flight(2), tmp_path_factory.mktemp("truth") / "output.mcap")
    return Log.read(path.read_bytes())


def caught(content, folder, *, script=False):
    """Codes of the checks that fail, or damage."""
    path = folder / "output.mcap"
    path.write_bytes(content)
    given = folder / "proved.yaml"
    given.write_bytes(script_of(2))
    try:
        found = verify_log(path, missions=False, script=given if script else None)
    except DamagedLogError:
        return {DAMAGE}
    assert found.passed == (not failed(found))
    return set(failed(found))


def test_the_truth_passes(truth, tmp_path):
    assert caught(truth.bytes(), tmp_path) == set()
    assert caught(truth.bytes(), tmp_path, script=True) == set()


def test_there_are_enough_lies(truth):
    lies = all_lies(truth)
    assert len(lies) >= LEAST
    assert len({lie.name for lie in lies}) == len(lies)


@pytest.mark.parametrize("tell", TABLE, ids=lambda tell: tell.__name__)
def test_every_lie_is_caught_by_its_check(tell, truth, tmp_path):
    wrong = {}
    for lie in tell(truth):
        found = caught(lie.told(truth), tmp_path, script=lie.script)
        if not found & set(lie.code.split("|")):
            wrong[lie.name] = sorted(found)
    assert wrong == {}
