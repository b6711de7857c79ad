"""Drawings of the site as SVG: from above, with the fence, and from the side."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin
from typing import TYPE_CHECKING

import numpy as np

from showc.view.document import text

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.view.overview import Overview


WIDTH, HEIGHT, MARGIN = 440.0, 340.0, 34.0
"""Of the map, and of the room for its scale around it [px]."""
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


def ways(positions: FloatArray, axes: list[int], frame: Frame) -> str:
    """Thin lines along the ways of some drones; positions (steps, drones, 3) [m]."""
    drones = positions.shape[1]
    chosen = np.unique(np.linspace(0, drones - 1, PATHS).astype(int))
    lines = [path(_thinned(frame(positions[:, one][:, axes]))) for one in chosen]
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


def _pictures(overview: Overview, axes: list[int], frame: Frame) -> str:
    """Dots at the places of every picture, in its colours."""
    total = max(1, sum(len(one.places) for one in overview.pictures))
    stride = max(1, -(-total // DOTS))
    dots = []
    for one in overview.pictures:
        places, colours = frame(one.places[::stride][:, axes]), one.colours[::stride]
        for (x, y), light in zip(places, colours.tolist(), strict=True):
            shown = "#{:02x}{:02x}{:02x}".format(*light) if any(light) else "#9aa3b5"
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


def map_from_above(overview: Overview) -> str:
    """Fence, pads, pictures and ways from above, with scale and north if known."""
    ground = overview.ground
    frame = Frame.around(_level(overview))
    marks = "".join(
        f'<rect x="{x - 1.5:.1f}" y="{y - 1.5:.1f}" width="3" height="3"/>'
        for x, y in frame(overview.positions[0][:, :2])
    )
    origin = frame(np.zeros((1, 2)))[0]
    fence = ""
    if ground.fence.size:
        fence = (
            f'<path d="{path(frame(ground.fence), close=True)}" fill="#fff" '
            'stroke="#e0701b" stroke-width="1.6" stroke-dasharray="6 3"/>'
        )
    north = "" if ground.heading is None else north_arrow(ground.heading, frame)
    return svg(
        [
            fence,
            ways(overview.positions, [0, 1], frame),
            f'<g fill="none" stroke="#5b6578" stroke-width="0.7">{marks}</g>',
            _pictures(overview, [0, 1], frame),
            (
                f'<path d="M{origin[0] - 5:.1f},{origin[1]:.1f}h10m-5,-5v10" '
                'stroke="#161b26" stroke-width="1.1"/>'
            ),
            scale_bar(frame),
            north,
        ],
        "Site from above",
        frame,
    )


def _level(overview: Overview) -> FloatArray:
    """Corners of the fence; of the flights where none is known, (n, 2) [m]."""
    fence = overview.ground.fence
    return fence if fence.size else overview.positions[..., :2].reshape(-1, 2)


def map_from_the_side(overview: Overview) -> str:
    """Draw what the audience sees: ground, ceiling, pictures and ways, x and height."""
    ground, highest = overview.ground, overview.highest
    across = _level(overview)[:, 0]
    left, right = float(across.min()), float(across.max())
    top = highest if ground.ceiling is None else ground.ceiling
    low = min(overview.lowest, 0.0)
    frame = Frame.around(np.array([[left, low], [right, top]]))
    walls = frame(np.array([[left, low], [right, top]]))
    (x0, y0), (x1, y1) = walls
    level = frame(np.array([[left, highest]]))[0, 1]
    earth = frame(np.array([[left, 0.0]]))[0, 1]
    volume, ceiling = "", ""
    if ground.fence.size and ground.ceiling is not None:
        volume = (
            f'<rect x="{x0:.1f}" y="{y1:.1f}" width="{x1 - x0:.1f}" '
            f'height="{y0 - y1:.1f}" fill="#fff" stroke="#e0701b" '
            'stroke-width="1.6" stroke-dasharray="6 3"/>'
        )
    if ground.ceiling is not None:
        ceiling = (
            f'<path d="M{x0:.1f},{y1:.1f}H{x1:.1f}" stroke="#e0701b" '
            'stroke-width="1.6" stroke-dasharray="6 3"/>'
            f'<text x="{x0 + 5:.1f}" y="{y1 - 5:.1f}" style="fill:#a85210">'
            f"volume up to {top:.1f} m</text>"
        )
    return svg(
        [
            volume,
            f'<path d="M0,{earth:.1f}H{WIDTH:.0f}" stroke="#5b6578"/>',
            ways(overview.positions, [0, 2], frame),
            _pictures(overview, [0, 2], frame),
            (
                f'<path d="M{x0:.1f},{level:.1f}H{x1:.1f}" stroke="#2459c4" '
                'stroke-width="0.8" stroke-dasharray="2 3"/>'
            ),
            (
                f'<text x="{x1 - 4:.1f}" y="{level - 4:.1f}" text-anchor="end" '
                f'style="fill:#2459c4">highest {highest:.1f} m</text>'
            ),
            ceiling,
            scale_bar(frame),
        ],
        "Site from the audience",
        frame,
    )
