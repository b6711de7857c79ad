"""``showc upload``: put missions onto vehicles, read them back, keep a record."""

from __future__ import annotations

import json
from pathlib import Path

import click

from showc.cli.options import (
    FILE,
    Real,
    connected,
    flag,
    given,
    json_option,
    quiet_option,
    system_ids,
)


@click.command(name="upload")
@click.argument(
    "folder",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    metavar="OUTPUT/",
)
@connected
@click.option(
    "--audit",
    type=FILE,
    help="Record of which vehicle has which file, with hashes.  "
    "[default: OUTPUT/../OUTPUT-audit.json]",
)
@given(
    "--timeout",
    type=Real(min=0.1),
    metavar="SECONDS",
    default=30.0,
    help="Time within which every vehicle must answer.",
)
@flag(
    "--missing",
    text="Only drones that, by the record, do not have their mission yet: for another "
    "try.",
)
@flag("--no-parameters", text="Do not change the parameters of the vehicles.")
@json_option
@quiet_option
def command(
    folder: Path,
    connections: tuple[str, ...],
    drones: list[int] | None,
    systems: list[int] | None,
    audit: Path | None,
    timeout: float,
    missing: bool,
    no_parameters: bool,
    signing_key: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Load missions onto vehicles, read them back, compare, and keep a record.

    OUTPUT/ is the folder that compile wrote. The vehicle with MAVLink system id n gets
    the parameters of OUTPUT/missions/ardupilot.parm, then the mission of drone n.
    Folders with files of two compiles are refused, and so are vehicles that are armed
    or share a system id. Exits with 0 if every vehicle has its mission, else with 1.

    \b
      showc upload output/ --connect udpin:0.0.0.0:14550
    """
    from showc.cli.console import progress
    from showc.vehicle_link.frames import read_key
    from showc.vehicle_link.upload import UploadOptions, upload_missions

    record = audit or folder.with_name(f"{folder.resolve().name}-audit.json")
    with progress(quiet=quiet or as_json) as watcher:
        report = upload_missions(
            folder,
            connections=connections,
            drones=drones,
            audit=record,
            options=UploadOptions(
                timeout=timeout,
                systems=system_ids(drones, systems),
                missing=missing,
                parameters=not no_parameters,
                key=None if signing_key is None else read_key(signing_key),
            ),
            progress=watcher,
        )
    if as_json:
        click.echo(json.dumps(report.to_json(), indent=1))
    else:
        if missing and not report.vehicles:
            click.echo("every drone holds its mission by the record")
        for vehicle in report.vehicles:
            state = "holds its mission" if vehicle.holds else vehicle.reason
            click.echo(f"drone {vehicle.drone}: {state}")
        click.echo(f"record: {record}")
        if report.vehicles and report.complete and report.advice:
            click.echo(f"next: {report.advice}")
    return 0 if report.complete else 1
