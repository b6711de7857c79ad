"""Three answers about a show of others, kept apart.

What the file says, exactly; whether it can be flown, smoothed as little as an aircraft
needs; what the firmware makes of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import degrees
from typing import TYPE_CHECKING

from showc.errors import DamagedFileError
from showc.foreign.facts import Asked, own_rules, searched, what_it_says
from showc.foreign.firmware import Firmware, what_it_becomes
from showc.foreign.reading import read_show
from showc.foreign.smoothing import Agility, least_smoothing, smoothed
from showc.log.showc_pb2 import Separation
from showc.verify.kernel.separation import closest_in
from showc.verify.report import Check, Place, Verification

if TYPE_CHECKING:
    from pathlib import Path

    from showc.foreign.facts import Facts
    from showc.foreign.show import ForeignShow
    from showc.foreign.smoothing import Smoothed

GROUP = "whether it can be flown"
"""Heading of the second answer."""

MOST_ROWS = 120_000
"""Pieces up to which the smoothed fleet's separation is proved itself; beyond, it is
bounded by the file's less twice the tube."""

TILT = 0.5235987755982988
"""30 degrees: ArduCopter's default ANGLE_MAX [rad]."""

THRUST_MIN, THRUST_MAX = 0.5, 1.5
"""Least and greatest thrust over weight: what a show drone with half its thrust in
reserve gives without wind."""

_WORST_CORNERS = 3
"""Corners that are named."""


@dataclass(frozen=True, slots=True)
class Questions:
    """What a show of others is asked."""

    asked: Asked | None = None
    """The user's rules, beside the file's own."""
    agility: Agility = field(
        default_factory=lambda: Agility(TILT, THRUST_MIN, THRUST_MAX)
    )
    """What the aircraft can do."""
    firmware: Firmware = field(default_factory=Firmware)
    """Parameters of the firmware."""


def verify_foreign(path: Path, questions: Questions | None = None) -> Verification:
    """Judge a show of any known format.

    Raises
    ------
    UsageError
        If there is no such file, or its format is not known.
    """
    try:
        show = read_show(path)
    except DamagedFileError as error:
        return damaged(path, error)
    return judge(show, questions or Questions())


def judge(show: ForeignShow, questions: Questions) -> Verification:
    """Judge a show that was read."""
    rules = rules_for(show, questions)
    facts = what_it_says(show, rules)
    checks = [
        *facts.checks,
        *_flyable(show, facts, rules, questions.agility),
        *what_it_becomes(show, questions.firmware),
    ]
    trusted = " and ".join(f"{one.source} rules" for one in rules if one.any)
    trusted = trusted or "no rules: the file has none, and none were asked for"
    return Verification(
        show.path, show.title, show.drones, show.duration, trusted, tuple(checks)
    )


def rules_for(show: ForeignShow, questions: Questions) -> list[Asked]:
    """Return the file's own rules, and those that are asked for."""
    asked = [] if questions.asked is None else [questions.asked]
    return [own_rules(show), *asked]


def damaged(path: Path, error: DamagedFileError) -> Verification:
    """Return the result for a file that is not what it claims to be: one finding."""
    check = Check(
        "VRF501",
        "what the file says",
        "bytes are whole and sound",
        "fail",
        notes=(str(error),),
    )
    return Verification(str(path), path.stem, 0, 0.0, "nothing", (check,))


def _flyable(
    show: ForeignShow, facts: Facts, rules: list[Asked], agility: Agility
) -> list[Check]:
    """Say how much a show must be smoothed, and what that costs."""
    name = "least smoothing that the aircraft can follow"
    limits = (
        f"tilt {degrees(agility.tilt):g} deg, thrust {agility.thrust_min:g} to "
        f"{agility.thrust_max:g} of the weight"
    )
    found = least_smoothing(show.tracks, agility)
    if found is None:
        return [
            Check(
                "VRF521",
                GROUP,
                name,
                "fail",
                notes=(f"none keeps {limits}: no such aircraft flies this show",),
            )
        ]
    demand = found.demand
    checks = [
        Check(
            "VRF521",
            GROUP,
            name,
            "pass",
            found.width,
            None,
            "s",
            Place(drone=demand.tilt.drone + 1, time=demand.tilt.time),
            (
                (
                    f"{limits}; what is left: tilt {degrees(demand.tilt.upper):.1f} "
                    f"deg, thrust {-demand.lightest.upper:.2f} to "
                    f"{demand.thrust.upper:.2f}"
                ),
            ),
        ),
        Check(
            "VRF522",
            GROUP,
            "tube: how far the smoothed flight leaves the file",
            "pass",
            found.tube.upper,
            None,
            "m",
            Place(drone=found.tube.drone + 1, time=found.tube.time),
            tuple(
                f"{show.names[one.drone]}: {one.upper:.3f} m at {one.time:.2f} s"
                for one in found.corners[1:_WORST_CORNERS]
            ),
        ),
    ]
    return [*checks, *_smoothed_apart(show, facts, rules, found)]


def _smoothed_apart(
    show: ForeignShow, facts: Facts, rules: list[Asked], found: Smoothed
) -> list[Check]:
    """Separation of the smoothed fleet."""
    name = "separation of the smoothed flights"
    wanted = [asked for asked in rules if asked.separation is not None]
    if facts.closest is None:
        return []
    if found.width == 0.0:
        return [
            Check("VRF523", GROUP, name, "skipped", notes=("they are the file's own",))
        ]
    separation = Separation(distance=0.0, vertical_stretch=1.0)
    limit = None
    if wanted:
        assert wanted[-1].separation is not None  # noqa: S101 - chosen so
        separation = wanted[-1].separation
        limit = separation.distance
    place = Place()
    notes: tuple[str, ...] = ("the file's, less twice the tube",)
    value = facts.closest.lower - 2.0 * found.tube.upper
    if show.tracks.starts.size * 5 <= MOST_ROWS:
        soft = smoothed(show.tracks, found.width)
        closest = closest_in(soft, searched(soft, separation))
        assert closest is not None  # noqa: S101 - there are pairs
        value, notes = closest.lower, ()
        pair = closest.pair
        place = Place(pair=(pair[0] + 1, pair[1] + 1), time=closest.time)
    bad = limit is not None and value < limit - 1e-6
    return [
        Check(
            "VRF523",
            GROUP,
            name,
            "fail" if bad else "pass",
            value,
            limit,
            "m",
            place,
            notes,
        )
    ]
