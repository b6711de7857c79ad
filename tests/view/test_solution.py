"""A solution of the core on one page: curves, bounds, margins, meshes and reasons."""

from __future__ import annotations

import re
import sys
from html import unescape
from subprocess import run
from xml.etree import ElementTree as ET

import pytest
from benchmarks.ocp_further import rayleigh, two_phase_waypoint
from benchmarks.ocp_problems import goddard

from showc import ocp
from showc.view import render_solution


@pytest.fixture(scope="module")
def flown() -> ocp.Solution:
    return ocp.solve(goddard())


@pytest.fixture(scope="module")
def page(flown) -> str:
    return render_solution(goddard(), flown)


def words(page: str) -> str:
    body = page.split("</style>", 1)[1]
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", body)))


def drawings(page: str) -> list[ET.Element]:
    return [
        ET.fromstring(part)  # noqa: S314 - the page is our own
        for part in re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL)
    ]


def test_every_state_and_control_is_drawn_with_its_bounds(page):
    text = words(page)
    for name in ("State h", "State v", "State m", "Control T"):
        assert name in text
    assert "limit 0, 3.5" in text and "limit 0.6, 1" in text
    assert "Margins" in text


def test_the_figures_are_the_solution_s(page, flown):
    text = words(page)
    assert f"{flown.objective:.10g}" in text
    assert flown.message in text
    assert f"{flown.error.shooting:.1e} from start to end" in text


def test_each_mesh_is_a_band_and_each_interval_a_bar(page, flown):
    drawing = drawings(page)[-1]
    tag = "{http://www.w3.org/2000/svg}"
    labels = [e.text for e in drawing.iter(f"{tag}text")]
    for number, record in enumerate(flown.history, start=1):
        assert f"mesh {number}" in labels
        assert f"{record.intervals} intervals" in labels
    bars = [e for e in drawing.iter(f"{tag}rect") if e.find(f"{tag}title") is not None]
    assert len(bars) == sum(record.intervals for record in flown.history)
    colours = {bar.get("fill") for bar in bars}
    steps = {
        interval.decision.step
        for record in flown.history
        for interval in record.phases[0].intervals
    }
    assert len(colours) == len(steps) > 2


def test_why_each_interval_changed_can_be_read(page, flown):
    text = words(page)
    for record in flown.history:
        assert record.action in text
        for interval in record.phases[0].intervals:
            assert interval.decision.reason in text


def test_path_constraints_and_phases_are_drawn():
    problem = rayleigh()
    text = words(render_solution(problem, ocp.solve(problem)))
    assert "Path constraint mixed" in text and "'mixed' violated by" in text
    problem = two_phase_waypoint()
    text = words(render_solution(problem, ocp.solve(problem)))
    assert "Phase out" in text and "Phase back" in text


def test_a_solve_without_refinement_and_without_solution_is_drawn_too():
    built = ocp.Transcription(goddard(), ocp.Mesh.uniform(4, 3))
    text = words(render_solution(goddard(), built.solve()))
    assert "no refinement" in text
    problem = ocp.Problem("impossible <x>")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=5.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, u)
    problem.minimise(phase.integral(u**2))
    failed = ocp.solve(problem)
    page = render_solution(problem, failed)
    assert failed.message.split(".", maxsplit=1)[0] in words(page)
    assert "impossible &lt;x&gt;" in page
    for drawing in drawings(page):
        assert drawing.get("aria-label")


def test_the_view_alone_loads_no_core():
    code = "import sys, showc.view; sys.exit('casadi' in sys.modules)"
    assert run([sys.executable, "-c", code], check=False).returncode == 0
