"""The formulas of the LBA's guide, against its worked figures."""

from math import radians

import pytest

from showc.safety.volumes import Flying, buffers
from showc.script.show import Risk


@pytest.mark.parametrize(
    ("speed", "width", "height", "one_to_one", "ballistic"),
    [
        (5.0, 13.27, 65.77, 66.0, 18.6),
        (8.0, 18.26, 69.86, 70.1, 30.4),
        (10.0, 22.10, 73.10, 73.3, 38.9),
    ],
)
def test_worked_figures(speed, width, height, one_to_one, ballistic):
    flying = Flying(speed, 60.0, 0.5, radians(45.0), 9.81)
    found = buffers(flying, Risk())
    assert found.contingency == pytest.approx(width, abs=0.01)
    assert found.height == pytest.approx(height, abs=0.01)
    assert found.one_to_one == pytest.approx(one_to_one, abs=0.06)
    assert found.ballistic == pytest.approx(ballistic, abs=0.06)


@pytest.mark.parametrize(("speed", "way"), [(5.0, 3.50), (8.0, 8.96), (10.0, 14.00)])
def test_a_gentle_tilt_needs_a_longer_way(speed, way):
    flying = Flying(speed, 60.0, 0.5, radians(20.0), 9.81)
    assert buffers(flying, Risk()).manoeuvre == pytest.approx(way, abs=0.01)
