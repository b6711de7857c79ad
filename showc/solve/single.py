"""One drone on one leg: in minimum time, or in a given time near a reference."""

from showc.solve.estimate import minimum_time_estimate
from showc.solve.following import follow, hover
from showc.solve.model import Aircraft
from showc.solve.result import HalfSpace, Result
from showc.solve.shortest import minimum_time

__all__ = [
    "Aircraft",
    "HalfSpace",
    "Result",
    "follow",
    "hover",
    "minimum_time",
    "minimum_time_estimate",
]
