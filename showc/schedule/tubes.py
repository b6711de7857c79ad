"""How far beside the places that a proof reckons with drones are likely to be flown.

The proof of the separation has each drone on its straight leg, between the law's places
at the greatest and the least delay, the end's overshoot included. The flights
themselves leave that a little: a fast leg that climbs ends with a swing that is level,
beside its line. Legs that leave it by more than the width that flights were measured to
have are flown more slowly, and drones that have not settled wait for longer.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.following import law_time
from showc.autopilot.timing import CLOCK_LAG
from showc.schedule.distances import dot

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.autopilot.stage import Stage
    from showc.autopilot.timing import Timing
    from showc.autopilot.tracking import Tracks


BESIDE, BESIDE_FAST = 0.3, 0.06
"""How far beside its part of a line a drone may be [m], and by how much more for each
m/s of its speed [s]: the verifier holds drawn flights to the same."""

INSTANTS = 0.1
"""Time between places that are looked at [s]: a swing lasts for a second and more."""


def room_used(stage: Stage, tracks: Tracks, timing: Timing) -> FloatArray:
    """Return how much of the room beside its line each drone uses, shape (n,).

    At most 1 for a drone that keeps to it at all instants until its next leg.
    """
    profile, level = stage.profile, stage.level
    along = stage.end - stage.begin
    beyond = stage.farthest - stage.begin
    spread = timing.spread(profile.speed)
    used = np.zeros(len(profile))
    for since in np.arange(0.0, float(tracks.over.max(initial=0.0)), INSTANTS):
        live = since < tracks.until
        now = law_time(level, np.full(len(profile), since))
        times = np.stack([now - spread, now + spread])
        times = np.vstack([times, np.clip(0.5 * profile.duration, *times)])
        distance, speed, _ = profile.motion(times)
        part = distance / np.where(profile.length > 0.0, profile.length, 1.0)
        rear = part[0][:, None] * along
        way = part[1][:, None] * beyond - rear
        from_rear = tracks.places(np.full(len(profile), since)) - rear
        size = dot(way, way)
        share = dot(from_rear, way) / np.where(size > 0.0, size, 1.0)
        aside = from_rear - np.clip(share, 0.0, 1.0)[:, None] * way
        room = BESIDE + BESIDE_FAST * speed.max(axis=0)
        used = np.maximum(used, np.where(live, np.sqrt(dot(aside, aside)) / room, 0.0))
    return used


def off_end(tracks: Tracks) -> FloatArray:
    """How far each drone is off its end when its next leg begins, shape (n,) [m].

    That leg's proof has it there from its slot on, and clocks most likely are late by
    half of their lag; 0 for a drone without a next leg.
    """
    slot = np.maximum(tracks.until - 0.5 * CLOCK_LAG, 0.0)
    left = tracks.along - tracks.places(slot)
    return np.asarray(np.sqrt(dot(left, left)))
