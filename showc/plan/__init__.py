"""Planning: each drone's way from place to place, before its time is known."""

from showc.plan.build import build_itinerary
from showc.plan.itinerary import Itinerary, Leg, LegKind

__all__ = ["Itinerary", "Leg", "LegKind", "build_itinerary"]
