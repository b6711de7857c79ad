"""A comparison as tables and pictures: one page to print."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.vehicle_link.compare import GRID, nearest
from showc.view.document import document, table, text
from showc.view.plot import Curve, line_plot

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.vehicle_link.compare import Comparison, LegComparison
    from showc.vehicle_link.overlay import Flown


STEPS = 800
"""Points of a curve."""


def leg_cells(leg: LegComparison) -> list[str]:
    """Return what a table says of a leg, as plain text."""
    late = leg.lateness
    fast = leg.greatest("speed")
    tightest = "-" if leg.tightest is None else f"{leg.tightest:.2f}"
    proved = "-" if leg.proved is None else f"{leg.proved:.2f}"
    return [
        leg.name,
        "-" if late is None else f"{late[0]:+.2f}..{late[1]:+.2f}",
        *(
            "-" if (value := leg.greatest(name)) is None else f"{value:.2f}"
            for name in ("at_arrival", "settled", "greatest_error", "rms_error")
        ),
        f"{tightest} / {proved}",
        "-" if fast is None else f"{fast:.1f}",
    ]


LEG_HEADS = (
    "leg",
    "arrival error s",
    "at arrival m",
    "settled m",
    "max m",
    "rms m",
    "tightest flown / proved m",
    "fastest m/s",
)
"""Of the table of legs."""


def render_comparison(title: str, flight: Flown, result: Comparison) -> str:
    """Return the page: legs, drones, distances to the plan and between drones.

    Parameters
    ----------
    title
        Of the page.
    flight
        The flight beside its plan.
    result
        What was measured.
    """
    first = frozenset({0})
    legs = table(
        LEG_HEADS,
        [[text(cell) for cell in leg_cells(leg)]
         for leg in result.legs],
        words=first,
    )  # fmt: skip
    drones = table(
        ("drone", "max m", "at s", "rms m", "late s"),
        [
            [
                str(one.drone),
                f"{one.greatest_error:.2f}",
                f"{one.greatest_error_time:.1f}",
                f"{one.rms_error:.2f}",
                f"{one.lag:+.2f}",
            ]
            for one in result.drones
        ],
    )
    body = (
        f"<h1>{text(title)}</h1><p>Held against the {result.against}.</p>"
        f"<h2>Legs</h2>{legs}<h2>Drones</h2>{drones}"
        f"<h2>Distances</h2>{_error_plot(flight)}{_distance_plot(flight, result)}"
    )
    return document(title, body)


def _error_plot(flight: Flown) -> str:
    """Greatest and mean distance to the plan over time."""
    times = _times(flight)
    errors = np.array(
        [
            np.interp(times, track.times, flight.errors(drone), left=0.0, right=0.0)
            for drone, track in flight.tracks.items()
        ]
    )
    curves = [
        Curve("farthest drone", errors.max(axis=0)),
        Curve("mean", errors.mean(axis=0)),
    ]
    return line_plot("Distance to the plan [m]", times, curves)


def _distance_plot(flight: Flown, result: Comparison) -> str:
    """Least distance of two drones over time."""
    if len(flight.tracks) < 2:
        return ""
    times = _times(flight)
    least = nearest(flight, times)
    return line_plot(
        "Least distance of two drones, in the show's metric [m]",
        times,
        [Curve("flown", least)],
        limits=[result.separation],
    )


def _times(flight: Flown) -> FloatArray:
    start = max(float(track.times[0]) for track in flight.tracks.values())
    end = min(float(track.times[-1]) for track in flight.tracks.values())
    return np.linspace(start, max(end, start + GRID), STEPS)
