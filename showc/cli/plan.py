"""``showc plan``: what compile would solve, and bounds before solving."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from showc.cli.options import FILE, cache_option, flag, json_option, outside_option


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
    """Say what compile would solve and why, and bounds on each transition's time.

    Assigns drones to places without solving anything. Bounds every leg's time from
    below (a proof) and from above (a straight flight that always exists). Shows when
    each begins, moves not solved yet taken as straight flights. Says what missions
    cannot carry.

    \b
      showc plan my-show.yaml
      showc plan my-show.yaml --labels my-show.txt
    """
    from showc.cli.compile import report
    from showc.cli.console import columns
    from showc.files import write_file
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
        rows: list[tuple[str, ...]] = [("leg", "starts", "at least", "at most", "why")]
        for leg in legs:
            name = leg.name if leg.group is None else f"  {leg.group}: {leg.name}"
            times = (f"{time:.3f} s" for time in (leg.start, leg.lower, leg.upper))
            asked = "" if leg.ends is None else f"; ends at {leg.ends:.3f} s"
            if leg.asked is not None:
                asked = f"; asked to end at {leg.asked:.3f} s"
            rows.append((name, *times, leg.reason + asked))
        click.echo("\n".join(columns(rows, (0, 4))))
        click.echo(f"compile would solve {pending} of {len(legs)} legs")
        for reason in missions.refused:
            click.echo(f"missions: none (see --no-missions): {reason}")
        for note in missions.notes:
            click.echo(f"missions: {note}")
    return 3 if detailed_exitcode and pending else 0
