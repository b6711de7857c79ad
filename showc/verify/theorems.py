"""The kernel's theorems about one show, as checks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from showc.verify.kernel.certificates import certified
from showc.verify.kernel.choreography import joined_up
from showc.verify.kernel.dynamics import radius, ties
from showc.verify.kernel.fence import Nearest, fenced, nearest
from showc.verify.kernel.limits import Extreme, extremes, kept
from showc.verify.kernel.separation import closest_of, encounter_parts, separated
from showc.verify.report import Check, Place

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from showc.log.showc_pb2 import Rules
    from showc.verify.kernel.separation import Encounter
    from showc.verify.kernel.show import LoggedShow, Segment, Statement


@dataclass(frozen=True, slots=True)
class Examined:
    """What is proved about one segment by itself."""

    radius: NDArray[np.float64]
    extremes: list[Extreme]
    nearest: Nearest | None


def segment_parts(show: LoggedShow) -> list[Callable[[], Examined]]:
    """Return the work on each segment."""
    return [partial(_examined, one, show.rules) for one in show.segments]


def _examined(segment: Segment, rules: Rules) -> Examined:
    return Examined(
        radius(segment, rules.vehicle),
        extremes(segment, rules),
        nearest(segment, rules.site),
    )


def separation_parts(show: LoggedShow) -> list[Callable[[], Any]]:
    """Return the work on each stretch of time."""
    return list(encounter_parts(show))


def check_choreography(show: LoggedShow) -> list[Check]:
    """Make all checks of how the show joins up."""
    return [check("choreography", one) for one in joined_up(show)]


def flight_checks(
    show: LoggedShow, examined: Sequence[Examined], encounters: Sequence[Encounter]
) -> list[Check]:
    """Join what the parts found, in the order of ``segment_parts``."""
    radii = [one.radius for one in examined]
    limits = kept(show, radii, [one.extremes for one in examined])
    fence = fenced(show, radii, [one.nearest for one in examined])
    apart = separated(show, radii, closest_of(encounters))
    return [
        *(check("physics", one) for one in ties(show, radii)),
        *(check("limits", one) for one in (*limits, fence)),
        check("separation", apart),
        *(check("certificates", one) for one in certified(show, encounters)),
    ]


def check(group: str, statement: Statement) -> Check:
    """Turn what the kernel proves into a check under a heading."""
    holds, drones = statement.holds, [drone + 1 for drone in statement.drones]
    return Check(
        statement.code,
        group,
        statement.title,
        "skipped" if holds is None else "pass" if holds else "fail",
        statement.value,
        statement.limit,
        statement.unit,
        Place(
            drones[0] if len(drones) == 1 else None,
            (drones[0], drones[1]) if len(drones) == 2 else None,
            statement.segment,
            statement.time,
        ),
        statement.notes,
    )
