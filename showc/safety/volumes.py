"""Volumes of the LBA's guide: contingency volume and ground risk buffer.

Luftfahrt-Bundesamt, Guideline for the dimensioning of flight geography, contingency
volume and ground risk buffer, revision 1.7 (2024), for multirotors.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt, tan
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from showc.script.show import Risk

CLIMB_SHARE = 0.7
"""Share of the speed that climbs in a reaction at 45° (the guide's 0.7)."""


@dataclass(frozen=True, slots=True)
class Flying:
    """What the formulas take from a show."""

    speed: float
    """V0, greatest ground speed with the wind [m/s]."""
    height: float
    """H_FG, greatest height over the ground that is flown [m]."""
    size: float
    """CD, from tip to tip [m]."""
    tilt: float
    """Greatest tilt of the stopping manoeuvre [rad]."""
    gravity: float
    """[m/s²]."""


@dataclass(frozen=True, slots=True)
class Buffers:
    """Distances around the flight geography [m]."""

    reaction: float
    """S_RZ = V0 t_R."""
    manoeuvre: float
    """S_CM = V0² / (2 g tan tilt)."""
    contingency: float
    """S_CV = S_GPS + S_Pos + S_K + S_RZ + S_CM."""
    height_reaction: float
    """H_RZ = 0.7 V0 t_R."""
    height_manoeuvre: float
    """H_CM = V0² / (2 g)."""
    height: float
    """H_CV = H_FG + H_baro + H_RZ + H_CM."""
    one_to_one: float
    """S_GRB = H_CV + CD / 2."""
    ballistic: float
    """S_GRB = V0 sqrt(2 H_CV / g) + CD / 2."""


def buffers(flying: Flying, risk: Risk) -> Buffers:
    """Evaluate the guide's formulas for a multirotor."""
    speed, gravity = flying.speed, flying.gravity
    reaction = speed * risk.reaction_time
    manoeuvre = speed**2 / (2.0 * gravity * tan(flying.tilt))
    rise = speed**2 / (2.0 * gravity)
    climb = CLIMB_SHARE * reaction
    height = flying.height + risk.height_error + climb + rise
    half = 0.5 * flying.size
    return Buffers(
        reaction=reaction,
        manoeuvre=manoeuvre,
        contingency=risk.misplaced + reaction + manoeuvre,
        height_reaction=climb,
        height_manoeuvre=rise,
        height=height,
        one_to_one=height + half,
        ballistic=speed * sqrt(2.0 * height / gravity) + half,
    )
