"""The page of a great fleet: small enough, and as quickly drawn as that of a few."""

from __future__ import annotations

import json
import re

import pytest
from synthetic import gliding_flight

from showc.view import render_page


@pytest.fixture(scope="module")
def big_page(make_logged):
    """A thousand drones for five minutes."""
    return render_page(make_logged(gliding_flight(1000, moves=6, hold=3.0)))


@pytest.mark.slow
def test_five_minutes_of_a_thousand_drones_stay_under_15_megabytes(big_page):
    found = re.search(r'<script id="header"[^>]*>(.*?)</script>', big_page, re.DOTALL)
    header = json.loads(found.group(1))
    assert header["duration"] > 300.0
    assert header["drones"] == 1000
    assert len(big_page) < 15e6


CALLS = """(() => {
  const gl = stage.gl, counts = {draws: 0, uploads: 0, others: 0};
  for (const name in gl) {
    if (typeof gl[name] !== "function") continue;
    const inner = gl[name].bind(gl);
    const kind = name.startsWith("draw") ? "draws"
      : /^(buffer|tex)(Sub)?(Data|Image)/.test(name) ? "uploads" : "others";
    gl[name] = (...given) => { counts[kind] += 1; return inner(...given); };
  }
  stage.draw(20.03);
  return counts;
})()"""
"""Calls of the graphics interface that one frame makes."""


@pytest.mark.slow
def test_a_frame_of_a_thousand_drones_makes_no_more_calls_than_one_of_sixteen(
    tab, tmp_path, big_page, gliding_log
):
    page, path = tmp_path / "show.html", tmp_path / "big.html"
    page.write_text(render_page(gliding_log), "utf-8")
    path.write_text(big_page, "utf-8")
    tab.open(page, "t=20&play=0")
    few = tab.evaluate(CALLS)
    tab.open(path, "t=20&play=0")
    many = tab.evaluate(CALLS)
    assert few["draws"] > 0
    assert all(many[kind] <= few[kind] for kind in few)
