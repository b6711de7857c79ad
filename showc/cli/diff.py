"""``showc diff``: compare two compiled shows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from showc.log.reader import LoggedShow

_LOG = click.Path(dir_okay=False, path_type=Path)


@click.command(name="diff")
@click.argument("before", type=_LOG, metavar="A.mcap")
@click.argument("after", type=_LOG, metavar="B.mcap")
@click.option("--json", "as_json", is_flag=True, help="Print the differences as JSON.")
def command(before: Path, after: Path, as_json: bool) -> int:
    """Compare two compiled shows: rules, legs, times, paths.

    Ends with 0 if both fly the same, 1 if they differ.

    \b
      showc diff monday.mcap tuesday.mcap
    """
    from showc.log.reader import read_log

    differences = compare(read_log(before), read_log(after))
    if as_json:
        click.echo(json.dumps({"same": not differences, "differences": differences}))
    elif not differences:
        click.echo("both fly the same")
    else:
        for item in differences:
            click.echo("{what}: {before} -> {after}".format(**item))
    return int(bool(differences))


def compare(before: LoggedShow, after: LoggedShow) -> list[dict[str, Any]]:
    """List what differs between two shows, the most general first."""
    found: list[dict[str, Any]] = []

    def note(what: str, old: object, new: object) -> None:
        if old != new:
            found.append({"what": what, "before": old, "after": new})

    for name in ("name", "drones", "yaw_held", "heading", "log_rate"):
        note(name, getattr(before.rules, name), getattr(after.rules, name))
    for name in ("site", "vehicle", "separation"):
        old = _flat(getattr(before.rules, name))
        new = _flat(getattr(after.rules, name))
        for key in sorted(old | new):
            note(f"{name} {key}", old.get(key), new.get(key))
    note(
        "duration [s]", round(before.rules.duration, 3), round(after.rules.duration, 3)
    )
    note("legs", len(before.segments), len(after.segments))
    same_fleet = before.rules.drones == after.rules.drones
    for old_leg, new_leg in zip(before.segments, after.segments, strict=False):
        title = f"leg {old_leg.message.index} {old_leg.message.name!r}"
        note(title, old_leg.message.name, new_leg.message.name)
        note(f"{title} takes [s]", old_leg.duration, new_leg.duration)
        if same_fleet:
            note(
                f"{title} drones with another path",
                0,
                _other_paths(old_leg.trajectories, new_leg.trajectories),
            )
    return found


def _flat(message: Any) -> dict[str, Any]:  # noqa: ANN401 - any protobuf message
    """Fields of a message as a flat mapping of readable values."""
    return {
        field.name: str(value).strip().replace("\n", ", ")
        for field, value in message.ListFields()
    }


def _other_paths(before: Any, after: Any) -> int:  # noqa: ANN401 - trajectories
    """Count drones whose states differ by more than a micrometre anywhere."""
    import numpy as np

    count = 0
    for old, new in zip(before, after, strict=True):
        end = max(old.state.end, new.state.end)
        times = np.linspace(0.0, end, 101)
        difference = old.state(times)[:, :3] - new.state(times)[:, :3]
        count += bool(np.abs(difference).max() > 1e-6)
    return count
