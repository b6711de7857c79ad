"""What drawings on paper show of a flight: the ground, ways, pictures that are held."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.view.digest import metric_scale
from showc.view.scene import Ground

if TYPE_CHECKING:
    from showc.arrays import ByteArray, FloatArray
    from showc.log.reader import LoggedShow

WAYS_RATE = 2.5
"""Places of a way that is drawn [Hz]."""
_SETTLED = 0.5
"""After this time of a hold its colours are those of the picture [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """The fleet while it holds a formation."""

    name: str
    start: float
    """Show time [s]."""
    places: FloatArray
    """Shape (drones, 3) [m]."""
    colours: ByteArray
    """As screens show them, shape (drones, 3)."""


@dataclass(frozen=True, slots=True, eq=False)
class Overview:
    """A flight as drawings on paper show it."""

    ground: Ground
    positions: FloatArray
    """Of all drones, ``WAYS_RATE`` times a second or more, (steps, drones, 3) [m]."""
    lowest: float
    """Height of the lowest drone [m]."""
    highest: float
    """Height of the highest drone [m]."""
    pictures: tuple[Picture, ...]
    """In the order in which they are shown first."""


def overview_of(logged: LoggedShow) -> Overview:
    """Return what drawings show of a log."""
    heights = logged.positions[..., 2]
    wanted = max(WAYS_RATE * logged.duration, 1.0)
    return Overview(
        ground_of(logged),
        logged.positions[:: max(1, round(logged.times.size / wanted))],
        float(heights.min()),
        float(heights.max()),
        tuple(_pictures(logged)),
    )


def _pictures(logged: LoggedShow) -> list[Picture]:
    """Every formation that is held, or shown in passing, once."""
    shown: dict[str, tuple[float, float]] = {}
    for kinds in ({"hold", "motion"}, {"transition"}):
        for segment in logged.segments:
            message = segment.message
            moving = segment.kind == "motion"
            name = message.from_formation if moving else message.to_formation
            if segment.kind not in kinds or name.startswith("above "):
                continue
            # A picture that is not held stands when its move ends.
            passing = segment.kind == "transition"
            stands = segment.start + segment.duration * passing
            settled = min(_SETTLED, segment.duration / 2) * (segment.kind == "hold")
            shown.setdefault(name, (stands, stands + settled))
    found = []
    for name, (start, moment) in sorted(shown.items(), key=lambda one: one[1]):
        row = int(np.searchsorted(logged.times, moment))
        row = min(row, logged.times.size - 1)
        samples = logged.samples[row]
        colours = np.stack([samples[one] for one in ("red", "green", "blue")], axis=-1)
        found.append(Picture(name, start, logged.positions[row], colours))
    return found


def ground_of(logged: LoggedShow) -> Ground:
    """Ground, fence, pads and heading of a log's site."""
    site, rules = logged.rules.site, logged.rules
    fence = np.reshape(site.fence, (-1, 2))
    if fence.size == 0:
        low, high = site.volume_min, site.volume_max
        fence = box_of((low.x, low.y), (high.x, high.y))
    # The formation that the launch leaves is the one on the ground.
    start = str(logged.segments[0].message.from_formation)
    pads = next(one for one in rules.formations if one.name == start)
    return Ground(
        fence=fence,
        floor=site.volume_min.z,
        ceiling=site.volume_max.z,
        pads=np.reshape(pads.points, (-1, 3)),
        heading=site.heading,
        separation=rules.separation.distance,
        metric=metric_scale(rules.separation),
    )


def box_of(low: tuple[float, ...], high: tuple[float, ...]) -> FloatArray:
    """Corners of the rectangle between two points, shape (4, 2) [m]."""
    (a, b), (c, d) = low[:2], high[:2]
    return np.array([[a, b], [c, b], [c, d], [a, d]])
