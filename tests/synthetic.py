"""Flights made by formula, for tests that need a flight but no solver.

``vertical_flight`` is physically exact: every drone only climbs, holds and descends,
height is a quintic of time and thrust is m (g + z''), a cubic, so that the logged
polynomials solve the equations of motion to rounding.

``gliding_flight`` moves along straight lines in space with attitude and torques from
differential flatness, fitted by polynomials: good to look at, not exact physics.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache
from math import cos, isqrt, radians, sin, tau

import numpy as np

from showc.flight import Certificate, Encounter, Flight, LegFlight, Trajectory
from showc.plan.itinerary import Itinerary, Leg
from showc.script.mark import Mark
from showc.script.show import (
    Effect,
    Formation,
    Landing,
    Launch,
    MissionOptions,
    Show,
    Site,
    Source,
    Transition,
)
from showc.trajectory import PiecewisePolynomial, bernstein_basis_inverse
from showc.vehicle import DEFAULT_PRESET, PRESETS, Body, Limits, Quadrotor, Separation
from showc.verify.decode import decoding

SCRIPT = b"format: 1\nname: synthetic\n"
MARK = Mark("synthetic.yaml", 1, 1, 1, 10)
VEHICLE = Quadrotor(
    name="seed",
    mass=0.625,
    arm_length=0.1275,
    thrust_coefficient=2.103e-6,
    torque_coefficient=2.091e-8,
    inertia=(2.3e-3, 2.4e-3, 2.6e-3),
    rotor_speed_max=1581.0,
)
LIMITS = Limits(
    velocity_min=(-5.0, -5.0, -5.0),
    velocity_max=(5.0, 5.0, 5.0),
    tilt=radians(20.0),
    body_rate=(1.7, 1.7, 1.7),
    thrust_min=0.0,
    thrust_max=21.03,
    torque_max=(0.67, 0.67, 0.105),
    position_min=(-200.0, -200.0, -0.5),
    position_max=(200.0, 200.0, 120.0),
)
HELD = {"approach": "reaching the pads"}
"""What a hold follows, where it is not named after its move."""
# Of (s^5, s^4, s^3, ...) the minimum-jerk move: greatest speed and acceleration
# of a unit move in unit time.
PEAK_SPEED = 1.875
PEAK_ACCELERATION = 10.0 / 3.0**0.5


def grid(drones: int, spacing: float = 3.0) -> np.ndarray:
    """Places on the ground, (drones, 3) [m]."""
    columns = isqrt(drones - 1) + 1
    index = np.arange(drones)
    place = np.stack([index % columns, index // columns, np.zeros(drones)], axis=1)
    place[:, :2] -= (columns - 1) / 2.0
    return np.asarray(place * spacing, dtype=np.float64)


def raised(places: np.ndarray, height: float) -> np.ndarray:
    """Return the same places ``height`` higher [m]."""
    return np.asarray(places + np.array([0.0, 0.0, height]))


def move_time(start: np.ndarray, goal: np.ndarray, speed: float) -> float:
    """Common time of the quintic move, whole milliseconds [s]."""
    distance = float(np.linalg.norm(goal - start, axis=1).max())
    time = max(
        PEAK_SPEED * distance / speed, (PEAK_ACCELERATION * distance / 2.0) ** 0.5, 0.5
    )
    return float(np.ceil(time * 1000.0)) / 1000.0


def quintic(start: float, goal: float, duration: float) -> PiecewisePolynomial:
    """Rest to rest in minimum jerk, one component."""
    coefficients = np.repeat([start, goal], 3)[None, :, None]
    return PiecewisePolynomial(np.array([0.0, duration]), coefficients)


def vertical_trajectory(
    vehicle: Quadrotor, start: np.ndarray, goal: np.ndarray, duration: float, yaw: float
) -> Trajectory:
    """Exact flight straight up or down."""
    height = quintic(float(start[2]), float(goal[2]), duration)
    climb = height.derivative()
    state = np.zeros((1, 6, 12))
    state[0, :, 0] = start[0]
    state[0, :, 1] = start[1]
    state[0, :, 2] = height.coefficients[0, :, 0]
    state[0, :, 5] = climb.elevated(5).coefficients[0, :, 0]
    state[0, :, 8] = yaw
    control = np.zeros((1, 4, 4))
    control[0, :, 0] = vehicle.mass * (
        vehicle.gravity + climb.derivative().coefficients[0, :, 0]
    )
    return Trajectory(
        PiecewisePolynomial(height.breaks, state),
        PiecewisePolynomial(height.breaks, control),
    )


def hold_trajectory(
    vehicle: Quadrotor, place: np.ndarray, duration: float, yaw: float
) -> Trajectory:
    """Exact hover: constants, degree 0."""
    state = vehicle.hover_state(place, yaw)
    return Trajectory(
        PiecewisePolynomial.constant(state, 0.0, duration),
        PiecewisePolynomial.constant(vehicle.hover_control(), 0.0, duration),
    )


@dataclass(frozen=True)
class Glide:
    """The way of one metre that all glides of a duration are multiples of."""

    breaks: np.ndarray
    """Ends of the intervals, shape (i + 1,) [s]."""
    place: np.ndarray
    """Coefficients on each interval, shape (i, degree + 1) [m]."""
    speed: np.ndarray
    """Of its derivative, in the same degree [m/s]."""
    derivatives: tuple[np.ndarray, ...]
    """Acceleration, jerk and snap at the nodes, each of shape (i, degree + 1), SI."""
    fit: np.ndarray
    """Coefficients from values at the nodes, shape (degree + 1, degree + 1)."""


@cache
def unit_glide(duration: float) -> Glide:
    """Cut a quintic into three intervals of degree 7."""
    breaks = duration * np.array([0.0, 0.3, 0.7, 1.0])
    degree = 7
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
    path = quintic(0.0, 1.0, duration).split(breaks)
    speed = path.derivative()
    derivatives = [speed.derivative()]
    for _ in range(2):
        derivatives.append(derivatives[-1].derivative())
    time = breaks[:-1, None] + np.diff(breaks)[:, None] * nodes
    return Glide(
        breaks,
        path.elevated(degree).coefficients[..., 0],
        speed.elevated(degree).coefficients[..., 0],
        tuple(one(time)[..., 0] for one in derivatives),
        bernstein_basis_inverse(degree, tuple(nodes)),
    )


def gliding_trajectory(
    vehicle: Quadrotor, start: np.ndarray, goal: np.ndarray, duration: float, yaw: float
) -> Trajectory:
    """Straight line; attitude and torques from flatness on three intervals.

    Position and velocity are exact derivatives of each other, everything else is
    interpolated with degree 7 (not exact).
    """
    unit = unit_glide(duration)
    way, degree = goal - start, unit.place.shape[1] - 1
    push, jerk, snap = (one[..., None] * way for one in unit.derivatives)
    push = push + np.array([0.0, 0.0, vehicle.gravity])
    force = np.linalg.norm(push, axis=-1)
    across = push[..., 0] * sin(yaw) - push[..., 1] * cos(yaw)
    ahead = push[..., 0] * cos(yaw) + push[..., 1] * sin(yaw)
    state = np.zeros((3, degree + 1, 12))
    state[..., 0:3] = start + unit.place[..., None] * way
    state[..., 3:6] = unit.speed[..., None] * way
    state[..., 8] = yaw
    g = vehicle.gravity
    values = np.stack([np.arcsin(across / force), np.arctan2(ahead, push[..., 2])], -1)
    rates = np.stack([-jerk[..., 1] / g, jerk[..., 0] / g], -1)
    torque = np.stack([-snap[..., 1] / g, snap[..., 0] / g], -1) * vehicle.inertia[:2]
    fit = unit.fit
    state[..., 6:8] = np.einsum("rk,ikc->irc", fit, values)
    state[..., 9:11] = np.einsum("rk,ikc->irc", fit, rates)
    control = np.zeros((3, degree + 1, 4))
    control[..., 0] = np.einsum("rk,ik->ir", fit, vehicle.mass * force)
    control[..., 1:3] = np.einsum("rk,ikc->irc", fit, torque)
    return Trajectory(
        PiecewisePolynomial(unit.breaks, state),
        PiecewisePolynomial(unit.breaks, control),
    )


def make_show(
    formations: list[Formation],
    drones: int,
    *,
    holds: list[float],
    altitude: float,
    heading: float = 0.0,
    site_heading: float = 30.0,
    separation: float = 1.0,
    fades: tuple[str, ...] = ("linear",),
    effects: tuple[Effect | None, ...] = (None,),
) -> Show:
    """Wrap formations (the first on the ground) into a show."""
    transitions = tuple(
        Transition(
            name=f"{before.name} -> {after.name}",
            to=after.name,
            hold=hold,
            assignment="fixed",
            mark=MARK,
            fade=fades[i % len(fades)],
            effect=effects[i % len(effects)],
        )
        for i, (before, after, hold) in enumerate(
            zip(formations, formations[1:], holds, strict=False)
        )
    )
    lower = tuple(min(f.points[:, k].min() for f in formations) - 10.0 for k in (0, 1))
    upper = tuple(max(f.points[:, k].max() for f in formations) + 10.0 for k in (0, 1))
    top = max(altitude, *(float(f.points[:, 2].max()) for f in formations)) + 10.0
    return Show(
        format_version=1,
        name="Synthetic show",
        source=Source("shows/synthetic.yaml", SCRIPT, {"points.csv": b"0,0,0\n"}),
        epoch=datetime(2026, 1, 1, tzinfo=UTC),
        site=Site(
            latitude=48.1374,
            longitude=11.5755,
            altitude=520.0,
            heading=site_heading,
            volume_min=(*lower, -0.5),
            volume_max=(*upper, top),
            fence=np.array(
                [
                    [lower[0], lower[1]],
                    [upper[0], lower[1]],
                    [upper[0] + 5.0, (lower[1] + upper[1]) / 2.0],
                    [upper[0], upper[1]],
                    [lower[0], upper[1]],
                ]
            ),
        ),
        vehicle=VEHICLE,
        body=Body(0.4, (0.02, 0.04)),
        battery=PRESETS[DEFAULT_PRESET].battery,
        limits=LIMITS,
        separation=Separation(separation),
        yaw="held",
        heading=heading,
        drones=drones,
        formations={f.name: f for f in formations},
        pads=formations[0].name,
        groups={},
        launch=Launch(altitude=altitude, climb_speed=3.0, hold=1.0),
        transitions=transitions,
        landing=Landing(
            altitude=altitude, descent_speed=3.0, hold=1.0, assignment="fixed"
        ),
        mission=MissionOptions(),
    )


def frozen(array: np.ndarray) -> np.ndarray:
    """Return a read-only copy."""
    copy = np.array(array, dtype=np.float64)
    copy.setflags(write=False)
    return copy


def formation(name: str, points: np.ndarray, colours: np.ndarray) -> Formation:
    """Formation with one colour for all, or one for each."""
    shaded = np.broadcast_to(np.asarray(colours, dtype=np.float64), points.shape)
    return Formation(name, frozen(points), frozen(shaded), MARK)


def fly(show: Show, stops: list[tuple[str, str, np.ndarray, int | None]], trajectory):
    """Chain legs through ``stops``: (kind, formation, places, transition)."""
    vehicle, yaw = show.vehicle, show.heading
    added = {
        name: formation(name, places, [0.0, 0.0, 0.0])
        for _, name, places, _ in stops
        if name not in show.formations
    }
    show = replace(show, formations={**show.formations, **added})
    legs, flights, starts = [], [], []
    names = {"launch": "launch", "approach": "approach to the pads", "land": "land"}
    place, last, clock = stops[0][2], stops[0][1], 0.0
    drones = np.arange(show.drones)
    holds = {"launch": show.launch.hold, "approach": show.landing.hold, "land": 0.0}
    for kind, name, goal, transition in stops[1:]:
        vertical = kind in ("launch", "land")
        limits = show.limits
        speed = 4.0
        if kind == "launch":
            speed = show.launch.climb_speed
            limits = limits.upright(speed)
        if kind == "land":
            speed = show.landing.descent_speed
            limits = limits.upright(speed)
        title = names[kind] if transition is None else show.transitions[transition].name
        hold = holds.get(kind, 0.0)
        if transition is not None:
            hold = show.transitions[transition].hold
        for part in ("move", "hold"):
            if part == "hold" and hold == 0.0:
                continue
            holding = part == "hold"
            target = place if holding else goal
            time = hold if holding else move_time(place, goal, speed)
            leg = Leg(
                index=len(legs),
                name=f"hold after {HELD.get(kind, title)}" if holding else title,
                kind="hold" if holding else kind,
                drones=drones,
                start=frozen(place),
                goal=frozen(target),
                from_formation=name if holding else last,
                to_formation=name,
                places=drones,
                limits=show.limits if holding else limits,
                duration=hold if holding else None,
                after=(len(legs) - 1,) if legs else (),
                mark=MARK if transition is not None else None,
                transition=transition,
            )
            fly_one = vertical_trajectory if vertical else trajectory
            parts = tuple(
                hold_trajectory(vehicle, start, time, yaw)
                if holding
                else fly_one(vehicle, start, end, time, yaw)
                for start, end in zip(place, target, strict=True)
            )
            closest = closest_sampled(parts, time)
            certificate = Certificate(
                duration=time,
                single_drone_minimum=0.0 if holding else 0.97 * time,
                dual_bound=0.0,
                witness=None,
                closest=closest,
                method="made by formula",
                statistics={"intervals": float(parts[0].state.intervals)},
            )
            legs.append(leg)
            flights.append(LegFlight(leg, time, parts, certificate))
            starts.append(clock)
            clock = round(clock + time, 3)
            place = target
        last = name
    return Flight(Itinerary(show, tuple(legs)), tuple(flights), np.array(starts))


def closest_sampled(parts, time: float) -> Encounter | None:
    """Nearest pair on a coarse grid of times; None for one drone or a great fleet."""
    if not 2 <= len(parts) <= 120:
        return None
    grid_times = np.linspace(0.0, time, 61)
    place = np.stack([p.state.select([0, 1, 2])(grid_times) for p in parts])
    best = Encounter(0, 1, 0.0, np.inf)
    for a in range(len(parts) - 1):
        distance = np.linalg.norm(place[a] - place[a + 1 :], axis=-1)
        b, k = np.unravel_index(int(distance.argmin()), distance.shape)
        if distance[b, k] < best.distance:
            best = Encounter(
                a, a + 1 + int(b), float(grid_times[k]), float(distance[b, k])
            )
    return best


def vertical_flight(
    drones: int = 4, *, heading: float = 0.0, show: Show | None = None
) -> Flight:
    """Up, higher, and down again; exact physics, all rules kept.

    ``show``, if given, has the formations of :func:`vertical_formations` and launches
    and lands at 6 m.
    """
    formations = vertical_formations(drones)
    pads = formations[0].points
    level = raised(pads, 6.0)
    show = show or make_show(
        formations, drones, holds=[1.5, 1.0], altitude=6.0, heading=heading
    )
    stops = [
        ("pads", "pads", pads, None),
        ("launch", "above pads", level, None),
        ("transition", "steps", formations[1].points, 0),
        ("transition", "level", formations[2].points, 1),
        ("approach", "above pads to land", level, None),
        ("land", "pads", pads, None),
    ]
    return fly(show, stops, vertical_trajectory)


def vertical_formations(drones: int) -> list[Formation]:
    """Pads, and two formations above them."""
    pads = grid(drones)
    steps = raised(pads, 10.0)
    steps[:, 2] += 0.5 * np.arange(drones)
    return [
        formation("pads", pads, [0.0, 0.0, 0.0]),
        formation("steps", steps, [1.0, 0.25, 0.0]),
        formation("level", raised(pads, 12.0), [0.0, 0.5, 1.0]),
    ]


def gliding_flight(drones: int = 16, *, moves: int = 3, hold: float = 2.0) -> Flight:
    """A show with pictures, colours and effects, of any size and length."""
    pads = grid(drones, 2.0)
    level = raised(pads, 10.0)
    radius = max(8.0, 1.3 * drones**0.5)
    index = np.arange(drones)
    angle = np.pi * (1.0 + 5.0**0.5) * index
    upright = 1.0 - 2.0 * (index + 0.5) / drones
    flat = np.sqrt(1.0 - upright**2)
    sphere = np.stack([flat * np.cos(angle), flat * np.sin(angle), upright], axis=1)
    turn = tau * index / drones
    wave = grid(drones, 2.2)
    wave[:, 2] = 3.0 * np.sin(wave[:, 0] * tau / (2.0 * radius))
    helix = np.stack(
        [np.cos(5.0 * turn), np.sin(5.0 * turn), 2.0 * index / drones - 1.0], axis=1
    )
    middle = np.array([0.0, 0.0, radius + 14.0])
    hue = np.stack([0.5 + 0.5 * np.cos(turn + k * tau / 3.0) for k in range(3)], axis=1)
    shapes = [
        ("sphere", sphere * radius + middle, np.array([1.0, 0.45, 0.05])),
        ("helix", helix * radius + middle, hue**2),
        ("wave", wave + middle, np.array([0.05, 0.3, 1.0])),
    ]
    formations = [formation("pads", pads, [0.0, 0.0, 0.0])]
    for k in range(moves):
        name, points, colours = shapes[k % 3]
        formations.append(formation(f"{name}-{k + 1}", points, colours))
    show = make_show(
        formations,
        drones,
        holds=[hold] * moves,
        altitude=10.0,
        fades=("linear", "end", "start"),
        effects=(Effect("pulse", 2.0), Effect("sweep", 3.0), Effect("rainbow", 4.0)),
    )
    stops = [("pads", "pads", pads, None), ("launch", "above pads", level, None)]
    stops += [("transition", f.name, f.points, k) for k, f in enumerate(formations[1:])]
    stops += [
        ("approach", "above pads to land", level, None),
        ("land", "pads", pads, None),
    ]
    return fly(show, stops, gliding_trajectory)


def decoded(log):
    """Show in an opened log, its segments decoded one after the other."""
    parts, joined = decoding(log)
    return joined([part() for part in parts])


__all__ = ["decoded", "gliding_flight", "vertical_flight", "vertical_formations"]
