"""From latitude, longitude and altitude to the show frame, on the WGS 84 ellipsoid.

Only this direction is needed, and it is closed: geodetic to earth-centred (Hofmann-
Wellenhof, Lichtenegger, Wasle 2008, GNSS, equation 8.5), to east, north, up of the
tangent plane at the site's origin (equation 8.10), to the show frame by the site's
heading. Exact to rounding, below a micrometre within tens of kilometres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from showc.arrays import FloatArray
    from showc.log.showc_pb2 import Site


EQUATORIAL_RADIUS = 6378137.0
"""Semi-major axis of WGS 84 [m]."""

FLATTENING = 1.0 / 298.257223563
"""Flattening of WGS 84."""

_ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)  # of WGS 84


def earth_centred(
    latitude: ArrayLike, longitude: ArrayLike, altitude: ArrayLike
) -> FloatArray:
    """Earth-centred, earth-fixed coordinates (..., 3) [m] of degrees and metres."""
    phi, theta = np.radians(latitude), np.radians(longitude)
    height = np.asarray(altitude, dtype=np.float64)
    normal = EQUATORIAL_RADIUS / np.sqrt(1.0 - _ECCENTRICITY_SQUARED * np.sin(phi) ** 2)
    return np.stack(
        [
            (normal + height) * np.cos(phi) * np.cos(theta),
            (normal + height) * np.cos(phi) * np.sin(theta),
            (normal * (1.0 - _ECCENTRICITY_SQUARED) + height) * np.sin(phi),
        ],
        axis=-1,
    )


def east_north_up(
    site: Site, latitude: ArrayLike, longitude: ArrayLike, altitude: ArrayLike
) -> FloatArray:
    """East, north, up (..., 3) [m] of the tangent plane at the site's origin."""
    origin = earth_centred(site.latitude, site.longitude, site.altitude)
    away = earth_centred(latitude, longitude, altitude) - origin
    phi, theta = np.radians(site.latitude), np.radians(site.longitude)
    sine, cosine = np.sin(phi), np.cos(phi)
    east = np.array([-np.sin(theta), np.cos(theta), 0.0])
    north = np.array([-sine * np.cos(theta), -sine * np.sin(theta), cosine])
    up = np.array([cosine * np.cos(theta), cosine * np.sin(theta), sine])
    return np.asarray(away @ np.stack([east, north, up], axis=1))


def to_show_frame(site: Site, places: FloatArray) -> FloatArray:
    """Show-frame points (..., 3) [m] of east, north, up.

    The show frame's +y points along the site's heading, a compass bearing.
    """
    bearing = np.radians(site.heading)
    cosine, sine = np.cos(bearing), np.sin(bearing)
    east, north, up = np.moveaxis(np.asarray(places), -1, 0)
    return np.stack(
        [east * cosine - north * sine, east * sine + north * cosine, up], axis=-1
    )
