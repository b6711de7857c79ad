"""Rules of geometry: spacing, volume, fence, places for everyone, time for each move.

Each rule looks at a sketch, which may have gaps where something else is wrong, and
yields what it finds.
"""

from __future__ import annotations

from math import ceil, floor, sqrt
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import Diagnostic, Label, Severity, Spot
from showc.script.fence import LEAST, Fence, inside_polygon
from showc.script.formations.spacing import closest, crowded
from showc.script.language.settings import Settings
from showc.script.language.wording import (
    counted,
    measured_text,
    number_text,
    point_text,
)
from showc.script.rules.company import company_findings
from showc.script.rules.legible import legibility_findings
from showc.script.sections.aircraft import FLOWN_APART, SHOW_MODE_TRACKING
from showc.script.sections.gallery import bases_of
from showc.script.sections.motions import formations_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import BoolArray, FloatArray
    from showc.script.mark import Mark
    from showc.script.sections.build import Sketch
    from showc.script.show import Formation, Site


_SLACK = 1e-9
"""What counts as rounding: a share of distances, and [m]."""


def geometry_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield everything wrong with where the drones are to be."""
    yield from _spacing(sketch)
    yield from _volume(sketch)
    yield from _fence(sketch)
    yield from _ways(sketch)
    yield from _around(sketch)
    yield from _places(sketch)
    yield from _kept(sketch)
    yield from company_findings(sketch)
    yield from _unused(sketch)
    yield from legibility_findings(sketch)


def _spacing(sketch: Sketch) -> Iterator[Diagnostic]:
    """Places of one formation against the separation (SHW201, SHW202)."""
    separation = sketch.separation
    if separation is None:
        return
    distance = separation.distance
    section = sketch.settings.section("separation")
    asked = section.mark_of("distance")
    for formation in sketch.formations.values():
        pair = closest(formation.points, sqrt(2.0) * distance, separation)
        if pair is None:
            continue
        apart = measured_text(pair.distance, distance)
        where = [formation.points[place] for place in (pair.first, pair.second)]
        names = f"places {pair.first + 1} and {pair.second + 1} of `{formation.name}`"
        notes = tuple(
            f"place {place + 1} is at {point_text(point)}"
            for place, point in zip((pair.first, pair.second), where, strict=True)
        )
        if pair.distance < distance * (1.0 - _SLACK):
            tight = crowded(formation.points, distance, separation)
            if tight > 2:
                notes += (f"{tight} places are too close to another one",)
            if distance > section.number("distance"):
                notes += (_tracked(section, pair.distance),)
            # Pads that the script leaves out stand where it asks for the separation.
            unwritten = formation.name == "pads" and not sketch.settings.written("pads")
            mark = asked if unwritten else formation.mark
            yield Diagnostic(
                "SHW201",
                f"{names} are {apart} m apart; the separation is "
                f"{number_text(distance)} m" + _measure(separation.shape),
                mark,
                secondary=(Label(asked, "the separation"),)
                if section.written("distance") and asked.line != mark.line
                else (),
                notes=notes,
                help="with `all-axes` places differ in x, y and z, also on the "
                "ground: write them as `points`, or use another shape"
                if separation.shape == "all-axes"
                else f"{_larger(distance, pair.distance)}, or add `spread: true` to it",
                spot=Spot(formation.name, (pair.first, pair.second)),
            )
        elif separation.shape == "sphere":
            sure = measured_text(pair.distance / sqrt(2.0))
            yield Diagnostic(
                "SHW202",
                f"{names} are {apart} m apart, less than √2 times the separation "
                f"of {number_text(distance)} m",
                formation.mark,
                notes=(
                    (
                        f"in straight, simultaneous moves between such formations, "
                        f"drones may come as close as {sure} m"
                    ),
                    (
                        f"√2 × {number_text(distance)} m = "
                        f"{measured_text(sqrt(2.0) * distance)} m"
                    ),
                ),
                help="a wider formation is faster to reach, because drones do not "
                "have to fly around each other",
                spot=Spot(formation.name, (pair.first, pair.second)),
                severity=Severity.WARNING,
            )


def _tracked(section: Settings, apart: float) -> str:
    """Say why the separation is more than `distance`."""
    note = "the separation is `distance` plus twice `tracking`"
    if section.written("tracking"):
        return note
    left = floor(100.0 * (apart - FLOWN_APART) + 1e-6) / 100.0
    return (
        f"{note}; by default, `tracking` is the {SHOW_MODE_TRACKING:g} m that show "
        f"mode needs, unless `exports` have `separation: {left:g}` or less"
    )


def _larger(wanted: float, found: float) -> str:
    """Say by how much a formation must grow so that two places are far enough apart."""
    if found < _SLACK:
        return "move one of two places that are the same"
    times = number_text(ceil(100.0 * (wanted / found)) / 100.0)
    return f"make it {times} times as large (`transform: [{{scale: {times}}}]`)"


def _measure(shape: str) -> str:
    return "" if shape == "sphere" else f" (measured as `{shape}`)"


def _volume(sketch: Sketch) -> Iterator[Diagnostic]:
    """Places outside the flight volume, or too near its walls (SHW203)."""
    site = sketch.site
    if site is None:
        return
    low, high = map(np.array, site.walls)
    asked = sketch.settings.section("site").section("volume").mark
    for formation, points, hover, mark in _stands(sketch):
        what = _hovering(hover)
        beyond = np.maximum(low - points, points - high)
        worst = beyond.max(axis=1)
        count = int(np.sum(worst > _SLACK))
        if not count:
            continue
        place = int(np.argmax(worst))
        axis = int(np.argmax(beyond[place]))
        value = float(points[place, axis])
        above = value > high[axis]
        limit = float(high[axis] if above else low[axis])
        yield Diagnostic(
            "SHW203",
            f"place {place + 1} of `{formation.name}`{what} is outside the flight "
            f"volume: {'xyz'[axis]} is {number_text(value)} m, "
            f"{'at most' if above else 'at least'} {number_text(limit)} m is allowed",
            sketch.place(mark, asked),
            secondary=(Label(asked, "the volume"),)
            if asked.line != mark.line and sketch.written(asked, mark)
            else (),
            notes=(
                f"{count} of {len(points)} places are outside",
                (
                    f"the formation reaches from {point_text(points.min(axis=0))} to "
                    f"{point_text(points.max(axis=0))}"
                ),
                *wall_notes(site),
            ),
            help="move the formation, make it smaller, or enlarge `site: volume:`"
            if not hover
            else f"move the pads, or change `{hover}: altitude` or `site: volume:`",
            spot=Spot(formation.name, (place,)),
        )


def wall_notes(site: Site) -> tuple[str, ...]:
    """Say how near the walls drones may come, where these are the fence."""
    if site.fence is not None or not site.fence_margin:
        return ()
    kept = number_text(site.fence_margin)
    return (f"without `fence`, `fence_margin` keeps drones {kept} m from the walls",)


def _stands(sketch: Sketch) -> Iterator[tuple[Formation, FloatArray, str, Mark]]:
    """Yield everything drones hover in: formations, and the hovers above the pads.

    With the section that hovers, if any, and the place in the script that decides it.
    """
    for formation in sketch.formations.values():
        yield formation, formation.points, "", formation.mark
    pads = sketch.formations.get(sketch.pads)
    for key in ("launch", "landing"):
        section = sketch.settings.values.get(key)
        if pads is None or section is None or not isinstance(section.value, Settings):
            continue
        if not section.value.broken:
            lift = np.array([0.0, 0.0, section.value.number("altitude")])
            mark = section.value.mark_of("altitude")
            said = sketch.place(mark, pads.mark)
            yield pads, pads.points + lift, key, said


def _hovering(key: str) -> str:
    return f" at the {key} altitude" if key else ""


def _fence(sketch: Sketch) -> Iterator[Diagnostic]:
    """Places outside the geofence or nearer to it than the margin (SHW204)."""
    fence = None if sketch.site is None else Fence.of(sketch.site)
    if fence is None:
        return
    for formation in sketch.formations.values():
        outside = ~fence.keeps(formation.points[:, :2])
        if outside.any():
            clearance = fence.clearance(formation.points[:, :2])
            place = int(np.argmin(clearance))
            where = "outside the fence"
            if abs(clearance[place]) < LEAST:
                where = "on the fence"
            elif clearance[place] > 0.0:
                where = (
                    f"{number_text(float(clearance[place]))} m from the fence; the "
                    f"margin is {number_text(fence.margin)} m"
                )
            asked = sketch.settings.section("site").mark_of("fence")
            yield Diagnostic(
                "SHW204",
                f"place {place + 1} of `{formation.name}` is {where}",
                sketch.place(formation.mark, asked),
                secondary=(Label(asked, "the fence"),)
                if sketch.written(asked, formation.mark)
                else (),
                notes=(
                    f"it is at {point_text(formation.points[place])}",
                    (
                        f"{int(outside.sum())} of {len(formation.points)} places are "
                        "outside or too near"
                    ),
                ),
                help="move the formation or the fence",
                spot=Spot(formation.name, (place,)),
            )


def _ways(sketch: Sketch) -> Iterator[Diagnostic]:
    """Places that no way within the fence joins to the pads (SHW212)."""
    fence = None if sketch.site is None else Fence.of(sketch.site)
    pads = sketch.formations.get(sketch.pads)
    if fence is None or pads is None or not len(pads.points):
        return
    # Places that keep the margin lie in one part of the field or in several; one place
    # of the pads stands for the part in which the drones are.
    home = pads.points[0, :2]
    for item in sketch.settings.sound("transitions"):
        formation = sketch.formations.get(item.text("to"))
        if formation is None or not fence.keeps(formation.points[:, :2]).all():
            continue
        points = formation.points[:, :2]
        for place in np.flatnonzero(~fence.straight(home, points)).tolist():
            if fence.way(home, points[place]) is None:
                yield Diagnostic(
                    "SHW212",
                    f"no path from the pads to place {place + 1} of "
                    f"`{formation.name}` stays {number_text(fence.margin)} m inside "
                    "the fence",
                    item.mark_of("to"),
                    secondary=(
                        Label(
                            sketch.settings.section("site").mark_of("fence"), "fence"
                        ),
                    ),
                    notes=(f"the place is at {point_text(formation.points[place])}",),
                    help="widen the passage, or reduce `fence_margin`",
                )
                break


def _around(sketch: Sketch) -> Iterator[Diagnostic]:
    """Places above the ceiling, the audience or in a building (SHW214, SHW215)."""
    site = sketch.site
    if site is None:
        return
    section = sketch.settings.section("site")
    for formation, points, hover, mark in _stands(sketch):
        what = _hovering(hover)
        top = int(np.argmax(points[:, 2]))
        if site.ceiling is not None and points[top, 2] > site.ceiling + _SLACK:
            yield Diagnostic(
                "SHW214",
                f"place {top + 1} of `{formation.name}`{what} is "
                f"{number_text(float(points[top, 2]))} m high; the ceiling is "
                f"{number_text(site.ceiling)} m",
                sketch.place(mark, section.mark_of("ceiling")),
                secondary=(Label(section.mark_of("ceiling"), "the ceiling"),)
                if sketch.written(mark)
                else (),
                help=f"reduce `{hover}: altitude`, or raise `site: ceiling:`"
                if hover
                else "move the formation down, or raise `site: ceiling:`",
                spot=Spot(formation.name, (top,)),
            )
        for where, key, name, met in reached(site, points):
            if met.any():
                place = int(np.argmax(met))
                yield Diagnostic(
                    "SHW215",
                    f"place {place + 1} of `{formation.name}`{what} is {where} "
                    f"`{name}`",
                    sketch.place(mark, section.mark_of(key)),
                    secondary=(Label(section.mark_of(key), f"`{name}`"),)
                    if sketch.written(mark)
                    else (),
                    notes=(
                        f"it is at {point_text(points[place])}",
                        f"{int(met.sum())} of {len(points)} places are there",
                    ),
                    help="move the formation away",
                    spot=Spot(formation.name, (place,)),
                )


def reached(
    site: Site, points: FloatArray
) -> Iterator[tuple[str, str, str, BoolArray]]:
    """Yield what places, shape (n, 3) [m], may not be over or in, and which ones are.

    Each as ``over`` or ``in``, the key of the site, the name, and a mask of shape (n,).
    """
    level = points[:, :2]
    for people in site.audience:
        if people.area:
            met = inside_polygon(level, people.points)
            yield "over", "audience", people.name, met
    for building in site.buildings:
        met = inside_polygon(level, building.corners)
        met &= points[:, 2] <= building.height
        yield "in", "buildings", building.name, met


def _places(sketch: Sketch) -> Iterator[Diagnostic]:
    """Numbers of places against numbers of drones (SHW205)."""
    drones = sketch.drones
    if drones is None:
        return
    pads = sketch.formations.get(sketch.pads)
    if pads is not None and len(pads.points) < drones:
        yield Diagnostic(
            "SHW205",
            f"the pads `{pads.name}` have {counted(len(pads.points), 'place')} for "
            f"{counted(drones, 'drone')}",
            pads.mark,
            help="give every drone a pad",
        )
    for item in sketch.settings.sound("transitions"):
        formation = sketch.formations.get(item.text("to"))
        group = item.word("group")
        if formation is None or (group is not None and group not in sketch.groups):
            continue
        flying = drones if group is None else len(sketch.groups[group])
        places = len(formation.points)
        flown = counted(flying, "drone")
        flown += "" if group is None else f" of the group `{group}`"
        if places > flying or (places < flying and sketch.parking is None):
            yield Diagnostic(
                "SHW205",
                f"`{formation.name}` has {counted(places, 'place')} for {flown}",
                item.mark_of("to"),
                secondary=(Label(formation.mark, counted(places, "place")),),
                help="remove places, or let more drones fly there"
                if places > flying
                else "add places, or a `parking` formation for the other drones",
            )


def _kept(sketch: Sketch) -> Iterator[Diagnostic]:
    """Numbers of places that drones cannot keep, or perhaps not (SHW219).

    Of drones whose places are chosen, it is known which places they have among them.
    """
    show = sketch.show
    if show is None:
        return
    numbers = np.arange(show.drones)
    # Which transition chose the place of a drone, and for how many; -1: it is known.
    chosen, sizes = np.full(show.drones, -1), {-1: 0}
    for index, item in enumerate(show.transitions):
        every = range(show.drones) if item.group is None else show.groups[item.group]
        members, places = np.array(every), len(show.formations[item.to].points)
        if item.assignment != "keep":
            rank = np.arange(members.size)
            numbers[members] = np.where(rank < places, rank, -1)
            chosen[members] = -1 if item.assignment == "fixed" else index
            sizes[index] = members.size
            continue
        by, counts = np.unique(chosen[members], return_counts=True)
        whole = all(
            sizes[one] in {0, count} for one, count in zip(by, counts, strict=True)
        )
        same = np.array_equal(np.sort(numbers[members]), np.arange(places))
        unequal = places > members.size or (places < members.size and not show.parking)
        if (whole and same) or unequal:
            continue  # numbers that differ are a finding of their own
        theirs = ", ".join(str(place + 1) for place in np.sort(numbers[members])[:8])
        why = f"its drones have the places {theirs}" + ", …" * (members.size > 8)
        if (numbers[members] < 0).any():
            why = "some of its drones are parked"
        if not whole:
            why = "its drones come from part of a larger formation"
        yield Diagnostic(
            "SHW219",
            f"the drones cannot keep their places in `{item.to}`",
            sketch.ordered()[index].mark_of("assignment"),
            notes=(f"`{item.to}` has {counted(places, 'place')}; {why}",),
            help="write `assignment: optimal`, or `fixed`",
        )
        return


def _unused(sketch: Sketch) -> Iterator[Diagnostic]:
    """Find formations that nothing uses (SHW118)."""
    used = {item.text("to") for item in sketch.settings.sound("transitions")}
    used |= {
        name
        for item in sketch.settings.sound("transitions")
        for name in formations_of(item)
    }
    used |= {sketch.pads, sketch.parking or ""}
    if "formations" not in sketch.settings or "transitions" not in sketch.settings:
        return
    if len(sketch.settings.sound("transitions")) < len(
        sketch.settings.items("transitions")
    ):
        return  # one that could not be read may fly to it
    table = sketch.settings.section("formations").values
    if used - table.keys() - {sketch.pads, sketch.parking, ""}:
        return  # a name that is none may mean it
    for setting in table.values():
        if isinstance(setting.value, Settings):
            used |= set(bases_of(setting.value))
    for name, setting in table.items():
        broken = not isinstance(setting.value, Settings) or setting.value.broken
        if name not in used and not broken:
            yield Diagnostic(
                "SHW118",
                f"nothing uses the formation `{name}`",
                setting.key_mark,
                help="fly to it in a transition, or remove it",
                severity=Severity.WARNING,
            )
