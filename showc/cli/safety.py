"""``showc safety``: the safety case of a compiled show."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from math import radians
from pathlib import Path

import click

from showc.cli.options import Real, json_option, log_argument, output_option


@click.command(name="safety")
@log_argument
@output_option(
    "PAGE.html",
    "Where to put the page.  The map goes beside it.  [default: OUTPUT-safety.html]",
)
@click.option(
    "--wind",
    type=Real(0.0, 30.0),
    metavar="M/S",
    help="Strongest wind during a fall.  [default: the script's]",
)
@click.option(
    "--rotation",
    type=Real(0.0, 180.0),
    metavar="DEGREES",
    help="Angle by which the whole show may be turned.  [default: the script's]",
)
@click.option(
    "--shift",
    type=Real(0.0, 100.0),
    metavar="METRES",
    help="Distance by which the whole show may be moved.  [default: the script's]",
)
@json_option
def command(
    log: Path,
    output: Path | None,
    wind: float | None,
    rotation: float | None,
    shift: float | None,
    as_json: bool,
) -> int:
    """Compute where drones may fall, and which ground must stay clear.

    A drone may lose thrust at any moment of the flight. It then falls with drag, in any
    wind up to the given one. The command bounds all places where it may hit the ground,
    and computes the volumes of the German aviation authority (LBA). The script
    describes the surroundings (site: audience, buildings, ceiling, fence) and the
    assumptions (site: risk).

    Writes a page with a drawing, and a KML map with a folder for each volume. Exits
    with 1 if a finding is an error, else with 0: warnings do not count. showc explain
    SAF111 explains a finding.

    \b
      showc safety output.mcap
      showc safety output.mcap --wind 8 --rotation 7
    """
    from showc.export.pictures import kml_file
    from showc.export.solved import solved_show
    from showc.files import write_file
    from showc.log.reader import read_log
    from showc.safety.assessment import safety_case, show_of
    from showc.view import render_safety
    from showc.view.overview import WAYS_RATE

    logged = read_log(log, WAYS_RATE)
    show = show_of(logged)
    risk = show.site.risk
    risk = replace(
        risk,
        wind=risk.wind if wind is None else wind,
        rotation=risk.rotation if rotation is None else radians(rotation),
        shift=risk.shift if shift is None else shift,
    )
    show = replace(show, site=replace(show.site, risk=risk))
    case = safety_case(logged, show)
    page = output or log.with_name(f"{log.stem}-safety.html")
    write_file(page, render_safety(logged, case).encode())
    write_file(page.with_suffix(".kml"), kml_file(solved_show(logged), case))
    if as_json:
        # As it is made: of large fleets the text takes gigabytes in one piece.
        json.dump(case.to_json(), sys.stdout, indent=1)
        click.echo()
        return 1 if case.errors else 0
    for one in case.distances:
        click.echo(
            f"{one.name}: at least {one.left:.1f} m left, {one.wanted:.1f} m wanted "
            f"(drone {one.place.drone + 1}, {one.place.time:.1f} s)"
        )
    click.echo(
        f"a stopped fleet stands after {case.stops.longest:.2f} s at most from every "
        f"whole second, after {case.stops.sure:.2f} s from any instant"
    )
    energy = case.energy
    taken = (
        f"the show takes {100.0 * energy.used.max():.0f} % and an abort "
        f"{100.0 * energy.abort:.0f} %"
    )
    if energy.empty is not None:
        taken = f"it is empty {energy.empty:.0f} s into {energy.times[-1]:.0f} s"
    click.echo(
        f"battery, an estimate: {taken}; {100.0 * show.battery.allowed:.0f} % may be "
        f"used (drone {energy.worst + 1})"
    )
    for item in case.findings:
        where = item.place
        said = (
            "" if where is None else f" (drone {where.drone + 1}, {where.time:.1f} s)"
        )
        colour = "red" if item.severity == "error" else "yellow"
        head = click.style(f"{item.severity}[{item.code}]", fg=colour, bold=True)
        click.echo(f"{head}: {item.message}{said}")
    click.echo(f"wrote {page} and {page.with_suffix('.kml')}")
    return 1 if case.errors else 0
