"""The aircraft: physical parameters, limits, presets, equations of motion."""

from showc.vehicle.limits import Envelope, Limits, Separation, SeparationShape, Vector
from showc.vehicle.power import Battery
from showc.vehicle.presets import DEFAULT_PRESET, PRESETS, Preset
from showc.vehicle.quadrotor import (
    CONTROL_NAMES,
    STANDARD_GRAVITY,
    STATE_NAMES,
    Body,
    Quadrotor,
)

__all__ = [
    "CONTROL_NAMES",
    "DEFAULT_PRESET",
    "PRESETS",
    "STANDARD_GRAVITY",
    "STATE_NAMES",
    "Battery",
    "Body",
    "Envelope",
    "Limits",
    "Preset",
    "Quadrotor",
    "Separation",
    "SeparationShape",
    "Vector",
]
