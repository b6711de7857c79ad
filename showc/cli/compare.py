"""``showc compare``: hold what was flown against the plan."""

from __future__ import annotations

import json
from pathlib import Path

import click

_LOG = click.Path(dir_okay=False, path_type=Path)


@click.command(name="compare")
@click.argument("plan", type=_LOG, metavar="OUTPUT.mcap")
@click.argument("flown", type=_LOG, metavar="FLOWN.mcap")
@click.option(
    "--limit",
    type=click.FloatRange(min=0.0),
    help="Also end with 1 if a drone was farther from its plan, in metres.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def command(plan: Path, flown: Path, limit: float | None, as_json: bool) -> int:
    """Hold what was flown against the plan.

    For each drone the greatest and the mean distance to its trajectory, how late it
    was, when it arrived at each formation; and the nearest that two drones came. Ends
    with 1 if two came nearer than the show's separation.

    \b
      showc compare output.mcap output-flown.mcap
    """
    from showc.vehicle_link.compare import compare_flown

    result = compare_flown(plan, flown)
    if as_json:
        click.echo(json.dumps(result.to_json(), indent=1))
    else:
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
    near = limit is None or result.greatest_error <= limit
    return 0 if result.kept_separation and near else 1
