"""From an itinerary to a flight: least common times, kept apart, with certificates."""

from showc.fleet.itinerary import solve_itinerary
from showc.fleet.leg import solve_leg
from showc.fleet.options import SolveOptions

__all__ = ["SolveOptions", "solve_itinerary", "solve_leg"]
