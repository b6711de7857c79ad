"""Straight-line shows for the mission tests: shift, swap, and a many-legged one."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
from synthetic import (
    fly,
    formation,
    gliding_trajectory,
    grid,
    hold_trajectory,
    make_show,
    move_time,
    raised,
    vertical_trajectory,
)

from showc.fleet.lanes import _flown
from showc.fleet.timetable import scheduled
from showc.flight import Certificate, Flight, LegFlight
from showc.script.show import MissionOptions

START = datetime(2026, 6, 1, 20, 0, 0, tzinfo=UTC)


def shift_flight(drones, shift=(12.0, 8.0, 4.0), spacing=2.0, options=None, fades=()):
    """A grid goes up, becomes green, shifts, comes back and lands."""
    pads = grid(drones, spacing)
    level = raised(pads, 6.0)
    first = raised(pads, 8.0)
    second = first + np.array(shift)
    return _show(pads, level, first, second, options=options, fades=fades)


def hop_flight(drones=3, altitude=2.0):
    """A short show: up, higher, back and down, within a few metres and seconds."""
    pads = grid(drones)
    level, top = raised(pads, altitude), raised(pads, 3.5)
    formations = [
        formation("pads", pads, [0.0, 0.0, 0.0]),
        formation("top", top, [1.0, 1.0, 1.0]),
    ]
    show = make_show(formations, drones, holds=[0.5], altitude=altitude)
    show = replace(
        show,
        launch=replace(show.launch, hold=0.5),
        landing=replace(show.landing, hold=0.5),
    )
    stops = [
        ("pads", "pads", pads, None),
        ("launch", "above", level, None),
        ("transition", "top", top, 0),
        ("approach", "above to land", level, None),
        ("land", "pads", pads, None),
    ]
    return fly(show, stops, vertical_trajectory)


def swap_flight(drones=6, radius=8.0):
    """Drones on a ring go to the opposite place, all at once through the middle."""
    angle = np.arange(drones) * 2.0 * np.pi / drones
    ring = radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    return _show(ring, raised(ring, 6.0), raised(ring, 8.0), raised(-ring, 8.0))


def mixed_flight(drones, target, seed=0):
    """Fly from a grid to random places of a plane, a ball or a cube, and back."""
    pads = grid(drones, 3.0)
    first = raised(pads, 10.0)
    number = np.arange(drones)
    if target == "plane":
        places = first
    elif target == "ball":
        radius = max(4.0, 0.75 * drones**0.5)
        polar = np.arccos(1.0 - (2.0 * number + 1.0) / drones)
        turn = np.pi * (1.0 + 5.0**0.5) * (number + 0.5)
        ball = [
            np.cos(turn) * np.sin(polar),
            np.sin(turn) * np.sin(polar),
            np.cos(polar),
        ]
        places = radius * np.stack(ball, axis=1) + [0.0, 0.0, 12.0 + radius]
    else:
        edge = int(np.ceil(drones ** (1.0 / 3.0)))
        cell = np.stack([number % edge, number // edge % edge, number // edge**2], 1)
        places = 2.5 * cell + [-1.25 * edge, -1.25 * edge, 12.0]
    mixed = places[np.random.default_rng(seed).permutation(drones)]
    return _show(pads, raised(pads, 6.0), first, mixed)


def _show(pads, level, first, second, *, options=None, fades=()):
    formations = [
        formation("pads", pads, [0.0, 0.0, 0.0]),
        formation("red", first, [1.0, 0.0, 0.0]),
        formation("green", second, [0.0, 1.0, 0.0]),
    ]
    show = make_show(
        formations,
        len(pads),
        holds=[2.0, 5.0],
        altitude=6.0,
        fades=fades or ("start",),
    )
    show = replace(show, mission=options or MissionOptions())
    stops = [
        ("pads", "pads", pads, None),
        ("launch", "above", level, None),
        ("transition", "red", first, 0),
        ("transition", "green", second, 1),
        ("approach", "above to land", level, None),
        ("land", "pads", pads, None),
    ]
    return fly(show, stops, gliding_trajectory)


def formula_flight(itinerary):
    """Fly any itinerary on straight lines, without solving anything."""
    show = itinerary.show
    times = {
        leg.index: move_time(leg.start, leg.goal, 4.0)
        for leg in itinerary.legs
        if leg.open
    }
    itinerary = scheduled(itinerary, times)
    flights, starts, clock = [], [], 0.0
    for leg in itinerary.legs:
        moves = tuple(
            LegFlight(
                part,
                part.duration,
                tuple(
                    gliding_trajectory(
                        show.vehicle, start, goal, part.duration, show.heading
                    )
                    for start, goal in zip(part.start, part.goal, strict=True)
                ),
                Certificate(part.duration, 0.0, 0.0, None, None, "made by formula"),
            )
            for part in leg.parts
        )
        held = leg.kind == "hold"
        time = leg.duration or move_time(leg.start, leg.goal, 4.0)
        fly_one = (
            vertical_trajectory
            if leg.kind in {"launch", "land"}
            else gliding_trajectory
        )
        parts = tuple(
            hold_trajectory(show.vehicle, start, time, show.heading)
            if held
            else fly_one(show.vehicle, start, goal, time, show.heading)
            for start, goal in zip(leg.start, leg.goal, strict=True)
        )
        parts = _flown(leg, moves, show) if moves else parts
        certificate = Certificate(time, 0.0, 0.0, None, None, "made by formula")
        flights.append(LegFlight(leg, time, parts, certificate, moves))
        starts.append(clock)
        clock = round(clock + time, 3)
    return Flight(itinerary, tuple(flights), np.array(starts))


def rows(content: bytes) -> list[list[float]]:
    """Numbers of a .waypoints file, row by row."""
    lines = content.decode("ascii").splitlines()
    assert lines[0] == "QGC WPL 110"
    return [[float(field) for field in line.split("\t")] for line in lines[1:]]
