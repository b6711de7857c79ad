"""``showc compare``: hold what was flown against the plan."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

if TYPE_CHECKING:
    from showc.vehicle_link.compare import Comparison


@click.command(name="compare")
@click.argument(
    "plan", type=click.Path(dir_okay=False, path_type=Path), metavar="OUTPUT.mcap"
)
@click.argument(
    "flown",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path),
    metavar="FLOWN...",
)
@click.option(
    "--against",
    type=click.Choice(["missions", "trajectories"]),
    help="What the fleet was to fly.  [default: missions if an autopilot flew one]",
)
@click.option(
    "--limit",
    type=click.FloatRange(min=0.0),
    help="Also end with 1 if a drone was farther from its plan, in metres.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write a page with the tables and with pictures.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def command(
    plan: Path,
    flown: tuple[Path, ...],
    against: Literal["missions", "trajectories"] | None,
    limit: float | None,
    output: Path | None,
    as_json: bool,
) -> int:
    """Hold what was flown against the plan.

    FLOWN is what stream wrote, or logs of autopilots: .BIN, .tlog, or a folder of them.
    By leg: how late the drones arrived, how far from the plan they were, and the
    nearest that two of them came against what was proved; by drone: the greatest and
    the mean distance and the lag. Ends with 1 if two came nearer than the show's
    separation.

    \b
      showc compare output.mcap output-flown.mcap
      showc compare output.mcap logs/ -o flight.html
    """
    from showc.errors import UsageError
    from showc.vehicle_link.compare import compared, load_flown
    from showc.vehicle_link.comparison_page import render_comparison

    flight = load_flown(plan, flown, against=against)
    result = compared(flight)
    if output is not None:
        page = render_comparison(f"{plan.stem}, flown", flight, result)
        try:
            output.write_text(page, encoding="utf-8")
        except OSError as error:
            raise UsageError(
                f"{output}: cannot be written ({error.strerror})"
            ) from None
    if as_json:
        click.echo(json.dumps(result.to_json(), indent=1))
    else:
        _print(result)
    near = limit is None or result.greatest_error <= limit
    return 0 if result.kept_separation and near else 1


def _print(result: Comparison) -> None:
    """Print the tables."""
    from showc.vehicle_link.comparison_page import LEG_HEADS, leg_cells

    rows = [list(LEG_HEADS), *(leg_cells(leg) for leg in result.legs)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(LEG_HEADS))]
    click.echo(f"held against the {result.against}")
    for name, *cells in rows:
        line = [name.ljust(widths[0])]
        line += [
            cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True)
        ]
        click.echo("  ".join(line))
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
