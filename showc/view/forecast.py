"""What the missions will do when autopilots fly them: a section of the report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from showc.view.document import clock, small, table, text

if TYPE_CHECKING:
    from collections.abc import Mapping


def forecast_section(manifest: Mapping[str, Any]) -> str:
    """HTML of the missions' prediction; empty where the manifest has none."""
    missions = manifest.get("missions")
    if not isinstance(missions, dict):
        return ""
    prediction = missions.get("prediction")
    if not isinstance(prediction, dict) or "legs" not in prediction:
        return ""
    heads = [
        "Leg", "Flown as", "Starts", "Time [s]", "Log's time [s]",
        "Off the log by [m]", "Arrives later by [s]", "Smallest separation [m]",
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
        f"<p>Start: {text(start)}. Length {clock(prediction['duration'])}. Times are "
        "those of the missions' own clock, which waits between legs; the released leg "
        f"follows its slot by {prediction.get('delay', 0.0):.2f} ± "
        f"{prediction.get('delay_spread', 0.0):.2f} s.</p>"
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
