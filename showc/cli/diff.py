"""``showc diff``: compare two compiled shows."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from showc.cli.options import SHOW, json_option

if TYPE_CHECKING:
    from showc.log.reader import LoggedShow

_SHOW = SHOW


@click.command(name="diff")
@click.argument("before", type=_SHOW, metavar="A.mcap|SHOW")
@click.argument("after", type=_SHOW, metavar="B.mcap|SHOW")
@json_option
def command(before: Path, after: Path, as_json: bool) -> int:
    """Compare two compiled shows: rules, legs, times, paths.

    Another tool's show is compared by its flights from one formation to the next. After
    showc import and compile, this shows how much faster the solved flights are.

    Exits with 0 if both shows are the same, 1 if they differ.

    \b
      showc diff monday.mcap tuesday.mcap
      showc diff night.skyc night.mcap
    """
    from showc.cli.foreign import is_foreign

    if is_foreign(before) or is_foreign(after):
        differences = gains(_stops(before), _stops(after))
    else:
        from showc.log.reader import read_log

        differences = compare(read_log(before), read_log(after))
    if as_json:
        click.echo(json.dumps({"same": not differences, "differences": differences}))
    elif not differences:
        click.echo("both shows are the same")
    else:
        for item in differences:
            old, new = _shown(item["before"]), _shown(item["after"])
            click.echo(f"{item['what']}: {old} -> {new}")
    return int(bool(differences))


def _shown(value: object) -> object:
    """Return a value as people write it: numbers without the noise of rounding."""
    return float(f"{value:.9g}") if isinstance(value, float) else value


@dataclass(frozen=True, slots=True)
class Stop:
    """A picture while it is held, or the ground."""

    name: str
    begin: float
    """[s]"""
    end: float
    """[s]"""


def gains(before: list[Stop], after: list[Stop]) -> list[dict[str, Any]]:
    """List what each flight from a picture to the next takes in both, and all of them.

    Flights that only one of them has are listed with what the other has not: None.
    """
    old, new = _flights(before), _flights(after)
    found = [
        {
            "what": f"from {first} to {last} [s]",
            "before": old.get((first, last)),
            "after": new.get((first, last)),
        }
        for first, last in old | new
        if old.get((first, last)) != new.get((first, last))
    ]
    both = old.keys() & new.keys()
    total = round(sum(old[one] for one in both), 3)
    least = round(sum(new[one] for one in both), 3)
    if found and total:
        share = f"{abs(100.0 * (1.0 - least / total)):.0f} %"
        way = "less" if least < total else "more"
        what = f"the flights of both, {share} {way} [s]"
        found.append({"what": what, "before": total, "after": least})
    return found


def _flights(stops: list[Stop]) -> dict[tuple[str, str], float]:
    """How long each flight takes, by the pictures that it leads from and to [s]."""
    found: dict[tuple[str, str], float] = {}
    for one, other in pairwise(stops):
        if one.name != other.name:
            found.setdefault((one.name, other.name), round(other.begin - one.end, 3))
    return found


def _stops(path: Path) -> list[Stop]:
    """Return what a show holds, between the ground and the ground."""
    from showc.cli.foreign import is_foreign
    from showc.foreign.script import GROUND

    if is_foreign(path):
        from showc.foreign.acts import holds
        from showc.foreign.reading import read_show
        from showc.foreign.script import held, pictures

        show = read_show(path)
        stands = held(show, holds(show.tracks))
        shown = [*pictures(show), *(one for one in stands if one.name == GROUND)]
        found = [
            Stop(one.name, one.begin, one.end)
            for one in sorted(shown, key=lambda one: one.begin)
        ]
        end = show.tracks.end
    else:
        from showc.log.reader import read_log

        log = read_log(path)
        found, end = [], log.duration
        for leg in log.segments:
            name, stop = str(leg.message.to_formation), leg.start + leg.duration
            # Places that a motion ends in are still those of its picture.
            name = name.partition(" after motion ")[0]
            begin = stop if leg.kind == "transition" else leg.start
            # Above its pads a fleet only passes by.
            if leg.kind in {"hold", "motion", "transition"} and not name.startswith(
                "above "
            ):
                found.append(Stop(name, begin, stop))
    if not found or found[0].name != GROUND:
        found.insert(0, Stop(GROUND, 0.0, 0.0))
    if found[-1].name != GROUND:
        found.append(Stop(GROUND, end, end))
    return found


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


def _flat(message: Any) -> dict[str, Any]:
    """Fields of a message as a flat mapping of readable values."""
    return {
        field.name: str(value).strip().replace("\n", ", ")
        for field, value in message.ListFields()
    }


def _other_paths(before: Any, after: Any) -> int:
    """Count drones whose states differ by more than a micrometre anywhere."""
    import numpy as np

    count = 0
    for old, new in zip(before, after, strict=True):
        end = max(old.state.end, new.state.end)
        times = np.linspace(0.0, end, 101)
        difference = old.state(times)[:, :3] - new.state(times)[:, :3]
        count += bool(np.abs(difference).max() > 1e-6)
    return count
