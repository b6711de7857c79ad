"""The aircraft: physical parameters, limits, presets, equations of motion."""

from showc.vehicle.battery import Battery
from showc.vehicle.body import Body
from showc.vehicle.limits import Envelope, Limits, Separation, SeparationShape, Vector
from showc.vehicle.presets import DEFAULT_PRESET, PRESETS, Preset
from showc.vehicle.quadrotor import (
    CONTROL_NAMES,
    STANDARD_GRAVITY,
    STATE_NAMES,
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
