"""What was found about a show, as pages list it, ring it and mark it on the ruler."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from showc.view.document import figure, place

if TYPE_CHECKING:
    from collections.abc import Mapping

SEVERITIES = {
    "fail": "error",
    "unproved": "error",
    "accepted": "warning",
    "warning": "warning",
    "skipped": "none",
    "pass": "ok",
}
"""How a verdict of the verification is shown."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding as the page lists it."""

    code: str
    severity: str
    """``error`` and ``warning`` are marked; ``ok`` and ``none`` only listed."""
    message: str
    help: str
    line: int
    """Of the script, from 1; 0: no particular one."""
    time: float | None
    """Show time at which it can be seen [s]."""
    drones: tuple[int, ...]
    """Which drones it is about, counting from 0."""
    group: str = ""
    """Heading that it stands under."""


def findings_of(
    verification: Mapping[str, Any] | None, *, whole: bool = False
) -> tuple[Finding, ...]:
    """Return what ``showc verify --json`` found not proved; all if ``whole``."""
    checks = [] if verification is None else verification["checks"]
    return tuple(
        _finding(check)
        for check in checks
        if whole or check["verdict"] not in {"pass", "skipped"}
    )


def _finding(check: Mapping[str, Any]) -> Finding:
    where = check["where"]
    found = figure(check["value"], check["unit"])
    if found and check["limit"] is not None:
        found += f", limit {figure(check['limit'], '')}"
    parts = (check["name"], found, place(where))
    drones = where.get("pair") or ([where["drone"]] if "drone" in where else [])
    return Finding(
        code=check["code"],
        severity=SEVERITIES[check["verdict"]],
        message=" · ".join(part for part in parts if part),
        help="; ".join(check["notes"]),
        line=0,
        time=where.get("time"),
        drones=tuple(drone - 1 for drone in drones),
        group=check["group"],
    )
