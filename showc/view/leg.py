"""One drone's solution over one leg: states, controls, margins, mesh."""

from __future__ import annotations

from itertools import pairwise
from math import degrees
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.history import Decision, IntervalRecord, MeshRecord, PhaseRecord
from showc.ocp.outcome import ErrorEstimate, Result
from showc.view.course import Course, course_of
from showc.view.document import document, table, text
from showc.view.mesh import mesh_plot
from showc.view.plot import Curve, bar_plot, line_plot

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.flight import MeshTaken
    from showc.log import showc_pb2 as pb
    from showc.log.reader import LoggedShow


HIGHEST_MARGIN = 60.0
"""Separation far beyond the rule is drawn no higher than this [%]."""


def render_leg(logged: LoggedShow, segment: int, drone: int) -> str:
    """Return a page that draws what was solved.

    Every curve is the logged polynomial itself. The mesh is drawn with the defect of
    each interval, which a finer mesh lessens, and with its curvature, which tells
    whether more intervals or a higher degree would do it.

    Parameters
    ----------
    logged
        The show.
    segment
        Which leg, counting from 0 in the order of their start.
    drone
        Which drone, counting from 0.

    Raises
    ------
    UsageError
        If there is no such leg, or the drone takes no part in it.
    """
    course = course_of(logged, segment, drone)
    plots = [
        *_states(course),
        *_controls(course),
        *_separation(course),
        _margins(course),
        *_mesh(course),
    ]
    name = course.segment.message.name
    return document(
        f"{name}, drone {drone + 1} – {logged.rules.name}",
        f"{_head(logged, course, drone)}<div class='plots'>{''.join(plots)}</div>"
        f"{_origin_of_mesh(course)}",
    )


def _head(logged: LoggedShow, course: Course, drone: int) -> str:
    segment, message = course.segment, course.segment.message
    certificate = message.certificate
    facts = [
        ("Starts at", f"{segment.start:.3f} s"),
        ("Takes", f"{segment.duration:.3f} s"),
    ]
    if certificate.single_drone_minimum > 0.0:
        least = certificate.single_drone_minimum
        facts.append(("Longest least time of a single drone", f"{least:.3f} s"))
    if certificate.dual_bound > 0.0:
        facts.append(("Claimed lower bound", f"{certificate.dual_bound:.3f} s"))
    state, control = course.trajectory.state, course.trajectory.control
    mesh = f"{state.intervals} interval{'' if state.intervals == 1 else 's'}"
    degree = f"states of degree {state.degree}, controls of degree {control.degree}"
    facts.append(("Mesh", f"{mesh}, {degree}"))
    if certificate.method:
        facts.append(("Method", certificate.method))
    facts += [
        (name.replace("_", " "), f"{value:g}")
        for name, value in sorted(certificate.statistics.items())
    ]
    words = frozenset({0, 1})
    rows = [[text(name), text(value)] for name, value in facts]
    return (
        f"<header><div><h1>{text(message.name)}</h1>"
        f"<p>{text(logged.rules.name)} · drone {drone + 1} · "
        f"{text(message.from_formation)} → {text(message.to_formation)}</p></div>"
        f"</header><h2>Solution</h2>{table(['', ''], rows, words=words, kind='facts')}"
        "<h2>Course<small>time since the start of the leg [s]; grey borders: mesh "
        "intervals</small></h2>"
    )


def _curves(names: str, values: FloatArray) -> list[Curve]:
    return [Curve(name, values[:, k]) for k, name in enumerate(names.split())]


def _triple(vector: pb.Vector3) -> FloatArray:
    return np.array([vector.x, vector.y, vector.z])


def _both(levels: FloatArray) -> list[float]:
    """Each level and its opposite, once."""
    return sorted({float(sign * level) for level in levels for sign in (-1, 1)})


def _states(course: Course) -> list[str]:
    state, limits = course.state, course.limits
    speeds = [*_triple(limits.velocity_min), *_triple(limits.velocity_max)]
    tilt = np.array([degrees(limits.tilt)])
    drawn: tuple[tuple[str, str, FloatArray, list[float]], ...] = (
        ("Displacement [m]", "x y z", state[:, :3] - state[0, :3], []),
        ("Velocity [m/s]", "x y z", state[:, 3:6], sorted(set(map(float, speeds)))),
        ("Attitude [°]", "roll pitch yaw", np.degrees(state[:, 6:9]), _both(tilt)),
        (
            "Body rates [rad/s]",
            "p q r",
            state[:, 9:12],
            _both(_triple(limits.body_rate)),
        ),
    )
    return [
        line_plot(
            title,
            course.times,
            _curves(names, values),
            limits=levels,
            breaks=course.breaks,
        )
        for title, names, values, levels in drawn
    ]


def _controls(course: Course) -> list[str]:
    control, limits = course.control, course.limits
    times, breaks = course.times, course.breaks
    return [
        line_plot(
            "Thrust [N]",
            times,
            [Curve("", control[:, 0])],
            limits=[limits.thrust_min, limits.thrust_max],
            breaks=breaks,
        ),
        line_plot(
            "Torques [N m]",
            times,
            _curves("x y z", control[:, 1:]),
            limits=_both(_triple(limits.torque_max)),
            breaks=breaks,
        ),
        line_plot(
            "Rotor speeds squared, over the greatest",
            times,
            _curves("1 2 3 4", course.rotors),
            limits=[0.0, 1.0],
            breaks=breaks,
        ),
    ]


def _separation(course: Course) -> list[str]:
    if course.distance is None:
        return []
    return [
        line_plot(
            "Distance to the nearest drone [m]",
            course.times,
            [Curve("", course.distance)],
            limits=[course.separation],
            breaks=course.breaks,
        )
    ]


def _left(values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Share of the range left [%]: 0 on a limit, 50 in the middle; (n,)."""
    room = np.minimum(values - low, high - values) / (high - low)
    return np.asarray(100.0 * room.min(axis=1))


def _margins(course: Course) -> str:
    state, control, limits = course.state, course.control, course.limits
    tilt = np.full(2, limits.tilt)
    rate, torque = _triple(limits.body_rate), _triple(limits.torque_max)
    slowest, fastest = _triple(limits.velocity_min), _triple(limits.velocity_max)
    thrust = np.array([limits.thrust_min]), np.array([limits.thrust_max])
    turning = [
        _left(state[:, 6:8], -tilt, tilt),
        _left(state[:, 9:12], -rate, rate),
    ]
    pushing = [
        _left(control[:, :1], *thrust),
        _left(control[:, 1:], -torque, torque),
        _left(course.rotors, np.zeros(4), np.ones(4)),
    ]
    curves = [
        Curve("velocity", _left(state[:, 3:6], slowest, fastest)),
        Curve("attitude and rates", np.minimum.reduce(turning)),
        Curve("controls and rotors", np.minimum.reduce(pushing)),
    ]
    if course.distance is not None:
        beyond = 100.0 * (course.distance / course.separation - 1.0)
        shown = np.minimum(beyond, HIGHEST_MARGIN)
        curves.append(Curve("separation beyond the rule", shown))
    return line_plot(
        "Margins: share of the range left [%]",
        course.times,
        curves,
        limits=[0.0],
        breaks=course.breaks,
    )


def _origin_of_mesh(course: Course) -> str:
    """Draw the meshes on which the flight was sought, or say how its own was made."""
    taken = course.trajectory.meshes
    if taken:
        heads = ["", "Intervals", "Points", "Iterations", "Why", "Then"]
        words = frozenset({4, 5})
        rows = [
            [
                str(number),
                str(len(mesh.points)),
                str(sum(mesh.points)),
                str(mesh.iterations),
                text(mesh.why),
                text(mesh.found),
            ]
            for number, mesh in enumerate(taken, start=1)
        ]
        return (
            "<h2>Meshes<small>on which the flight was sought by optimal control, each "
            "from where the one before ended</small></h2>"
            f"{mesh_plot('leg', [_record(mesh) for mesh in taken])}"
            f"{table(heads, rows, words=words, kind='meshes')}"
        )
    breaks = course.breaks
    if breaks.size == 2:
        return '<p class="note">One interval: a hover is exact, nothing was solved.</p>'
    widths = np.diff(breaks)
    narrow, wide = int(np.argmin(widths)), int(np.argmax(widths))
    return (
        f'<p class="note">{widths.size} intervals, from {1e3 * widths[narrow]:.0f} ms '
        f"at {breaks[narrow]:.2f} s to {1e3 * widths[wide]:.0f} ms at "
        f"{breaks[wide]:.2f} s: a straight flight or a spline has those of its "
        "construction, and no mesh was sought.</p>"
    )


def _record(mesh: MeshTaken) -> MeshRecord:
    """Return a mesh as the figure of refinements takes it."""
    errors: tuple[float | None, ...] = mesh.errors or (None,) * len(mesh.points)
    decision = Decision(reason=f"{mesh.why}; {mesh.found}")
    intervals = tuple(
        IntervalRecord(*borders, points, error, None, None, decision)
        for borders, points, error in zip(
            pairwise(mesh.breaks), mesh.points, errors, strict=True
        )
    )
    worst = max(mesh.errors, default=0.0)
    return MeshRecord(
        len(intervals),
        sum(mesh.points),
        mesh.breaks[-1],
        mesh.iterations,
        Result.SOLVED,
        ErrorEstimate(worst, worst, 0.0, 0.0) if mesh.errors else None,
        mesh.found,
        (PhaseRecord("leg", intervals, ()),),
    )


def _mesh(course: Course) -> list[str]:
    ratios = course.curvature_ratios()
    return [
        bar_plot(
            "Defect of the acceleration by interval [m/s²]",
            course.breaks,
            course.defects(),
            [f"{1000.0 * width:.0f} ms" for width in np.diff(course.breaks)],
        ),
        bar_plot(
            "Curvature of the velocity by interval, greatest over mean",
            course.breaks,
            ratios,
            [f"{value:.1f}" for value in ratios],
        ),
    ]
