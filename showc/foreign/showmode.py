"""Whether show mode can follow a file: limits that were measured in flight.

Flown in the simulation of branch CMCopter-4.6 with its default quadrotor, in calm air,
from the end of the take-off to the last descent. Mode 3 at 50 Hz, and the parameters of
:mod:`showc.foreign.parameters`. Accelerations are those between joints a quarter of a
second apart: shorter peaks, where a file's acceleration jumps, did no harm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.foreign.motion import (
    Greatest,
    derivative,
    greatest,
    length,
    over_fleet,
    owners,
    values,
)
from showc.verify.report import Check, Place

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.log.showc_pb2 import Separation
    from showc.verify.kernel.separation import Encounter
    from showc.verify.kernel.slices import Tracks

GROUP = "whether show mode can follow it"
"""Heading of these checks."""

WINDOW = 0.25
"""Least time between the joints of which accelerations are formed [s]: the length of
the pieces that were flown."""

LOST = 0.14
"""How much nearer two drones came than their files, at most, in calm air [m], where
those leave 3 m or less: in five shows, up to eight drones at once. All fly by one clock
and err alike: far less than twice the tube."""
ROOM = 0.08
"""Way of each drone for which a script plans, so that a pair has it left [m]: half of
it, and the usual error of a fit."""


@dataclass(frozen=True, slots=True)
class Tube:
    """How far vehicles were from their files, and up to what they were asked."""

    acceleration: float
    """Sideways [m/s²]."""
    speed: float
    """Horizontal [m/s]."""
    radius: float
    """Greatest horizontal error [m]."""


TUBES = (Tube(4.2, 8.0, 0.30), Tube(5.0, 9.7, 0.50), Tube(6.0, 10.7, 0.55))
"""Flown, narrowest first."""

FITTED = 0.1
"""What the file of a flight may ask beyond the flight itself [m/s², m/s]. Limits above
are those of the solved flights; velocities at the joints of their files are rounded, on
a grid of 1 mm to 6 mm/s: over a quarter of a second 0.05 m/s²."""

UP, DOWN = 3.0, 3.8
"""Greatest acceleration up and down that was flown within ``HEIGHT`` [m/s²]."""

HEIGHT = 0.25
"""Greatest vertical error up to there [m]."""


@dataclass(frozen=True, slots=True)
class Followed:
    """Up to which accelerations a file is followed, as a fit aims at them."""

    sideways: tuple[float, ...]
    """By growing tube [m/s²]."""
    up: float
    """[m/s²]"""
    down: float
    """[m/s²]"""

    def limits(self, asked: FloatArray) -> FloatArray:
        """Limits that flights (n, 3) are within: sideways, up, down [m/s²].

        Infinite where a flight is within none.
        """
        limits = np.full(asked.shape, np.inf)
        for axis, levels in enumerate((self.sideways, (self.up,), (self.down,))):
            row = np.searchsorted(levels, asked[:, axis])
            limits[:, axis] = np.append(levels, np.inf)[row]
        return limits


FOLLOWED = Followed(
    tuple(tube.acceleration + 0.5 * FITTED for tube in TUBES),
    UP + 0.5 * FITTED,
    DOWN + 0.5 * FITTED,
)
"""What a fit aims at: half of what a file may ask beyond its flight is kept free."""


def what_show_mode_makes(
    tracks: Tracks,
    closest: Encounter | None,
    wanted: Separation | None,
) -> list[Check]:
    """Hold a file against what was flown.

    Parameters
    ----------
    tracks
        What the file says.
    closest
        Its closest encounter.
    wanted
        Separation that drones must keep in the air.
    """
    velocity = derivative(tracks)
    speed = over_fleet(velocity, lambda part: greatest(part, length((0, 1)), 1e-3))
    sideways, up, down = joint_accelerations(velocity)
    last = TUBES[-1]
    checks = [
        _check(
            f"sideways acceleration over {WINDOW:g} s",
            sideways,
            last.acceleration + FITTED,
            "m/s²",
        ),
        _check(f"upward acceleration over {WINDOW:g} s", up, UP + FITTED, "m/s²"),
        _check(f"downward acceleration over {WINDOW:g} s", down, DOWN + FITTED, "m/s²"),
        _check("horizontal speed", speed, last.speed + FITTED, "m/s"),
    ]
    fits = [
        tube
        for tube in TUBES
        if sideways.lower <= tube.acceleration + FITTED
        and speed.lower <= tube.speed + FITTED
    ]
    known = bool(fits) and all(check.verdict == "pass" for check in checks)
    checks.append(
        Check(
            "VRF562",
            GROUP,
            "tube around the file",
            "pass" if known else "fail",
            fits[0].radius if known else None,
            last.radius,
            "m",
            notes=(f"vertically {HEIGHT:g} m; calm air, as measured",)
            if known
            else (
                (
                    "no parameters that were tried follow this show: solve it for the "
                    "autopilot (`vehicle: {envelope: autopilot}`, as is usual), or "
                    "with gentler limits (tilt 15 deg, speed 5.5, 5.5, 3)"
                ),
            ),
        )
    )
    checks.append(_flown(closest, wanted, known=known))
    return checks


def joint_accelerations(velocity: Tracks) -> tuple[Greatest, Greatest, Greatest]:
    """Greatest acceleration sideways, up and down, between joints of a file [m/s²].

    It is the change of velocity from a joint to the next that is a quarter of a second
    later or more, over that time; a piece that lasts half a second or more counts as
    several. At joints a file has the velocity of the flight that was solved, but for
    rounding; between them a cubic overshoots where the flight's acceleration jumps.
    """
    parts = np.floor((velocity.ends - velocity.starts) / WINDOW + 1e-6)
    parts = np.maximum(parts.astype(np.int64), 1)
    # The last piece of a drone ends in a joint too.
    joints = parts.copy()
    joints[velocity.first[1:] - 1] += 1
    of = np.repeat(np.arange(parts.size), joints)
    share = (np.arange(of.size) - np.repeat(np.cumsum(joints) - joints, joints)) / (
        parts[of]
    )
    begin = values(velocity.position[of], share)
    starts = velocity.starts[of] + share * (velocity.ends - velocity.starts)[of]
    owner = owners(velocity)[of]
    offset = 2.0 * (velocity.end - velocity.begin + 1.0)
    key = starts - velocity.begin + offset * owner
    later = np.searchsorted(key, key + WINDOW - 1e-6)
    row = np.flatnonzero(later < of.size)
    row = row[owner[later[row]] == owner[row]]
    time = starts[later[row]] - starts[row]
    push = (begin[later[row]] - begin[row]) / time[:, None]
    kinds = (np.hypot(push[:, 0], push[:, 1]), push[:, 2], -push[:, 2])
    found = []
    for kind in kinds:
        worst = int(np.argmax(kind)) if kind.size else 0
        value = float(kind[worst]) if kind.size else 0.0
        place = int(row[worst]) if kind.size else 0
        found.append(Greatest(value, value, int(owner[place]), float(starts[place])))
    return found[0], found[1], found[2]


def _flown(
    closest: Encounter | None, wanted: Separation | None, *, known: bool
) -> Check:
    """Separation less what flying costs."""
    name = "separation as it will be flown"
    if closest is None or wanted is None:
        return Check("VRF563", GROUP, name, "skipped", notes=("nothing is asked",))
    if not known:
        return Check(
            "VRF563",
            GROUP,
            name,
            "fail",
            None,
            wanted.distance,
            "m",
            notes=("the vehicles do not follow the file, so nothing is known",),
        )
    value = closest.lower - LOST
    return Check(
        "VRF563",
        GROUP,
        name,
        "pass" if value >= wanted.distance else "fail",
        value,
        wanted.distance,
        "m",
        Place(pair=(closest.pair[0] + 1, closest.pair[1] + 1), time=closest.time),
        (
            (
                f"the file less {LOST:g} m that flying was measured to cost; plan for "
                f"it (`separation: tracking: {ROOM:g}`), or ask for less with "
                "--separation"
            ),
        )
        if value < wanted.distance
        else (f"the file less {LOST:g} m that flying was measured to cost",),
    )


def _check(name: str, found: Greatest, limit: float, unit: str) -> Check:
    return Check(
        "VRF561",
        GROUP,
        name,
        "pass" if found.lower <= limit else "fail",
        found.lower,
        limit,
        unit,
        Place(drone=found.drone + 1, time=found.time),
    )
