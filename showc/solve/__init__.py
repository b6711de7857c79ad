"""From an itinerary to a flight: least common times, kept apart, with certificates."""

from showc.solve.itinerary import solve_itinerary
from showc.solve.leg import solve_leg
from showc.solve.options import SolveOptions

__all__ = ["SolveOptions", "solve_itinerary", "solve_leg"]
