"""The abort table in a log is proved: each lie in it is found by its check."""

import hashlib
import re
import shutil
import tracemalloc
from functools import partial

import numpy as np
import pytest
from findings import failed
from lies import Log
from synthetic import decoded

from showc.log import showc_pb2 as pb
from showc.log.additions import add, digest_of
from showc.log.container import open_log
from showc.log.reader import read_log
from showc.log.records import Damage
from showc.log.schema import ABORT_NAME
from showc.verify import DamagedLogError, verify_log
from showc.verify.decode import read_aborts
from showc.verify.kernel.choreography import joined_up
from showc.verify.specification.aborts import Aborts
from showc.verify.specification.cover import read_anchor

PROVED = {"VRF108", "VRF351", "VRF352", "VRF353", "VRF354", "VRF355", "VRF356"}


@pytest.fixture(scope="module")
def aborted(compiled, run_showc, tmp_path_factory):
    """A log with an abort table."""
    log = tmp_path_factory.mktemp("aborted") / "swap.mcap"
    shutil.copyfile(compiled("swap"), log)
    run = run_showc("abort", log, "--every", 5, "-q")
    assert run.code == 0, run.err
    return log


def told(aborted, place, change):
    """Prove a table that was changed, and its binding to the log."""
    log = place / aborted.name
    shutil.copyfile(aborted, log)
    message = pb.AbortTable()
    message.CopyFrom(read_log(log).aborts)
    change(message)
    content = message.SerializeToString(deterministic=True)
    add(log, ABORT_NAME, content, digest_of(log))
    file = open_log(log)
    with file.reported():
        script = read_anchor(file, dict(file.metadata)["showc"])[1]
        proof = Aborts(file, decoded(file), script)
    found = proof.checks([part() for part in proof.parts()])
    return found[0], {one.code: one.verdict != "fail" for one in found}


def test_every_row_is_proved_from_the_bytes(aborted):
    found = verify_log(aborted, missions=False)
    assert found.proved
    verdicts = {c.code: c.verdict for c in found.checks if c.code in PROVED}
    assert verdicts == dict.fromkeys(PROVED, "pass")
    nearest = found.check("VRF354")
    rows = read_log(aborted).aborts.legs
    least = min(leg.certificate.closest.distance for leg in rows)
    assert nearest.value == pytest.approx(least, abs=1e-4)
    assert nearest.limit == 1.0


def last_leg(table):
    return table.legs[table.rows[2].legs[-1]]


def shifted(table):
    """A drone goes down a metre beside its place, on a path of its own."""
    for number, one in enumerate(table.flights):
        if one.segment == 0 and one.drone == 0:
            for at in range(0, len(one.state), 12):
                table.flights[number].state[at] += 1.0
    table.legs[0].goals[0] += 1.0


def faster(table):
    """All flights of a leg in half of their time."""
    leg = last_leg(table)
    leg.duration *= 0.5
    for one in table.flights:
        if one.segment == leg.index:
            one.breaks[:] = [0.5 * time for time in one.breaks]


def nearer(table):
    """Two drones of a leg fly as one."""
    first, second = (
        one for one in table.flights if one.segment == 1 and one.drone in {0, 1}
    )
    second.state[:] = first.state
    second.control[:] = first.control


def back(table):
    """A stop, and then back along the plan, at half its rate."""
    row = table.rows[2]
    while len(table.rows) > 3:
        table.rows.pop()
    row.way = pb.AbortRow.BACK_ALONG_THE_PLAN
    del row.legs[:]
    ramp = [-0.5] * 20
    row.changes.extend(ramp)
    # The ramp takes as much of the plan as flying half as long at the full rate.
    left = row.rest - 0.5 * table.period * (0.5 * len(ramp))
    row.changes.extend([0.0] * int(np.ceil(left / (0.5 * table.period))))
    row.duration = (len(row.changes) - stopping(row, table.period)) * table.period


def abrupt(row, period):
    """The clock stops in four periods, where the row says."""
    left = row.rest - row.time
    row.changes[:] = []
    row.rest = row.time + 2.0 * period
    row.changes.extend([-0.25 / period] * 4)
    assert left > 0.0


def jerked(row, period):
    """The whole ramp back in one period."""
    begin = stopping(row, period)
    changes = list(row.changes)
    changes[begin : begin + 20] = [-0.5 / period] + [0.0] * 19
    row.changes[:] = changes


def onward(row, period):
    """Forwards for a while before it goes back."""
    begin = stopping(row, period)
    changes = list(row.changes)
    row.changes[:] = [*changes[:begin], 0.5, *changes[begin:-1], -0.5]


def stopping(row, period):
    """Periods until the clock of a row rests."""
    rates = 1.0 + period * np.cumsum(row.changes)
    return int((rates < 1e-8).argmax()) + 1


LIES = {
    "a row is missing": ("VRF351", lambda t: t.rows.pop()),
    "a row is of another time": ("VRF351", lambda t: setattr(t.rows[1], "time", 8.0)),
    "the fleet stands elsewhere": (
        "VRF351",
        lambda t: setattr(t.rows[1], "rest", t.rows[1].rest + 0.5),
    ),
    "the clock stops too late": ("VRF351", lambda t: t.rows[1].changes.pop()),
    "the clock runs back": ("VRF351", lambda t: t.rows[1].changes.append(-1.0)),
    "rows have each other's ways": (
        "VRF351",
        lambda t: t.rows[1].legs.__setitem__(0, t.rows[2].legs[0]),
    ),
    "in the air, it is on the ground": (
        "VRF351",
        lambda t: (t.rows[1].legs.pop(), setattr(t.rows[1], "way", 0)),
    ),
    "it goes home, and does not": ("VRF351", lambda t: setattr(t.rows[1], "way", 2)),
    "nothing is known of the way": ("VRF351", lambda t: setattr(t.rows[1], "way", 9)),
    "a landing with the limits of a move": (
        "VRF351",
        lambda t: setattr(t.legs[0], "limits", 0),
    ),
    "farther apart than they are": (
        "VRF351",
        lambda t: setattr(t.legs[1].certificate.closest, "distance", 9.0),
    ),
    "it takes less time": ("VRF355", lambda t: setattr(t.rows[2], "duration", 1.0)),
    "it ends higher": ("VRF355", lambda t: t.legs[1].goals.__setitem__(2, 1.0)),
    "a drone beside its place": ("VRF351", shifted),
    "twice as fast": ("VRF352", faster),
    "two drones in one place": ("VRF354", nearer),
    "the clock stops at once": ("VRF356", lambda t: abrupt(t.rows[2], t.period)),
    "back, but not to the ground": (
        "VRF351",
        lambda t: (back(t), t.rows[2].changes.pop(), t.rows[2].changes.pop()),
    ),
    "back in less time": (
        "VRF351",
        lambda t: (back(t), setattr(t.rows[2], "duration", 3.0)),
    ),
    "back at once": ("VRF356", lambda t: (back(t), jerked(t.rows[2], t.period))),
    "back, and on again": ("VRF351", lambda t: (back(t), onward(t.rows[2], t.period))),
}


def test_what_rows_repeat_is_proved_once(aborted, tmp_path, monkeypatch):
    """Else tables of a few kilobytes take minutes."""
    taken = []

    def counted(show):
        taken.append(show)
        return joined_up(show)

    def many(table):
        table.rows.extend([table.rows[2]] * 100)

    monkeypatch.setattr("showc.verify.specification.aborts.joined_up", counted)
    rows, _ = told(aborted, tmp_path, many)
    assert rows.verdict == "fail"
    assert len(taken) <= len(read_log(aborted).aborts.rows)


def placed(table):
    leg = table.legs[0]
    leg.places[0], leg.places[1] = leg.places[1], leg.places[0]


WORDS = {
    "a leg has the name of an escape": lambda t: setattr(t.legs[0], "name", "\x1b[2J"),
    "a leg has no name": lambda t: setattr(t.legs[0], "name", ""),
    "a landing is called an approach": lambda t: setattr(
        t.legs[0], "name", t.legs[0].name.replace("land", "approach")
    ),
    "a leg comes from a formation": lambda t: setattr(t.legs[0], "from_formation", "x"),
    "a leg flies to a formation": lambda t: setattr(t.legs[1], "to_formation", "x"),
    "a leg has another index": lambda t: setattr(t.legs[0], "index", 7),
    "drones have each other's places": placed,
    "groups move in a leg": lambda t: t.legs[0].moves.add(name="x"),
    "a leg claims a bound": lambda t: setattr(
        t.legs[0].certificate, "dual_bound", 0.001
    ),
    "a leg claims a minimum": lambda t: setattr(
        t.legs[0].certificate, "single_drone_minimum", 0.001
    ),
    "a leg has a witness": lambda t: t.legs[0].certificate.witness.knots.append(0.5),
    "a leg was solved by a method": lambda t: setattr(
        t.legs[0].certificate, "method", "certified"
    ),
    "a leg has a count of its own": lambda t: t.legs[0].certificate.statistics.update(
        {"proved": 1.0}
    ),
    "an encounter has a pair": lambda t: setattr(
        t.legs[0].certificate.closest, "drone_b", 5
    ),
}


def test_words_that_no_table_has_are_found(aborted):
    file = open_log(aborted)
    with file.reported():
        script = read_anchor(file, dict(file.metadata)["showc"])[1]
        proof = Aborts(file, decoded(file), script)
    assert list(proof.strange()) == []
    true = pb.AbortTable.FromString(proof.table.SerializeToString())
    for name, change in WORDS.items():
        proof.table = pb.AbortTable.FromString(true.SerializeToString())
        change(proof.table)
        assert list(proof.strange()), name


def test_a_table_of_another_log_is_found_whatever_it_says(aborted, tmp_path):
    """The hash of this log may stand in any word of the table but in its place."""
    log = tmp_path / aborted.name
    shutil.copyfile(aborted, log)
    digest, table = digest_of(log), pb.AbortTable()
    table.CopyFrom(read_log(log).aborts)
    table.data_sha256, table.legs[0].name = "0" * 64, digest
    add(log, ABORT_NAME, table.SerializeToString(), digest)
    assert "VRF108" in failed(verify_log(log, missions=False))


def test_a_table_before_the_data_that_it_is_of_is_found(aborted, tmp_path):
    """It names all bytes before it, and these are not the log."""
    log, whole = tmp_path / aborted.name, Log.read(aborted.read_bytes())
    entry = whole.attachment(ABORT_NAME)
    log.write_bytes(whole.bytes())
    at = next(one for one in open_log(log).attachments if one.name == ABORT_NAME)
    table = pb.AbortTable.FromString(entry[3])
    before = log.read_bytes()[: at.position]
    table.data_sha256 = hashlib.sha256(before).hexdigest()
    entry[3] = table.SerializeToString(deterministic=True)
    log.write_bytes(whole.bytes())
    assert failed(verify_log(log, missions=False)) == {"VRF108"}


@pytest.mark.parametrize("lie", LIES)
def test_a_lie_in_the_table_is_found(aborted, tmp_path, lie):
    code, change = LIES[lie]
    _, holds = told(aborted, tmp_path, change)
    assert holds[code] is False


@pytest.mark.parametrize(
    ("way", "duration", "right"),
    [(0, 0.0, True), (0, 1e8, False), (0, -5.0, False), (9, 0.0, False)],
)
def test_a_row_on_the_ground_takes_no_time(aborted, tmp_path, way, duration, right):
    file = open_log(aborted)
    with file.reported():
        end = decoded(file).duration

    def landed(table):
        row = table.rows[-1]
        row.way, row.duration, row.rest = way, duration, end
        row.changes[:] = [0.0] * int(2.0 + (end - row.time) / table.period)
        del row.legs[:]

    _, holds = told(aborted, tmp_path, landed)
    assert holds["VRF351"] is right


def test_a_lie_in_the_table_makes_the_verdict_not_proved(aborted, tmp_path):
    told(aborted, tmp_path, faster)
    found = verify_log(tmp_path / aborted.name, missions=False)
    assert not found.proved
    assert {"VRF352"} <= failed(found) <= PROVED


@pytest.mark.parametrize(
    "change",
    [
        lambda t: t.flights.pop(),
        lambda t: t.rows[1].legs.append(99),
        lambda t: setattr(t, "every", 0.0),
        lambda t: setattr(t, "period", float("nan")),
        lambda t: t.legs[0].drones.pop(),
        lambda t: setattr(t.rows[1], "rest", float("inf")),
    ],
)
def test_a_table_that_contradicts_itself_is_damage(aborted, tmp_path, change):
    with pytest.raises(DamagedLogError, match="abort table"):
        told(aborted, tmp_path, change)


@pytest.mark.parametrize("tag", [b"\x22", b"\x2a", b"\x32", b"\x3a"])
def test_a_table_of_many_empty_parts_is_refused_at_once(aborted, tmp_path, tag):
    """Decoded, each of two bytes takes a hundred times as many."""
    log = tmp_path / aborted.name
    shutil.copyfile(aborted, log)
    digest = digest_of(log)
    table = pb.AbortTable(data_sha256=digest, every=5.0, period=0.05)
    many = table.SerializeToString(deterministic=True) + 1_000_000 * (tag + b"\x00")
    add(log, ABORT_NAME, many, digest)
    tracemalloc.start()
    file = open_log(log)
    with pytest.raises(Damage, match="abort table"):
        read_aborts(file, decoded(file).rules)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 16e6


@pytest.mark.parametrize("part", ["rows", "legs", "flights", ""])
def test_what_no_part_of_a_table_has_is_refused(aborted, tmp_path, part):
    """A field that no reader knows hides any number of bytes."""

    def change(table):
        place = getattr(table, part)[0] if part else table
        place.MergeFromString(b"\xfa\x3e\x04evil")

    with pytest.raises(DamagedLogError, match="abort table"):
        told(aborted, tmp_path, change)


def test_a_clock_that_never_slows_is_seen_in_the_verdict(aborted, tmp_path):
    """The fleet then flies the show to its end before it lands."""
    true, _ = told(aborted, tmp_path, lambda _: None)
    end = read_log(aborted).duration

    def onward(table, faster=0.0):
        for row in table.rows:
            row.way, row.duration, row.rest = pb.AbortRow.ON_THE_GROUND, 0.0, end
            steps = int(2.0 + (end - row.time) / table.period)
            row.changes[:] = [faster / table.period] * steps
            del row.legs[:]

    late, holds = told(aborted, tmp_path, onward)
    assert holds["VRF351"]
    down = re.compile("on the ground within ([0-9.]+) s")
    times = [float(down.search(found.notes[0])[1]) for found in (true, late)]
    assert times[0] < 20.0
    assert end <= times[1] <= end + 1.0
    # Each step is below what rounding is granted.
    _, holds = told(aborted, tmp_path, partial(onward, faster=0.9e-6))
    assert not holds["VRF351"]


def test_a_way_back_along_the_plan_is_proved(aborted, tmp_path):
    def change(table):
        rows = len(table.rows)
        back(table)
        assert rows >= len(table.rows)

    rows, holds = told(aborted, tmp_path, change)
    assert holds["VRF356"]
    assert "clock" not in " ".join(rows.notes)
