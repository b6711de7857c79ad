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
    from showc.script.show import Audience


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
        "<h2>Safety of the site<small>falls, distances and stops hold for every "
        "instant of the solved flights; wind and energy are estimates</small></h2>"
        f"{_flown(logged)}<figure>{volumes_from_above(logged, case)}<figcaption>"
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
        f"revision 1.7, with V0 {case.flying.speed:.1f} m/s (wind included), a tilt "
        f"of {np.degrees(case.flying.tilt):.0f}°, reaction {risk.reaction_time:g} s, "
        f"errors of {risk.gnss_error:g} m (satellite position), "
        f"{risk.position_error:g} m (keeping the place), {risk.map_error:g} m (map) "
        f"and {risk.height_error:g} m (height). Turned and moved: "
        f"{np.degrees(risk.rotation):g}° about the origin and {risk.shift:g} m.</p>"
    )


def _flown(logged: LoggedShow) -> str:
    """Say of a show with missions whose flights are judged here."""
    if not isinstance(logged.manifest.get("missions"), dict):
        return ""
    return (
        "<p>The solved flights are those of <code>showc stream</code>. Missions fly to "
        "the same places on other ways and at other times: <code>showc verify</code> "
        "proves their distances from the fence and from each other, but their falls "
        "are not computed.</p>"
    )


def _key(case: SafetyCase) -> str:
    entries = [
        (colour, volume.name)
        for colour, volume in zip(COLOURS, case.volumes, strict=True)
    ]
    site = case.show.site
    dashed = "repeating-linear-gradient(90deg,#e0701b 0 5px,#0000 5px 8px)"
    entries.append((dashed, "Fence"))
    entries += [("#f0a500", "Audience")] * bool(site.audience)
    entries += [("#555555", "Buildings")] * bool(site.buildings)
    return "".join(
        f'<span class="key"><i style="background:{colour}"></i>{text(name)}</span> '
        for colour, name in entries
    )


def _findings(findings: tuple[Finding, ...]) -> str:
    if not findings:
        return "<p>No findings.</p>"
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
    heads = ["Distance", "At least [m]", "Required [m]", "Decided by"]
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
        "<h3>One drone fails</h3><p>A drone that loses thrust may hit another one on "
        f"its way down in {100.0 * failures.share:.1f} % of all cases, one for each "
        "drone and second of the show. In all other cases it cannot.</p>"
    )
    heads = ["Falling drone", "May hit", "Drones"]
    return said + (table(heads, rows, words=words) if rows else "")


def _stops(stops: Stops) -> str:
    """Return how long the fleet takes to stand still."""
    kept = stops.authority
    plot = line_plot(
        "Time to stop [s]",
        stops.times,
        [Curve("by the second of the show at which the stop begins", stops.durations)],
    )
    return (
        "<h3>Stop</h3><p>All drones follow one clock. <code>showc stream</code> stops "
        "the fleet by slowing this clock down to rest, so that all distances are kept. "
        f"Accelerations stay within {kept.level:.1f} m/s² sideways, {kept.up:.1f} up "
        f"and {kept.down:.1f} down. From each second plotted, the fleet stops within "
        f"{stops.longest:.2f} s; from any instant, within {stops.sure:.2f} s "
        f"(proved).</p><div class='maps'>{plot}</div>"
    )


def _aborts(logged: LoggedShow) -> str:
    """Return how the stopped fleet comes down, by the table in the log."""
    table_ = logged.aborts
    if not table_.rows:
        return "<p>No abort was planned: see <code>showc abort</code>.</p>"
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
        "At", "The stop takes [s]", "Then", "This takes [s]", "In all [s]",
        "Smallest separation [m]",
    ]  # fmt: skip
    said = (
        "<h3>Abort table</h3><p>The log holds the flights of every way down and way "
        "home. <code>showc verify</code> proves them as it proves the show, from where "
        "the fleet has stopped. It also proves the accelerations of the stop, and of "
        "ways back along the plan, which keep the plan's distances.</p>"
    )
    return said + table(heads, lines, words=words)


def _wind(case: SafetyCase, flown: Campaign | None) -> str:
    """Return what wind asks of drones, and how far they strayed in a simulated one."""
    risk, limits = case.show.site.risk, case.show.limits
    standing, flying = (f"{np.degrees(lean):.0f}°" for lean in case.leans)
    said = (
        f"<h3>Wind</h3><p>In a steady wind of {risk.wind:g} m/s a hovering drone "
        f"tilts by up to {standing}, and the fastest drone, flying against it, by up "
        f"to {flying} (from drag alone, an estimate). The plan itself tilts by at most "
        f"{np.degrees(limits.tilt):.0f}°.</p>"
    )
    if flown is None:
        return (
            f"{said}<p>No flights in wind were simulated: see <code>showc "
            "simulate</code>.</p>"
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
        "Closest pair [m]", "Rotors at limits [%]", "Limits used [%]",
    ]  # fmt: skip
    watched = "with" if flown.observer else "without"
    planned = (
        f"; their paths keep {show.separation.distance:g} m, because each drone may "
        f"stray by {show.tracking:g} m"
        if show.tracking
        else ""
    )
    return (
        f"{said}<p>A simulation with typical figures, not of one aircraft: "
        f"{weather.runs} flights in a wind of {weather.wind:g} m/s with "
        f"{text(weather.gusts)} gusts (Dryden), {text(flown.controller)} controller "
        f"{watched} disturbance observer. A tube contains the stated share of single "
        f"drones' flights, with a confidence of {100.0 * CONFIDENCE:.0f} %. Two drones "
        f"must stay {wanted:g} m apart{planned}; red: they came closer. The limits "
        "used are those of speed, body rates and thrust, and a tilt of "
        f"{np.degrees(LEAN):.0f}° in place of the plan's; above 100 % one of them was "
        "exceeded.</p>" + table(heads, lines, words=frozenset({0}))
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
            _voltage(float(energy.voltage[:, drone].min())),
        ]
        for drone in order.tolist()
    ]
    heads = [
        "Largest use", "Energy [Wh]", "Charge [%]", "Greatest power [W]",
        "Lowest voltage [V]",
    ]  # fmt: skip
    plots = line_plot(
        f"Charge left, drone {worst + 1} [%]",
        energy.times,
        [Curve("", 100.0 * energy.left[:, worst])],
        limits=[100.0 * (1.0 - battery.allowed)],
    ) + line_plot(
        f"Lowest voltage under load, drone {worst + 1} [V]",
        energy.times,
        [Curve("", np.nan_to_num(energy.voltage[:, worst]))],
        limits=[battery.voltage_min],
    )
    return (
        "<h3>Energy</h3><p>An estimate by momentum theory, fitted to a hover power of "
        f"{battery.hover_power:.1f} W. The battery of {battery.capacity / 3.6:.0f} mAh "
        f"and {battery.resistance * 1e3:.0f} mΩ is full at the start, and lasts for "
        f"{energy.hover_endurance / 60.0:.1f} min of hovering. An abort at the end "
        f"uses {100.0 * energy.abort:.1f} % more. At most "
        f"{100.0 * battery.allowed:.0f} % of the charge may be used.</p>"
        f"{table(heads, rows, words=frozenset({0}))}"
        f'<div class="maps">{plots}</div>'
    )


def _voltage(lowest: float) -> str:
    """Return a voltage; NaN: the battery cannot give the power at any."""
    return f"{lowest:.2f}" if lowest > 0.0 else '<span class="fail">none</span>'


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
        "Move that saves energy", "Duration [s]", "Fleet's energy [Wh]",
        "Flown at once, then hovering [Wh]", "Saved [%]",
    ]  # fmt: skip
    return table(heads, lines, words=frozenset({0}))


def _volumes(case: SafetyCase) -> str:
    words = frozenset({0})
    buffers, ground = case.buffers, case.show.site.risk.ground
    width = {
        "Contingency volume": buffers.contingency,
        "Ground risk buffer, ballistic": buffers.ballistic,
        "Ground risk buffer, 1:1": buffers.one_to_one,
    }
    rows = [
        [
            text(volume.name),
            f"{width[volume.name]:.1f}" if volume.name in width else "",
            f"{volume.top:.1f}" if volume.top > ground else "on the ground",
            (
                f"{np.ptp(volume.corners[:, 0]):.0f} × "
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
    }.get(method, "; the ground risk buffers are for comparison")
    return (
        "<h3>Volumes</h3><p>The script demands that the audience stays outside the "
        f"impact footprint{clear}. Widths add up outwards, from the flight geography."
        "</p>" + table(heads, rows, words=words)
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
        parts.append(_label(frame, _middle(people), people.name))
    parts += [scale_bar(frame), north_arrow(float(site.heading), frame)]
    return svg(parts, "Volumes of the show from above", frame)


def _shape(frame: Frame, corners: FloatArray, colour: str, opacity: float) -> str:
    return (
        f'<path d="{path(frame(corners), close=True)}" fill="{colour}" '
        f'fill-opacity="{opacity:g}" stroke="{colour}" stroke-width="1.3"/>'
    )


def _middle(people: Audience) -> FloatArray:
    """Return the place of an audience's name: on its line, or in its area."""
    if people.area:
        return np.asarray(people.points.mean(axis=0))
    way = np.linalg.norm(np.diff(people.points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(way)])
    half = 0.5 * along[-1]
    return np.array([np.interp(half, along, part) for part in people.points.T])


def _label(frame: Frame, place: FloatArray, name: str) -> str:
    x, y = frame(place[None])[0]
    return (
        f'<text x="{x:.1f}" y="{y - 7:.1f}" text-anchor="middle" '
        'style="fill:#161b26;font-weight:600;paint-order:stroke;stroke:#fff;'
        f'stroke-width:3px;stroke-linejoin:round">{text(name)}</text>'
    )
