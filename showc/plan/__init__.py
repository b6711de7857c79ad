"""Planning: who flies from where to where, before anyone knows how fast."""

from showc.plan.build import build_itinerary, chapters
from showc.plan.itinerary import Itinerary, Leg, LegKind

__all__ = ["Itinerary", "Leg", "LegKind", "build_itinerary", "chapters"]
