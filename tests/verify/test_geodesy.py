"""Geodesy of verify against another library's; what missions say is elsewhere."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.log import showc_pb2 as pb
from showc.verify.missions.legs import to_show_frame


@settings(deadline=None, max_examples=100, derandomize=True)
@given(
    st.floats(-80.0, 80.0),
    st.floats(-180.0, 180.0),
    st.floats(-100.0, 4000.0),
    st.floats(0.0, 360.0),
    st.tuples(st.floats(-2000, 2000), st.floats(-2000, 2000), st.floats(-5, 500)),
)
def test_geodesy_agrees_with_another_library(
    latitude, longitude, altitude, heading, point
):
    import pymap3d

    site = pb.Site(
        latitude=latitude, longitude=longitude, altitude=altitude, heading=heading
    )
    # The show frame's y axis points along the heading, a compass bearing.
    bearing = np.radians(heading)
    ahead = np.array([np.sin(bearing), np.cos(bearing), 0.0])
    right = np.array([np.cos(bearing), -np.sin(bearing), 0.0])
    enu = point[0] * right + point[1] * ahead + np.array([0.0, 0.0, point[2]])
    geodetic = pymap3d.enu2geodetic(*enu, latitude, longitude, altitude)
    np.testing.assert_allclose(to_show_frame(site, *geodetic), point, atol=1e-5)
