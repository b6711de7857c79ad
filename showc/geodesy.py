"""From the show frame to the globe and back, through the site's tangent plane.

East = x cos h + y sin h and north = -x sin h + y cos h, h being the site's heading
(compass bearing of +y). The tangent plane touches WGS 84 at the site's origin; the way
from there to latitude and longitude goes through earth-centred coordinates and is
exact to rounding (better than 1 um within 10 km).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pymap3d

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.script.show import Site


METRES_PER_DEGREE = 111318.845
"""Length of a degree of latitude in ArduPilot's flat earth [m]."""

POSITION_RESOLUTION = 0.02
"""How much nearer two places can come by rounding to the format's grid [m].

Each of them moves by at most 0.56 cm north, 0.56 cm east and 0.5 cm up: 0.93 cm.
"""


@dataclass(frozen=True, slots=True, eq=False)
class GlobalPoints:
    """Places as a mission stores them: whole 1e-7 degrees, whole centimetres."""

    latitude: IntArray
    """Latitude, WGS 84, shape (n,) [1e-7 deg]."""
    longitude: IntArray
    """Longitude, WGS 84, shape (n,) [1e-7 deg]."""
    height: IntArray
    """Height above each one's home, shape (n,) [cm]."""

    def __len__(self) -> int:
        return int(self.latitude.size)

    def select(self, chosen: BoolArray | IntArray) -> GlobalPoints:
        """Return the ``chosen`` ones: a mask (n,), or indices."""
        return GlobalPoints(
            self.latitude[chosen], self.longitude[chosen], self.height[chosen]
        )

    @classmethod
    def joined(cls, parts: Sequence[GlobalPoints]) -> GlobalPoints:
        """Return the places of all ``parts``, one after the other."""
        return cls(
            np.concatenate([part.latitude for part in parts]),
            np.concatenate([part.longitude for part in parts]),
            np.concatenate([part.height for part in parts]),
        )


@dataclass(frozen=True, slots=True)
class SiteFrame:
    """The show frame's place on the globe."""

    latitude: float
    """Latitude of the origin [deg]."""
    longitude: float
    """Longitude of the origin [deg]."""
    altitude: float
    """Altitude of the origin above mean sea level [m]."""
    heading: float
    """Compass bearing of +y [deg]."""

    @classmethod
    def of(cls, site: Site) -> SiteFrame:
        """Return the frame of a show's ``site``."""
        return cls(site.latitude, site.longitude, site.altitude, site.heading)

    def _rotation(self) -> FloatArray:
        """Matrix (3, 3) from show frame to east-north-up."""
        bearing = np.radians(self.heading)
        cosine, sine = np.cos(bearing), np.sin(bearing)
        return np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    def to_enu(self, points: ArrayLike) -> FloatArray:
        """East, north, up of the tangent plane of show-frame ``points`` (..., 3)."""
        return np.asarray(np.asarray(points, dtype=np.float64) @ self._rotation().T)

    def from_enu(self, points: ArrayLike) -> FloatArray:
        """Show-frame positions (..., 3) of east-north-up ``points`` (..., 3) [m]."""
        return np.asarray(np.asarray(points, dtype=np.float64) @ self._rotation())

    def to_geodetic(self, points: ArrayLike) -> FloatArray:
        """Latitude, longitude [deg], altitude above mean sea level [m], (..., 3)."""
        enu = np.moveaxis(self.to_enu(points), -1, 0)
        here = self.latitude, self.longitude, self.altitude
        return np.stack(pymap3d.enu2geodetic(*enu, *here), axis=-1)

    def from_geodetic(self, geodetic: ArrayLike) -> FloatArray:
        """Show-frame positions (..., 3) of what :meth:`to_geodetic` returns."""
        lla = np.moveaxis(np.asarray(geodetic, dtype=np.float64), -1, 0)
        here = self.latitude, self.longitude, self.altitude
        return self.from_enu(np.stack(pymap3d.geodetic2enu(*lla, *here), axis=-1))

    def round_points(
        self, points: FloatArray, home_altitude: FloatArray
    ) -> GlobalPoints:
        """Round show-frame ``points`` (n, 3) to what a mission can store.

        ``home_altitude`` (n,) is the altitude of each one's home [m].
        """
        lla = self.to_geodetic(points)
        return GlobalPoints(
            np.rint(lla[:, 0] * 1e7).astype(np.int64),
            np.rint(lla[:, 1] * 1e7).astype(np.int64),
            np.rint((lla[:, 2] - home_altitude) * 100.0).astype(np.int64),
        )

    def place(self, stored: GlobalPoints, home_altitude: FloatArray) -> FloatArray:
        """Show-frame positions (n, 3) [m] of ``stored`` places."""
        return self.from_geodetic(
            np.stack(
                [
                    stored.latitude * 1e-7,
                    stored.longitude * 1e-7,
                    stored.height * 1e-2 + home_altitude,
                ],
                axis=-1,
            )
        )


def autopilot_displacement(
    begin: GlobalPoints, end: GlobalPoints, latitude: float
) -> FloatArray:
    """North, east, up (n, 3) [m] from ``begin`` to ``end`` in ArduPilot's metric.

    ArduPilot takes a degree for 111318.845 m in both axes, the eastern one shortened
    by the cosine of ``latitude`` [deg]: up to 0.7 % off WGS 84. Its leg lengths, and so
    its leg times, are in this metric.
    """
    north = (end.latitude - begin.latitude) * 1e-7 * METRES_PER_DEGREE
    east = (
        (end.longitude - begin.longitude)
        * (1e-7 * METRES_PER_DEGREE)
        * np.cos(np.radians(latitude))
    )
    return np.stack([north, east, (end.height - begin.height) * 1e-2], axis=-1)


def stored_height(centimetres: int) -> float:
    """Height [m] to write so that an autopilot stores exactly ``centimetres``.

    ArduPilot truncates to centimetres after float32; 2 mm away from zero keeps the
    value above the step it stands for.
    """
    if centimetres == 0:
        return 0.0
    return centimetres * 0.01 + (0.002 if centimetres > 0 else -0.002)
