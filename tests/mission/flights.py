"""Straight-line shows for the mission tests: shift, swap, and a many-legged one."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
from synthetic import (
    fly,
    formation,
    gliding_trajectory,
    grid,
    make_show,
    raised,
)

from showc.script.show import MissionOptions

START = datetime(2026, 6, 1, 20, 0, 0, tzinfo=UTC)


def shift_flight(drones, shift=(12.0, 8.0, 4.0), spacing=2.0, options=None, fades=()):
    """A grid goes up, becomes green, shifts, comes back and lands."""
    pads = grid(drones, spacing)
    level = raised(pads, 6.0)
    first = raised(pads, 8.0)
    second = first + np.array(shift)
    return _show(pads, level, first, second, options=options, fades=fades)


def swap_flight(drones=6, radius=8.0):
    """Drones on a ring go to the opposite place, all at once through the middle."""
    angle = np.arange(drones) * 2.0 * np.pi / drones
    ring = radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    return _show(ring, raised(ring, 6.0), raised(ring, 8.0), raised(-ring, 8.0))


def _show(pads, level, first, second, *, options=None, fades=()):
    formations = [
        formation("pads", pads, [0.0, 0.0, 0.0]),
        formation("red", first, [1.0, 0.0, 0.0]),
        formation("green", second, [0.0, 1.0, 0.0]),
    ]
    show = make_show(
        formations,
        len(pads),
        holds=[2.0, 5.0],
        altitude=6.0,
        fades=fades or ("start",),
    )
    show = replace(show, mission=options or MissionOptions())
    stops = [
        ("pads", "pads", pads, None),
        ("launch", "above", level, None),
        ("transition", "red", first, 0),
        ("transition", "green", second, 1),
        ("approach", "above to land", level, None),
        ("land", "pads", pads, None),
    ]
    return fly(show, stops, gliding_trajectory)


def rows(content: bytes) -> list[list[float]]:
    """Numbers of a .waypoints file, row by row."""
    lines = content.decode("ascii").splitlines()
    assert lines[0] == "QGC WPL 110"
    return [[float(field) for field in line.split("\t")] for line in lines[1:]]
