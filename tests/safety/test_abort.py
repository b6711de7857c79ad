"""Every moment of a show has a way to the ground, planned and proved."""

import json
from dataclasses import replace

import numpy as np
import pytest

from showc.abort import abort_table
from showc.fleet import solve_itinerary
from showc.fleet.options import SolveOptions
from showc.fleet.proof import flaw
from showc.log.reader import read_log
from showc.progress import Silent
from showc.safety.assessment import show_of
from showc.script.show import Building
from showc.vehicle import Separation


@pytest.fixture(scope="module")
def logged(compiled):
    return read_log(compiled("swap"))


@pytest.fixture(scope="module")
def options(tmp_path_factory):
    return SolveOptions(jobs=1, cache=tmp_path_factory.mktemp("aborts"))


def planned(logged, options, monkeypatch, step=9.0, **changes):
    """The table, and every flight that was planned for it with the show."""
    show = show_of(logged)
    show = replace(show, **changes)
    flown = []

    def watched(itinerary, given, progress):
        solved = solve_itinerary(itinerary, given, progress)
        flown.extend(solved.legs)
        return solved

    monkeypatch.setattr("showc.abort.solve_itinerary", watched)
    table = abort_table(logged, show, step, options, Silent())
    return table, flown, show


def test_drones_that_stand_apart_go_down_in_place(logged, options, monkeypatch):
    table, flown, show = planned(logged, options, monkeypatch)
    assert len(table.rows) == int(np.ceil(logged.duration / 9.0))
    assert {row.way for row in table.rows} <= {"down in place", "on the ground"}
    for flight in flown:
        assert flaw(flight, show) == ""
        assert (flight.leg.goal[:, :2] == flight.leg.start[:, :2]).all()
        rows = rows_from(flight.leg.start, table, logged)
        assert rows
        assert all(flight.duration == pytest.approx(row.duration) for row in rows)


def test_drones_apart_along_an_axis_go_down_in_place(logged, options, monkeypatch):
    apart = Separation(1.5, "any-axis")
    table, _, _ = planned(logged, options, monkeypatch, step=14.0, separation=apart)
    assert {row.way for row in table.rows} <= {"down in place", "on the ground"}


def rows_from(places, table, logged):
    states = [logged.trajectory(k).state for k in range(logged.drones)]
    stood = [np.array([state(row.rest)[:3] for state in states]) for row in table.rows]
    return [
        row
        for row, there in zip(table.rows, stood, strict=True)
        if there == pytest.approx(places)
    ]


def test_a_fleet_that_holds_is_planned_for_once(logged, options, monkeypatch):
    table, flown, _ = planned(logged, options, monkeypatch, step=1.0)
    starts = [tuple(np.round(flight.leg.start.ravel(), 9)) for flight in flown]
    assert len(set(starts)) == len(starts) < len(table.rows)
    assert sum(len(rows_from(one.leg.start, table, logged)) for one in flown) == len(
        [row for row in table.rows if row.way != "on the ground"]
    )


def test_over_a_building_the_fleet_goes_home(logged, options, monkeypatch):
    corners = np.array([[-30.0, -30.0], [30.0, -30.0], [30.0, 30.0], [-30.0, 30.0]])
    site = replace(show_of(logged).site, buildings=(Building("hall", corners, 1.0),))
    table, flown, show = planned(logged, options, monkeypatch, step=14.0, site=site)
    rows = [row for row in table.rows if row.way != "on the ground"]
    assert {row.way for row in rows} == {"home"}
    pads = show.formations[show.pads].points[: show.drones]
    for flight in flown:
        assert flaw(flight, show) == ""
        if flight.leg.kind == "land":
            ends = sorted(map(tuple, np.round(flight.leg.goal, 6).tolist()))
            assert ends == sorted(map(tuple, np.round(pads, 6).tolist()))
    assert min(row.closest for row in rows) >= show.separation.distance - 1e-6


def test_where_no_way_is_found_the_plan_is_flown_back(logged, options, monkeypatch):
    # Pads nearer than the separation: no way home can end there, nor one down.
    apart = Separation(500.0)
    table, _, show = planned(logged, options, monkeypatch, step=14.0, separation=apart)
    rows = [row for row in table.rows if row.way != "on the ground"]
    assert {row.way for row in rows} == {"back along the plan"}
    assert all(row.duration > 0.0 for row in rows)
    assert show.separation.distance == 500.0


def test_the_table_is_in_the_log_beside_it_and_on_the_page(
    compiled, run_showc, tmp_path
):
    log = tmp_path / "swap.mcap"
    log.write_bytes(compiled("swap").read_bytes())
    run = run_showc("abort", log, "--every", "15", "-q", cwd=tmp_path)
    assert run.code == 0, run.err
    once = log.read_bytes()
    table = tmp_path / "swap-abort.json"
    rows = json.loads(table.read_text(encoding="utf-8"))["rows"]
    said = [line for line in run.out.splitlines() if line.startswith("at ")]
    assert len(rows) == len(said)
    logged = read_log(log)
    assert [row.time for row in logged.aborts.rows] == [row["time"] for row in rows]
    # What lies beside the log is for people; the page takes it from the log.
    table.unlink()
    page = tmp_path / "case.html"
    run_showc("safety", log, "-o", page)
    content = page.read_text(encoding="utf-8")
    assert "Abort table" in content
    assert all(f"{row['total']:.1f}" in content for row in rows)
    assert all(f">{row['stop']:.2f}<" in content for row in rows)
    assert run_showc("abort", log, "--every", "15", "-q").code == 0
    assert log.read_bytes() == once


def test_the_message_has_every_row_and_every_flight(logged, options, monkeypatch):
    table, flown, _ = planned(logged, options, monkeypatch)
    message = table.to_message("0" * 64)
    assert len(message.rows) == len(table.rows)
    assert len(message.legs) == len(flown)
    assert len(message.flights) == len(flown) * logged.drones
    for row, one in zip(table.rows, message.rows, strict=True):
        assert len(one.changes) * message.period == pytest.approx(row.stop)
        assert [message.legs[k].name for k in one.legs] == [
            flight.leg.name for flight in row.legs
        ]
        # The clock slows from its whole rate to none.
        assert sum(one.changes) * message.period == pytest.approx(-1.0)


def test_over_pads_of_different_heights_drones_go_home(logged, options, monkeypatch):
    """The ground between them is not known, nor is one below the highest pad on it."""
    show = show_of(logged)
    pads = show.formations[show.pads]
    points = pads.points + np.array([0.0, 0.0, 0.5]) * (np.arange(6) == 0)[:, None]
    sloped = {**show.formations, show.pads: replace(pads, points=points)}
    table, _, _ = planned(logged, options, monkeypatch, formations=sloped)
    assert {row.way for row in table.rows[1:]} == {"home"}
