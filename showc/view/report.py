"""The report: what a signature under a show needs to see, on paper."""

from __future__ import annotations

from math import degrees
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.log import showc_pb2 as pb
from showc.view.digest import Digest, digest, tightest
from showc.view.document import (
    badge,
    clock,
    document,
    figure,
    place,
    row,
    small,
    table,
    text,
)
from showc.view.overview import overview_of
from showc.view.pictures import pictures_section
from showc.view.safety import safety_badge, safety_section
from showc.view.sitemap import map_from_above, map_from_the_side

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.flight import Encounter
    from showc.log.reader import LoggedShow
    from showc.safety.case import SafetyCase
    from showc.view.overview import Overview


SHAPES = {
    pb.Separation.SPHERE: "sphere",
    pb.Separation.ELLIPSOID: "ellipsoid",
    pb.Separation.ANY_AXIS: "any axis",
    pb.Separation.ALL_AXES: "all axes",
}
MOST_FILES = 80
"""Mission files that are listed one by one; a great fleet's would fill a book."""
TOLERANCE = 1e-6
"""Separation that the verifier lets pass below the rule [m]."""
SIGNATURE = (
    '<div class="sign"><div>Signed off by</div><div>Place</div><div>Date</div></div>'
)
"""Where a person signs."""
WORDS = {
    "pass": "ok",
    "fail": "FAILED",
    "unproved": "not proved",
    "accepted": "not proved, accepted",
    "warning": "warning",
    "skipped": "nothing to prove",
}


def render_report(
    logged: LoggedShow,
    verification: Mapping[str, Any] | None,
    case: SafetyCase | None = None,
) -> str:
    """Return the report as one printable HTML page.

    Parameters
    ----------
    logged
        The show.
    verification
        What ``showc verify --json`` gives; None: the report says that nothing was
        verified, and has no margins.
    case
        The safety case of the show; None: the report has none.
    """
    digests = digest(logged)
    overview = overview_of(logged)
    body = [
        _head(logged, verification, case),
        _figures(logged, digests),
        site_section(overview),
        "" if case is None else safety_section(logged, case),
        pictures_section(overview),
        _moves(logged, digests),
        checks_section(verification),
        forecast_section(logged.manifest),
        SIGNATURE,
        _origin(logged),
    ]
    return document(f"{logged.rules.name} – report", "\n".join(body))


def _head(
    logged: LoggedShow,
    verification: Mapping[str, Any] | None,
    case: SafetyCase | None,
) -> str:
    site = logged.rules.site
    safe = "" if case is None else safety_badge(case)
    return (
        f"<header><div><h1>{text(logged.rules.name)}</h1>"
        f"<p>Drone show report · site {site.latitude:.6f}°, {site.longitude:.6f}°, "
        f"{site.altitude:.1f} m · heading {site.heading:.1f}°</p></div>"
        f'<div class="verdicts">{badge(verification)}{safe}</div></header>'
    )


def _figures(logged: LoggedShow, digests: tuple[Digest, ...]) -> str:
    nearest = tightest(digests)
    rule = logged.rules.separation.distance
    shown = [
        (str(logged.drones), "drones", ""),
        (clock(logged.duration), "from take-off to landing", ""),
        (str(sum(one.moving for one in digests)), "moves", ""),
        (f"{logged.positions[..., 2].max():.1f} m", "greatest height", ""),
        (
            f"{max(one.speed for one in digests):.2f} m/s",
            f"greatest speed ({_along_an_axis(logged):.2f} m/s along an axis)",
            "",
        ),
        (
            "–" if nearest is None else f"{nearest.distance:.2f} m",
            f"smallest separation (rule: {rule:.2f} m)",
            "fail" if _too_near(nearest, rule) else "",
        ),
    ]
    return figures_section(shown)


def figures_section(shown: Sequence[tuple[str, str, str]]) -> str:
    """HTML of the greatest figures: value, what it is, class of the value."""
    inner = "".join(
        f'<div><b class="{kind}">{text(value)}</b><span>{text(name)}</span></div>'
        for value, name, kind in shown
    )
    return f'<section class="figures">{inner}</section>'


def _along_an_axis(logged: LoggedShow) -> float:
    """Greatest speed of any drone along an axis, from the samples [m/s]."""
    parts = (np.abs(logged.samples[name]).max() for name in ("vx", "vy", "vz"))
    return float(max(parts))


def _too_near(closest: Encounter | None, rule: float) -> bool:
    return closest is not None and closest.distance < rule - TOLERANCE


def site_section(overview: Overview) -> str:
    """HTML of the two drawings of the site."""
    ground = overview.ground
    corners = len(ground.fence)
    fence = f"Orange: fence of {corners} corners." if corners else "No fence is known."
    volume = f"Highest drone at {overview.highest:.1f} m; no ceiling is known."
    if ground.ceiling is not None:
        below = "up" if ground.floor is None else f"from {ground.floor:.1f} m"
        volume = f"Flight volume {below} to {ground.ceiling:.1f} m."
    return (
        "<h2>Site</h2><div class='maps'>"
        f"<figure>{map_from_above(overview)}<figcaption>From above. {fence} Squares: "
        "pads. Dots: places of the pictures in their colours. Cross: "
        "origin.</figcaption></figure>"
        f"<figure>{map_from_the_side(overview)}<figcaption>From the front. {volume}"
        "</figcaption></figure></div>"
    )


def _moves(logged: LoggedShow, digests: tuple[Digest, ...]) -> str:
    heads = [
        "", "Move", "Start", "Duration [s]", "Lower bound [s]", "Gap",
        "Smallest separation [m]", "Speed [m/s]", "Roll, pitch [°]",
    ]  # fmt: skip
    nearest = tightest(digests)
    rule = logged.rules.separation.distance
    rows: list[Sequence[str]] = []
    number = 0
    for one in digests:
        number += one.moving
        rows.append(_move(one, number, nearest, rule))
        rows += [_group_move(move) for move in one.segment.message.moves]
    limits = logged.rules.limits
    fastest = max(
        max(abs(value) for value in (v.x, v.y, v.z))
        for one in limits
        for v in (one.velocity_min, one.velocity_max)
    )
    rows.append(
        row(
            [
                "",
                "allowed",
                "",
                "",
                "",
                "",
                (f"≥ {rule:.2f} ({SHAPES[logged.rules.separation.shape]})"),
                f"≤ {fastest:.2f} per axis",
                f"≤ {degrees(max(one.tilt for one in limits)):.1f}",
            ],
            kind="limit",
            words=frozenset({1}),
        )
    )
    bounds = [one for one in digests if one.bound is not None]
    note = (
        '<p class="note">Lower bound: no flight of the fleet is shorter (proved).</p>'
        if bounds
        else ""
    )
    note += (
        '<p class="note">Gap: how much longer a move takes than its slowest drone '
        "would need alone. Where the script sets the time, so is the gap.</p>"
    )
    note += (
        '<p class="note">Speeds are in the direction of flight. The limit holds along '
        "each axis, so that a slanted flight may be faster.</p>"
    )
    note += _passing(digests) + _envelope_cost(digests)
    return f"<h2>Moves</h2>{table(heads, rows, words=frozenset({1}))}{note}"


def _group_move(move: pb.Move) -> list[str]:
    """Return the line of a group that has times of its own, below its leg."""
    certificate = move.certificate
    least, bound = certificate.single_drone_minimum, certificate.dual_bound
    return [
        "",
        text(f"{move.group}: {move.name}"),
        clock(move.start),
        f"{move.duration:.3f}",
        f"{bound:.3f}" if bound > 0.0 else "–",
        f"{100.0 * (move.duration / least - 1.0):.1f} %" if least > 0.0 else "–",
        "",
        "",
        "",
    ]


def _passing(digests: tuple[Digest, ...]) -> str:
    """Say what pairs need to pass each other, where that is more than one alone."""
    return "".join(
        f'<p class="note">{text(one.segment.message.name)}: drones {one.passing[0]} '
        f"and {one.passing[1]} need at least {one.passing[2]:.3f} s to pass each "
        "other, by the planner's own bound.</p>"
        for one in digests
        if one.passing is not None
    )


def _envelope_cost(digests: tuple[Digest, ...]) -> str:
    """Say how much of the time of the moves the autopilot's envelope may cost."""
    pairs = [
        (one.segment.duration, one.airframe_bound)
        for one in digests
        if one.airframe_bound is not None
    ]
    if not pairs:
        return ""
    flown = sum(duration for duration, _ in pairs)
    least = sum(bound for _, bound in pairs)
    return (
        f'<p class="note">These moves take {flown:.1f} s within the envelope that the '
        f"autopilot follows. The airframe alone would need at least {least:.1f} s "
        "(proved for the slowest drone of each move). The envelope and any limit of "
        f"jerk cost at most {100.0 * (flown / least - 1.0):.0f} %.</p>"
    )


def _move(one: Digest, number: int, nearest: Encounter | None, rule: float) -> str:
    message = one.segment.message
    closest = one.closest
    way = f"{message.from_formation} → {message.to_formation}" if one.moving else ""
    way = "" if way == message.name.replace("->", "→") else way
    distance = ""
    if closest is not None:
        where = f"{closest.drone_a + 1} and {closest.drone_b + 1}"
        value = f"{closest.distance:.2f}"
        if _too_near(closest, rule):
            value = f'<span class="fail">{value}</span>'
        if closest is nearest:
            value = f"<b>◆ {value}</b>"
        distance = value + small(f"{where}, {clock(closest.time)}")
    return row(
        [
            str(number) if one.moving else "",
            text(message.name) + small(text(way)),
            clock(one.segment.start),
            f"{one.segment.duration:.3f}",
            "–" if one.bound is None else f"{one.bound:.3f}",
            "–" if one.gap is None else f"{100.0 * one.gap:.1f} %",
            distance,
            f"{one.speed:.2f}" if one.moving else "",
            f"{degrees(one.tilt):.1f}" if one.moving else "",
        ],
        kind="" if one.moving else "hold",
        words=frozenset({1}),
    )


def checks_section(verification: Mapping[str, Any] | None) -> str:
    """HTML table of what was proved, with margins and places."""
    if verification is None:
        return (
            "<h2>Margins</h2><p>Nothing was verified. Run <code>showc verify</code> "
            "on the log before you sign.</p>"
        )
    heads = ["", "What is proved", "Found", "Allowed", "Where"]
    words = frozenset({0, 1, 4})
    rows: list[Sequence[str]] = []
    group = None
    for check in verification["checks"]:
        if check["group"] != group:
            group = check["group"]
            rows.append(
                f'<tr><td colspan="5" class="text"><h3>{text(group)}</h3></td></tr>'
            )
        verdict = check["verdict"]
        notes = "".join(small(text(note)) for note in check["notes"])
        rows.append(
            [
                (
                    f'<span class="{"ok" if verdict == "pass" else verdict}">'
                    f"{WORDS.get(verdict, text(verdict))}</span>"
                ),
                text(f"{check['code']} {check['name']}") + notes,
                text(figure(check["value"], check["unit"])),
                text(figure(check["limit"], check["unit"])),
                text(place(check["where"])),
            ]
        )
    shown = table(heads, rows, words=words, kind="checks")
    return (
        "<h2>Margins and proofs<small>by showc verify; "
        f"{text(verification['anchor'])}</small></h2>{shown}"
    )


def _origin(logged: LoggedShow) -> str:
    """Hashes and versions: what exactly was looked at."""
    manifest, metadata = logged.manifest, logged.metadata
    files = _entry(_entry(manifest, "missions"), "files")
    rows = [
        ("Script", metadata.get("script", ""), metadata.get("script_sha256", "")),
        ("Manifest", "manifest.json", metadata.get("manifest_sha256", "")),
    ]
    rows += [
        ("Input", str(name), str(digest_))
        for name, digest_ in _entry(_entry(manifest, "show"), "inputs").items()
    ]
    if isinstance(manifest.get("fleet"), str):
        rows.append(("Fleet", f"{len(files)} files", manifest["fleet"]))
    if len(files) <= MOST_FILES:
        rows += [("", str(name), str(value)) for name, value in files.items()]
    else:
        rows.append(("", "each file", "in manifest.json"))
    words = frozenset({0, 1, 2})
    versions = ", ".join(
        f"{name} {value}" for name, value in _entry(manifest, "versions").items()
    )
    lines = [
        [text(kind), text(name), f"<code>{text(value)}</code>"]
        for kind, name, value in rows
    ]
    made = text(versions or f"showc {metadata.get('showc_version', '')}")
    return (
        "<h2>Files<small>SHA-256</small></h2>"
        + table(["", "File", "Hash"], lines, words=words)
        + f'<p class="note">Made with {made}. Vehicle: {text(_vehicle(logged))}.</p>'
    )


def _entry(content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """Return the object under ``key``; empty where the manifest has none."""
    found = content.get(key)
    return found if isinstance(found, dict) else {}


def _vehicle(logged: LoggedShow) -> str:
    vehicle = logged.rules.vehicle
    weight = vehicle.mass * vehicle.gravity
    ratio = 4.0 * vehicle.thrust_coefficient * vehicle.rotor_speed_max**2 / weight
    held = "held" if logged.rules.yaw_held else "free"
    yaw = np.degrees(logged.rules.heading)
    return (
        f"{vehicle.name}, {vehicle.mass:.3f} kg, thrust to weight {ratio:.2f}; "
        f"yaw {held} at {yaw:.1f}°"
    )


def forecast_section(manifest: Mapping[str, Any]) -> str:
    """HTML of the missions' prediction; empty where the manifest has none."""
    missions = manifest.get("missions")
    if not isinstance(missions, dict):
        return ""
    prediction = missions.get("prediction")
    if not isinstance(prediction, dict) or "legs" not in prediction:
        return ""
    heads = [
        "Leg", "Flown", "Start", "Duration [s]", "In the log [s]",
        "Off the log by [m]", "Later by [s]", "Smallest separation [m]",
    ]  # fmt: skip
    words = frozenset({0, 1})
    rows = [_leg(leg) for leg in prediction["legs"]]
    rows += [
        [name, "", "", "", "", "", "", _encounter(prediction.get(key))]
        for name, key in (("Take-off", "launch"), ("Landing", "land"))
        if prediction.get(key)
    ]
    minute = prediction.get("start_minute")
    start = prediction.get("start") or f"minute {minute} of any hour"
    warnings = "".join(f"<li>{text(one)}</li>" for one in missions.get("warnings", []))
    return (
        "<h2>Missions<small>prediction for "
        f"{text(prediction.get('firmware', 'the autopilot'))}</small></h2>"
        f"<p>Start: {text(start)}. Duration: {clock(prediction['duration'])}. Times "
        "are those of the missions, which wait for a clock slot before each leg. A leg "
        f"begins {prediction.get('delay', 0.0):.2f} ± "
        f"{prediction.get('delay_spread', 0.0):.2f} s after its slot.</p>"
        + table(heads, rows, words=words)
        + (f"<ul>{warnings}</ul>" if warnings else "")
    )


def _leg(leg: Mapping[str, Any]) -> list[str]:
    slots = leg.get("slots", [leg["slot"]])
    more = small(f"in {len(slots)} groups") if len(slots) > 1 else ""
    return [
        text(leg["name"]),
        text(leg["encoding"]) + more,
        clock(leg["slot"]),
        f"{leg['duration']:.2f}",
        f"{leg['optimal_duration']:.2f}",
        f"{max(leg['position_difference'], default=0.0):.2f}",
        f"{max(leg['arrival_difference'], default=0.0):.2f}",
        _encounter(leg.get("closest")),
    ]


def _encounter(found: Mapping[str, Any] | None) -> str:
    if not found:
        return "–"
    where = ""
    if "drones" in found:
        where = f"{found['drones'][0]} and {found['drones'][1]}"
    if found.get("time") is not None:
        where += f", {clock(found['time'])}"
    return f"{found['distance']:.2f}" + small(where)
