"""``showc compare``: hold what was flown against the plan."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from showc.cli.options import FILE, SHOW, Real, json_option

if TYPE_CHECKING:
    from showc.vehicle_link.compare import Comparison


@click.command(name="compare")
@click.argument("plan", type=FILE, metavar="OUTPUT.mcap")
@click.argument(
    "flown",
    nargs=-1,
    required=True,
    type=SHOW,
    metavar="FLOWN...",
)
@click.option(
    "--against",
    type=click.Choice(["missions", "trajectories"]),
    help="The plan that was flown.  [default: missions if an autopilot flew one]",
)
@click.option(
    "--limit",
    type=Real(min=0.0),
    metavar="METRES",
    help="Also exit with 1 if a drone was farther from its plan than this.",
)
@click.option(
    "-o",
    "--output",
    type=FILE,
    help="Write a page with the tables and with pictures.",
)
@json_option
def command(
    plan: Path,
    flown: tuple[Path, ...],
    against: Literal["missions", "trajectories"] | None,
    limit: float | None,
    output: Path | None,
    as_json: bool,
) -> int:
    """Compare flights with the plan.

    FLOWN is a log written by showc stream, or logs of autopilots: .BIN, .tlog, or a
    folder of them. The table gives for each leg how late the drones arrived, how far
    they were from the plan, and how close two of them came, beside what was proved. For
    each drone it gives the greatest and the mean distance, and the lag. Exits with 1 if
    two drones came closer than the separation of the show.

    \b
      showc compare output.mcap output-flown.mcap
      showc compare output.mcap logs/ -o flight.html
    """
    from showc.files import write_file
    from showc.vehicle_link.compare import compared
    from showc.vehicle_link.comparison_page import render_comparison
    from showc.vehicle_link.overlay import load_flown

    flight = load_flown(plan, flown, against=against)
    result = compared(flight)
    if output is not None:
        page = render_comparison(f"{plan.stem}, flown", flight, result)
        write_file(output, page.encode())
    if as_json:
        click.echo(json.dumps(result.to_json(), indent=1))
    else:
        _print(result)
    near = limit is None or result.greatest_error <= limit
    return 0 if result.kept_separation and near else 1


def _print(result: Comparison) -> None:
    """Print the tables."""
    from showc.cli.console import columns
    from showc.vehicle_link.comparison_page import LEG_HEADS, leg_cells

    rows = [list(LEG_HEADS), *(leg_cells(leg) for leg in result.legs)]
    click.echo("\n".join([f"held against the {result.against}", *columns(rows)]))
    for drone in result.drones:
        click.echo(
            f"drone {drone.drone}: at most {drone.greatest_error:.2f} m off, at "
            f"{drone.greatest_error_time:.1f} s; {drone.rms_error:.2f} m root "
            f"mean square; {drone.lag:+.2f} s late"
        )
    if result.least_separation is not None and result.least_separation_drones:
        first, second = result.least_separation_drones
        verdict = "kept" if result.kept_separation else "BROKEN"
        click.echo(
            f"separation {verdict}: drones {first} and {second} came to "
            f"{result.least_separation:.2f} m at "
            f"{result.least_separation_time:.1f} s (wanted {result.separation:g} m)"
        )
