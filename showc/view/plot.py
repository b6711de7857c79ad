"""Line plots as SVG, printable, with limits and mesh borders behind the curves."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, log10
from typing import TYPE_CHECKING

import numpy as np

from showc.view.document import text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray


WIDTH, HEIGHT = 460.0, 170.0
"""Of a plot [px]: two stand side by side on a page."""
LEFT, RIGHT, TOP, BOTTOM = 52.0, 8.0, 8.0, 22.0
"""Its margins, for the numbers of its axes [px]."""
COLOURS = ("#2459c4", "#d9541e", "#14804a", "#8b3fb5")
"""Of the curves, in order."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One line of a plot."""

    name: str
    """For the key."""
    values: FloatArray
    """At the plot's times."""


def ticks(low: float, high: float, *, count: int = 5) -> list[float]:
    """Round numbers within [low, high], ``count`` of them or one or two beside."""
    span = high - low
    power = 10.0 ** floor(log10(span / count))
    steps = [factor * power for factor in (1.0, 2.0, 2.5, 5.0, 10.0)]
    step = next(step for step in steps if span / step <= count + 1.5)
    first, last = ceil(low / step - 1e-9), floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


@dataclass(frozen=True, slots=True)
class Axes:
    """Where times and levels go on the drawing."""

    begin: float
    """Time of the left edge [s]."""
    end: float
    """Time of the right edge [s]."""
    low: float
    """Level of the lower edge."""
    high: float
    """Level of the upper edge."""

    def x(self, time: float) -> float:
        """Place of ``time`` from the left."""
        share = (time - self.begin) / (self.end - self.begin)
        return LEFT + share * (WIDTH - LEFT - RIGHT)

    def y(self, level: float) -> float:
        """Place of ``level`` from the top."""
        share = (level - self.low) / (self.high - self.low)
        return HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM)

    def background(self, unit: str = "") -> list[str]:
        """Return the sheet and the labels of the times, the last with its ``unit``."""
        times = ticks(self.begin, self.end, count=6)
        labels = [f"{time:.6g}" for time in times]
        labels[-1] = f"{labels[-1]} {text(unit)}".strip()
        return [
            (
                f'<rect x="{LEFT}" y="{TOP}" width="{WIDTH - LEFT - RIGHT}" '
                f'height="{HEIGHT - TOP - BOTTOM}" fill="#f7f9fb"/>'
            ),
            *(
                f'<text x="{self.x(time):.1f}" y="{HEIGHT - 7}" '
                f'text-anchor="middle">{label}</text>'
                for time, label in zip(times, labels, strict=True)
            ),
        ]

    def level(self, level: float, label: str) -> str:
        """Return a faint line across, with its label."""
        return (
            f'<path d="M{LEFT},{self.y(level):.1f}H{WIDTH - RIGHT}" stroke="#e6eaf1" '
            f'stroke-width="0.6"/><text x="{LEFT - 5}" y="{self.y(level) + 4:.1f}" '
            f'text-anchor="end">{label}</text>'
        )


def line_plot(
    title: str,
    times: FloatArray,
    curves: Sequence[Curve],
    *,
    limits: Sequence[float] = (),
    breaks: FloatArray | None = None,
    unit: str = "s",
) -> str:
    """Return a figure: title, plot and key.

    Parameters
    ----------
    title
        With the unit.
    times
        Shape (n,) [s], increasing; equal neighbours draw a jump.
    curves
        Lines to draw.
    limits
        Levels drawn as dashed lines where they are not far from the curves.
    breaks
        Borders of the mesh intervals [s].
    unit
        Of the times, written behind the last of them.
    """
    values = np.concatenate([curve.values for curve in curves])
    low, high = float(values.min()), float(values.max())
    # A limit far away would flatten the curves: only its level is named.
    reach = max(high - low, 0.35 * max(abs(high), abs(low)), 1e-9)
    near = [level for level in limits if low - 1.6 * reach < level < high + 1.6 * reach]
    low, high = min([low, *near]), max([high, *near])
    size = max(abs(high), abs(low))
    if high - low <= 1e-9 * size or size < 1e-12:
        # A constant: the line stands in the middle of a sheet of its own size.
        low, high = low - max(0.5 * size, 1.0), high + max(0.5 * size, 1.0)
    room = 0.06 * (high - low)
    axes = Axes(float(times[0]), float(times[-1]), low - room, high + room)
    parts = axes.background(unit)
    if breaks is not None:
        borders = "".join(f"M{axes.x(t):.1f},{TOP}V{HEIGHT - BOTTOM}" for t in breaks)
        parts.append(f'<path d="{borders}" stroke="#d5dce8" stroke-width="0.8"/>')
    parts += [
        axes.level(level, f"{level:.6g}")
        for level in ticks(axes.low, axes.high, count=4)
    ]
    parts += [
        f'<path d="M{LEFT},{axes.y(level):.1f}H{WIDTH - RIGHT}" stroke="#c22036" '
        'stroke-width="1" stroke-dasharray="5 3"/>'
        for level in near
    ]
    keys = []
    for colour, curve in zip(COLOURS, curves, strict=False):
        steps = " ".join(
            f"{axes.x(time):.1f},{axes.y(value):.1f}"
            for time, value in zip(times, curve.values, strict=True)
        )
        parts.append(
            f'<polyline points="{steps}" fill="none" stroke="{colour}" '
            'stroke-width="1.4" stroke-linejoin="round"/>'
        )
        if curve.name:
            keys.append(_key(colour, curve.name))
    if limits:
        levels = ", ".join(f"{level:.4g}" for level in limits)
        keys.append(_key("#c22036", f"limit {levels}"))
    return _figure(title, parts, keys)


def bar_plot(
    title: str, breaks: FloatArray, values: FloatArray, labels: Sequence[str]
) -> str:
    """Return a figure with one bar over each mesh interval, logarithmic.

    Parameters
    ----------
    title
        With the unit.
    breaks
        Borders of the intervals, shape (n + 1,) [s].
    values
        Not negative, shape (n,).
    labels
        Written on the bars where there is room.
    """
    exponents = np.log10(np.maximum(values, 1e-16))
    low, high = floor(float(exponents.min())) - 0.3, ceil(float(exponents.max())) + 0.2
    axes = Axes(float(breaks[0]), float(breaks[-1]), low, max(high, low + 1.5))
    step = max(1, round((axes.high - axes.low) / 5.0))
    levels = range(ceil(axes.low), floor(axes.high) + 1, step)
    parts = axes.background() + [axes.level(level, f"1e{level}") for level in levels]
    for left, right, exponent, label in zip(
        breaks[:-1], breaks[1:], exponents, labels, strict=True
    ):
        wide = axes.x(right) - axes.x(left)
        top = axes.y(exponent)
        parts.append(
            f'<rect x="{axes.x(left) + 0.5:.1f}" y="{top:.1f}" '
            f'width="{max(wide - 1.0, 0.5):.1f}" '
            f'height="{HEIGHT - BOTTOM - top:.1f}" fill="#9db8ea"/>'
        )
        if wide > 7.0 * len(label):
            parts.append(
                f'<text x="{axes.x(left) + wide / 2.0:.1f}" y="{HEIGHT - BOTTOM - 5}" '
                f'text-anchor="middle" style="fill:#1d3f86">{text(label)}</text>'
            )
    return _figure(title, parts, [])


def _key(colour: str, name: str) -> str:
    return f'<span class="key"><i style="background:{colour}"></i>{text(name)}</span>'


def _figure(title: str, parts: list[str], keys: list[str]) -> str:
    return (
        f"<figure><h3>{text(title)}</h3>"
        f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" role="img" '
        f'aria-label="{text(title)}" xmlns="http://www.w3.org/2000/svg">'
        f"{''.join(parts)}</svg>"
        f"<figcaption>{''.join(keys)}</figcaption></figure>"
    )
