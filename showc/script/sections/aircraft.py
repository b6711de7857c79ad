"""The aircraft of a script: its parameters, its limits, and what two of them keep."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

from showc.script.diagnostic import ScriptError
from showc.script.language.wording import measured_text, number_text
from showc.vehicle import (
    PRESETS,
    Battery,
    Body,
    Envelope,
    Limits,
    Quadrotor,
    Separation,
    Vector,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.script.files import InputFiles
    from showc.script.language.reader import Reader
    from showc.script.language.settings import Settings
    from showc.script.show import Site

_OWN = {
    "mass", "arm_length", "thrust_coefficient", "torque_coefficient",
    "rotor_speed_max", "inertia",
}  # fmt: skip
"""Parameters that make another aircraft of a preset."""
MOST_TRACKING = 20.0
"""Greatest way that a drone may stray [m]: beyond it nothing is tracked."""
SURE = 0.999
"""Share of flights that a measured tube must hold to be planned with."""


def vehicle_of(settings: Settings) -> Quadrotor:
    """Return the preset, with the parameters the script gives itself."""
    vehicle = PRESETS[settings.text("preset")].vehicle
    if _OWN & settings.values.keys():
        vehicle = replace(vehicle, name="custom")
    return settings.over(vehicle)


def body_of(settings: Settings) -> Body:
    """Return how the aircraft falls: the preset's, with what the script gives."""
    body = settings.over(PRESETS[settings.text("preset")].body)
    return replace(body, drag_area=(min(body.drag_area), max(body.drag_area)))


def battery_of(aircraft: Settings, vehicle: Quadrotor) -> Battery:
    """Return what the aircraft flies on: the preset's, with what the script gives.

    Where no hover power is given, the preset's is taken for its weight, and its part
    that makes thrust grows with the weight to the power of 3/2.
    """
    preset, settings = PRESETS[aircraft.text("preset")], aircraft.section("battery")
    battery = settings.over(preset.battery)
    if "hover_power" in settings:
        return battery
    lifting = preset.battery.hover_power - preset.battery.idle_power
    weight = vehicle.hover_thrust / preset.vehicle.hover_thrust
    return replace(battery, hover_power=battery.idle_power + lifting * weight**1.5)


def limits_of(
    settings: Settings,
    aircraft: Settings,
    vehicle: Quadrotor,
    site: Site,
    reader: Reader,
) -> Limits | None:
    """Return the airframe's limits: the script's, else the preset's.

    None if the vehicle could not hover within them, or is no rigid body, which is then
    reported.
    """
    base = PRESETS[aircraft.text("preset")].limits
    custom = vehicle.name == "custom"
    speed = _each(settings, "speed", base.velocity_max)
    climb, descent = speed[2], speed[2]
    if "speed" not in settings:
        descent = -base.velocity_min[2]
    most = vehicle.thrust_max if custom else min(base.thrust_max, vehicle.thrust_max)
    torque = vehicle.torque_max if custom else base.torque_max
    if "torque" in settings:
        torque = settings.vector("torque")
    whole = replace(
        base,
        velocity_min=(-speed[0], -speed[1], -_given(settings, "descent", descent)),
        velocity_max=(speed[0], speed[1], _given(settings, "climb", climb)),
        thrust_max=most,
        torque_max=torque,
        position_min=site.room[0],
        position_max=site.room[1],
    )
    limits = replace(
        settings.over(whole), body_rate=_each(settings, "body_rate", base.body_rate)
    )
    sound = _can_hover(limits, vehicle, settings, aircraft, reader)
    sound &= _is_rigid(vehicle, aircraft, reader)
    return limits if sound else None


def envelope_of(aircraft: Settings) -> Envelope | None:
    """Return what the autopilot follows, if the flight is to keep it and it is known.

    Parameters
    ----------
    aircraft
        The script's vehicle.
    """
    if aircraft.text("envelope") == "airframe":
        return None
    return PRESETS[aircraft.text("preset")].envelope


def separation_of(settings: Settings, tracking: float) -> Separation:
    """Return the separation that paths keep.

    Parameters
    ----------
    settings
        What the script asks for.
    tracking
        How far each drone may stray from its path [m]: two of them, towards each other.
    """
    return settings.made(
        Separation, distance=settings.number("distance") + 2.0 * tracking
    )


SHOW_MODE = frozenset({"skyb", "skyc"})
"""Exports that Skybrush's show mode flies."""

FLOWN_APART = 0.14
"""How much nearer drones come in Skybrush's show mode than their files, at most, as
flown in calm air [m]."""

SHOW_MODE_TRACKING = 0.08
"""How far each drone may stray where show mode flies it [m]: half of the 0.14 m that
pairs were measured to lose in calm air, and twice what the fit of a file takes."""


def tracking_of(
    settings: Settings, exports: Sequence[Settings], files: InputFiles, reader: Reader
) -> float:
    """Return how far each drone may stray from its path [m].

    A number, or the tube of the whole show in a file that ``showc simulate`` wrote;
    ``reader`` hears what is wrong with that file. Unwritten, it is what show mode takes
    where ``exports`` are for it and do not say themselves what is left.
    """
    flown = any(
        one.text("to") in SHOW_MODE and "separation" not in one for one in exports
    )
    if flown and not settings.written("tracking"):
        return SHOW_MODE_TRACKING
    if settings.values["tracking"].value != "measured":
        return settings.number("tracking")
    name = settings.text("results")
    mark = settings.mark_of("results" if settings.written("results") else "tracking")
    try:
        whole = json.loads(files.read(name, "results"))["legs"][-1]
        radius, share = float(whole["radius"]), float(whole["share"])
        sound = 0.0 <= radius <= MOST_TRACKING and 0.0 <= share <= 1.0
    except ScriptError as fault:
        reader.refuse(fault, mark)
        return 0.0
    except (ValueError, KeyError, IndexError, TypeError, RecursionError):
        sound = False
    if not sound:
        reader.say(
            "SHW122",
            f"`{name}` has no tube of at most {MOST_TRACKING:g} m",
            mark,
            help_text="`showc simulate` writes such a file, beside the log of the show",
        )
        return 0.0
    if share < SURE:
        reader.say(
            "SHW122",
            f"the tube in `{name}` is sure to hold only {100.0 * share:.2f} % of "
            f"flights; expected {100.0 * SURE:g} %",
            mark,
            help_text="increase `--runs` of `showc simulate`: 2995 flights of single "
            "drones are enough",
        )
        return 0.0
    return radius


def _given(settings: Settings, key: str, default: float) -> float:
    """Return the number a script gives, or the default."""
    return settings.number(key) if key in settings else default


def _each(settings: Settings, key: str, default: Vector) -> Vector:
    """Return three numbers: those of a list, one number thrice, or the default."""
    if key not in settings:
        return default
    if isinstance(settings.values[key].value, list):
        return settings.vector(key)
    value = settings.number(key)
    return value, value, value


def _can_hover(
    limits: Limits,
    vehicle: Quadrotor,
    settings: Settings,
    aircraft: Settings,
    reader: Reader,
) -> bool:
    weight = vehicle.hover_thrust
    most = min(limits.thrust_max, vehicle.thrust_max)
    if limits.thrust_min < weight < most:
        return True
    low = weight <= limits.thrust_min
    key = "thrust_min" if low else "thrust_max"
    limit = limits.thrust_min if low else most
    span = settings.mark_of(key) if key in settings else aircraft.mark
    mass = number_text(vehicle.mass)
    reader.say(
        "SHW207",
        f"hovering needs {measured_text(weight)} N; the "
        f"{'least' if low else 'greatest'} thrust is {number_text(limit)} N",
        span,
        notes=(
            f"the weight of {mass} kg is {measured_text(weight)} N",
            f"the rotors produce at most {measured_text(vehicle.thrust_max)} N",
        ),
        help_text="change the thrust limits, the mass, or the rotors",
    )
    return False


def _is_rigid(vehicle: Quadrotor, aircraft: Settings, reader: Reader) -> bool:
    """Whether a body can have its inertia: no moment exceeds the sum of the others."""
    most = max(vehicle.inertia)
    others = sum(vehicle.inertia) - most
    if most <= (1.0 + 1e-9) * others:
        return True
    axis = "xyz"[vehicle.inertia.index(most)]
    reader.say(
        "SHW104",
        f"no body has a moment of inertia of {number_text(most)} kg m² about {axis}: "
        f"the other two add up to {measured_text(others)} kg m²",
        aircraft.mark_of("inertia") if "inertia" in aircraft else aircraft.mark,
        help_text="give all three as measured; of a flat frame, the one about z is the "
        "sum of the other two",
    )
    return False
