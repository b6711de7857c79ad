"""One drone on one leg: in minimum time, or in a given time near a reference."""

from showc.fleet.shared_profile.estimate import minimum_time_estimate
from showc.fleet.single_drone.following import follow, hover
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.result import Result
from showc.fleet.single_drone.shortest import minimum_time

__all__ = [
    "Aircraft",
    "Result",
    "follow",
    "hover",
    "minimum_time",
    "minimum_time_estimate",
]
