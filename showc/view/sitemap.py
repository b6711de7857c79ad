"""Drawings of the site as SVG: from above, with the fence, and from the side."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin
from typing import TYPE_CHECKING

import numpy as np

from showc.view.document import text

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.log.reader import LoggedShow


WIDTH, HEIGHT, MARGIN = 440.0, 340.0, 34.0
DOTS = 1500
"""Most places drawn of all formations together."""
PATHS = 60
"""Most drones whose ways are drawn."""


@dataclass(frozen=True, slots=True)
class Frame:
    """Where points of the show go on the drawing."""

    low: tuple[float, float]
    """Show coordinates of the lower left corner [m]."""
    scale: float
    """Drawing units a metre."""
    width: float = WIDTH
    """Of the drawing."""
    height: float = HEIGHT
    """Of the drawing."""

    @classmethod
    def around(
        cls, points: FloatArray, *, width: float = WIDTH, height: float = HEIGHT
    ) -> Frame:
        """Fit ``points`` (n, 2) [m] into a drawing of a size."""
        low, high = points.min(axis=0), points.max(axis=0)
        size = np.array([width, height])
        room = size - 2.0 * MARGIN
        scale = float((room / np.maximum(high - low, 1.0)).min())
        middle = (low + high) / 2.0
        corner = middle - 0.5 * size / scale
        return cls((float(corner[0]), float(corner[1])), scale, width, height)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Drawing places (n, 2) of ``points`` (n, 2) [m]."""
        across = (points[:, 0] - self.low[0]) * self.scale
        up = self.height - (points[:, 1] - self.low[1]) * self.scale
        return np.stack([across, up], axis=1)


def path(points: FloatArray, *, close: bool = False) -> str:
    """Return the way through drawing places (n, 2), for a path of SVG."""
    steps = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f"M{steps}{'Z' if close else ''}"


def svg(parts: list[str], label: str, frame: Frame) -> str:
    """Return a drawing of ``parts`` on a sheet."""
    return (
        f'<svg viewBox="0 0 {frame.width:.0f} {frame.height:.0f}" role="img" '
        f'aria-label="{text(label)}" xmlns="http://www.w3.org/2000/svg">'
        f'<rect width="100%" height="100%" rx="8" fill="#f4f6f9"/>'
        f"{''.join(parts)}</svg>"
    )


def fence_of(logged: LoggedShow) -> FloatArray:
    """Corners (n, 2) [m] of the fence; the volume's walls where there is none."""
    site = logged.rules.site
    if site.fence:
        return np.reshape(np.array(site.fence), (-1, 2))
    a, b = site.volume_min, site.volume_max
    return np.array([[a.x, a.y], [b.x, a.y], [b.x, b.y], [a.x, b.y]])


def ways(logged: LoggedShow, axes: list[int], frame: Frame) -> str:
    """Thin lines along the ways of some drones."""
    chosen = np.unique(np.linspace(0, logged.drones - 1, PATHS).astype(int))
    stride = max(1, round(logged.rules.log_rate / 2.5))
    lines = [
        path(_thinned(frame(logged.positions[::stride, drone][:, axes])))
        for drone in chosen
    ]
    return (
        f'<path d="{"".join(lines)}" fill="none" stroke="#8fa3c8" '
        'stroke-width="0.6" stroke-opacity="0.55"/>'
    )


def _thinned(points: FloatArray) -> FloatArray:
    """Leave out what lies within a unit of the drawing beside what is kept."""
    kept = [points[0]]
    kept.extend(
        point
        for point in points[1:]
        if abs(point[0] - kept[-1][0]) + abs(point[1] - kept[-1][1]) > 1.0
    )
    return np.array(kept)


def _pictures(logged: LoggedShow, axes: list[int], frame: Frame) -> str:
    """Dots at the places of every picture, in the colour shown on arrival."""
    found = [s for s in logged.segments if s.kind == "transition"]
    total = max(1, sum(segment.drones.size for segment in found))
    stride = max(1, -(-total // DOTS))
    dots = []
    for segment in found:
        end = segment.start + segment.duration
        step = min(int(np.searchsorted(logged.times, end)), logged.times.size - 1)
        samples = logged.samples[step, segment.drones][::stride]
        goals = np.reshape(np.array(segment.message.goals), (-1, 3))[::stride]
        for (x, y), sample in zip(frame(goals[:, axes]), samples, strict=True):
            colour = "#{:02x}{:02x}{:02x}".format(
                *(int(sample[name]) for name in ("red", "green", "blue"))
            )
            shown = "#9aa3b5" if colour == "#000000" else colour
            dots.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.9" fill="{shown}"/>')
    return f'<g stroke="#161b26" stroke-width="0.35">{"".join(dots)}</g>'


def scale_bar(frame: Frame) -> str:
    """Return a bar of a round length in the lower left corner."""
    lengths = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000]
    length = max((n for n in lengths if n * frame.scale < 0.3 * frame.width), default=1)
    x, y = MARGIN - 14.0, frame.height - 13.0
    end = x + length * frame.scale
    return (
        f'<path d="M{x:.1f},{y - 4:.1f}v4H{end:.1f}v-4" fill="none" stroke="#5b6578"/>'
        f'<text x="{end + 5:.1f}" y="{y:.1f}">{length} m</text>'
    )


def north_arrow(heading: float, frame: Frame) -> str:
    """Arrow to the north; +y of the show is up, at bearing ``heading`` [deg]."""
    angle = radians(-heading)
    x, y = frame.width - 28.0, 30.0
    dx, dy = 13.0 * sin(angle), -13.0 * cos(angle)
    return (
        f'<g stroke="#c22036" fill="#c22036"><path d="M{x - dx:.1f},{y - dy:.1f}'
        f'L{x + dx:.1f},{y + dy:.1f}" stroke-width="1.6"/>'
        f'<circle cx="{x + dx:.1f}" cy="{y + dy:.1f}" r="2.6"/></g>'
        f'<text x="{x + 1.75 * dx:.1f}" y="{y + 1.75 * dy + 4:.1f}" '
        'text-anchor="middle" style="fill:#c22036;font-weight:600">N</text>'
    )


def map_from_above(logged: LoggedShow) -> str:
    """Fence, pads, pictures and ways from above, with scale and north."""
    fence = fence_of(logged)
    frame = Frame.around(fence)
    pads = logged.positions[0][:, :2]
    marks = "".join(
        f'<rect x="{x - 1.5:.1f}" y="{y - 1.5:.1f}" width="3" height="3"/>'
        for x, y in frame(pads)
    )
    origin = frame(np.zeros((1, 2)))[0]
    return svg(
        [
            (
                f'<path d="{path(frame(fence), close=True)}" fill="#fff" '
                'stroke="#e0701b" stroke-width="1.6" stroke-dasharray="6 3"/>'
            ),
            ways(logged, [0, 1], frame),
            f'<g fill="none" stroke="#5b6578" stroke-width="0.7">{marks}</g>',
            _pictures(logged, [0, 1], frame),
            (
                f'<path d="M{origin[0] - 5:.1f},{origin[1]:.1f}h10m-5,-5v10" '
                'stroke="#161b26" stroke-width="1.1"/>'
            ),
            scale_bar(frame),
            north_arrow(float(logged.rules.site.heading), frame),
        ],
        "Site from above",
        frame,
    )


def map_from_the_side(logged: LoggedShow) -> str:
    """Draw what the audience sees: ground, ceiling, pictures and ways, x and height."""
    site = logged.rules.site
    fence = fence_of(logged)
    left, right = float(fence[:, 0].min()), float(fence[:, 0].max())
    top = float(site.volume_max.z)
    low = min(float(logged.positions[..., 2].min()), 0.0)
    frame = Frame.around(np.array([[left, low], [right, top]]))
    walls = frame(np.array([[left, low], [right, top]]))
    (x0, y0), (x1, y1) = walls
    highest = float(logged.positions[..., 2].max())
    level = frame(np.array([[left, highest]]))[0, 1]
    ground = frame(np.array([[left, 0.0]]))[0, 1]
    return svg(
        [
            (
                f'<rect x="{x0:.1f}" y="{y1:.1f}" width="{x1 - x0:.1f}" '
                f'height="{y0 - y1:.1f}" fill="#fff" stroke="#e0701b" '
                'stroke-width="1.6" stroke-dasharray="6 3"/>'
            ),
            f'<path d="M0,{ground:.1f}H{WIDTH:.0f}" stroke="#5b6578"/>',
            ways(logged, [0, 2], frame),
            _pictures(logged, [0, 2], frame),
            (
                f'<path d="M{x0:.1f},{level:.1f}H{x1:.1f}" stroke="#2459c4" '
                'stroke-width="0.8" stroke-dasharray="2 3"/>'
            ),
            (
                f'<text x="{x1 - 4:.1f}" y="{level - 4:.1f}" text-anchor="end" '
                f'style="fill:#2459c4">highest {highest:.1f} m</text>'
            ),
            (
                f'<text x="{x0 + 5:.1f}" y="{y1 - 5:.1f}" style="fill:#a85210">'
                f"ceiling {top:.1f} m</text>"
            ),
            scale_bar(frame),
        ],
        "Site from the audience",
        frame,
    )
