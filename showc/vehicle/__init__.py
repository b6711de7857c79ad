"""The aircraft: physical parameters, limits, presets."""

from showc.vehicle.limits import Limits, Separation, SeparationShape, Vector
from showc.vehicle.quadrotor import (
    CONTROL_NAMES,
    STANDARD_GRAVITY,
    STATE_NAMES,
    Quadrotor,
)

__all__ = [
    "CONTROL_NAMES",
    "STANDARD_GRAVITY",
    "STATE_NAMES",
    "Limits",
    "Quadrotor",
    "Separation",
    "SeparationShape",
    "Vector",
]
