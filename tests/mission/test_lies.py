"""Lies in mission files, with every hash made to fit: each is caught."""

import json
import os
import pickle
import shutil
from collections import Counter
from dataclasses import replace
from datetime import timedelta, timezone
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mission.flights import START, shift_flight
from mission.planted import Case, OtherManifest

from showc.documents.values import DEEPEST, read_json
from showc.errors import ShowError
from showc.log import showc_pb2 as pb
from showc.script.show import MissionOptions
from showc.verify.missions.folder import (
    Folder,
    Missions,
    check_parameters,
    check_plan,
)
from showc.verify.missions.language import MissionFormatError, read_mission
from showc.verify.missions.law import parameter_file
from showc.verify.specification.demands import Demands, hold_against

LIGHTS = MissionOptions(light_servos=(9, 10, 11))
MISSION, PLAN = "missions/drone_0002.waypoints", "missions/drone_0002.plan"
PARAMETERS = "missions/ardupilot.parm"


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return Case(
        tmp_path_factory.mktemp("lies"),
        shift_flight(4, options=LIGHTS, fades=("linear", "end")),
    )


def test_a_compiled_show_passes_whole(case):
    assert case.failures() == set()
    assert case.caught() == set()


def row(command, frame, *fields):
    """One row: parameters, latitude, longitude, height; what is left out is zero."""
    values = [*fields, *["0"] * (4 - len(fields)), *["0.00000000"] * 2, "0.000"]
    return ["0", "0", str(frame), str(command), *map(str, values), "1"]


def inserted(at, *rows):
    return lambda old: [*old[:at], *(list(one) for one in rows), *old[at:]]


def place_of(number, command=None):
    """Turn row ``number`` into one with another command, at its own place."""

    def change(old):
        old[number][3] = str(command)
        return old

    return change


def index(rows, command, which=0):
    return [n for n, one in enumerate(rows) if one[3] == str(command)][which]


def moved(command, field, change, which=0):
    def edit(old):
        one = old[index(old, command, which)]
        one[field] = change(one[field])
        return old

    return edit


STRANGERS = {
    "return to launch": (20, 2),
    "loiter": (17, 3),
    "loiter, turns": (18, 3),
    "loiter, time": (19, 3, 5),
    "spline": (82, 3),
    "jump": (177, 2, 1, 5),
    "termination": (185, 2, 1),
    "home": (179, 2, 1),
    "mode": (176, 2, 1, 5),
    "parachute": (208, 2, 2),
    "relay": (181, 2, 0, 1),
    "gripper": (211, 2, 0, 1),
    "guided": (92, 2, 1),
    "fence off": (207, 2, 0),
    "auxiliary function": (218, 2, 31, 2),
    "yaw": (115, 2, 90),
    "region of interest": (201, 3),
    "land start": (189, 2),
    "script": (42702, 2, 1),
    "payload": (94, 3),
    "absolute waypoint": (16, 0),
    "terrain waypoint": (16, 10),
    "a second take-off": (22, 3),
    "a second landing": (21, 3),
    "a free waypoint": (16, 3),
    "a relative delay": (93, 2, 3, -1, -1, -1),
    "a pause": (93, 2, 3),
    "an hour": (93, 2, -1, 3, 0, 0),
    "a throttle": (178, 2, 1, 5, 50),
    "a speed of no kind": (178, 2, 4, 5, -1),
    "a speed that is not heeded": (178, 2, 1, "0.05", -1),
}


@pytest.mark.parametrize("at", [1, 2, 5, -2, -1, 10_000])
@pytest.mark.parametrize("lie", STRANGERS)
def test_items_that_showc_does_not_write_there_are_findings(case, lie, at):
    content = case.with_row(2, inserted(at, row(*STRANGERS[lie])))[MISSION]
    with pytest.raises(ShowError):
        read_mission(content)


CHANGES = {
    "a hold": moved(16, 4, lambda _: "60", 1),
    "an acceptance radius": moved(16, 5, lambda _: "1000", 1),
    "a pass radius": moved(16, 6, lambda _: "5", 1),
    "a yaw": moved(16, 7, lambda _: "90", 1),
    "a waypoint 1 cm off": moved(16, 8, lambda t: f"{float(t) + 3e-7:.8f}", 2),
    "a waypoint 560 m off": moved(16, 8, lambda t: f"{float(t) + 5e-3:.8f}", 2),
    "a waypoint 3 cm up": moved(16, 10, lambda t: f"{float(t) + 0.03:.3f}", 2),
    "a waypoint at 500 m": moved(16, 10, lambda _: "500.002", 2),
    "a waypoint 20 m under ground": moved(16, 10, lambda _: "-20.002", 2),
    "no take-off": lambda rows: [rows[0], *rows[2:]],
    "take-off to 40 m": moved(22, 10, lambda _: "40.002"),
    "take-off elsewhere": moved(22, 8, lambda t: f"{float(t) + 1e-4:.8f}"),
    "landing beside the pad": moved(21, 9, lambda t: f"{float(t) + 5e-7:.8f}"),
    "landing twice": lambda rows: [*rows, list(rows[-1])],
    "no landing": lambda rows: rows[:-2],
    "a longer pause before landing": moved(93, 4, lambda _: "30", -1),
    "a slot in another minute": moved(93, 6, lambda t: str((int(t) + 1) % 60)),
    "a slot 20 minutes late": moved(93, 6, lambda t: str((int(t) + 20) % 60), 3),
    "a slot too soon": moved(93, 7, lambda t: str(int(t) - 3), 2),
    "a slot that names the hour": moved(93, 5, lambda _: "20"),
    "a slot without a minute": moved(93, 6, lambda _: "-1"),
    "a slot at second 61": moved(93, 7, lambda _: "61"),
    "a half second": moved(93, 7, lambda t: f"{t}.5"),
    "a light on a motor": moved(183, 4, lambda _: "1"),
    "a light at 2400 us": moved(183, 5, lambda _: "2400"),
    "home elsewhere": moved(16, 8, lambda t: f"{float(t) + 1e-4:.8f}"),
    "home 3 m up": moved(16, 10, lambda t: f"{float(t) + 3.0:.3f}"),
    "not current": moved(16, 1, lambda _: "0"),
    "another one current": moved(16, 1, lambda _: "1", 1),
    "no autocontinue": moved(16, 11, lambda _: "0", 1),
    "an altitude frame": moved(16, 2, lambda _: "0", 1),
    "a frame of terrain": moved(16, 2, lambda _: "10", 1),
    "not a number": moved(16, 8, lambda _: "nan", 1),
    "infinite": moved(178, 5, lambda _: "inf"),
    "written otherwise": moved(178, 5, lambda t: f"+{t}"),
    "far too fast": moved(178, 5, lambda _: "30"),
}


@pytest.mark.parametrize("lie", CHANGES)
def test_changed_items_are_findings(case, lie):
    changed = case.with_row(2, CHANGES[lie])
    assert changed[MISSION] != case.files[MISSION]
    assert case.caught(changed)


ADMISSIBLE = {
    ("S", 5): "speeds: any at which legs keep apart and in time",
    ("C", 6): "slots: any that leave time for the legs and keep them apart",
    ("C", 7): "slots: any that leave time for the legs and keep them apart",
    ("F", 4): "slots: any that leave time for the legs and keep them apart",
    ("D", 4): "when during a leg lights change",
    ("V", 4): "which of the script's outputs a light item sets",
    ("V", 5): "pulse widths within the script's range",
}
"""Words and fields of rows that may have other values, within what is proved."""


def other_values(text):
    """Values that a field could have instead."""
    value = float(text)
    found = [value + 1, value - 1, -value, 1.1 * value, 0.0, 1e9]
    known = {f"{one:.8f}".rstrip("0").rstrip(".") for one in found} - {"-0"}
    return sorted(known | {"nan", "inf", "-inf", "", "x", f"{text}0", f" {text}"})


def test_every_field_of_every_row_is_caught_or_admissible(case):
    """Whatever is not caught keeps all that is proved: it is in the table above."""
    names = read_mission(case.files[MISSION])
    words = "H" + "".join(item.word for item in names.items)
    lines = case.files[MISSION].decode().splitlines()
    through, asked = set(), Counter()
    for number, word in enumerate(words):
        fields = lines[number + 1].split("\t")
        for field, old in enumerate(fields):
            for new in other_values(old):
                if new == old:
                    continue
                changed = [*fields[:field], new, *fields[field + 1 :]]
                text = [*lines[: number + 1], "\t".join(changed), *lines[number + 2 :]]
                content = ("\n".join(text) + "\n").encode()
                try:
                    read_mission(content)
                except ShowError:
                    continue
                # A sentence of the language: then it is the flight that tells.
                asked[word, field] += 1
                known = (word, field) in through or asked[word, field] > 6
                if known or case.caught({MISSION: content}):
                    continue
                through.add((word, field))
    assert through <= set(ADMISSIBLE)


def test_rows_that_change_places_are_caught(case):
    rows = [line.split("\t") for line in case.files[MISSION].decode().splitlines()[1:]]
    for first in range(len(rows) - 1):

        def swapped(old, first=first):
            old[first], old[first + 1] = old[first + 1], old[first]
            return old

        changed = case.with_row(2, swapped)
        if changed[MISSION] == case.files[MISSION]:
            continue
        if not case.caught(changed):
            # Speeds of two kinds, or lights, may come in any order.
            pair = {rows[first][3], rows[first + 1][3]}
            assert pair <= {"178"} or pair <= {"183"}


def test_every_parameter_line_is_caught(case):
    wanted = parameter_file(case.script)
    assert wanted == case.files[PARAMETERS]
    lines = wanted.decode().splitlines()

    def verdict(*lines):
        content = "\n".join(lines) + "\n"
        return check_parameters(content.encode(), wanted).verdict

    assert verdict(*lines) == "pass"
    for number, line in enumerate(lines):
        name = line.partition(",")[0]
        others = [name, f"{name},nan", f"{name},inf", f"{name},1e3", f"{line}0", ""]
        for other in set(others) - {line}:
            assert verdict(*lines[:number], other, *lines[number + 1 :]) == "fail"
        assert verdict(*lines[:number], *lines[number + 1 :]) == "fail"
    for more in ("LAND_SPEED,500", "ARMING_CHECK,0", "FENCE_ENABLE,0", "\x1b[31m"):
        assert verdict(*lines, more) == "fail"
    assert "VRF407" in case.caught({PARAMETERS: wanted + b"FENCE_ENABLE,0\n"})


def leaves(value, path=()):
    """Paths of all that is no container in a JSON document, and of all keys."""
    if isinstance(value, dict):
        for key, inside in value.items():
            yield (*path, key)
            yield from leaves(inside, (*path, key))
    elif isinstance(value, list):
        for number, inside in enumerate(value):
            yield from leaves(inside, (*path, number))
    else:
        yield path


def changed_at(document, path, change):
    copy = json.loads(json.dumps(document))
    inside = copy
    for key in path[:-1]:
        inside = inside[key]
    change(inside, path[-1])
    return copy


def test_every_key_of_a_plan_is_caught(case):
    document = json.loads(case.files[PLAN])
    token, site = case.missions.fleet_token, case.show.rules.site
    rest = read_mission(case.files[MISSION]), site, case.script
    whose = case.log.library, token, "ardupilot"
    assert list(check_plan(case.files[PLAN], *rest, whose)) == []
    free = []

    def other(inside, key):
        value = inside[key]
        inside[key] = value + 1 if isinstance(value, int | float) else [value]

    def gone(inside, key):
        del inside[key]

    def more(inside, key):
        if isinstance(inside, dict):
            inside[f"{key}2"] = inside[key]
        else:
            inside.append(inside[key])

    for path in sorted(set(leaves(document)), key=str):
        for change in (other, gone, more):
            content = json.dumps(changed_at(document, path, change)).encode()
            if not list(check_plan(content, *rest, whose)):
                free.append((path, change.__name__))
    assert free == []
    assert "VRF406" in case.caught({PLAN: b"{}"})


@pytest.mark.parametrize(
    "change",
    [
        lambda m: m["missions"].update(autopilot="px4"),
        lambda m: m["missions"].update(autopilot=None),
        lambda m: m["missions"].update(start="2026-06-01T20:00:00+00:00"),
        lambda m: m["missions"].update(start=[]),
        lambda m: m["missions"].update(prediction=None),
        lambda m: m["missions"]["prediction"].update(start_minute=7),
        lambda m: m["missions"]["prediction"].update(start_minute=True),
        lambda m: m["missions"]["prediction"]["legs"].clear(),
        lambda m: m["missions"]["prediction"].update(latest_mission_start=60.0),
        lambda m: m["missions"]["prediction"].update(latest_mission_start=None),
        lambda m: m["missions"]["prediction"].update(latest_mission_start=True),
        lambda m: m["missions"]["prediction"].update(latest_mission_start=[]),
        lambda m: m["missions"]["prediction"].update(
            latest_mission_start=m["missions"]["prediction"]["latest_mission_start"]
            + 2.5
        ),
        lambda m: m["missions"]["prediction"].update(firmware="PX4 1.15"),
        lambda m: m["missions"]["prediction"].update(clock="sundial"),
        lambda m: m["missions"]["prediction"].update(start="2026-06-01T21:00:00Z"),
        lambda m: m["missions"]["prediction"].update(required_separation=0.1),
        lambda m: m["missions"]["prediction"].update(delay_spread=0.0),
        lambda m: m["missions"]["prediction"].update(clock_lag=0.0),
        lambda m: m["missions"]["prediction"].update(more=1),
        lambda m: m["missions"]["prediction"]["land"].update(
            distance=str(m["missions"]["prediction"]["land"]["distance"])
        ),
        lambda m: m["missions"]["prediction"]["land"].update(distance=10**400),
        lambda m: m["missions"]["prediction"].update(latest_mission_start=10**400),
        lambda m: m["missions"]["prediction"]["legs"][0].update(closest={}),
        lambda m: m["missions"]["prediction"].update(launch=None),
        lambda m: m["missions"]["prediction"]["land"].update(distance=9.0),
        lambda m: m["missions"]["prediction"]["legs"][0].update(more=1),
        lambda m: m["missions"]["prediction"]["legs"][0].update(optimal_start=99.0),
        lambda m: m["missions"]["prediction"]["legs"][0].update(optimal_duration=0.0),
        lambda m: m["missions"]["prediction"]["legs"][0].update(name="\x1b[2J"),
        lambda m: m["missions"]["prediction"]["legs"][0].update(leg=99),
        lambda m: m["missions"]["prediction"]["legs"][0].update(encoding="\x1b[2J"),
        lambda m: m["missions"]["prediction"]["legs"][0].update(slots={"a": 1}),
        lambda m: m["missions"]["prediction"]["legs"][0].update(delays=[[1.0]]),
        lambda m: m["missions"]["prediction"]["legs"][0]["closest"].update(more=1),
        lambda m: m["missions"]["prediction"]["launch"].update(proved="wholly"),
        lambda m: m["missions"]["prediction"]["land"].pop("time"),
        lambda m: m["missions"]["files"].pop(MISSION),
        lambda m: m["missions"]["files"].update({"../x": "0" * 64}),
        lambda m: m.update(fleet="0" * 64),
        lambda m: m.update(missions=[]),
    ],
)
def test_a_manifest_that_says_something_else_is_caught(case, change):
    def edited(manifest):
        change(manifest)
        return manifest

    assert case.caught(manifest=edited)


def test_what_differs_of_a_prediction_is_named_with_its_figures(case):
    manifest = json.loads(case.manifest)
    manifest["missions"]["prediction"]["clock_lag"] = 0.0
    log = OtherManifest(case.log, json.dumps(manifest).encode())
    asked = hold_against(case.script, case.show)
    flight = Missions(Folder(log, case.script), log, case.show, asked).flight()
    found = {check.code: check for check in flight}["VRF414"]
    assert (found.verdict, found.value) == ("fail", None)
    assert found.notes == ("prediction.clock_lag is 0.0, not 0.17",)


def test_missions_of_a_show_that_no_mission_carries_are_not_proved(case):
    segments = list(case.show.segments)
    message = pb.Segment()
    message.CopyFrom(segments[1].message)
    message.kind = pb.Segment.MOTION
    segments[1] = replace(segments[1], message=message)
    show = replace(case.show, segments=tuple(segments))
    missions = Missions(Folder(case.log, case.script), case.log, show, Demands())
    (found,) = missions.flight()
    assert (found.code, found.verdict) == ("VRF410", "fail")
    assert missions.tubes is None


def test_a_name_cannot_bring_escapes_to_a_terminal(case):
    def edited(manifest):
        manifest["missions"]["files"]["\x1b[2J\n::error::x"] = "0" * 64
        return manifest

    assert "VRF403" in case.caught(manifest=edited)


def test_missing_and_foreign_files_are_caught(case):
    for name in (MISSION, PLAN, PARAMETERS):
        content = (case.folder / name).read_bytes()
        (case.folder / name).unlink()
        assert "VRF401" in case.failures()
        (case.folder / name).symlink_to("/dev/zero")
        assert "VRF401" in case.failures()
        (case.folder / name).unlink()
        os.mkfifo(case.folder / name)
        assert "VRF401" in case.failures()
        (case.folder / name).unlink()
        (case.folder / name).write_bytes(content)
    (case.folder / "missions" / "more.txt").write_text("")
    assert case.failures() == {"VRF401"}
    (case.folder / "missions" / "more.txt").unlink()
    assert case.failures() == set()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b'"fileType"', b'"fileType": "Evil", "fileType"'),
        (b'"params"', b'"params": [9, 9, 9, 9, 9, 9, 9], "params"'),
        (b'"version": 1,', b'"version": true,'),
        (b'"version": 1,', b'"version": 1' + 400 * b"0" + b","),
        (b'"polygon": [', b'"polygon": [[1' + 400 * b"0" + b", 1], "),
        (b'{\n "fileType"', b'\xef\xbb\xbf{\n "fileType"'),
        (b'"groundStation": "showc', b'"groundStation": "showc showc'),
    ],
)
def test_a_plan_that_two_readers_read_in_two_ways_is_caught(case, old, new):
    changed = case.files[PLAN].replace(old, new, 1)
    assert changed != case.files[PLAN]
    assert "VRF406" in case.caught({PLAN: changed})


@pytest.mark.parametrize(
    "name",
    ["drone_0001.waypoints", "missions/.hidden", "missions/DRONE_0001.plan", "x/a.kml"],
)
def test_whatever_else_lies_in_the_folder_is_caught(case, name):
    path = case.folder / name
    made = not path.parent.exists()
    path.parent.mkdir(exist_ok=True)
    for make in (lambda: path.write_text("x"), lambda: path.symlink_to("/nowhere")):
        make()
        assert case.failures() == {"VRF401"}
        path.unlink()
    if made:
        path.parent.rmdir()
    assert case.failures() == set()


@pytest.mark.parametrize("name", ["", "missions"])
def test_a_folder_that_cannot_be_listed_is_caught(case, name, monkeypatch):
    """For all but the superuser, whom tests often run as, it looks empty."""
    closed, listed = case.folder / name, Path.iterdir

    def iterdir(path):
        if path == closed:
            raise PermissionError(13, "Permission denied", str(path))
        return listed(path)

    monkeypatch.setattr(Path, "iterdir", iterdir)
    assert case.failures() == {"VRF401"}


def test_folders_in_the_folder_are_caught_empty_or_deeper_than_any_path(case):
    for name in ("old", "missions/old"):
        top = case.folder / name
        top.mkdir()
        assert case.failures() == {"VRF401"}
        deep = os.open(top, os.O_RDONLY)
        for _ in range(20):
            os.mkdir(250 * "a", dir_fd=deep)
            inner = os.open(250 * "a", os.O_RDONLY, dir_fd=deep)
            os.close(deep)
            deep = inner
        os.close(deep)
        assert case.failures() == {"VRF401"}
        shutil.rmtree(top)
    assert case.failures() == set()


def test_a_folder_of_missions_that_is_a_link_is_caught(case, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    (case.folder / "missions").rename(elsewhere)
    (case.folder / "missions").symlink_to(elsewhere)
    assert "VRF401" in case.failures()
    (case.folder / "missions").unlink()
    elsewhere.rename(case.folder / "missions")
    assert case.failures() == set()


def test_px4_is_unproved_unless_the_script_names_it(tmp_path):
    case = Case(tmp_path, shift_flight(2), autopilot="px4")
    assert case.failures() == set()
    named = replace(case.script.mission, autopilot="px4")
    accepted = replace(case.script, mission=named)
    for script, verdict in ((case.script, "unproved"), (accepted, "accepted")):
        checks = case.checks(script)
        assert checks["VRF410"].verdict == verdict
        assert "VRF411" not in checks
        assert {c.verdict for k, c in checks.items() if k != "VRF410"} == {"pass"}


@pytest.fixture(scope="module")
def pixhawks(tmp_path_factory):
    return Case(tmp_path_factory.mktemp("px4"), shift_flight(2), autopilot="px4")


PLACES = {
    "a waypoint 560 m off": (16, 8, lambda t: f"{float(t) + 5e-3:.8f}", "VRF410"),
    "a waypoint at 500 m": (16, 10, lambda _: "500.002", "VRF415"),
    "a take-off elsewhere": (22, 9, lambda t: f"{float(t) + 1e-4:.8f}", "VRF404"),
    "a landing elsewhere": (21, 9, lambda t: f"{float(t) + 1e-4:.8f}", "VRF404"),
}


@pytest.mark.parametrize("lie", PLACES)
def test_missions_to_other_places_are_caught_whatever_flies_them(pixhawks, lie):
    *change, code = PLACES[lie]
    assert code in pixhawks.caught(pixhawks.alike(2, moved(*change)))


def test_a_way_round_of_an_autopilot_that_is_not_known_is_caught(pixhawks):
    def change(rows):
        away = list(rows[index(rows, 16, 1)])
        away[8] = f"{float(away[8]) + 5e-3:.8f}"
        return inserted(index(rows, 16, 1), away)(rows)

    assert pixhawks.caught(pixhawks.alike(2, change)) == {"VRF410"}


@pytest.mark.parametrize(
    "change",
    [
        lambda m: m["missions"].update(prediction={"clock": "relative", "nearest": 9}),
        lambda m: m["missions"].update(start="tonight"),
    ],
)
def test_what_is_foretold_of_an_autopilot_that_is_not_known_is_caught(pixhawks, change):
    def edited(manifest):
        change(manifest)
        return manifest

    assert pixhawks.caught(manifest=edited) & {"VRF410", "VRF414"}


def test_a_home_at_another_height_is_caught(pixhawks):
    document = json.loads(pixhawks.files[PLAN])
    document["mission"]["plannedHomePosition"][2] += 1.0
    assert "VRF406" in pixhawks.caught({PLAN: json.dumps(document).encode()})


def test_a_minute_beside_a_time_of_day_is_caught(tmp_path):
    def edited(manifest):
        manifest["missions"]["prediction"]["start_minute"] = 30
        return manifest

    case = Case(tmp_path, shift_flight(2), START)
    assert case.caught() == set()
    assert case.caught(manifest=edited) == {"VRF414"}


class Shifted:
    """A prediction that is elsewhere, or at another time."""

    def __init__(self, flight, *, drone=0, by=(0.0, 0.0, 0.0), late=0.0, until=1.0):
        self.flight, self.drone, self.by, self.late = flight, drone, by, late
        self.duration = flight.duration * until

    def position(self, times):
        places = np.array(self.flight.position(np.asarray(times) - self.late))
        places[:, self.drone] += self.by
        return places


@pytest.mark.parametrize(
    "shift",
    [
        {"by": (1.0, 0.0, 0.0)},
        {"by": (0.0, 0.0, -1.0), "drone": 3},
        {"by": (np.nan, 0.0, 0.0)},
        {"late": 2.0},
        {"late": -2.0},
        {"until": 0.5},
        {"until": 0.97},
        {"until": 9.0},
    ],
)
def test_a_fleet_drawn_elsewhere_is_caught(tmp_path, shift, monkeypatch):
    whole = Case(tmp_path / "whole", shift_flight(4), START)
    assert whole.failures() == set()
    from showc.mission import fleet

    real = fleet.PredictedFlight
    monkeypatch.setattr(
        fleet, "PredictedFlight", lambda *a, **k: Shifted(real(*a, **k), **shift)
    )
    case = Case(tmp_path / "other", shift_flight(4), START)
    assert case.failures() == {"VRF421"}


@settings(
    deadline=None,
    max_examples=60,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    st.recursive(
        st.none()
        | st.booleans()
        | st.floats()
        | st.sampled_from(["ardupilot", "px4", "2026-06-01T20:00:00Z"]),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(
                    ["missions", "show", "files", "legs", "prediction", "closest"]
                    + ["autopilot", "start", "start_minute", MISSION]
                ),
                inner,
                max_size=4,
            )
        ),
        max_leaves=12,
    )
)
def test_whatever_stands_in_a_manifest_raises_nothing(case, manifest):
    assert case.caught(manifest=lambda _: manifest)


@settings(deadline=None, max_examples=100, derandomize=True)
@given(st.binary(max_size=200))
def test_whatever_is_no_mission_is_refused_in_words(content):
    for text in (content, b"QGC WPL 110\n" + content):
        with pytest.raises(ShowError):
            read_mission(text)


def pulses(change):
    """Change rows of servo items, all of them."""

    def changed(rows):
        for one in rows:
            if one[3] == "183":
                one[4:6] = change(*one[4:6])
        return rows

    return changed


@pytest.mark.parametrize(
    "change",
    [
        pulses(lambda output, _: (output, "1000")),
        pulses(lambda output, _: (output, "2000")),
        pulses(lambda output, pulse: ({"9": "10", "10": "9"}.get(output, "11"), pulse)),
        pulses(lambda output, pulse: (output, str(int(pulse) // 2 + 500))),
        pulses(lambda output, pulse: (str(int(output) + 1), pulse)),
    ],
    ids=["dark", "bright", "exchanged", "dim", "elsewhere"],
)
def test_lights_of_other_colours_are_caught(case, change):
    assert "VRF409" in case.caught(case.with_row(2, change))


@pytest.fixture(scope="module")
def dark(tmp_path_factory):
    """A show whose drones have no lights on outputs."""
    return Case(tmp_path_factory.mktemp("dark"), shift_flight(2))


@pytest.mark.parametrize("at", [2, -1])
def test_outputs_of_a_show_without_lights_are_caught(dark, at):
    """Output 1 turns a motor."""
    motor = row(183, 2, 1, 2000)
    assert "VRF409" in dark.caught(dark.alike(2, inserted(at, motor)))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b'"groundStation": "showc ', b'"groundStation": "showc 9'),
        (b'"hoverSpeed": 8', b'"hoverSpeed": 5'),
    ],
)
def test_a_plan_of_another_writer_is_caught(case, old, new):
    changed = case.files[PLAN].replace(old, new, 1)
    assert changed != case.files[PLAN]
    assert "VRF406" in case.caught({PLAN: changed})


def test_a_corner_of_the_fence_off_by_one_unit_of_its_rounding_is_caught(case):
    document = json.loads(case.files[PLAN])
    corner = document["geoFence"]["polygons"][0]["polygon"][0]
    own = list(corner)
    for axis, off in product((0, 1), (1e-7, -1e-7, 3e-8, 1.3e-7)):
        corner[:] = own
        corner[axis] = round(own[axis] + off, 9)
        assert "VRF406" in case.caught({PLAN: json.dumps(document).encode()})


def test_a_mission_that_its_board_cannot_hold_is_caught(case):
    """Speeds may be said twice, but not two thousand times."""

    def change(rows):
        at = next(n for n, row in enumerate(rows) if row[3] == "178")
        return [*rows[:at], *[list(rows[at]) for _ in range(700)], *rows[at:]]

    assert case.script.mission.board == "pixhawk"
    found = case.with_row(2, change)
    assert "VRF405" in case.caught(found)
    content = found[MISSION]
    assert len(read_mission(content).items) > 700
    with pytest.raises(MissionFormatError, match="1 to 161 rows"):
        read_mission(content, most=161)


def test_a_height_of_minus_zero_is_caught(case):
    def change(rows):
        at = next(n for n, row in enumerate(rows) if row[3] == "93")
        rows[at][10] = "-0.000"
        return rows

    assert "VRF405" in case.caught(case.alike(1, change))


@pytest.mark.parametrize("slot", [0, 1, -1])
def test_a_slot_minutes_later_than_needed_is_caught(case, slot):
    """All drones leave later, and all is as before but for a long wait."""

    def change(rows):
        slots = [n for n, row in enumerate(rows) if row[3:5] == ["93", "-1"]]
        assert len(slots) > 1
        for at in slots[slot:]:
            minute, second = int(rows[at][6]) + 2, int(rows[at][7])
            rows[at][6:8] = str(minute % 60), str(second)
            if minute >= 60 and rows[at][5] != "-1":
                rows[at][5] = str(int(rows[at][5]) + 1)
        return rows

    later = {}
    for drone in range(1, case.script.drones + 1):
        later |= case.with_row(drone, change)
    assert "VRF408" in case.caught(later)


@pytest.mark.parametrize(
    "elsewhere",
    [
        lambda latitude, longitude: (latitude, longitude + 360.0),
        lambda latitude, longitude: (latitude, longitude - 72000.0),
        lambda latitude, longitude: (latitude - 360.0, longitude),
        lambda latitude, longitude: (180.0 - latitude, longitude + 180.0),
    ],
)
def test_a_corner_of_the_fence_written_off_the_globe_is_caught(case, elsewhere):
    document = json.loads(case.files[PLAN])
    corner = document["geoFence"]["polygons"][0]["polygon"][0]
    corner[:] = elsewhere(*corner)
    assert "VRF406" in case.caught({PLAN: json.dumps(document).encode()})


@pytest.mark.parametrize(
    "said",
    [
        START.isoformat().replace("+00:00", ""),
        START.isoformat().replace("+00:00", "Z"),
        START.isoformat().replace("-", "").replace("T", " "),
        START.astimezone(timezone(timedelta(hours=2))).isoformat(),
    ],
)
def test_a_start_in_another_form_than_compile_writes_is_caught(tmp_path, said):
    case = Case(tmp_path, shift_flight(2), start=START)
    assert case.caught() == set()

    def edited(manifest):
        missions = manifest["missions"]
        missions["start"] = missions["prediction"]["start"] = said
        return manifest

    assert case.caught(manifest=edited)


@pytest.mark.parametrize("number", [b"1e400", b"-1e400", b"NaN", b"Infinity"])
def test_a_number_that_is_none_is_refused(number):
    with pytest.raises(ValueError, match="is no number"):
        read_json(b"[" + number + b"]", 100)
    assert read_json(b"[1e3, -2.5, 7]", 100) == [1000.0, -2.5, 7]


def test_json_of_wide_letters_takes_four_times_the_memory():
    assert read_json(b'"' + 40_000_000 * b"a" + b'"', 100_000_000)
    wide = "\N{GRINNING FACE}".encode()
    with pytest.raises(ValueError, match="MB of memory"):
        read_json(b'"' + wide + 40_000_000 * b"a" + b'"', 100_000_000)


@pytest.mark.parametrize(("first", "last"), [(b"[", b"]"), (b'{"a":', b"}")])
def test_json_is_nested_no_deeper_than_another_process_can_be_told(first, last):
    def document(depth):
        return first * depth + b"1" + last * depth

    assert pickle.dumps(read_json(document(DEEPEST), 10_000))
    for depth in (DEEPEST + 1, 500, 100_000):
        with pytest.raises(ValueError, match="nested too deeply"):
            read_json(document(depth), 1_000_000)


@pytest.mark.parametrize("much", [b"[],", b"{},", b"1,", b'"":1,'])
def test_json_that_would_fill_the_memory_is_not_read(much):
    content = b"[" + 10_000_000 * much + b"0]"
    with pytest.raises(ValueError, match="MB of memory"):
        read_json(content, 100_000_000)


@pytest.mark.parametrize("command", [16, 21, 22])
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_yaw_in_mission_and_plan_alike_is_caught(tmp_path, autopilot, command):
    case = Case(tmp_path, shift_flight(2), autopilot=autopilot)

    def turned(rows):
        for one in rows[autopilot == "ardupilot" :]:
            if one[3] == str(command):
                one[7] = "90"
        return rows

    assert case.caught(case.alike(2, turned)) == {"VRF405"}


@pytest.mark.parametrize("kind", ["1", "2"])
def test_legs_faster_than_any_that_were_measured_are_caught(tmp_path, kind):
    """Level at 8 m/s, upright at the speeds of the script: of more nothing is known."""
    case = Case(tmp_path, shift_flight(2, shift=(70.0, 10.0, 40.0)))
    assert case.caught() == set()

    def faster(rows):
        for one in rows:
            if one[3] == "178":
                one[5] = "20" if one[4] == kind else "8"
        return rows

    assert "VRF410" in case.caught(case.alike(2, faster))


@pytest.mark.parametrize("change", [lambda legs: legs[1:], lambda legs: legs * 2])
def test_a_prediction_of_other_moves_is_caught(case, change):
    def edited(manifest):
        prediction = manifest["missions"]["prediction"]
        prediction["legs"] = change(prediction["legs"])
        return manifest

    assert "VRF414" in case.caught(manifest=edited)


@pytest.mark.parametrize(
    "other",
    [
        lambda text: text.replace(b"\n", b"\r\n"),
        lambda text: b"\xef\xbb\xbf" + text,
        lambda text: text + b"\n",
        lambda text: text + b"\0",
        lambda text: text[:-1],
        lambda text: text.replace(b"\t", b" "),
        lambda text: text.replace(b"\t16\t", b"\t+16\t"),
        lambda text: text.replace(b"\t16\t", b"\t1_6\t"),
        lambda text: text.replace(b"\t16\t", b"\t016\t"),
        lambda text: text.replace(b"\t16\t", b"\t16.0\t"),
        lambda text: text.replace(b"\t16\t", "\t１６\t".encode()),
        lambda text: text.replace(b"\t0\t0\t0\t0\t", b"\t-0\t0\t0\t0\t", 1),
        lambda text: text.replace(b"\t0\t0\t0\t0\t", b"\tnan\t0\t0\t0\t", 1),
        lambda text: text.replace(b"\t0\t0\t0\t0\t", b"\t0e9\t0\t0\t0\t", 1),
        lambda text: text.replace(b"\t0\t0\t0\t0\t", b"\t0x0\t0\t0\t0\t", 1),
        lambda text: text.replace(b"QGC WPL 110", b"QGC WPL 120"),
        lambda text: text.replace(b"QGC WPL 110", b"qgc wpl 110"),
        lambda text: text.replace(b"\t1\n", b"\t0\n", 1),
        lambda text: text.replace(b"\t1\n", b"\t1\t1\n", 1),
        lambda text: text.replace(b"\t1\n", b"\t1 \n", 1),
    ],
)
def test_a_mission_in_other_bytes_is_refused_though_it_says_the_same(case, other):
    changed = other(case.files[MISSION])
    assert changed != case.files[MISSION]
    with pytest.raises(MissionFormatError):
        read_mission(changed)


def taken(rows, which, to):
    """Rows with some of them carried to before another one."""
    rest = [one for number, one in enumerate(rows) if number not in which]
    at = to - sum(number < to for number in which)
    return [*rest[:at], *(rows[number] for number in which), *rest[at:]]


def lights(rows, which):
    """Numbers of the light items of one group: those that follow each other."""
    found = [n for n, one in enumerate(rows) if one[3] == "183"]
    starts = [n for n in found if n - 1 not in found]
    begin = starts[which]
    return [
        n for n in found if begin <= n < begin + 3 and {*range(begin, n)} <= {*found}
    ]


def carried(which, to):
    """Carry a group of lights to before the item that ``to`` finds."""
    return lambda rows: taken(rows, lights(rows, which), to(rows))


def later(rows):
    """The colour of the first move comes on the slot of the second."""
    found = taken(rows, lights(rows, 1), index(rows, 16, 3))
    return [one for one in found if one[3] != "112"]


def blinked(rows):
    """A group of lights shows another colour first."""
    first = lights(rows, 2)[0]
    other = [*rows[first][:5], "1500", *rows[first][6:]]
    return [*rows[:first], other, *rows[first:]]


def repeated(rows):
    last = lights(rows, 2)[-1]
    return [*rows[: last + 1], list(rows[last]), *rows[last + 1 :]]


@pytest.mark.parametrize(
    "change",
    [
        carried(2, lambda rows: index(rows, 21)),
        carried(2, lambda rows: index(rows, 16, 4)),
        carried(3, lambda rows: index(rows, 16, 3)),
        later,
        blinked,
        repeated,
        lambda rows: [*rows[:2], *rows[3:]],
        lambda rows: [*rows[:4], *rows[5:]],
    ],
)
def test_lights_on_the_legs_of_another_move_are_caught(case, change):
    """Mission and plan agree, and the colours come in their order."""
    assert case.caught(case.alike(2, lambda rows: rows)) == set()
    assert "VRF409" in case.caught(case.alike(2, change))


def test_a_way_round_of_many_legs_is_caught(case):
    def change(rows):
        slot, place = index(rows, 93, 2), index(rows, 16, 3)
        more = []
        for second in (19, 20, 21):
            again, here = list(rows[slot]), list(rows[place])
            again[7] = str(second)
            more += [again, here]
        return [*rows[: place + 1], *more, *rows[place + 1 :]]

    assert "VRF404" in case.caught(case.alike(2, change))


def test_lights_that_would_change_after_their_leg_are_caught(case):
    """An autopilot that waits with an item drops it at the end of the leg."""
    late = moved(112, 4, lambda _: "60")
    assert "VRF410" in case.caught(case.alike(2, late))


@pytest.mark.parametrize("second", [19, 26])
def test_a_slot_of_lights_that_has_passed_is_caught(case, second):
    """A vehicle that comes too late for a slot waits for the next hour."""

    def change(rows):
        slot, light = list(rows[index(rows, 93, 4)]), rows[lights(rows, 3)[0]]
        slot[7] = str(second)
        at = lights(rows, 2)[-1] + 1
        rest = [one for one in rows[at:] if one is not light]
        return [*rows[:at], slot, light, *rest]

    assert "VRF408" in case.caught(case.alike(2, change))


def test_a_landing_from_beside_the_pad_is_caught(case):
    """An autopilot flies level to above the pad first, and not straight down to it."""

    def change(rows):
        last = max(n for n, one in enumerate(rows) if one[3] == "16")
        slot = max(n for n, one in enumerate(rows) if one[3] == "93" and one[4] == "-1")
        again, aside = list(rows[slot]), list(rows[last])
        again[7] = str(int(again[7]) + 20)
        aside[9] = f"{float(aside[9]) + 4e-5:.8f}"
        return [*rows[: last + 1], again, aside, *rows[last + 1 :]]

    assert "VRF404" in case.caught(case.alike(2, change))


@pytest.mark.parametrize(
    ("depth", "code"), [(50, "VRF414"), (90, "VRF414"), (500, "VRF410")]
)
def test_a_forecast_nested_beyond_reason_is_caught(case, depth, code):
    def change(manifest):
        delay = 1.0
        for _ in range(depth):
            delay = {"distance": delay}
        manifest["missions"]["prediction"]["delay"] = delay
        return manifest

    assert code in case.caught(manifest=change)


def test_lights_on_legs_of_another_move_are_caught_of_an_unknown_autopilot(tmp_path):
    flight = shift_flight(2, options=LIGHTS, fades=("linear", "end"))
    case = Case(tmp_path, flight, autopilot="px4")
    assert case.caught(case.alike(2, lambda rows: rows)) == set()
    assert "VRF409" in case.caught(case.alike(2, later))
