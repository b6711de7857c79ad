"""The shows of the fleet table: scripts as a user would write them, and what is asked.

Formations come from the show language. Only where it has no word for a case are places
worked out here: the random order of a fixed assignment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

HEAD = """\
showc: 1
name: {name}
drones: {drones}
site: {{volume: {{min: [-400, -400, 0], max: [400, 400, 400]}}}}
separation: 1 m
pads: {pads}
formations:
{formations}
transitions:
{transitions}
{more}"""

TEXT = "showc\\nflies"


@dataclass(frozen=True, slots=True)
class Case:
    """One transition of a show, and what is asked of it."""

    label: str
    index: int
    """Which of the show's transitions, counting from 0."""
    time: float | None = None
    """Greatest time of the compile on two cores [s]; None: nothing is asked."""
    gap: float = 0.01
    """Greatest time over the bound, as a fraction."""


@dataclass(frozen=True, slots=True)
class FleetShow:
    """A script, the files beside it, and its cases."""

    name: str
    drones: int
    script: str
    cases: tuple[Case, ...]
    files: dict[str, str] = field(default_factory=dict)
    memory: float = 2048.0
    """Greatest memory asked for [MiB]."""
    start: str | None = None
    """When its missions start (UTC); None: they have no clock."""


def _script(
    name: str,
    drones: int,
    formations: dict[str, str],
    *,
    pads: str = "{type: grid, step: 2}",
    fixed: bool = False,
    hold: float = 1.0,
    more: str = "",
) -> str:
    assignment = ", assignment: fixed" if fixed else ""
    return HEAD.format(
        name=name,
        drones=drones,
        pads=pads,
        formations="\n".join(f"  {key}: {body}" for key, body in formations.items()),
        transitions="\n".join(
            f"  - {{to: {key}, hold: {hold:g}{assignment}}}" for key in formations
        ),
        more=more,
    )


def grid_to_sphere(
    drones: int,
    time: float | None,
    gap: float,
    *,
    spacing: float = 2.0,
    memory: float = 2048.0,
) -> FleetShow:
    """From the pads' grid to a sphere, both with ``spacing`` [m]."""
    label = f"{drones:,} grid to sphere"
    if spacing != 2.0:
        label += f", spacing {spacing:g} x d_safe"
    height = 20.0 + 0.35 * spacing * math.sqrt(drones)
    body = f"{{type: sphere, spacing: {spacing:g}, centre: [0, 0, {height:.0f}]}}"
    script = _script(
        label,
        drones,
        {"sphere": body},
        pads=f"{{type: grid, step: {spacing:g}}}",
    )
    return FleetShow(label, drones, script, (Case(label, 0, time, gap),), memory=memory)


def chain() -> FleetShow:
    """A thousand drones through four pictures, spacing 2 m."""
    formations = {
        "sphere": "{type: sphere, spacing: 2, centre: [0, 0, 45]}",
        "text": (
            f'{{type: text, text: "{TEXT}", height: 70, draw: inside, spacing: 2, '
            "spread: true, centre: [0, 0, 55]}"
        ),
        "helix": (
            "{type: helix, strands: 4, radius: 26, height: 70, turns: 3, "
            "centre: [0, 0, 55]}"
        ),
        "cube": (
            "{type: cube, size: 20, draw: inside, spacing: 2, spread: true, "
            "centre: [0, 0, 45]}"
        ),
    }
    names = ["grid", *formations]
    cases = tuple(
        Case(f"1,000 {first} to {second}", index, 30.0, 0.01)
        for index, (first, second) in enumerate(zip(names, formations, strict=False))
    )
    name = "1,000 drones, four pictures"
    return FleetShow(name, 1000, _script(name, 1000, formations), cases)


def ten_pictures() -> FleetShow:
    """A whole show of a thousand drones, as it is flown before people."""
    rings = ", ".join(
        f"{{type: circle, count: {count}, radius: {radius}, plane: front}}"
        for count, radius in ((290, 66), (260, 60), (235, 54), (215, 48))
    )
    saturn = ", ".join(
        f"{{type: circle, count: {count}, radius: {radius}}}"
        for count, radius in ((140, 36), (130, 40), (130, 44))
    )
    words = "draw: inside, spread: true, spacing: 2"
    formations = {
        "ball": "{type: sphere, radius: 20, centre: [0, 0, 45], colour: magenta}",
        "word": (
            f'{{type: text, text: "{TEXT}", height: 70, {words}, '
            "centre: [0, 0, 55], colour: gold}"
        ),
        "helix": (
            "{type: helix, strands: 4, radius: 26, height: 70, turns: 3, "
            "centre: [0, 0, 50], colour: lime}"
        ),
        "cube": f"{{type: cube, size: 20, {words}, centre: [0, 0, 45], colour: white}}",
        "wave": (
            "{type: wave, step: 2.5, amplitude: 5, wavelength: 30, "
            "centre: [0, 0, 45], colour: aquamarine}"
        ),
        "rings": f"{{parts: [{rings}], centre: [0, 0, 78], colour: crimson}}",
        "saturn": (
            f"{{parts: [{{type: sphere, radius: 18, count: 600}}, {saturn}], "
            "transform: [{rotate: {angle: 25, axis: x}}], centre: [0, 0, 50], "
            "colour: {gradient: [gold, white], along: z}}"
        ),
        "line": (
            f'{{type: text, text: "2026", height: 50, {words}, '
            "centre: [0, 0, 50], colour: orangered}"
        ),
        "column": (
            "{type: cube, size: [20, 20, 60], draw: faces, spread: true, "
            "spacing: 2, centre: [0, 0, 50], colour: violet}"
        ),
        "wall": (
            "{type: grid, plane: front, step: 2.5, centre: [0, 0, 55], "
            "colour: {gradient: [red, blue], along: x}}"
        ),
    }
    name = "1,000 drones, ten pictures"
    script = _script(name, 1000, formations, hold=5.0)
    return FleetShow(name, 1000, script, (), start="2026-06-01T20:00:00Z")


def at_random(drones: int, time: float) -> FleetShow:
    """Grid to sphere, every drone to a place given out at random."""
    index = np.arange(drones) + 0.5
    polar = np.arccos(1.0 - 2.0 * index / drones)
    turn = np.pi * (1.0 + math.sqrt(5.0)) * index
    # The lattice's places are about sqrt(4 pi / n) radii apart, the nearest less.
    radius = 2.0 / (0.87 * math.sqrt(4.0 * math.pi / drones))
    places = radius * np.column_stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)]
    )
    places[:, 2] += radius + 15.0
    order = np.random.default_rng(1).permutation(drones)
    rows = "\n".join(f"{x:.4f},{y:.4f},{z:.4f}" for x, y, z in places[order])
    label = f"{drones:,} grid to sphere, fixed at random"
    script = _script(label, drones, {"sphere": "{type: csv, file: s.csv}"}, fixed=True)
    cases = (Case(label, 0, time, 0.05),)
    return FleetShow(label, drones, script, cases, {"s.csv": rows + "\n"})


def swap(drones: int, time: float) -> FleetShow:
    """Everyone to the opposite place of a circle, neighbours 6 m apart."""
    radius = 3.0 / math.sin(math.pi / drones)
    ring = f"{{type: circle, radius: {radius:.4f}, count: {drones}"
    label = f"{drones} antipodal swap"
    script = _script(
        label,
        drones,
        {"swapped": f"{ring}, start: 180 deg, centre: [0, 0, 20]}}"},
        pads=f"{ring}}}",
        fixed=True,
        more="launch: {altitude: 20}\nlanding: {altitude: 20}\n",
    )
    cases = (Case(label, 0, time, 0.03),)
    return FleetShow(label, drones, script, cases)


def turned(time: float) -> FleetShow:
    """Sixty drones on a grid of 1.2 times the separation, turned in place by 90°."""
    body = "{type: grid, rows: 4, columns: 5, layers: 3, step: 1.2, centre: [0, 0, 20]"
    label = "60 turned by 90° in place, spacing 1.2 x d_safe"
    script = _script(
        label,
        60,
        {"g": body + "}", "t": body + ", transform: [{rotate: 90 deg}]}"},
        fixed=True,
    )
    return FleetShow(label, 60, script, (Case(label, 1, time, 0.08),))


def word(time: float) -> FleetShow:
    """A thousand drones into a filled word whose places are as near as they may be."""
    formations = {
        "word": "{type: text, text: SHOW, height: 27, draw: inside, spread: true, "
        "centre: [0, 0, 40]}",
        "ball": "{type: sphere, radius: 14, centre: [0, 0, 40]}",
    }
    label = "1,000 into a filled word, spacing 1.0 x d_safe"
    script = _script(label, 1000, formations, pads="{type: grid, step: 1.34}")
    cases = (
        Case(label, 0, time, 0.05),
        Case("1,000 out of the filled word", 1, time, 0.05),
    )
    return FleetShow(label, 1000, script, cases)


def through_the_centre(time: float) -> FleetShow:
    """Forty drones on a sphere, each to the place opposite its own."""
    index = np.arange(40) + 0.5
    polar, turn = np.arccos(1.0 - index / 20.0), np.pi * (1.0 + math.sqrt(5.0)) * index
    ring = np.column_stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)]
    )
    files = {
        f"{name}.csv": "".join(f"{x:.4f},{y:.4f},{30.0 + z:.4f}\n" for x, y, z in rows)
        for name, rows in (("here", 6.0 * ring), ("there", -6.0 * ring))
    }
    label = "40 through the centre of a sphere"
    formations = {
        name: f"{{type: csv, file: {name}.csv}}" for name in ("here", "there")
    }
    script = _script(label, 40, formations, fixed=True)
    return FleetShow(label, 40, script, (Case(label, 1, time, 0.03),), files)


def all_shows() -> dict[str, FleetShow]:
    """All shows by key, in the order of the table."""
    return {
        "100": grid_to_sphere(100, 4.0, 0.01),
        "chain": chain(),
        "ten": ten_pictures(),
        "random": at_random(1000, 120.0),
        "tight": grid_to_sphere(1000, 120.0, 0.05, spacing=1.2),
        "5000": grid_to_sphere(5000, 300.0, 0.02, memory=4096.0),
        "swap-6": swap(6, 2.0),
        "swap-12": swap(12, 4.0),
        "swap-24": swap(24, 10.0),
        "turned": turned(10.0),
        "centre": through_the_centre(15.0),
        "word": word(60.0),
    }


def growth() -> dict[str, FleetShow]:
    """Show one case at several sizes: how the cost grows with the fleet."""
    return {
        f"growth-{drones}": grid_to_sphere(drones, None, 0.01)
        for drones in (250, 500, 1000, 2000)
    }
