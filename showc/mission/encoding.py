"""How one leg of the show becomes stages that an autopilot flies apart.

The straight line in the shortest common time comes first. Where the predicted flights
come too near, the encoding changes: drones leave one after the other, fly in other
times, along the solved flight's bend, in layers of height, or above the others. The
quickest that is proved is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from showc.errors import ExportError
from showc.mission.choices import candidates
from showc.mission.separation import Closest, closest_encounter
from showc.mission.space import leaves
from showc.mission.surroundings import Surroundings, stage_motion

if TYPE_CHECKING:
    from showc.flight import LegFlight
    from showc.mission.stage import Stage, StageBuilder
    from showc.plan.itinerary import Leg


@dataclass(frozen=True, slots=True, eq=False)
class Encoding:
    """The stages of one leg, proved apart."""

    name: str
    """What was done, in words."""
    stages: tuple[Stage, ...]
    """In order; none when no drone moves."""
    closest: tuple[Closest | None, ...]
    """Nearest encounter of each stage, times since its release [s]."""


def choose_encoding(
    leg: Leg, flight: LegFlight | None, builder: StageBuilder, around: Surroundings
) -> Encoding:
    """Return the first encoding of ``leg`` whose predicted flights keep apart.

    ``flight`` is the leg solved; None before that: then no bend can follow it.

    Raises
    ------
    ExportError
        If none does; names the pair, the time and the distance of the best one.
    """
    best: Closest | None = None
    outside: int | None = None
    for name, stages in candidates(leg, flight, builder, around):
        closest, positions = [], around.positions
        for stage in stages:
            out = stage.drones[leaves(stage, around.site)]
            if out.size:
                outside = outside or int(out[0]) + 1
                break
            found = closest_encounter(
                stage_motion(stage, positions, around.timing),
                around.separation,
                enough=around.required,
            )
            closest.append(found)
            if found is not None and found.distance < around.required:
                if best is None or found.distance > best.distance:
                    best = found
                break
            positions = positions.copy()
            positions[stage.drones] = stage.end
        else:
            return Encoding(name, tuple(stages), tuple(closest))
    raise _refusal(leg, best, around.separation.distance, outside)


def _refusal(
    leg: Leg, best: Closest | None, wanted: float, outside: int | None
) -> ExportError:
    if best is None and outside is not None:
        return ExportError(
            f"{leg.name}: the straight legs of missions leave the flight volume or the "
            f"fence (drone {outside}, with what an autopilot flies beyond its end); "
            "give the formations more room, or fly the show with `showc stream`"
        )
    if best is None:
        return ExportError(
            f"{leg.name}: no mission encoding of this leg was found; "
            "fly it with `showc stream`"
        )
    return ExportError(
        f"{leg.name}: drones {best.drone_a + 1} and {best.drone_b + 1} come as near as "
        f"{best.distance:.2f} m at {best.time:.1f} s of the leg on the flights that "
        f"the autopilot would make; wanted {wanted:g} m. "
        "Straight legs, more time, staggered releases, bends, layers of height and "
        "ways above the others were tried. Give "
        "the formations more room, or fly the show with `showc stream`"
    )


__all__ = ["Encoding", "Surroundings", "choose_encoding", "stage_motion"]
