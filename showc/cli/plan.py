"""``showc plan``: what compile would solve, and bounds before solving."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from showc.cli.options import FILE, cache_option, flag, json_option, outside_option

if TYPE_CHECKING:
    from showc.pipeline.outlook import LegOutlook
    from showc.script.show import Show


@click.command(name="plan")
@click.argument("script", metavar="SHOW.yaml")
@json_option
@cache_option
@click.option(
    "--labels",
    type=FILE,
    help="Write the timeline as labels for Audacity (.txt), or as CSV for Reaper and "
    "others (.csv), in the music's time.",
)
@outside_option
@flag("--detailed-exitcode", text="Exit with 3 if compile would solve anything.")
def command(
    script: str,
    as_json: bool,
    cache_dir: Path | None,
    labels: Path | None,
    allow_outside: bool,
    detailed_exitcode: bool,
) -> int:
    """Show the timeline before anything is solved, and about how long each move takes.

    Assigns drones to places. Each leg takes at least a time that no flight can beat. A
    straight flight of all drones side by side takes the next one: drones that meet on
    straight ways may need more, all others less. Start times count moves that are not
    solved yet as straight flights. Also lists what missions cannot carry.

    \b
      showc plan my-show.yaml
      showc plan my-show.yaml --labels my-show.txt
    """
    from showc.cli.compile import report
    from showc.cli.console import columns
    from showc.files import write_file
    from showc.fleet.itinerary import check_places
    from showc.fleet.options import SolveOptions
    from showc.mission.feasibility import mission_outlook
    from showc.pipeline.outlook import cue_sheet, outlook
    from showc.plan import build_itinerary
    from showc.script import load_show

    result = load_show(script, allow_outside=allow_outside)
    if result.show is None:
        report(result, as_json=as_json)
        return result.exit_code(strict=False) or 1
    itinerary = build_itinerary(result.show)
    check_places(itinerary)
    legs = outlook(itinerary, SolveOptions(cache=cache_dir))
    if labels is not None:
        music = result.show.music
        sheet = cue_sheet(
            legs, 0.0 if music is None else music.offset, csv=labels.suffix == ".csv"
        )
        write_file(labels, sheet)
    missions = mission_outlook(itinerary)
    pending = sum(leg.solve for leg in legs)
    if as_json:
        click.echo(
            json.dumps(
                {
                    "pending": pending,
                    "legs": [leg.to_json() for leg in legs],
                    "missions": asdict(missions),
                }
            )
        )
    else:
        click.echo("\n".join(columns(timeline(legs, result.show), (0, 4))))
        click.echo(f"compile would solve {pending} of {len(legs)} legs")
        for reason in missions.refused:
            click.echo(f"no missions: {reason}")
        for note in missions.notes:
            click.echo(f"note: {note}")
    return 3 if detailed_exitcode and pending else 0


def timeline(legs: list[LegOutlook], show: Show) -> list[tuple[str, ...]]:
    """Return the rows of the table; with music, times count from its beginning."""
    offset = 0.0 if show.music is None else show.music.offset
    head = "starts" if show.music is None else "music time"
    rows: list[tuple[str, ...]] = [("leg", head, "at least", "straight", "to do")]
    for leg in legs:
        name = leg.name if leg.group is None else f"  {leg.group}: {leg.name}"
        start, *times = (
            f"{time:.3f} s" for time in (leg.start - offset, leg.lower, leg.upper)
        )
        ends = "" if leg.ends is None else f"; ends at {leg.ends - offset:.3f} s"
        if leg.asked is not None:
            ends = f"; arrives at {leg.asked - offset:.3f} s, as asked"
        rows.append((name, start, *times, leg.reason + ends))
    return rows
