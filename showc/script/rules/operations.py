"""Rules of operation: what authorities, radios, batteries and the ground ask for."""

from __future__ import annotations

from math import ceil, cos, floor, inf, sqrt, tan
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import Diagnostic, Label, Severity, Spot
from showc.script.fence import Fence, fence_distance
from showc.script.formations.spacing import closest
from showc.script.language.wording import measured_text, number_text
from showc.script.rules.least_time import least_mean_time
from showc.script.rules.missions import mission_findings
from showc.script.sections.aircraft import FLOWN_APART, SHOW_MODE
from showc.vehicle import PRESETS, Separation

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.script.mark import Mark
    from showc.script.sections.build import Sketch
    from showc.script.show import Export


CEILING = 120.0
"""Greatest height above ground without a special authorisation in most places [m]
(Regulation (EU) 2019/947, UAS.OPEN.010; 14 CFR 107.51 has 400 ft)."""
LEVEL_FLOOR = 2.5
"""Height below which autopilots of shows refuse level flight [m]."""
SMALL_SEPARATION = 1.5
"""Separation that needs better than the common satellite positioning [m]."""
TIGHT_PADS = 2.0
"""Spacing of take-off grids outdoors [m]."""
UNEVEN = 1.0
"""Height of a pad that uneven ground explains [m]."""
NETWORK = 250
"""Vehicles that one MAVLink network can address."""
BATTERY = 720.0
"""Time that batteries of show drones reliably last [s]."""
CRAZYFLIE_REACH = 32.767
"""Furthest coordinate of a Crazyflie's compressed trajectory, 16 bits of 1 mm [m]."""
FLOWN = (6.0, 3.0, 3.8)
"""Accelerations sideways, up and down up to which Skybrush's show mode was flown
[m/s²]."""
REACTION = 1.0
"""Time from a fault to the reaction of pilot or autopilot [s]."""


def operation_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield what deserves a look before the show is flown (SHW3xx)."""
    yield from _heights(sketch)
    yield from _separation(sketch)
    yield from _pads(sketch)
    yield from _fleet(sketch)
    yield from _battery(sketch)
    yield from _fence_margin(sketch)
    yield from mission_findings(sketch)
    yield from _exports(sketch)
    yield from _servos(sketch)


def _warning(
    code: str,
    message: str,
    span: Mark,
    help_text: str,
    *,
    notes: tuple[str, ...] = (),
    secondary: tuple[Label, ...] = (),
) -> Diagnostic:
    return Diagnostic(
        code,
        message,
        span,
        notes=notes,
        help=help_text,
        secondary=secondary,
        severity=Severity.WARNING,
    )


def _heights(sketch: Sketch) -> Iterator[Diagnostic]:
    """Too high for the rules (SHW301), too low for level flight (SHW302).

    What is outside the volume is a finding of its own.
    """
    site = sketch.site
    lowest, highest = (
        (-inf, inf) if site is None else (site.volume_min[2], site.volume_max[2])
    )
    for formation in sketch.formations.values():
        heights = formation.points[:, 2]
        place = int(np.argmax(heights))
        top = float(heights[place])
        if CEILING < top <= highest:
            yield _warning(
                "SHW301",
                f"place {place + 1} of `{formation.name}` is {number_text(top)} m "
                "above the ground, more than the usual ceiling of "
                f"{number_text(CEILING)} m",
                formation.mark,
                "fly lower, or ignore this finding with a comment that names the "
                "authorisation",
                notes=(f"{int(np.sum(heights > CEILING))} places are above it",),
            )
        place = int(np.argmin(heights))
        low = float(heights[place])
        grounded = formation.name in {sketch.pads, sketch.parking}
        if lowest <= low < LEVEL_FLOOR and not grounded:
            yield _warning(
                "SHW302",
                f"place {place + 1} of `{formation.name}` is {number_text(low)} m "
                f"above the ground, below {number_text(LEVEL_FLOOR)} m",
                formation.mark,
                "raise the formation",
                notes=("show autopilots refuse to fly sideways below that height",),
            )
    for key in ("launch", "landing"):
        if key not in sketch.settings.values:
            continue
        section = sketch.settings.section(key)
        if section.broken or section.number("altitude") >= LEVEL_FLOOR:
            continue
        height = number_text(section.number("altitude"))
        yield _warning(
            "SHW302",
            f"drones fly sideways {height} m above the pads, lower than "
            f"{number_text(LEVEL_FLOOR)} m",
            section.mark_of("altitude"),
            f"raise `{key}: altitude:`",
        )


def _separation(sketch: Sketch) -> Iterator[Diagnostic]:
    """Find a separation that needs precise positioning (SHW303)."""
    separation = sketch.separation
    if separation is None or separation.distance >= SMALL_SEPARATION:
        return
    yield _warning(
        "SHW303",
        f"a separation of {number_text(separation.distance)} m is small for outdoors",
        sketch.settings.section("separation").mark_of("distance"),
        "fly with RTK or motion capture, or keep at least "
        f"{number_text(SMALL_SEPARATION)} m",
        notes=(
            (
                "satellite positioning is accurate to 2 to 3 m, with RTK to 0.01 to "
                "0.1 m"
            ),
        ),
    )


def _pads(sketch: Sketch) -> Iterator[Diagnostic]:
    """Find pads off the ground (SHW312), or closer than is usual (SHW304)."""
    pads = sketch.formations.get(sketch.pads)
    if pads is None:
        return
    heights = pads.points[:, 2]
    place = int(np.argmax(np.abs(heights)))
    if abs(heights[place]) > UNEVEN:
        yield _warning(
            "SHW312",
            f"pad {place + 1} is {number_text(round(float(heights[place]), 3))} m high",
            pads.mark,
            "lay the pads on the ground: `plane: horizontal`, and z = 0 in `centre`",
            notes=("drones start from their pads, and the ground is at z = 0",),
        )
    pair = closest(pads.points, TIGHT_PADS, Separation(TIGHT_PADS))
    if pair is None:
        return
    yield _warning(
        "SHW304",
        f"pads {pair.first + 1} and {pair.second + 1} are "
        f"{measured_text(pair.distance, TIGHT_PADS)} m apart",
        pads.mark,
        f"leave at least {number_text(TIGHT_PADS)} m between pads",
        notes=(
            (
                "near the ground drones drift in each other's airflow; usual take-off "
                "grids have 2 to 4 m"
            ),
        ),
    )


def _fleet(sketch: Sketch) -> Iterator[Diagnostic]:
    """More vehicles than one network addresses (SHW305)."""
    if sketch.drones is None or sketch.drones <= NETWORK:
        return
    yield _warning(
        "SHW305",
        f"the fleet has {sketch.drones} drones; one MAVLink network can address "
        f"{NETWORK}",
        sketch.settings.mark_of("drones"),
        f"split the fleet into {-(-sketch.drones // NETWORK)} networks",
    )


def _battery(sketch: Sketch) -> Iterator[Diagnostic]:
    """Find a show that outlasts its batteries, however it is planned (SHW306)."""
    show = sketch.show
    if show is None:
        return
    launch, landing = show.launch, show.landing
    total = launch.altitude / launch.climb_speed + launch.hold
    total += landing.altitude / landing.descent_speed + landing.hold
    if not show.groups:
        for index, transition in enumerate(show.transitions):
            move = transition.duration or least_mean_time(show, index)
            total += move + transition.hold
    if total > BATTERY:
        yield _warning(
            "SHW306",
            f"the show takes at least {number_text(round(total))} s, batteries of show "
            f"drones reliably last {number_text(BATTERY)} s",
            sketch.settings.mark_of("transitions"),
            "shorten the holds, or split the show",
        )


def _fence_margin(sketch: Sketch) -> Iterator[Diagnostic]:
    """Places from which a drone cannot stop before the fence (SHW307)."""
    show, site = sketch.show, sketch.site
    fence = None if site is None else Fence.of(site)
    if show is None or site is None or fence is None:
        return
    speed = float(np.hypot(*show.limits.velocity_max[:2]))
    braking = 2.0 * show.vehicle.gravity * tan(show.limits.tilt)
    needed = speed * REACTION + speed * speed / braking
    asked = sketch.settings.section("site").mark_of("fence")
    for formation in sketch.formations.values():
        distance = fence_distance(formation.points[:, :2], fence.corners)
        place = int(np.argmin(distance))
        # Others are outside, or on the fence: an error says so.
        if distance[place] >= needed or not fence.keeps(formation.points[:, :2]).all():
            continue
        yield _warning(
            "SHW307",
            f"place {place + 1} of `{formation.name}` is "
            f"{measured_text(float(distance[place]))} m from the fence; a drone at "
            f"full speed needs {measured_text(needed)} m to stop",
            sketch.place(formation.mark, asked),
            "move the formation inwards, or fly slower",
            notes=(
                (
                    f"{measured_text(speed)} m/s, {number_text(REACTION)} s to react, "
                    "then braking at the greatest tilt"
                ),
            ),
            secondary=(Label(asked, "the fence"),)
            if sketch.written(formation.mark)
            else (),
        )


def _servos(sketch: Sketch) -> Iterator[Diagnostic]:
    """Servo outputs that are to carry two colours (SHW111)."""
    show = sketch.show
    outputs = () if show is None else show.mission.light_servos or ()
    if len(set(outputs)) < len(outputs):
        yield Diagnostic(
            "SHW111",
            "`light_servos` names one output for two colours",
            sketch.settings.section("mission").mark_of("light_servos"),
            help="red, green and blue need an output each: `[9, 10, 11]`",
        )


def _exports(sketch: Sketch) -> Iterator[Diagnostic]:
    """Places that a format does not hold, or its firmware not keep (SHW309, SHW310)."""
    show = sketch.show
    if show is None:
        return
    given: dict[str, Mark] = {}
    for wish, section in zip(
        show.exports, sketch.settings.sections("exports"), strict=True
    ):
        if wish.to in given:
            yield Diagnostic(
                "SHW111",
                f"`{wish.to}` is exported twice, into one folder",
                section.mark,
                secondary=(Label(given[wish.to], "the other one"),),
                help="keep one of them, and write the other with `showc export`",
            )
        given[wish.to] = section.mark
        for formation in sketch.formations.values():
            far = np.abs(formation.points).max(axis=1)
            place = int(np.argmax(far))
            if wish.to == "crazyflie" and far[place] > CRAZYFLIE_REACH:
                yield Diagnostic(
                    "SHW309",
                    f"place {place + 1} of `{formation.name}` is "
                    f"{number_text(float(far[place]))} m from the "
                    f"origin along an axis; `crazyflie` reaches {CRAZYFLIE_REACH} m",
                    section.mark,
                    help="bring the formation nearer to the origin, or export `poly7`",
                    spot=Spot(formation.name, (place,)),
                )
        if wish.to != "kml":
            yield from _room(sketch, wish, section.mark)
        if wish.to in SHOW_MODE:
            yield from _followed(sketch, wish, section.mark)


def _room(sketch: Sketch, wish: Export, mark: Mark) -> Iterator[Diagnostic]:
    """Look for less room between drones than an export takes (SHW310)."""
    show = sketch.show
    assert show is not None  # noqa: S101 - exports are a show's
    flown = wish.to in SHOW_MODE
    taken = FLOWN_APART if flown else 2.0 * wish.tolerance
    kept = wish.separation
    if kept is None:
        kept = show.kept
    planned = show.separation.distance
    if planned >= kept + taken:
        return
    near = [
        f"`{formation.name}` has places {number_text(pair.distance)} m apart "
        f"({pair.first + 1} and {pair.second + 1})"
        for formation in sketch.formations.values()
        if (pair := closest(formation.points, kept + taken, show.separation))
    ]
    # Show mode takes its share wherever drones pass; rounding matters where they stand.
    if not near and not flown:
        return
    # Half of what is taken beside at least what must remain.
    asked = max(sketch.settings.section("separation").number("distance"), kept)
    room = ceil(50.0 * taken - 1e-6) / 100.0 + 0.01 * flown
    less = floor(100.0 * (planned - taken) + 1e-6) / 100.0
    help_text = (
        f"write `separation: {{distance: {number_text(asked)}, tracking: {room:g}}}`"
    )
    if less > 0.0:
        other = f"{{to: {wish.to}, separation: {number_text(less)}}}"
        help_text += f", or `{other}` to leave less"
    yield _warning(
        "SHW310",
        f"`{wish.to}` needs {number_text(kept + taken)} m between paths, but they keep "
        f"only {number_text(planned)} m",
        mark,
        help_text,
        notes=(
            (
                f"{'show mode' if flown else 'the format'} takes up to {taken:g} m, "
                f"and {number_text(kept)} m must remain; an export in which drones "
                "come closer is not proved"
            ),
            *near,
        ),
    )


def _followed(sketch: Sketch, wish: Export, mark: Mark) -> Iterator[Diagnostic]:
    """Look for limits that allow more than show mode was flown with (SHW311)."""
    show = sketch.show
    assert show is not None  # noqa: S101 - exports are a show's
    limits, mass = show.limits, show.vehicle.mass
    # Roll and pitch both at their limits leave the square of the cosine upright.
    level = cos(limits.tilt)
    allowed = (
        min(
            limits.acceleration or inf,
            limits.thrust_max / mass * sqrt(1.0 - level**4),
        ),
        min(
            limits.acceleration_up or inf,
            limits.thrust_max / mass - show.vehicle.gravity,
        ),
        min(
            limits.acceleration_down or inf,
            show.vehicle.gravity - limits.thrust_min / mass * level**2,
        ),
    )
    over = [
        f"{measured_text(one)} m/s² {name} ({most:g} was tested)"
        for one, most, name in zip(
            allowed, FLOWN, ("sideways", "up", "down"), strict=True
        )
        if one > most + 0.05
    ]
    if not over:
        return
    known = PRESETS[sketch.settings.section("vehicle").text("preset")].envelope
    yield _warning(
        "SHW311",
        f"the limits allow {', '.join(over)}; show mode is not known to follow such "
        f"flights, and an export to `{wish.to}` that needs them is not proved",
        mark,
        "write `vehicle: {envelope: autopilot}`"
        if known is not None
        else "write `limits: {acceleration: 4.2, acceleration_up: 3, "
        "acceleration_down: 3.8}`",
    )
