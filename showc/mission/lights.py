"""Colours of the drones at the legs, and the servo items that show them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from showc.mission.items import Command, MissionItem, without_position

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from showc.plan.itinerary import Leg
    from showc.script.show import MissionOptions, Show

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

Moment = Literal["start", "middle", "end"]

NO_LIGHTS = "the missions carry no lights: mission.light_servos names no outputs"


def leg_colours(show: Show, leg: Leg) -> FloatArray:
    """Linear red, green, blue (n, 3) of a leg's drones once they have arrived."""
    formation = show.formations[leg.to_formation]
    colours = formation.colours
    if leg.transition is not None:
        transition = show.transitions[leg.transition]
        if transition.colours is not None and transition.to == leg.to_formation:
            colours = transition.colours
    placed = leg.places >= 0
    chosen = colours[np.where(placed, leg.places, 0)]
    return np.asarray(np.where(placed[:, None], chosen, 0.0))


def pulse_widths(options: MissionOptions, colours: FloatArray) -> IntArray:
    """Pulse widths (n, 3) [us] of linear ``colours`` (n, 3), 0 to 1."""
    dark, full = options.light_pwm
    part = np.clip(colours, 0.0, 1.0)
    return np.rint(dark + part * (full - dark)).astype(np.int64)


def change_moment(show: Show, leg: Leg) -> Moment:
    """When during ``leg`` its drones change colour.

    A servo item changes at once; an even fade becomes one change half way.
    """
    if leg.transition is None:
        return "start"
    fade = show.transitions[leg.transition].fade
    return "middle" if fade == "linear" else fade


def lights_left_out(show: Show) -> tuple[str, ...]:
    """Say what of the show's colours its missions do not carry, a sentence each."""
    if show.mission.light_servos is None:
        return (NO_LIGHTS,)
    stepped, effects = [], []
    for transition in show.transitions:
        members = "" if transition.group is None else f" (group {transition.group})"
        if transition.fade == "linear":
            stepped.append(f"{transition.name}{members}")
        effect = transition.effect or show.formations[transition.to].effect
        if effect is not None:
            effects.append(f"{effect.kind} over {transition.to}{members}")
    found = []
    if effects:
        found.append(
            "colour effects are not in the missions, whose servo items only step: "
            + ", ".join(dict.fromkeys(effects))
        )
    if stepped:
        found.append(
            "even fades are single steps half way in the missions: "
            + ", ".join(stepped)
        )
    return tuple(found)


def light_items(
    options: MissionOptions, before: Sequence[int] | None, after: Sequence[int]
) -> list[MissionItem]:
    """Items that bring the three outputs to ``after`` [us], unchanged ones left out."""
    if options.light_servos is None:
        return []
    return [
        without_position(Command.DO_SET_SERVO, float(output), float(wanted))
        for index, (output, wanted) in enumerate(
            zip(options.light_servos, after, strict=True)
        )
        if before is None or before[index] != wanted
    ]
