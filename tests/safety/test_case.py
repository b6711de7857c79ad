"""The case of a compiled show: regions hold, findings are found, files are written."""

import json
from dataclasses import replace
from math import radians
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from safety.falls import landings

from showc.log.reader import read_log
from showc.safety import codes, ground
from showc.safety.assessment import safety_case, show_of
from showc.safety.fall import Fall
from showc.safety.ground import (
    Footing,
    area,
    corners_of,
    hull,
    least,
    outside,
)
from showc.safety.landing import FallTable
from showc.safety.pieces import flight_pieces, flown_legs
from showc.script.show import Audience, Building, Risk
from showc.vehicle.power import SEA_LEVEL, air_density
from showc.view import render_report

RISK = Risk(wind=8.0, gnss_error=0.1, position_error=0.2, map_error=0.0)


@pytest.fixture(scope="module")
def logged(compiled):
    return read_log(compiled("swap"))


@pytest.fixture(scope="module")
def show(logged):
    found = show_of(logged)
    return replace(found, site=replace(found.site, risk=RISK))


def around(show, **changes):
    return replace(show, site=replace(show.site, **changes))


def line(*points):
    return Audience("crowd", np.array(points, dtype=float), area=False)


def sampled_states(logged, count, rng):
    times = rng.uniform(0.0, logged.duration, count)
    states = []
    for drone in range(logged.drones):
        mine = times[drone :: logged.drones]
        states.append(logged.trajectory(drone).state(mine))
    return np.concatenate(states)


@pytest.mark.slow
def test_a_million_falls_stay_in_the_footprint_which_is_close(logged, show):
    case = safety_case(logged, show)
    rng = np.random.default_rng(1)
    angle = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    farthest = np.full(90, -np.inf)
    for _ in range(10):
        states = sampled_states(logged, 100_000, rng)
        count = len(states)
        bearing = rng.uniform(0.0, 2.0 * np.pi, count)
        wind = 8.0 * np.column_stack([np.cos(bearing), np.sin(bearing)])
        air = rng.choice([air_density(show.site.altitude) / SEA_LEVEL, 1.0], count)
        drag = air * rng.choice(show.body.drag_area, count)
        high = np.maximum(states[:, 2], 0.0)
        hits = states[:, :2] + landings(states[:, 3:6], high, wind, drag, 0.04)
        farthest = np.maximum(farthest, (hits @ outward.T).max(axis=0))
    # A drone's own size is around the point that falls.
    farthest += 0.5 * show.body.size
    reach = (case.footprint @ outward.T).max(axis=0)
    assert (farthest <= reach).all()
    assert (reach <= 1.05 * farthest).all()
    assert area(case.footprint) <= 1.05 * area(corners_of(outward, farthest))


@pytest.mark.parametrize("size", [(20.0, 7.0), (5.0, 0.0), (0.0, 0.0)])
def test_the_polygon_of_loose_bounds_is_convex_and_holds_what_they_hold(size):
    rng = np.random.default_rng(3)
    angle = np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = 40.0 + rng.uniform(-1.0, 1.0, (50, 2)) * size
    bound = (points @ outward.T).max(axis=0) + rng.uniform(0.0, 0.05, 360)
    corners = corners_of(outward, bound)
    way = np.roll(corners, -1, axis=0) - corners
    next_way = np.roll(way, -1, axis=0)
    turn = way[:, 0] * next_way[:, 1] - way[:, 1] * next_way[:, 0]
    assert (turn >= -1e-6).all()
    reach = (corners @ outward.T).max(axis=0)
    assert (reach <= bound + 1e-6).all()
    assert (reach >= (points @ outward.T).max(axis=0) - 1e-6).all()


def test_the_flight_is_inside_its_geography(logged, show):
    case = safety_case(logged, show)
    places = sampled_states(logged, 4000, np.random.default_rng(2))[:, :2]
    angle = np.linspace(0.0, 6.0, 50)
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    room = (case.geography @ outward.T).max(axis=0) - (places @ outward.T).max(axis=0)
    assert room.min() >= -1e-9
    assert room.max() < 0.2
    assert area(case.geography) > 0.0


def test_a_footprint_in_strong_wind_is_found_with_few_looks(logged, monkeypatch):
    pieces = flight_pieces(flown_legs(logged))
    fall = Fall(0.625, (0.03, 0.03), 20.0)
    table = FallTable.covering(fall, (-3.0, 3.0), 7.0, 15.0)
    looks, reach = [], FallTable.reach

    def counted(self, courses):
        looks.append(len(courses))
        return reach(self, courses)

    monkeypatch.setattr(FallTable, "reach", counted)
    hull(pieces, Footing(table))
    assert sum(looks) < 150_000


def test_pieces_that_are_passed_over_quickly_change_no_bound(logged, monkeypatch):
    pieces = flight_pieces(flown_legs(logged))
    table = FallTable.covering(Fall(0.625, (0.02, 0.04), 8.0), (-3.0, 3.0), 7.0, 15.0)
    footing = Footing(table, 0.2)
    quick = hull(pieces, footing)
    seen, wide = [], ground.least

    def slow(*arguments, steady):
        seen.append(steady)
        return wide(*arguments, steady=False)

    monkeypatch.setattr(ground, "least", slow)
    assert (hull(pieces, footing) == quick).all()
    assert seen == [True]


def test_an_audience_below_is_found_with_drone_second_and_metres(logged, show):
    people = around(show, audience=(line((-5.0, 0.0), (5.0, 0.0)),))
    case = safety_case(logged, people)
    found = next(item for item in case.errors if item.code == "SAF111")
    assert found.place is not None
    assert 0.0 <= found.place.time <= logged.duration
    assert found.missing > RISK.misplaced
    assert "is missing" in found.message


@pytest.mark.parametrize(
    ("people", "met"),
    [
        (line((0.0, 70.0), (5.0, 70.0)), True),
        (line((-500.0, 70.0), (500.0, 70.0)), True),
        (line((0.0, 500.0), (5.0, 500.0)), False),
        # All around the fence, and over the whole of it.
        (
            Audience(
                "crowd",
                500.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]),
                area=True,
            ),
            True,
        ),
    ],
)
def test_people_within_the_fence_are_found(logged, show, people, met):
    fence = np.array([[-90.0, -90.0], [90.0, -90.0], [90.0, 90.0], [-90.0, 90.0]])
    case = safety_case(logged, around(show, audience=(people,), fence=fence))
    assert ("SAF115" in {one.code for one in case.findings}) == met


def test_an_audience_far_away_is_clear_and_its_distance_holds(logged, show):
    far = around(show, audience=(line((-60.0, -150.0), (60.0, -150.0)),), ceiling=300.0)
    case = safety_case(logged, far)
    assert not case.errors
    left = next(one for one in case.distances if one.name == "falls to crowd").left
    # The footprint's hull says the same to what both leave open.
    assert left == pytest.approx(150.0 + case.footprint[:, 1].min(), abs=0.5)


def test_seven_degrees_bring_a_wide_show_nearer_to_the_audience(logged, show):
    people = around(show, audience=(line((-60.0, -60.0), (60.0, -60.0)),))
    turned = around(people, risk=replace(RISK, rotation=radians(7.0), shift=0.0))
    straight = around(people, risk=replace(RISK, rotation=0.0, shift=0.0))

    def left(case):
        return next(one.left for one in case.distances if "turned" in one.name)

    lost = left(safety_case(logged, straight)) - left(safety_case(logged, turned))
    corners = safety_case(logged, straight).footprint
    most = 2.0 * np.linalg.norm(corners, axis=1).max() * np.sin(radians(3.5))
    assert 0.0 < lost <= most


def test_a_low_ceiling_and_a_near_building_are_found(logged, show):
    top = float(logged.positions[..., 2].max())
    corner = np.array([[8.0, 8.0], [30.0, 8.0], [30.0, 30.0], [8.0, 30.0]])
    near = around(show, ceiling=top + 0.5, buildings=(Building("hall", corner, 40.0),))
    found = {item.code for item in safety_case(logged, near).errors}
    assert {"SAF102", "SAF121"} <= found


def test_thin_air_carries_falls_farther_and_leaves_rotors_less(logged, show):
    calm = around(show, risk=replace(RISK, wind=0.0))
    low, high = (
        safety_case(logged, around(calm, altitude=altitude)) for altitude in (0.0, 4e3)
    )
    assert area(high.footprint) > area(low.footprint)
    assert {item.code for item in low.findings} >= {"SAF202"}
    assert "SAF133" not in {item.code for item in low.findings}
    thin = next(item for item in high.findings if item.code == "SAF133")
    assert "67 % as dense" in thin.message
    assert thin.place is not None
    assert thin.missing > 0.1


def test_the_formula_that_is_asked_for_is_judged(logged, show):
    people = around(
        show,
        audience=(line((-60.0, -60.0), (60.0, -60.0)),),
        risk=replace(RISK, method="one-to-one"),
    )
    assert "SAF112" in {item.code for item in safety_case(logged, people).errors}


def test_a_report_is_no_greener_than_its_safety_case(logged, show):
    people = around(show, audience=(line((-9.0, -9.0), (9.0, -9.0)),))
    page = render_report(logged, None, safety_case(logged, people))
    assert page.index("SAFETY OF THE SITE: NOT MET") < page.index("<h2>Site")


def test_wind_that_leans_a_standing_drone_too_far_is_found(logged, show):
    for wind, found in ((8.0, False), (20.0, True)):
        case = safety_case(logged, around(show, risk=replace(RISK, wind=wind)))
        assert ("SAF203" in {item.code for item in case.findings}) == found
        # Drag of 0.5 rho A w² against the weight.
        area = show.body.drag_area[1]
        drag = 0.5 * SEA_LEVEL * area * wind**2
        lean = np.arctan(drag / show.vehicle.mass / show.vehicle.gravity)
        assert case.leans[0] == pytest.approx(lean)
        assert case.leans[1] > lean


def test_cutting_pieces_changes_no_bound_but_for_the_better(logged):
    pieces = flight_pieces(flown_legs(logged))
    away = outside(np.array([[20.0, -50.0], [30.0, -50.0], [30.0, 50.0]]))
    coarse = least(pieces, Footing(), away).bound
    fine = least(pieces.parts(4), Footing(), away).bound
    assert coarse == pytest.approx(fine, abs=0.06)
    assert area(hull(pieces.parts(3), Footing())) == pytest.approx(
        area(hull(pieces, Footing())), rel=0.02
    )


def test_the_command_writes_page_and_map_with_a_folder_a_volume(
    compiled, run_showc, tmp_path
):
    log, page = compiled("swap"), tmp_path / "case.html"
    run = run_showc("safety", log, "-o", page, "--wind", "5", "--json")
    said = json.loads(run.out)
    assert run.code == int(any(one["severity"] == "error" for one in said["findings"]))
    written = page.read_text(encoding="utf-8")
    assert "Impact footprint" in written
    # Units of plots, and whose flights are judged.
    assert " s</text>" in written
    assert "but their falls are not computed" in written
    tree = ET.parse(page.with_suffix(".kml"))  # noqa: S314 - our own file
    space = "{http://www.opengis.net/kml/2.2}"
    names = {folder.findtext(f"{space}name") for folder in tree.iter(f"{space}Folder")}
    assert {volume["name"] for volume in said["volumes"]} <= names
    falls = said["failures"]["falls"]
    assert falls
    logged = read_log(log)
    case = safety_case(logged, around(show_of(logged), risk=replace(RISK, wind=5.0)))
    met = case.failures.meetings()
    assert [(one["drone"] - 1, one["may_meet"]) for one in falls] == [
        (drone, [other + 1 for other in others]) for (_, drone), others in met
    ]


def test_explain_knows_every_code(run_showc):
    listed = run_showc("explain").out
    assert all(code in listed for code in codes.codes())
    assert "metres" in run_showc("explain", "SAF111").out
