"""Shows of others on our pages: what was found is marked, what is not known is said."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest
from click.testing import CliRunner

from showc.cli.report import command as report
from showc.cli.view import command as view
from showc.errors import DamagedFileError, UsageError
from showc.foreign.reading import read_show
from showc.foreign.verdict import Questions, judge, rules_for
from showc.view.foreign import Judged, foreign_scene, render_foreign_report

# Two drones climb, swap sides past each other at 2.4 m, and come down.
TIMES = np.array([0.0, 4.0, 10.0, 13.0, 17.0, 20.0, 26.0])
MET = 15.0


def written(folder, **settings):
    drones = []
    for side in (-1.0, 1.0):
        x = side * np.array([4.0, 4.0, 4.0, 4.0, -4.0, -4.0, -4.0])
        z = np.array([0.0, 0.0, 12.0, 12.0, 12.0, 12.0, 0.0])
        points = [
            [time, [a, side * 1.2, b], []]
            for time, a, b in zip(TIMES.tolist(), x.tolist(), z.tolist(), strict=True)
        ]
        trajectory = {"version": 1, "points": points}
        name = "<b>left</b>" if side < 0 else "right"
        drones.append({"settings": {"name": name, "trajectory": trajectory}})
    show = {"version": 1, "settings": settings, "swarm": {"drones": drones}}
    path = folder / "swap.skyc"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("show.json", json.dumps(show))
    return path


def judged(path):
    show = read_show(path)
    return Judged(
        show, judge(show, Questions()).to_json(), rules_for(show, Questions())
    )


@pytest.fixture
def strict(tmp_path):
    return written(tmp_path, validation={"minDistance": 3, "maxAltitude": 30})


@pytest.fixture
def silent(tmp_path):
    return written(tmp_path)


def test_the_proved_encounter_is_the_tightest_of_the_page(strict):
    scene = foreign_scene(judged(strict))
    (tightest,) = [one for one in scene.encounters if one.tightest]
    assert tightest.distance == pytest.approx(2.4, abs=1e-3)
    assert tightest.time == pytest.approx(MET, abs=1e-2)
    (band,) = [one for one in scene.bands if one.name == "Closest pair"]
    assert band.values.min() == pytest.approx(2.4, abs=1e-3)
    assert np.all(band.limits == 3.0)


def test_findings_of_all_three_answers_can_be_pointed_at(strict):
    findings = {one.code: one for one in foreign_scene(judged(strict)).findings}
    apart = findings["VRF504"]
    assert (apart.severity, apart.drones) == ("error", (0, 1))
    assert apart.time == pytest.approx(MET, abs=1e-2)
    assert findings["VRF503"].severity == "warning"
    assert findings["VRF506"].severity == "ok"
    groups = list(dict.fromkeys(one.group for one in findings.values()))
    assert groups == [
        "what the file says",
        "whether it can be flown",
        "what the firmware makes of it",
    ]


def test_chapters_are_the_holds_and_what_leads_to_them(silent):
    chapters = foreign_scene(judged(silent)).chapters
    assert [(one.kind, one.start, one.duration) for one in chapters] == [
        ("hold", 0.0, 4.0),
        ("launch", 4.0, 6.0),
        ("hold", 10.0, 3.0),
        ("transition", 13.0, 4.0),
        ("hold", 17.0, 3.0),
        ("land", 20.0, 6.0),
    ]
    assert [one.picture for one in chapters if one.picture] == ["hold-1", "hold-2"]


def test_what_a_file_does_not_say_is_not_drawn_but_named(silent):
    scene = foreign_scene(judged(silent))
    assert scene.unknown == (
        "place and north",
        "fence",
        "least separation",
        "ceiling",
        "limits of speed",
        "lights",
    )
    header = scene.header()
    assert header["fence"] == []
    assert header["ceiling"] is header["heading"] is header["separation"] is None
    text = render_foreign_report(judged(silent), {"swap.skyc": "ab" * 32})
    assert "Not known: place and north, fence" in text
    assert "no ceiling is known" in text and "ab" * 32 in text
    assert "no limit is known" in text


def test_verdict_says_which_limits_are_not_known(silent):
    verdict = judge(read_show(silent), Questions()).verdict
    assert "no limit known for separation of all pairs" in verdict


def test_a_browser_shows_rings_marks_and_what_is_unknown(strict, tab, tmp_path):
    page = tmp_path / "swap.html"
    assert CliRunner().invoke(view, [str(strict)], standalone_mode=False).exit_code == 0
    tab.open(page, f"t={MET}&play=0&drone=1")
    assert tab.evaluate("document.querySelectorAll('#finding-rings circle').length") > 1
    assert tab.evaluate("document.querySelector('#desk').hidden") is False
    said = tab.evaluate("document.querySelector('#desk').textContent")
    assert "Not known: place and north, fence" in said and "2.4 m, limit 3" in said
    # Names are text, whatever they hold.
    assert tab.evaluate("document.querySelector('#panel-title').textContent") == (
        "<b>left</b>"
    )
    assert tab.evaluate("document.querySelector('#north').hidden") is True
    error = "[...show.findings].findIndex((one) => one.code === 'VRF504')"
    tab.evaluate("seek(0)")
    tab.evaluate(f"document.querySelectorAll('#findings button')[{error}].click()")
    assert tab.evaluate("player.time") == pytest.approx(MET, abs=1e-2)
    assert tab.errors == []


def test_report_ends_as_verify_does(silent, tmp_path):
    run = CliRunner().invoke(
        report, [str(silent), "-o", str(tmp_path / "a.html")], standalone_mode=False
    )
    assert bool(run.return_value) != judge(read_show(silent), Questions()).passed
    asked = [str(silent), "--separation", "9", "-o", str(tmp_path / "b.html")]
    run = CliRunner().invoke(report, asked, standalone_mode=False)
    assert run.return_value == 1 and "VRF504" in run.output
    assert "limit 9" in run.output


def test_options_of_our_own_logs_are_refused(silent):
    for command, option in (
        (view, "--music"),
        (view, "--no-verify"),
        (report, "--leg=1"),
    ):
        run = CliRunner().invoke(command, [str(silent), option], standalone_mode=False)
        assert isinstance(run.exception, UsageError)


def test_what_cannot_be_read_is_not_drawn(tmp_path):
    path = tmp_path / "bad.skyc"
    path.write_bytes(b"no archive")
    run = CliRunner().invoke(view, [str(path)], standalone_mode=False)
    assert isinstance(run.exception, DamagedFileError)
    assert not (tmp_path / "bad.html").exists()
