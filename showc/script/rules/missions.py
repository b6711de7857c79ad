"""What missions cannot carry: bounds that no plan and no solve can change."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import Diagnostic, Severity
from showc.script.lanes import arrival, chapters, own_times, rest
from showc.script.language.fields import BOARDS
from showc.script.language.wording import number_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.script.mark import Mark
    from showc.script.sections.build import Sketch
    from showc.script.show import MissionOptions, Show, Transition


PX4_ITEMS = 500
"""Items on PX4's usual boards."""

ALWAYS = {"ardupilot": 7, "px4": 4}
"""Items besides those of legs: take-off, climb, pause, landing; ArduPilot's have home
too, and two speeds before the first leg."""

PER_LEG = 2
"""Items of a leg at least: slot, waypoint. Speeds and parts of seconds come on top."""

HOUR = 3600.0
"""After this the same minute and second come round [s]."""

UNMOVED = 0.05
"""A place that is nearer to one left may be the same for a mission [m]: its places are
whole 1e-7 degrees and centimetres."""

LEAST_TAKEOFF, LEAST_VERTICAL = 1.0, 0.15
"""Height of a take-off, and speed of a commanded climb or descent, both at least [m,
m/s]."""

_STRIDES = np.array([1, 1 << 21, 1 << 42])
"""Numbers of cells along the axes: places are within 10 km of the origin."""

METRES_PER_DEGREE = 110_500.0
"""Length of a degree of latitude, or of one of longitude at the equator; both are
longer [m]."""

DATE_LINE = (
    "the flight volume lies on both sides of the 180th meridian, where longitudes jump"
)
"""Why missions are impossible there."""

_MOST_COLOURS = 64
"""Of more colours none is looked for."""

_ROUNDING = 1e-9
"""By how much a mean of whole numbers may be above one."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """One thing that missions cannot carry."""

    message: str
    """What, with the number and its limit."""
    help: str
    """What to do."""
    key: tuple[str, ...]
    """Where the script says it: a key, or keys of a section."""
    mark: Mark | None = None
    """The same, if it stands elsewhere."""
    written: bool = False
    """Whether there are missions all the same."""


def item_budget(autopilot: str, board: str) -> int:
    """Return the greatest number of items a mission may have."""
    return PX4_ITEMS if autopilot == "px4" else BOARDS[board]


def mission_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield what missions cannot carry, where they are wanted (SHW308)."""
    show = sketch.show
    if show is None or not show.mission.wanted:
        return
    for found in refusals(show):
        settings = sketch.settings
        for section in found.key[:-1]:
            settings = settings.section(section)
        yield Diagnostic(
            "SHW308",
            found.message,
            found.mark or settings.mark_of(found.key[-1]),
            help=found.help,
            severity=Severity.WARNING,
        )


def refusals(show: Show, least: int | None = None) -> Iterator[Refusal]:
    """Yield all that is certain before anything is solved.

    ``least`` is how many items some mission has at least, if more is known of that than
    :func:`least_items` finds.
    """
    without = "write `mission: {wanted: false}` and fly the log"
    moving = next((one for one in show.transitions if one.motion), None)
    if moving is not None:
        yield Refusal(
            f"missions cannot carry the motion of `{moving.to}`",
            f"{without}, or leave `motion` out",
            ("transitions",),
            moving.mark,
        )
    if show.mission.autopilot == "px4":
        yield Refusal(
            "how PX4 flies missions is not known: they wait for no clock, and nothing "
            "of them is proved",
            f"{without}, or let a comment that passes over this finding say how they "
            "are flown",
            ("mission", "autopilot"),
            written=True,
        )
    elif (landing := least_landing(show)) >= HOUR:
        yield Refusal(
            f"missions land {number_text(round(landing / 60.0, 1))} min after their "
            "start, or later, and slots of minute and second come round within the "
            "hour",
            f"compile with --start, which names the hour, or {without}",
            ("transitions",),
        )
    if show.launch.altitude <= LEAST_TAKEOFF:
        yield Refusal(
            f"the launch ends {number_text(show.launch.altitude)} m above the pads, an "
            f"autopilot takes off to more than {number_text(LEAST_TAKEOFF)} m",
            f"raise `altitude`, or {without}",
            ("launch", "altitude"),
        )
    vertical = min(show.limits.velocity_max[2], -show.limits.velocity_min[2])
    if vertical < LEAST_VERTICAL:
        yield Refusal(
            f"the limits allow {number_text(vertical)} m/s up or down, an autopilot "
            f"heeds {number_text(LEAST_VERTICAL)} m/s at least",
            f"raise the limits of climb and descent, or {without}",
            ("limits",),
        )
    if crosses_date_line(show):
        yield Refusal(
            DATE_LINE,
            f"{without}, or give a `volume` on one side of it",
            ("site",),
        )
    autopilot, board = show.mission.autopilot, show.mission.board
    held = item_budget(autopilot, board)
    items = least_items(show) if least is None else least
    if items > held:
        holder = "PX4" if autopilot == "px4" else f"board `{board}`"
        yield Refusal(
            f"the mission of some drone has at least {items} items, {holder} holds "
            f"{held}",
            "choose a larger board, take transitions out, or leave the lights to "
            "another carrier",
            ("mission", "board"),
        )


def crosses_date_line(show: Show) -> bool:
    """Tell whether longitudes jump within the flight volume."""
    site, bearing = show.site, np.radians(show.site.heading)
    (west, south, _), (east, north, _) = site.volume_min, site.volume_max
    x, y = np.array([(west, south), (west, north), (east, south), (east, north)]).T
    north_by = (y * np.cos(bearing) - x * np.sin(bearing)) / METRES_PER_DEGREE
    # Degrees of longitude are shortest where the volume is nearest to a pole.
    latitude = float(np.abs(site.latitude + north_by).max())
    degree = METRES_PER_DEGREE * np.cos(np.radians(latitude))
    away = site.longitude + (x * np.cos(bearing) + y * np.sin(bearing)) / degree
    return bool((away >= 180.0).any() or (away <= -180.0).any())


def least_landing(show: Show) -> float:
    """Return a time after the start before which no mission lands [s].

    Missions arrive no sooner than the script asks, and hold for as long.
    """
    time = 0.0
    for members in chapters(show):
        together = [show.transitions[index] for index in members]
        known = [at for one in together if (at := arrival(one)) is not None]
        time = max([time, *known])
        own = own_times(together)
        time += rest(together) if own else max(one.hold for one in together)
    return time


def least_items(show: Show) -> int:
    """Return how many items the mission of some drone has at least.

    Every place that a transition reaches is reached by some drone: from elsewhere if
    none was there before, in another colour if none had this one. Of the drones of a
    group, or of the fleet, some one has as many of these as they have on average.
    """
    options = show.mission
    servos = 0 if options.light_servos is None else len(options.light_servos)
    always = ALWAYS[options.autopilot] + servos
    most = always + (PER_LEG + 1 + servos) * len(show.transitions)
    if most <= item_budget(options.autopilot, options.board):
        return always
    every = dict.fromkeys((None, *show.groups), 0.0)
    for index, one in enumerate(show.transitions):
        costs = _costs(show, index, lit=servos > 0)
        size = show.drones if one.group is None else len(show.groups[one.group])
        every[None] += float(costs.sum()) / show.drones
        if one.group is not None:
            every[one.group] += float(costs.sum()) / size
        elif len(costs) == size:
            # Every drone of every group has one of these places.
            for group in show.groups:
                every[group] += float(costs.min())
    return always + ceil(max(every.values()) - _ROUNDING)


def _costs(show: Show, index: int, *, lit: bool) -> IntArray:
    """Items at least of whichever drones reach a transition's places, (places,)."""
    one = show.transitions[index]
    pads = show.formations[show.pads].points
    left = [pads + np.array([0.0, 0.0, show.launch.altitude])]
    shown = [np.zeros((1, 3))]
    for other in show.transitions[:index]:
        if other.group is None or other.group == one.group:
            left, shown = [], []
        if one.group is None or other.group in {None, one.group}:
            left.append(show.formations[other.to].points)
            shown.append(_colours(show, other))
    if show.parking is not None:
        left.append(show.formations[show.parking].points)
        shown.append(np.zeros((1, 3)))
    goal = show.formations[one.to].points
    moved = ~np.isin(_cells(goal), _cells(np.concatenate(left), around=True))
    changed = np.zeros(len(goal), dtype=np.int64)
    if lit:
        before = np.unique(pulse_widths(show.mission, np.concatenate(shown)), axis=0)
        after = pulse_widths(show.mission, _colours(show, one))
        if len(before) <= _MOST_COLOURS:
            differs = after[:, None, :] != before
            changed = differs.sum(axis=2).min(axis=1)
    # Lights that change half way wait for it with an item more.
    half_way = one.fade == "linear" and show.mission.autopilot == "ardupilot"
    waits = moved & (changed > 0) & half_way
    return np.asarray(
        (moved | (changed > 0)) + moved.astype(np.int64) + changed + waits
    )


def _colours(show: Show, one: Transition) -> FloatArray:
    return show.formations[one.to].colours if one.colours is None else one.colours


def _cells(points: FloatArray, *, around: bool = False) -> IntArray:
    """Numbers of the small cubes of space that points are in, or are in or around."""
    cells = np.floor(points / UNMOVED).astype(np.int64)
    if around:
        steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 3)
        cells = (cells[:, None] + steps).reshape(-1, 3)
    return np.asarray(cells @ _STRIDES)


def pulse_widths(options: MissionOptions, colours: FloatArray) -> IntArray:
    """Pulse widths (n, 3) [us] of linear ``colours`` (n, 3), 0 to 1."""
    dark, full = options.light_pwm
    part = np.clip(colours, 0.0, 1.0)
    return np.rint(dark + part * (full - dark)).astype(np.int64)
