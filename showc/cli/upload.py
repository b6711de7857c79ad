"""``showc upload``: put missions onto vehicles, read them back, keep a record."""

from __future__ import annotations

import json
from pathlib import Path

import click

from showc.cli.vehicles import connect_option, drones_option


@click.command(name="upload")
@click.argument(
    "folder",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    metavar="OUTPUT/",
)
@connect_option
@drones_option
@click.option(
    "--audit",
    type=click.Path(dir_okay=False, path_type=Path),
    help="File that keeps who has which file with which hash.  "
    "[default: OUTPUT/../OUTPUT-audit.json]",
)
@click.option(
    "--timeout",
    type=click.FloatRange(min=0.1),
    default=30.0,
    show_default=True,
    help="Seconds in which a vehicle must show up.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the record as JSON.")
@click.option("-q", "--quiet", is_flag=True, help="No progress; only the result.")
def command(
    folder: Path,
    connections: tuple[str, ...],
    drones: list[int] | None,
    audit: Path | None,
    timeout: float,
    as_json: bool,
    quiet: bool,
) -> int:
    """Put missions onto vehicles, read them back, compare, keep a record.

    OUTPUT/ is the folder that compile wrote. Drone n goes to the vehicle with MAVLink
    system id n. A folder mixed from two compiles is refused. Ends with 0 if every
    vehicle holds its mission, 1 if one does not.

    \b
      showc upload output/ --connect udpin:0.0.0.0:14550
    """
    from showc.cli.console import progress
    from showc.vehicle_link.upload import upload_missions

    record = audit or folder.with_name(f"{folder.resolve().name}-audit.json")
    with progress(quiet=quiet or as_json) as watcher:
        report = upload_missions(
            folder,
            connections=connections,
            drones=drones,
            audit=record,
            timeout=timeout,
            progress=watcher,
        )
    if as_json:
        click.echo(json.dumps(report.to_json(), indent=1))
    else:
        for vehicle in report.vehicles:
            state = "holds its mission" if vehicle.holds else vehicle.reason
            click.echo(f"drone {vehicle.drone}: {state}")
        click.echo(f"record: {record}")
    return 0 if report.complete else 1
