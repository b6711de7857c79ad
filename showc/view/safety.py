"""The safety case in the report: a drawing of the volumes, distances, findings."""

from __future__ import annotations

from math import isinf
from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb
from showc.safety.ground import area
from showc.safety.stop import time_to_rest
from showc.simulate.results import CONFIDENCE, LEAN, Campaign
from showc.view.document import clock, document, small, table, text
from showc.view.overview import overview_of
from showc.view.plot import Curve, line_plot
from showc.view.sitemap import (
    Frame,
    north_arrow,
    path,
    scale_bar,
    svg,
    ways,
)

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.log.reader import LoggedShow
    from showc.safety.case import Distance, Finding, SafetyCase
    from showc.safety.failure import Failures
    from showc.safety.stop import Stops


COLOURS = ("#2459c4", "#d9541e", "#c22036", "#8b3fb5", "#7a8191")
"""Of the volumes, from the innermost."""


def render_safety(logged: LoggedShow, case: SafetyCase) -> str:
    """Return the safety case as a printable HTML page of its own."""
    site = case.show.site
    body = (
        f"<header><div><h1>{text(case.show.name)}</h1><p>Safety case · site "
        f"{site.latitude:.6f}°, {site.longitude:.6f}°, {site.altitude:.1f} m · "
        f"heading {site.heading:.1f}°</p></div>{safety_badge(case)}</header>"
        f"{safety_section(logged, case)}"
    )
    return document(f"{case.show.name} – safety case", body)


def safety_badge(case: SafetyCase) -> str:
    """Return the verdict of the safety case, and how much was found."""
    kind, word = ("fail", "NOT MET") if case.errors else ("pass", "MET")
    if not case.errors and case.findings:
        kind, word = "open", "MET, WITH WARNINGS"
    errors, all_ = len(case.errors), len(case.findings)
    return (
        f'<div class="verdict {kind}">SAFETY OF THE SITE: {word}'
        f"<small>errors: {errors}, warnings: {all_ - errors}</small></div>"
    )


def safety_section(logged: LoggedShow, case: SafetyCase) -> str:
    """Return the safety case as a section of a report.

    Parameters
    ----------
    logged
        The show.
    case
        Its case.
    """
    risk = case.show.site.risk
    return (
        "<h2>Safety of the site<small>volumes and distances hold at every instant"
        f"</small></h2><figure>{volumes_from_above(logged, case)}<figcaption>"
        f"{_key(case)}</figcaption></figure>"
        f"{_findings(case.findings)}{_distances(case.distances)}{_volumes(case)}"
        f"{_failures(case.failures)}{_stops(case.stops)}"
        f"{_aborts(logged)}{_wind(case, Campaign.of(logged))}{_energy(case)}"
        f"{_spared(logged)}"
        f'<p class="note">Falls: a drone of {case.show.vehicle.mass:g} kg, '
        f"{case.flying.size:g} m from tip to tip, without thrust, drag area "
        f"{case.show.body.drag_area[0]:g} to {case.show.body.drag_area[1]:g} m², "
        f"steady wind up to {risk.wind:g} m/s from any direction; impact at up to "
        f"{case.impact_speed:.1f} m/s and {case.impact_energy:.0f} J. Formulas: LBA, "
        "guideline for flight geography, contingency volume and ground risk buffer, "
        f"revision 1.7, with V0 {case.flying.speed:.1f} m/s (wind included), reaction "
        f"{risk.reaction_time:g} s, errors {risk.gnss_error:g} + "
        f"{risk.position_error:g} + {risk.map_error:g} m. Turned and moved: "
        f"{np.degrees(risk.rotation):g}° about the origin and {risk.shift:g} m.</p>"
    )


def _key(case: SafetyCase) -> str:
    entries = [
        (colour, volume.name)
        for colour, volume in zip(COLOURS, case.volumes, strict=True)
    ]
    entries += [("#e0701b", "Fence"), ("#f0a500", "Audience"), ("#555555", "Buildings")]
    return "".join(
        f'<span class="key"><i style="background:{colour}"></i>{text(name)}</span> '
        for colour, name in entries
    )


def _findings(findings: tuple[Finding, ...]) -> str:
    if not findings:
        return "<p>Nothing is missing.</p>"
    words = frozenset({0, 1, 2})
    rows = [
        [
            (
                f'<span class="{"fail" if one.severity == "error" else "warning"}">'
                f"{text(one.severity)}</span>"
            ),
            text(f"{one.code} {one.title}") + small(text(one.message)),
            ""
            if one.place is None
            else f"drone {one.place.drone + 1}, {clock(one.place.time)}",
        ]
        for one in findings
    ]
    return "<h3>Findings</h3>" + table(["", "What", "Where"], rows, words=words)


def _distances(distances: tuple[Distance, ...]) -> str:
    words = frozenset({0, 3})
    rows = []
    for one in distances:
        left = f"{one.left:.1f}"
        if one.left < one.wanted:
            left = f'<span class="fail">{left}</span>'
        rows.append(
            [
                text(one.name),
                left,
                f"{one.wanted:.1f}",
                f"drone {one.place.drone + 1}, {clock(one.place.time)}",
            ]
        )
    heads = ["From … to …", "Left, at least [m]", "Wanted [m]", "Decided by"]
    return "<h3>Distances</h3>" + table(heads, rows, words=words)


def _failures(failures: Failures) -> str:
    """Return from where falling drones may meet most others."""
    words = frozenset({0, 2})
    order = np.argsort(-failures.met, axis=None, kind="stable")[:5]
    rows = []
    for step, drone in zip(*np.unravel_index(order, failures.met.shape), strict=True):
        below = failures.below(int(step), int(drone))
        if below:
            shown = ", ".join(str(other + 1) for other in below[:12])
            rows.append(
                [
                    f"drone {drone + 1}, {clock(float(failures.times[step]))}",
                    str(len(below)),
                    shown + (" …" if len(below) > 12 else ""),
                ]
            )
    said = (
        "<h3>One drone fails</h3><p>From "
        f"{100.0 * failures.share:.1f} % of all drones and seconds a drone without "
        "thrust may meet another one on its way down; from all others it cannot.</p>"
    )
    heads = ["Falls", "May meet", "Drones"]
    return said + (table(heads, rows, words=words) if rows else "")


def _stops(stops: Stops) -> str:
    """Return how long the fleet takes to stand still."""
    kept = stops.authority
    plot = line_plot(
        "Time until the fleet stands still [s]",
        stops.times,
        [Curve("by the second of the show at which the stop begins", stops.durations)],
    )
    return (
        "<h3>Stop</h3><p>One clock drives all drones. Brought to rest it keeps every "
        f"distance, and accelerations of {kept.level:.1f} m/s² sideways, {kept.up:.1f} "
        f"up and {kept.down:.1f} down. From every second below the fleet stands within "
        f"{stops.longest:.2f} s, from any instant within {stops.sure:.2f} s (proved). "
        f"<code>showc stream</code> stops so.</p><div class='maps'>{plot}</div>"
    )


def _aborts(logged: LoggedShow) -> str:
    """Return how the stopped fleet comes down, by the table in the log."""
    table_ = logged.aborts
    if not table_.rows:
        return "<p>No way down was planned: <code>showc abort</code> does.</p>"
    words = frozenset({0, 2})
    lines = []
    for one in table_.rows:
        stop = time_to_rest(one, table_.period)
        legs = [table_.legs[number].certificate for number in one.legs]
        near = [leg.closest.distance for leg in legs if leg.HasField("closest")]
        lines.append(
            [
                clock(one.time),
                f"{stop:.2f}",
                pb.AbortRow.Way.Name(one.way).lower().replace("_", " "),
                f"{one.duration:.1f}",
                f"{stop + one.duration:.1f}",
                f"{min(near):.2f}" if near else "",
            ]
        )
    heads = [
        "At", "Stands in [s]", "Then", "On the ground in [s]", "Together [s]",
        "Smallest separation [m]",
    ]  # fmt: skip
    said = (
        "<h3>Abort table</h3><p>Ways down and ways home are in the log, flight by "
        "flight: <code>showc verify</code> proves them as it proves the show, from "
        "where the fleet stands; and the accelerations of the stop, and of ways back "
        "along the plan, which keep its distances.</p>"
    )
    return said + table(heads, lines, words=words)


def _wind(case: SafetyCase, flown: Campaign | None) -> str:
    """Return what wind asks of drones, and how far they strayed in a simulated one."""
    risk, limits = case.show.site.risk, case.show.limits
    standing, flying = (f"{np.degrees(lean):.0f}°" for lean in case.leans)
    said = (
        f"<h3>Wind</h3><p>A steady wind of {risk.wind:g} m/s leans a drone that stands "
        f"by up to {standing}, and the fastest drone, against it, by up to {flying} "
        "(drag alone, an estimate). The plan itself tilts by no more than "
        f"{np.degrees(limits.tilt):.0f}°.</p>"
    )
    if flown is None:
        return (
            f"{said}<p>Not flown in simulated wind: <code>showc simulate</code> does."
            "</p>"
        )
    show, weather = case.show, flown.weather
    wanted = show.kept
    lines = []
    for tube in flown.tubes:
        near = "" if isinf(tube.closest) else f"{tube.closest:.2f}"
        if tube.closest < wanted:
            near = f'<span class="fail">{near}</span>'
        lines.append(
            [
                text(tube.name) + small(f"from {clock(tube.start)}"),
                f"{tube.rms:.2f}",
                f"{tube.radius:.2f}",
                f"{100.0 * tube.share:.1f}",
                near,
                f"{100.0 * tube.saturated:.2f}",
                f"{100.0 * tube.used:.0f}",
            ]
        )
    heads = [
        "Leg", "Error, RMS [m]", "Tube [m]", "Share of flights [%]",
        "Nearest two drones [m]", "Rotors at limits [%]", "Limits taken [%]",
    ]  # fmt: skip
    watched = "with" if flown.observer else "without"
    planned = (
        f"; paths keep {show.separation.distance:g} m, for each drone may stray by "
        f"{show.tracking:g} m"
        if show.tracking
        else ""
    )
    return (
        f"{said}<p>A simulation with typical figures, not of one aircraft: "
        f"{weather.runs} flights in a wind of {weather.wind:g} m/s with "
        f"{text(weather.gusts)} gusts (Dryden), {text(flown.controller)} controller "
        f"{watched} disturbance observer. Tubes hold their share of flights of single "
        f"drones with a confidence of {100.0 * CONFIDENCE:.0f} %. Two drones are "
        f"to keep {wanted:g} m{planned}; red: they came nearer. Limits taken are those "
        "of speed, body rates and thrust, and a lean of "
        f"{np.degrees(LEAN):.0f}°, not the tilt of the plan; above 100 % one "
        "was left.</p>" + table(heads, lines, words=frozenset({0}))
    )


def _energy(case: SafetyCase) -> str:
    """Return how the batteries empty: the drones that take most, and plots."""
    energy, battery = case.energy, case.show.battery
    worst = energy.worst
    order = np.argsort(-energy.used, kind="stable")[:5]
    rows = [
        [
            f"drone {drone + 1}",
            f"{energy.energy[drone] / 3600.0:.2f}",
            f"{100.0 * energy.used[drone]:.1f}",
            f"{energy.power[:, drone].max():.1f}",
            f"{np.nanmin(energy.voltage[:, drone]):.2f}",
        ]
        for drone in order.tolist()
    ]
    heads = [
        "Takes most", "Energy [Wh]", "Charge [%]", "Greatest power [W]",
        "Lowest voltage [V]",
    ]  # fmt: skip
    plots = line_plot(
        f"Charge left, drone {worst + 1} [%]",
        energy.times,
        [Curve("", 100.0 * energy.left[:, worst])],
        limits=[100.0 * (1.0 - battery.allowed)],
    ) + line_plot(
        f"Least voltage under load, drone {worst + 1} [V]",
        energy.times,
        [Curve("", np.nan_to_num(energy.voltage[:, worst]))],
        limits=[battery.voltage_min],
    )
    return (
        "<h3>Energy</h3><p>An estimate: momentum theory, fitted to a hover power of "
        f"{battery.hover_power:.1f} W; a battery of {battery.capacity / 3.6:.0f} mAh "
        f"and {battery.resistance * 1e3:.0f} mΩ, full at the start, which hovers for "
        f"{energy.hover_endurance / 60.0:.1f} min. An abort after the flight takes "
        f"{100.0 * energy.abort:.1f} % more; {100.0 * battery.allowed:.0f} % may be "
        f"taken.</p>{table(heads, rows, words=frozenset({0}))}"
        f'<div class="maps">{plots}</div>'
    )


def _spared(logged: LoggedShow) -> str:
    """Return what moves that prefer energy save."""
    lines = []
    for segment in logged.segments:
        counted = segment.message.certificate.statistics
        if "energy_at_once" not in counted:
            continue
        spent, at_once = counted["energy"], counted["energy_at_once"]
        lines.append(
            [
                text(segment.message.name) + small(f"from {clock(segment.start)}"),
                f"{segment.duration:.1f}",
                f"{spent / 3600.0:.2f}",
                f"{at_once / 3600.0:.2f}",
                f"{100.0 * (1.0 - spent / at_once):.1f}",
            ]
        )
    if not lines:
        return ""
    heads = [
        "Prefers energy", "Takes [s]", "Fleet's energy [Wh]",
        "Flown at once, then hovered [Wh]", "Saved [%]",
    ]  # fmt: skip
    return table(heads, lines, words=frozenset({0}))


def _volumes(case: SafetyCase) -> str:
    words = frozenset({0})
    buffers = case.buffers
    width = {
        "Contingency volume": buffers.contingency,
        "Ground risk buffer, ballistic": buffers.ballistic,
        "Ground risk buffer, 1:1": buffers.one_to_one,
    }
    rows = [
        [
            text(volume.name),
            f"{width[volume.name]:.1f}" if volume.name in width else "",
            f"{volume.top:.1f}",
            (
                f"{np.ptp(volume.corners[:, 0]):.0f} x "
                f"{np.ptp(volume.corners[:, 1]):.0f}"
            ),
            f"{area(volume.corners):,.0f}",
        ]
        for volume in case.volumes
    ]
    heads = ["Volume", "Added width [m]", "Top [m]", "Extent [m]", "Area [m²]"]
    method = case.show.site.risk.method
    clear = {
        "ballistic": " and the ballistic ground risk buffer",
        "one-to-one": " and the 1:1 ground risk buffer",
    }.get(method, "; the ground risk buffers are there to compare")
    return (
        "<h3>Volumes</h3><p>The script wants these clear of the audience: the impact "
        f"footprint{clear}. Widths add up from the flight geography outwards.</p>"
        + table(heads, rows, words=words)
    )


def volumes_from_above(logged: LoggedShow, case: SafetyCase) -> str:
    """Draw volumes, fence, audience and buildings from above, to scale."""
    site = case.show.site
    around = [volume.corners for volume in case.volumes] + [case.fence]
    around += [people.points for people in site.audience]
    around += [building.corners for building in site.buildings]
    frame = Frame.around(np.concatenate(around), width=940.0, height=560.0)
    parts = [
        _shape(frame, volume.corners, colour, 0.07)
        for colour, volume in reversed(list(zip(COLOURS, case.volumes, strict=True)))
    ]
    parts += [
        (
            f'<path d="{path(frame(case.fence), close=True)}" fill="none" '
            'stroke="#e0701b" stroke-width="2" stroke-dasharray="7 4"/>'
        ),
        ways(overview_of(logged).positions, [0, 1], frame),
    ]
    for building in site.buildings:
        parts.append(_shape(frame, building.corners, "#555555", 0.5))
        parts.append(_label(frame, building.corners.mean(axis=0), building.name))
    for people in site.audience:
        if people.area:
            parts.append(_shape(frame, people.points, "#f0a500", 0.35))
        else:
            parts.append(
                f'<path d="{path(frame(people.points))}" fill="none" '
                'stroke="#f0a500" stroke-width="5" stroke-linecap="round"/>'
            )
        parts.append(_label(frame, people.points.mean(axis=0), people.name))
    parts += [scale_bar(frame), north_arrow(float(site.heading), frame)]
    return svg(parts, "Volumes of the show from above", frame)


def _shape(frame: Frame, corners: FloatArray, colour: str, opacity: float) -> str:
    return (
        f'<path d="{path(frame(corners), close=True)}" fill="{colour}" '
        f'fill-opacity="{opacity:g}" stroke="{colour}" stroke-width="1.3"/>'
    )


def _label(frame: Frame, place: FloatArray, name: str) -> str:
    x, y = frame(place[None])[0]
    return (
        f'<text x="{x:.1f}" y="{y - 7:.1f}" text-anchor="middle" '
        f'style="fill:#161b26;font-weight:600">{text(name)}</text>'
    )
