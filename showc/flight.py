"""A flight: what solving gives, and what log, missions and pictures are made from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from showc.trajectory import PiecewisePolynomial, concatenate

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray
    from showc.plan.itinerary import Itinerary, Leg


@dataclass(frozen=True, slots=True)
class MeshTaken:
    """One mesh on which a flight was solved."""

    breaks: tuple[float, ...]
    """Borders of its K intervals as they came to lie, K + 1 times [s]."""
    points: tuple[int, ...]
    """Collocation points of each interval."""
    iterations: int
    """Of the nonlinear programming solver."""
    why: str
    """Why this mesh was taken."""
    found: str
    """What came out: how the solve ended, or what flying it again showed."""
    errors: tuple[float, ...] = ()
    """Greatest error of each interval over its scale; empty: not known one by one."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """States and controls of one drone over one leg, from time 0 to its duration."""

    state: PiecewisePolynomial
    """12 components in the order of ``showc.vehicle.STATE_NAMES``."""
    control: PiecewisePolynomial
    """4 components in the order of ``showc.vehicle.CONTROL_NAMES``; same breaks."""
    meshes: tuple[MeshTaken, ...] = ()
    """Meshes on which it was sought by optimal control, in order; empty if built."""


@dataclass(frozen=True, slots=True)
class DualWitness:
    """A few numbers that prove a lower bound on the time of one drone's move.

    The velocity v stays in the box V of its limits, the thrust acceleration u in the
    set U(t) that thrust, tilt, body rates and angular accelerations allow between the
    states at both ends. For any constant beta and absolutely continuous lambda, with d
    the displacement, ``beta . d + lambda(T) . v(T) - lambda(0) . v(0)`` is ``int (beta
    + lambda') . v + lambda . (u - g e_z) dt``, so a time T is impossible when the
    former is greater than ``int h_V(beta + lambda') + h_U(t)(lambda) - g lambda_z dt``
    over [0, T], h being support functions. Where jerk is at most j, ``int mu' . (u - g
    e_z) + mu . (u - g e_z)' dt = 0`` for any absolutely continuous mu that vanishes at
    ends that are no hovers: lambda + mu' then stands for lambda beside u and g, and the
    integral of j |mu| is added. The verifier re-checks it with code of its own.
    """

    drone: int
    """Counting from 0."""
    time: float
    """No flight of this drone can take less [s]."""
    beta: tuple[float, float, float]
    """Multiplier of the displacement."""
    knots: tuple[float, ...]
    """Fractions of the time at which ``multipliers`` stand, from 0 to 1."""
    multipliers: tuple[tuple[float, ...], ...]
    """lambda at the knots, linear in between; then mu too where jerk is limited."""


@dataclass(frozen=True, slots=True)
class Encounter:
    """Two drones, and how near they come."""

    drone_a: int
    """Counting from 0; less than ``drone_b``."""
    drone_b: int
    """Counting from 0."""
    time: float
    """On the clock of what is looked at: since the start of a leg or of a stage's
    release, of the show, of the missions [s]."""
    distance: float
    """In the separation's metric [m]; where it is proved, a lower bound."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """How good a leg's time is, and what was done to reach it."""

    duration: float
    """Common time of the leg [s]."""
    single_drone_minimum: float
    """Greatest minimum time of any single drone, other drones aside [s]."""
    dual_bound: float
    """Rigorous lower bound on the common time [s]; 0 for holds."""
    witness: DualWitness | None
    """Proof of ``dual_bound``."""
    closest: Encounter | None
    """None when fewer than two drones take part."""
    method: str
    """What was done, in words."""
    statistics: Mapping[str, float] = field(default_factory=dict)
    """Deterministic counts: solves, rounds of repair, mesh intervals, ..."""

    @property
    def gap(self) -> float:
        """Duration over the greatest single-drone minimum, minus one."""
        if self.single_drone_minimum <= 0.0:
            return 0.0
        return self.duration / self.single_drone_minimum - 1.0


@dataclass(frozen=True, slots=True, eq=False)
class LegFlight:
    """One leg, solved."""

    leg: Leg
    duration: float
    """Common time of all its drones [s]."""
    trajectories: tuple[Trajectory, ...]
    """One for each drone of ``leg.drones``, in that order."""
    certificate: Certificate
    parts: tuple[LegFlight, ...] = ()
    """Flights of the leg's parts, each on its own clock."""


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """A whole show, solved: legs with their places on the timeline."""

    itinerary: Itinerary
    legs: tuple[LegFlight, ...]
    starts: FloatArray
    """Show time at which each leg starts, shape (legs,) [s]."""

    @property
    def duration(self) -> float:
        """Show time at which the last leg ends [s]."""
        return max(
            (float(start) + leg.duration)
            for start, leg in zip(self.starts, self.legs, strict=True)
        )

    def drone(self, index: int) -> Trajectory:
        """Return the whole flight of one drone, in show time from 0 to its last leg."""
        state, control = [], []
        for start, flight in zip(self.starts, self.legs, strict=True):
            position = int(np.searchsorted(flight.leg.drones, index))
            if (
                position < flight.leg.drones.size
                and flight.leg.drones[position] == index
            ):
                state.append(flight.trajectories[position].state.shifted(float(start)))
                control.append(
                    flight.trajectories[position].control.shifted(float(start))
                )
        return Trajectory(concatenate(state), concatenate(control))
