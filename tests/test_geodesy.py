"""Show frame, globe and the mission's grid of numbers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from showc.geodesy import (
    SiteFrame,
    autopilot_displacement,
    stored_height,
)

MUNICH = SiteFrame(48.1374, 11.5755, 520.0, 0.0)


def earth_centred(latitude, longitude, height):
    """WGS 84 by the textbook, without the library under test."""
    a, f = 6378137.0, 1.0 / 298.257223563
    e2 = f * (2.0 - f)
    phi, lam = np.radians(latitude), np.radians(longitude)
    n = a / np.sqrt(1.0 - e2 * np.sin(phi) ** 2)
    return np.array(
        [
            (n + height) * np.cos(phi) * np.cos(lam),
            (n + height) * np.cos(phi) * np.sin(lam),
            (n * (1.0 - e2) + height) * np.sin(phi),
        ]
    )


@pytest.mark.parametrize(
    ("heading", "point", "enu"),
    [
        (0.0, (0, 1, 0), (0, 1, 0)),
        (0.0, (1, 0, 0), (1, 0, 0)),
        (90.0, (0, 1, 0), (1, 0, 0)),
        (90.0, (1, 0, 0), (0, -1, 0)),
        (30.0, (0, 2, 5), (1.0, 3.0**0.5, 5)),
    ],
)
def test_heading_turns_the_show_clockwise_from_north(heading, point, enu):
    frame = SiteFrame(10.0, 20.0, 0.0, heading)
    np.testing.assert_allclose(frame.to_enu(np.array(point)), enu, atol=1e-12)


@given(
    st.floats(-80, 80), st.floats(-180, 180), st.floats(-100, 5000), st.floats(0, 360)
)
def test_a_place_is_where_the_tangent_plane_says(latitude, longitude, altitude, turn):
    frame = SiteFrame(latitude, longitude, altitude, turn)
    point = np.array([310.0, -220.0, 90.0])
    there = earth_centred(*frame.to_geodetic(point))
    origin = earth_centred(latitude, longitude, altitude)
    phi, lam = np.radians(latitude), np.radians(longitude)
    axes = np.array(
        [
            [-np.sin(lam), np.cos(lam), 0.0],
            [-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)],
            [np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)],
        ]
    )
    np.testing.assert_allclose(axes @ (there - origin), frame.to_enu(point), atol=1e-6)
    np.testing.assert_allclose(
        frame.from_geodetic(frame.to_geodetic(point)), point, atol=1e-6
    )


@given(st.lists(st.tuples(*[st.floats(-400, 400)] * 3), min_size=1, max_size=20))
def test_rounding_moves_a_place_by_less_than_a_centimetre(points):
    points = np.array(points)
    home = np.full(len(points), 520.0)
    stored = MUNICH.round_points(points, home)
    moved = np.linalg.norm(MUNICH.place(stored, home) - points, axis=1)
    assert moved.max() < 0.0094


def test_the_autopilot_stores_the_centimetre_that_was_meant():
    # ArduPilot: float32 metres times 100, truncated.
    wanted = range(-3000, 12001)
    metres = np.array([stored_height(height) for height in wanted], dtype=np.float32)
    stored = np.trunc(metres * np.float32(100.0)).astype(int)
    assert stored.tolist() == list(wanted)


def test_leg_lengths_are_in_the_autopilots_flat_earth():
    home = np.zeros(2)
    stored = MUNICH.round_points(np.array([[0.0, 0, 0], [300.0, 400.0, 10.0]]), home)
    start = type(stored)(stored.latitude[:1], stored.longitude[:1], stored.height[:1])
    goal = type(stored)(stored.latitude[1:], stored.longitude[1:], stored.height[1:])
    north, east, up = autopilot_displacement(start, goal, MUNICH.latitude)[0]
    # At 48 degrees a WGS 84 degree is 111.2 km north and 74.4 km (74.3) east.
    assert 400.0 < north < 400.8
    assert 299.0 < east < 300.0
    assert up == pytest.approx(10.0, abs=0.05)
