"""Three answers about a foreign show, kept apart.

What the file says, exactly; whether it can be flown, smoothed as little as an aircraft
needs; what the firmware makes of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from math import degrees
from typing import TYPE_CHECKING

from showc.errors import DamagedFileError
from showc.foreign.facts import (
    NO_LIMIT,
    ROUNDING,
    Asked,
    all_pairs,
    each_alone,
    own_rules,
    searched,
    searches,
)
from showc.foreign.firmware import Firmware, what_it_becomes
from showc.foreign.reading import read_show
from showc.foreign.smoothing import Agility, least_smoothing, smoothed
from showc.log.showc_pb2 import Separation
from showc.processes import side_by_side
from showc.verify.kernel.separation import closest_in, closest_of
from showc.verify.report import Check, Place, Verification

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    from showc.foreign.show import ForeignShow
    from showc.foreign.smoothing import Smoothed
    from showc.verify.kernel.separation import Encounter
    from showc.verify.report import Standing, Verdict

INTEGRITY = "integrity"
"""Heading of the checks of the files themselves."""

GROUP = "whether it can be flown"
"""Heading of the second answer."""

MOST_ROWS = 120_000
"""Pieces up to which the smoothed fleet's separation is proved itself; beyond, it is
bounded by the file's less twice the tube."""

SPANS = 4
"""Parts of a great show's time that are searched side by side."""

GREAT = 20_000
"""Pieces from which on the answers are sought side by side."""

TILT = 0.5235987755982988
"""30 degrees: ArduCopter's default ANGLE_MAX [rad]."""

THRUST_MIN, THRUST_MAX = 0.5, 1.5
"""Least and greatest thrust over weight: what a show drone with half its thrust in
reserve gives without wind."""


DRAWINGS = {"glTF", ".vviz"}
"""Formats that are drawn by and not flown by."""


class Unflown(Verification):
    """The result for what nothing flies, or nothing was asked about.

    Its flights may be proved as they are drawn or measured; a badge is not green.
    """

    __slots__ = ()

    @property
    def trajectories(self) -> Standing:
        """What came of the flights in it; none where only hashes were looked at."""
        if all(c.group == INTEGRITY and c.verdict != "fail" for c in self.checks):
            return "none"
        return super().trajectories

    @property
    def proved(self) -> bool:
        """Never: there is nothing to fly."""
        return False

    @property
    def passed(self) -> bool:
        """Whether nothing is wrong with what is in it."""
        return self.trajectories != "not proved"

    @property
    def verdict(self) -> str:
        """One line that begins with what is missing."""
        said = super().verdict.partition(": ")[2]
        return f"{self._head()}: {said}"

    def _head(self) -> str:
        raise NotImplementedError


class Drawing(Unflown):
    """Of a format that no aircraft flies."""

    __slots__ = ()

    def _head(self) -> str:
        return "A DRAWING, NOT FLOWN" if self.passed else "NOT PROVED"


class Measured(Unflown):
    """Of a file that was measured, but not held against a least distance."""

    __slots__ = ()

    def _head(self) -> str:
        return "MEASURED, NOT JUDGED" if self.passed else "NOT PROVED"


@dataclass(frozen=True, slots=True)
class Questions:
    """What a foreign show is asked."""

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
    # No firmware ever reads a drawing.
    firmware = None if show.format in DRAWINGS else questions.firmware
    found = answer(show, rules, firmware, questions.agility)
    checks = [
        *found.facts,
        *_flyable(show, found, rules, questions.agility),
        *found.becomes,
    ]
    trusted = " and ".join(f"{one.source} rules" for one in rules if one.any)
    trusted = trusted or "no rules: the file has none, and none were asked for"
    kind = Verification
    if show.format in DRAWINGS:
        kind = Drawing
    elif show.drones > 1 and all(one.separation is None for one in rules):
        kind = Measured
    return kind(
        show.path, show.title, show.drones, show.duration, trusted, tuple(checks)
    )


@dataclass(frozen=True, slots=True)
class Answers:
    """What was found about a show."""

    facts: list[Check]
    """What the file says."""
    closest: Encounter | None
    """Closest encounter by the rules that ask for one last; None: one drone."""
    becomes: list[Check]
    """What the firmware makes of it."""
    soft: Smoothed | None
    """Smoothed as little as the aircraft needs; None: no smoothing is enough."""
    soft_closest: Encounter | None
    """Closest encounter of the smoothed fleet; None: it was not sought."""


def answer(
    show: ForeignShow,
    rules: list[Asked],
    firmware: Firmware | None,
    agility: Agility | None = None,
) -> Answers:
    """Find the answers, those about a great show side by side.

    Parameters
    ----------
    show
        The file.
    rules
        What it is held against.
    firmware
        Parameters of the firmware; None: it is not asked.
    agility
        What the aircraft can do; None: it is not asked whether it can be flown.
    """

    def becomes() -> list[Check]:
        return [] if firmware is None else what_it_becomes(show, firmware)

    great = show.tracks.starts.size >= GREAT
    sought = searches(show.tracks, rules, SPANS if great else 1)
    parts: list[Callable[[], Any]] = [
        *(one for some in sought.values() for one in some),
        becomes,
        partial(each_alone, show, rules),
    ]
    *near, made, alone = side_by_side(parts, None if great else 1)
    closest = {
        measure: closest_of([near.pop(0) for _ in some])
        for measure, some in sought.items()
    }
    apart = all_pairs(show, rules, closest)
    soft, soft_closest = _soften(show, rules, agility)
    facts = sorted([*alone, *apart[0]], key=lambda check: check.code)
    return Answers(facts, apart[1], made, soft, soft_closest)


def _soften(
    show: ForeignShow, rules: list[Asked], agility: Agility | None
) -> tuple[Smoothed | None, Encounter | None]:
    """Smooth a show as little as needed, and find its closest encounter then."""
    found = None if agility is None else least_smoothing(show.tracks, agility)
    small = show.tracks.starts.size * 5 <= MOST_ROWS and show.drones > 1
    if found is None or found.width == 0.0 or not small:
        return found, None
    soft = smoothed(show.tracks, found.width)
    return found, closest_in(soft, searched(soft, _separation(rules)))


def _separation(rules: list[Asked]) -> Separation:
    """Return the separation that was asked for last; nothing asked: a sphere of 0 m."""
    wanted = [one.separation for one in rules if one.separation is not None]
    return wanted[-1] if wanted else Separation(distance=0.0, vertical_stretch=1.0)


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
    show: ForeignShow, answers: Answers, rules: list[Asked], agility: Agility
) -> list[Check]:
    """Say how much a show must be smoothed, and what that costs."""
    name = "least smoothing that the aircraft can follow"
    limits = (
        f"tilt {degrees(agility.tilt):g} deg, thrust {agility.thrust_min:g} to "
        f"{agility.thrust_max:g} of the weight"
    )
    found = answers.soft
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
                for one in found.corners[1:]
            ),
        ),
    ]
    return [*checks, *_smoothed_apart(answers, rules, found)]


def _smoothed_apart(
    answers: Answers, rules: list[Asked], found: Smoothed
) -> list[Check]:
    """Separation of the smoothed fleet."""
    name = "separation of the smoothed flights"
    if answers.closest is None:
        return []
    if found.width == 0.0:
        return [
            Check("VRF523", GROUP, name, "skipped", notes=("they are the file's own",))
        ]
    asked = any(one.separation is not None for one in rules)
    limit = _separation(rules).distance if asked else None
    place, notes = Place(), ["the file's, less twice the tube"]
    value = answers.closest.lower - 2.0 * found.tube.upper
    closest = answers.soft_closest
    if closest is not None:
        value, notes = closest.lower, []
        pair = closest.pair
        place = Place(pair=(pair[0] + 1, pair[1] + 1), time=closest.time)
    verdict: Verdict = "pass"
    if limit is None:
        verdict = "skipped"
        notes.append(NO_LIMIT)
    elif value < limit - ROUNDING:
        verdict = "fail"
    return [
        Check("VRF523", GROUP, name, verdict, value, limit, "m", place, tuple(notes))
    ]
