"""A solution leaves the library as arrays, as a table and as a drawing."""

from __future__ import annotations

import csv
import sys
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from benchmarks.ocp_further import two_phase_waypoint
from benchmarks.ocp_problems import double_integrator

from showc import ocp


@pytest.fixture(scope="module")
def solution():
    return ocp.solve(two_phase_waypoint())


def test_arrays_are_the_polynomials_sampled(solution):
    arrays = solution.arrays(rows=11)
    assert list(arrays) == [part.name for part in solution.phases]
    for part in solution.phases:
        columns = arrays[part.name]
        assert columns["time"] == pytest.approx(np.linspace(part.start, part.end, 11))
        for name in part.state_names:
            wanted = part.state(name)(columns["time"])[:, 0]
            assert np.array_equal(columns[name], wanted)


def test_a_table_reads_back_to_the_last_bit(solution, tmp_path):
    solution.to_csv(tmp_path / "table.csv", rows=5)
    with (tmp_path / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 5 * len(solution.phases)
    arrays = solution.arrays(rows=5)
    for number, row in enumerate(rows):
        columns = arrays[row["phase"]]
        for name, column in columns.items():
            assert float(row[name]) == column[number % 5]


def test_a_data_frame_needs_pandas_and_says_so(solution, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        solution.to_frame()


def test_a_drawing_has_a_panel_for_each_quantity_and_jumps_as_jumps(tmp_path):
    solution = ocp.solve(double_integrator())
    drawing = solution.plot()
    drawing.save(tmp_path / "plot.svg")
    with pytest.raises(ocp.StatementError, match=r"'plot\.png' is no name of an SVG"):
        drawing.save(tmp_path / "plot.png")
    root = ET.parse(tmp_path / "plot.svg").getroot()  # noqa: S314 - our own
    space = "{http://www.w3.org/2000/svg}"
    curves = root.findall(f"{space}polyline")
    names = [curve.find(f"{space}title").text for curve in curves]
    assert names == ["x", "v", "u"]
    pairs = [point.split(",") for point in curves[2].get("points").split()]
    places = np.array(pairs, dtype=float)
    jump = np.argmax(np.abs(np.diff(places[:, 1])))
    assert np.abs(np.diff(places[:, 0]))[jump] < 0.05
    assert np.abs(np.diff(places[:, 1]))[jump] > 100.0
    assert solution.plot("v").svg.count("<polyline") == 1
