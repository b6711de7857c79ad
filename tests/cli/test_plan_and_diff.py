"""What a compile would solve is said beforehand; what differs, afterwards."""

import json

import pytest
from repository import ROOT

CHAPTERS = ROOT / "shows" / "chapters.yaml"


def plan(run_showc, script):
    run = run_showc("plan", script, "--json")
    assert run.code == 0, run.err
    return json.loads(run.out)


@pytest.mark.slow
def test_an_unchanged_show_solves_nothing_and_times_lie_within_the_bounds(
    run_showc, compiled
):
    manifest = compiled("chapters").with_suffix("") / "manifest.json"
    flown = json.loads(manifest.read_text())["segments"]
    outlook = plan(run_showc, CHAPTERS)
    assert outlook["pending"] == 0
    for leg, segment in zip(outlook["legs"], flown, strict=True):
        assert leg["name"] == segment["name"]
        assert leg["lower"] - 1e-9 <= segment["duration"]
    exit_code = run_showc("plan", CHAPTERS, "--detailed-exitcode").code
    assert exit_code == 0


@pytest.mark.slow
def test_one_changed_formation_solves_its_two_neighbours(run_showc, compiled, tmp_path):
    compiled("chapters")
    before = plan(run_showc, CHAPTERS)
    text = CHAPTERS.read_text()
    assert text.count("height: 18 m") == 1
    script = tmp_path / "chapters.yaml"
    script.write_text(text.replace("height: 18 m", "height: 17.5 m"))
    after = plan(run_showc, script)
    pending = [leg["name"] for leg in after["legs"] if leg["solve"]]
    assert before["pending"] == 0
    assert len(pending) == 2, pending
    assert run_showc("plan", script, "--detailed-exitcode").code == 3


@pytest.mark.slow
def test_diff_says_what_differs(run_showc, compiled):
    grid, swap = compiled("grid"), compiled("swap")
    same = run_showc("diff", grid, grid)
    assert (same.code, same.out) == (0, "both shows are the same\n")
    other = run_showc("diff", grid, swap, "--json")
    found = json.loads(other.out)
    assert other.code == 1 and found["same"] is False
    assert {"what": "name", "before": "Grid shift", "after": "Antipodal swap"} in found[
        "differences"
    ]


def test_a_drone_that_waits_where_a_group_flies_is_found_before_anything_is_solved(
    run_showc, tmp_path
):
    """Where it waits, the planner decides."""
    script = tmp_path / "waits.yaml"
    script.write_text(
        """\
showc: 1
drones: 4
groups: {left: 1-2}
formations:
  row: {type: line, length: 9, centre: [0, 0, 20]}
  beside: {type: line, count: 2, length: 6, centre: [-1.5, 0.9, 20]}
transitions: [row, {to: beside, group: left}]
"""
    )
    said = "waits there: move the formation away, or move it first"
    for command in ("plan", "compile"):
        run = run_showc(command, script)
        assert run.code == 1
        assert said in run.err
        assert "waits.yaml:7:25: row -> beside: drone" in run.err
        assert "solving" not in run.err


def test_diff_shows_numbers_without_the_noise_of_rounding():
    from showc.cli.diff import _shown

    assert _shown(0.21000000000000002) == 0.21
    assert [_shown(one) for one in (19.0, 3, None, "a")] == [19.0, 3, None, "a"]


def test_plan_refuses_an_order_that_all_axes_cannot_leave(run_showc, tmp_path):
    script = tmp_path / "order.yaml"
    script.write_text(
        """\
showc: 1
drones: 2
separation: {distance: 1, shape: all-axes}
pads: {type: points, points: [[-3, -3, 0], [3, 3, 2]]}
formations:
  a: {type: points, points: [[-3, -3, 10], [3, 3, 14]]}
  b: {type: points, points: [[3, 3, 14], [-3, -3, 10]]}
transitions:
  - {to: a, hold: 0}
  - {to: b, hold: 0, assignment: fixed}
"""
    )
    run = run_showc("plan", script)
    assert run.code == 1
    assert "stand in one order along x in 'a' and in the other in 'b'" in run.err
