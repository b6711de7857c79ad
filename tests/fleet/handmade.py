"""Legs and aircraft made by hand, without a script."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from showc.fleet.options import SolveOptions
from showc.plan.itinerary import Itinerary, Leg
from showc.progress import Silent
from showc.script.mark import Mark
from showc.vehicle import DEFAULT_PRESET, PRESETS, Separation

VEHICLE = PRESETS[DEFAULT_PRESET].vehicle
LIMITS = replace(
    PRESETS[DEFAULT_PRESET].limits,
    position_min=(-200.0, -200.0, -1.0),
    position_max=(200.0, 200.0, 200.0),
)
MARK = Mark("show.yaml", 12, 5, 12, 20)


def make_leg(
    start,
    goal,
    *,
    index=0,
    kind="transition",
    duration=None,
    limits=LIMITS,
    parked=None,
    name="move",
):
    start, goal = np.asarray(start, dtype=float), np.asarray(goal, dtype=float)
    count = start.shape[0]
    return Leg(
        index=index,
        name=name,
        kind=kind,
        drones=np.arange(count),
        start=start,
        goal=goal,
        from_formation="from",
        to_formation="to",
        places=np.arange(count),
        limits=limits,
        duration=duration,
        after=(index - 1,) if index else (),
        mark=MARK,
        others_parked=parked,
    )


def make_show(
    drones, *, separation=None, yaw="held", heading=0.0, fence=None, fence_margin=0.0
):
    return SimpleNamespace(
        vehicle=VEHICLE,
        airframe_limits=None,
        site=SimpleNamespace(fence=fence, fence_margin=fence_margin),
        separation=separation or Separation(1.0),
        yaw=yaw,
        heading=heading,
        drones=drones,
    )


def make_itinerary(legs, **options):
    return Itinerary(make_show(legs[0].drones.size, **options), tuple(legs))


class Listening(Silent):
    """Remembers what it was told."""

    def __init__(self):
        self.stages, self.notes, self.steps = [], [], 0

    def stage(self, title, total=None):
        self.stages.append((title, total))

    def advance(self, steps=1):
        self.steps += steps

    def note(self, text):
        self.notes.append(text)


def make_options(**changes):
    return SolveOptions(**{"jobs": 1, "use_cache": False, **changes})
