"""The report and the leg's drawing: numbers, margins, hashes, odd shows."""

from __future__ import annotations

import json
import re
from html import unescape

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from synthetic import gliding_flight, vertical_flight

from showc.errors import UsageError
from showc.log.reader import read_log
from showc.view import render_leg, render_page, render_report
from showc.view.course import course_of
from showc.view.digest import digest
from showc.view.plot import ticks


def words(page: str) -> str:
    """The page's text without its tags."""
    body = page.split("</style>", 1)[1]
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", body)))


def test_moves_have_their_numbers(gliding_log):
    text = words(render_report(gliding_log, None))
    digests = digest(gliding_log)
    for one in digests:
        assert f"{one.segment.duration:.3f}" in text
        if one.moving:
            assert f"{one.speed:.2f}" in text
            assert f"{np.degrees(one.tilt):.1f}" in text
            assert f"{one.closest.distance:.2f}" in text
    assert "NOT VERIFIED" in text and "3.1 %" in text


def test_digest_agrees_with_the_polynomials(gliding_log):
    one = digest(gliding_log)[4]
    segment = one.segment
    times = np.linspace(0.0, segment.duration, 400)
    states = np.stack([part.state(times) for part in segment.trajectories])
    thrust = np.stack([part.control(times)[:, 0] for part in segment.trajectories])
    speed = np.linalg.norm(states[..., 3:6], axis=-1).max()
    assert one.speed == pytest.approx(speed, abs=0.02)
    assert one.tilt == pytest.approx(np.abs(states[..., 6:8]).max(), abs=2e-3)
    assert one.thrust == pytest.approx((thrust.min(), thrust.max()), abs=0.02)


def test_verdicts_and_margins(vertical_log):
    check = {
        "code": "VRF312",
        "group": "limits",
        "name": "velocity within limits",
        "verdict": "pass",
        "value": 2.703,
        "limit": 3.0,
        "unit": "m/s",
        "where": {"drone": 2, "segment": "launch", "time": 2.08},
        "notes": ["margin <b>3.7 %</b>"],
    }
    result = {
        "proved": True,
        "passed": True,
        "verdict": "PROVED: trajectories proved; missions none.",
        "anchor": "script “a”",
        "checks": [check],
    }
    page = render_report(vertical_log, result)
    text = words(page)
    assert "PROVED trajectories proved; missions none." in text
    assert "2.703 m/s 3 m/s drone 2, launch, 0:02.1" in text
    assert "&lt;b&gt;3.7" in page
    assert 'class="verdict pass"' in page


@pytest.mark.parametrize(
    ("proved", "passed", "kind"),
    [(True, True, "pass"), (False, True, "open"), (False, False, "fail")],
)
def test_the_badge_is_green_only_if_all_is_proved(vertical_log, proved, passed, kind):
    result = {
        "proved": proved,
        "passed": passed,
        "verdict": "x: why",
        "anchor": "",
        "checks": [],
    }
    page = render_report(vertical_log, result)
    assert f'class="verdict {kind}"' in page
    assert ('class="verdict pass"' in page) == proved


def test_real_verification_is_understood(vertical_log, tmp_path):
    from showc.log.writer import write_log
    from showc.verify import verify_log

    path = tmp_path / "show.mcap"
    write_log(vertical_flight(4), path, manifest=b"{}")
    verification = verify_log(path, missions=False)
    text = words(render_report(vertical_log, verification.to_json()))
    for check in verification.checks:
        assert re.sub(r"\s+", " ", check.name).replace("->", "→") in text
    assert str(tmp_path) not in text


def test_missions_prediction_is_a_section_of_its_own(make_logged):
    from showc.mission import mission_files

    flight = vertical_flight(4)
    missions = mission_files(flight)
    manifest = {
        "fleet": missions.fleet_token,
        "missions": {
            "prediction": missions.prediction,
            "warnings": list(missions.warnings),
            "files": dict.fromkeys(missions.files, "0" * 64),
        },
        "versions": {"showc": "0"},
    }
    logged = make_logged(flight, json.dumps(manifest).encode())
    text = words(render_report(logged, None))
    assert "prediction for" in text and missions.fleet_token in text
    for leg in missions.prediction["legs"]:
        assert f"{leg['duration']:.2f}" in text
    for warning in missions.warnings:
        assert warning in text
    assert "missions/drone_0004.waypoints" in text


@pytest.mark.parametrize("manifest", [b"{}", b"[]", b"no json", b'{"missions": 3}'])
def test_any_manifest_gives_a_report(make_logged, manifest):
    logged = make_logged(vertical_flight(2), manifest)
    assert "Files" in words(render_report(logged, None))


def test_one_drone_alone(make_logged):
    logged = make_logged(gliding_flight(1, moves=1))
    assert "– smallest separation" in words(render_report(logged, None))
    assert "Nearest" not in render_leg(logged, 2, 0).split("</style>")[1]
    assert '"encounters":[]' in render_page(logged)


def test_same_log_gives_the_same_pages(gliding_log):
    assert render_report(gliding_log, None) == render_report(gliding_log, None)
    assert render_leg(gliding_log, 2, 3) == render_leg(gliding_log, 2, 3)


def test_leg_says_how_its_mesh_was_made(gliding_log):
    course = course_of(gliding_log, 4, 0)
    widths = np.diff(course.breaks)
    text = words(render_leg(gliding_log, 4, 0))
    if widths.size == 1:
        assert "a hover is exact" in text
    else:
        assert f"{widths.size} intervals, from {1e3 * widths.min():.0f} ms" in text
        assert "no mesh was sought" in text


def test_leg_draws_the_meshes_it_took_and_says_why(compiled):
    logged = read_log(compiled("swap"))
    taken = logged.segments[2].trajectory(0).meshes
    assert len(taken) >= 1
    assert len(taken[-1].points) == len(taken[-1].breaks) - 1
    np.testing.assert_allclose(taken[-1].breaks, course_of(logged, 2, 0).breaks)
    page = render_leg(logged, 2, 0)
    for mesh in taken:
        assert mesh.why in words(page) and mesh.found in words(page)
    bars = re.findall(r"<title>[^<]*points", page)
    assert len(bars) == sum(len(mesh.points) for mesh in taken)


def test_leg_wants_a_leg_and_a_drone_of_it(gliding_log):
    with pytest.raises(UsageError, match="no leg 99; the log has legs 0 to 10"):
        render_leg(gliding_log, 99, 0)
    with pytest.raises(UsageError, match="drone 17 takes no part"):
        render_leg(gliding_log, 2, 16)


def test_defect_tells_exact_flights_from_fitted_ones(vertical_log, gliding_log):
    assert course_of(vertical_log, 2, 1).defects().max() < 1e-12
    fitted = course_of(gliding_log, 2, 1)
    assert 1e-9 < fitted.defects().max() < 1e-2
    assert np.all(fitted.curvature_ratios() >= 1.0)


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ticks_are_even_and_inside(low, span):
    high = low + span
    assume(span > 1e-9 * abs(low))
    found = ticks(low, high, count=4)
    assert 2 <= len(found) <= 7
    steps = np.diff(found)
    assert np.allclose(steps, steps[0], rtol=1e-3)
    assert low - 1e-6 * span <= found[0] and found[-1] <= high + 1e-6 * span


def test_every_formation_that_is_held_is_drawn_once(gliding_log):
    page = render_report(gliding_log, None)
    section = page[page.index("<h2>Pictures") : page.index("<h2>Moves")]
    held = {
        one.message.to_formation
        for one in gliding_log.segments
        if one.kind == "hold" and not one.message.to_formation.startswith("above ")
    }
    assert held
    assert section.count("<figure>") == len(held)
    assert section.count("<circle") == 16 * len(held)
    assert all(name in section for name in held)


def test_hashes_come_after_the_signature(gliding_log):
    page = render_report(gliding_log, None)
    assert page.index('class="sign"') < page.index("<h2>Files")


def test_speeds_beside_a_limit_along_an_axis_say_which_they_are(gliding_log):
    page = render_report(gliding_log, None)
    samples = gliding_log.samples
    most = max(np.abs(samples[name]).max() for name in ("vx", "vy", "vz"))
    assert f"{most:.2f} m/s along an axis" in page
    assert "The limit holds along each axis" in page
