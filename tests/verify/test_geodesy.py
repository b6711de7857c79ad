"""Geodesy of verify against the textbook; what missions say is elsewhere."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.log import showc_pb2 as pb
from showc.verify.missions.legs import to_show_frame


def earth_centred(latitude, longitude, height):
    """Hofmann-Wellenhof, Lichtenegger, Wasle 2008, GNSS, equation 8.5."""
    squared = 0.00669437999014  # eccentricity of WGS 84
    phi, lam = np.radians(latitude), np.radians(longitude)
    normal = 6378137.0 / np.sqrt(1.0 - squared * np.sin(phi) ** 2)
    level, up = (normal + height) * np.cos(phi), normal * (1.0 - squared) + height
    return np.array([level * np.cos(lam), level * np.sin(lam), up * np.sin(phi)])


@settings(deadline=None, max_examples=100, derandomize=True)
@given(
    st.floats(-80.0, 80.0),
    st.floats(-180.0, 180.0),
    st.floats(-100.0, 4000.0),
    st.floats(0.0, 360.0),
    st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-5, 500)),
)
def test_geodesy_is_that_of_the_textbook(latitude, longitude, altitude, heading, away):
    site = pb.Site(
        latitude=latitude, longitude=longitude, altitude=altitude, heading=heading
    )
    place = np.array([latitude, longitude, altitude]) + away
    way = earth_centred(*place) - earth_centred(latitude, longitude, altitude)
    phi, lam, turn = np.radians([latitude, longitude, heading])
    east = np.array([-np.sin(lam), np.cos(lam), 0.0])
    up = np.array([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)])
    north = np.cross(up, east)
    # The show frame's y axis points along the heading, a compass bearing.
    ahead = np.sin(turn) * east + np.cos(turn) * north
    right = np.cos(turn) * east - np.sin(turn) * north
    wanted = [right @ way, ahead @ way, up @ way]
    np.testing.assert_allclose(to_show_frame(site, *place), wanted, atol=1e-5)
