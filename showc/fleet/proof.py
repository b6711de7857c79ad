"""Whether a leg's flight is what it should be, wherever it came from.

Solvers prove what they return. What a cache or another machine hands over may be of
anyone's making, so it is proved again before it is used, and in the same way: ends,
joints and limits from Bernstein coefficients, controls by flying them, separation in
continuous time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.conflicts import conflicts
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.ends import TOLERANCE, pair_names
from showc.fleet.leg import aircraft_of
from showc.fleet.single_drone.audit import greatest_excess
from showc.fleet.single_drone.judgement import (
    KEPT,
    POSITION_ACCURACY,
    VELOCITY_ACCURACY,
    attitude_accuracy,
)
from showc.fleet.single_drone.replay import replay
from showc.flight import Trajectory
from showc.trajectory import PiecewisePolynomial
from showc.vehicle import CONTROL_NAMES, STATE_NAMES
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.flight import LegFlight
    from showc.script.show import Show


JOINED = 1e-6
"""Greatest jump of a state between two intervals, and greatest distance from the ends
that the leg asks for [m, m/s, rad, rad/s]."""
_MILLISECOND = 1e-3
"""Durations are whole numbers of these [s]."""
_LOOKS, _FOLLOWED = 301, 1e-4
"""Instants at which a motion is looked at, and distance that is let be there [m]."""
_TOGETHER = 50
"""Flights whose limits are looked at together: their numbers stay in a core's cache."""
_RECORDED = 1e-5
"""Greatest difference between the recorded closest encounter and the tracks [m]."""


def flaw(flight: LegFlight, show: Show) -> str:
    """Say what is wrong with a leg's flight; empty if nothing is.

    Parameters
    ----------
    flight
        Any numbers in the shape of a flight.
    show
        Gives vehicle, heading and separation.
    """
    leg, duration = flight.leg, flight.duration
    if len(flight.trajectories) != leg.drones.size:
        return f"{len(flight.trajectories)} flights for {leg.drones.size} drones"
    if not (np.isfinite(duration) and duration > 0.0):
        return f"a duration of {duration} s"
    if flight.certificate.duration != duration:
        return "the certificate is of another duration"
    if leg.duration is not None and abs(duration - leg.duration) > _MILLISECOND:
        return f"it takes {duration:.3f} s, the script gives {leg.duration:.3f} s"
    for row, trajectory in enumerate(flight.trajectories):
        if wrong := _form(trajectory, duration) or _joints(
            trajectory, show, *leg.ends(row)
        ):
            return f"drone {int(leg.drones[row]) + 1}: {wrong}"
    return _motion(flight) or _limits(flight, show) or _separation(flight, show)


def _motion(flight: LegFlight) -> str:
    """Look at drones of a moving formation: they follow its motion."""
    leg, times = flight.leg, np.linspace(0.0, flight.duration, _LOOKS)
    for one in leg.motion:
        wanted = one.positions(flight.duration, times)
        for column, row in enumerate(one.rows.tolist()):
            flown = flight.trajectories[row].state(times)[:, :3]
            away = float(np.linalg.norm(flown - wanted[:, column], axis=1).max())
            if not away <= _FOLLOWED:
                drone = leg.drones[row] + 1
                return f"drone {drone} is {away:.3g} m off its formation's motion"
    return ""


def _form(trajectory: Trajectory, duration: float) -> str:
    """Look at the shapes: a polynomial for every quantity and all of the time."""
    state, control = trajectory.state, trajectory.control
    breaks = state.breaks
    faults = [
        (
            piece.coefficients.ndim != 3
            or piece.coefficients.shape[2] != len(names)
            or not len(piece.coefficients)
            or breaks.shape != (len(piece.coefficients) + 1,),
            "its polynomials are of other quantities or intervals",
        )
        for piece, names in ((state, STATE_NAMES), (control, CONTROL_NAMES))
    ]
    numbers = (breaks, state.coefficients, control.coefficients)
    faults += [
        (
            not np.array_equal(breaks, control.breaks),
            "states and controls have different intervals",
        ),
        (
            not all(np.isfinite(values).all() for values in numbers),
            "not all of its numbers are finite",
        ),
        (
            breaks.ndim != 1
            or not breaks.size
            or breaks[0] != 0.0
            or not (np.diff(breaks) > 0.0).all()
            or abs(breaks[-1] - duration) > _MILLISECOND * KEPT,
            "its intervals do not run from the start to the end",
        ),
    ]
    return next((text for wrong, text in faults if wrong), "")


def _joints(
    trajectory: Trajectory, show: Show, start: FloatArray, goal: FloatArray
) -> str:
    """Look at the ends, which are the states asked for, and at the joints."""
    coefficients = trajectory.state.coefficients
    jump = np.abs(coefficients[1:, 0] - coefficients[:-1, -1]).max(initial=0.0)
    if jump > JOINED:
        return f"its states jump by {jump:.3g} between two intervals"
    for name, state, asked in (
        ("starts", coefficients[0, 0], start),
        ("ends", coefficients[-1, -1], goal),
    ):
        wanted = show.vehicle.hover_state(asked[:3], show.heading)
        if asked.size > wanted.size:
            wanted = asked[: wanted.size]
        away = float(np.linalg.norm(state[:3] - wanted[:3]))
        moving = float(np.abs(state[3:] - wanted[3:]).max())
        if away > JOINED:
            return f"it {name} {away:.3g} m from its place"
        if moving > JOINED:
            still = asked.size == wanted[:3].size
            return f"it {name} " + ("without hovering" if still else "in other motion")
    return ""


def _limits(flight: LegFlight, show: Show) -> str:
    """Look at every limit at every instant, and fly the controls again."""
    leg = flight.leg
    aircraft = aircraft_of(show, leg)
    for row in _suspects(aircraft, flight.trajectories):
        worst = greatest_excess(aircraft, flight.trajectories[row])
        if worst.relative > KEPT:
            return (
                f"drone {int(leg.drones[row]) + 1}: {worst.name} is {worst.amount:.3g} "
                f"outside its limit near {worst.time:.2f} s"
            )
    flown = replay(aircraft.vehicle, flight.trajectories)
    missed = flown.position / POSITION_ACCURACY
    slipped = flown.velocity / VELOCITY_ACCURACY
    turned = flown.attitude / attitude_accuracy(aircraft.vehicle, flight.duration)
    worst_of = np.maximum(np.maximum(missed, slipped), turned)
    row = int(np.argmax(worst_of))
    if not worst_of[row] <= 1.0:
        return (
            f"drone {int(leg.drones[row]) + 1}: its controls miss its path by "
            f"{flown.position[row]:.3g} m and {flown.velocity[row]:.3g} m/s"
        )
    return ""


def _suspects(aircraft: Aircraft, trajectories: Sequence[Trajectory]) -> Iterator[int]:
    """Rows of flights that may break a limit.

    Limits hold interval by interval: those of some flights are looked at as if they
    were of one. Jerk is one of joints as well.
    """
    alike: dict[tuple[int, int], list[int]] = {}
    for row, item in enumerate(trajectories):
        alike.setdefault((item.state.degree, item.control.degree), []).append(row)
    for rows in alike.values():
        for begin in range(0, len(rows), _TOGETHER):
            some = rows[begin : begin + _TOGETHER]
            one = _joined([trajectories[row] for row in some])
            kept = greatest_excess(aircraft, one).relative <= KEPT
            if aircraft.limits.jerk or not kept:
                yield from some


def _joined(trajectories: Sequence[Trajectory]) -> Trajectory:
    """Put flights of equal degrees after each other, jumps between them or not."""
    widths = np.concatenate([np.diff(item.state.breaks) for item in trajectories])
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    state, control = (
        PiecewisePolynomial(breaks, np.concatenate(parts))
        for parts in zip(
            *((i.state.coefficients, i.control.coefficients) for i in trajectories),
            strict=True,
        )
    )
    return Trajectory(state, control)


def _separation(flight: LegFlight, show: Show) -> str:
    """Look at every pair at every instant, and at the closest one on record."""
    leg, separation = flight.leg, show.separation
    wanted = separation.distance - TOLERANCE
    found = conflicts(
        tracks_of(flight.trajectories, leg.others_parked, leg.others),
        separation,
        wanted,
    )
    if len(found):
        nearest = int(np.argmin(found.distance))
        names = pair_names(leg, int(found.first[nearest]), int(found.second[nearest]))
        return (
            f"{names} come {found.distance[nearest]:.3f} m near, the separation is "
            f"{separation.distance:.3f} m"
        )
    record = flight.certificate.closest
    if (record is None) != (len(flight.trajectories) < 2):
        return "the certificate names no closest pair, or one of a single drone"
    if record is None:
        return ""
    rows = np.searchsorted(leg.drones, [record.drone_a, record.drone_b])
    if not (
        (rows < leg.drones.size).all()
        and leg.drones[rows].tolist() == [record.drone_a, record.drone_b]
        and 0.0 <= record.time <= flight.duration
    ):
        return "the certificate's closest pair does not fly this leg"
    first, second = (flight.trajectories[int(row)].state(record.time) for row in rows)
    distance = float(measure((first - second)[..., :3].reshape(3), separation))
    if not abs(distance - record.distance) <= _RECORDED:
        return (
            f"the certificate's closest pair is {distance:.6f} m apart, not "
            f"{record.distance:.6f} m"
        )
    return ""
