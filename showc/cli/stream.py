"""``showc stream``: fly the trajectories themselves as timed setpoints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import click

from showc.cli.options import (
    FILE,
    Real,
    connected,
    flag,
    given,
    json_option,
    log_argument,
    quiet_option,
    system_ids,
)


@click.command(name="stream")
@log_argument
@connected
@given(
    "--rate",
    type=Real(min=10.0),
    metavar="HZ",
    default=20.0,
    help="Setpoints per second for each vehicle.",
)
@given(
    "--corridor",
    type=Real(min=0.1),
    metavar="METRES",
    default=3.0,
    help="Distance of a vehicle from its trajectory at which the show stops.",
)
@given(
    "--link-timeout",
    type=Real(min=0.1),
    metavar="SECONDS",
    default=1.0,
    help="Age of a vehicle's last position at which the show stops.",
)
@given(
    "--lead",
    type=Real(0.0, 1.0),
    metavar="SECONDS",
    default=0.0,
    help="How early a setpoint is sent, to make up for the lag of the autopilot "
    "and the link.",
)
@given(
    "--after-stop",
    type=click.Choice(["hold", "land", "return"]),
    default="hold",
    help="What a stopped fleet does: hover, land where it is, or fly back along its "
    "paths and land on its pads.",
)
@flag(
    "--set-parameters",
    text="Raise limits of ArduCopter that are too small for the show. They are "
    "restored after the landing.",
)
@flag(
    "--set-gains",
    text="Fly with the gains of ArduCopter's simulated quadrotor, with which "
    "trajectories were measured, until the landing. Not for vehicles that are tuned.",
)
@click.option(
    "--flown",
    type=FILE,
    help="Log of the flight, for compare.  [default: OUTPUT-flown.mcap]",
)
@json_option
@quiet_option
def command(
    log: Path,
    connections: tuple[str, ...],
    drones: list[int] | None,
    systems: list[int] | None,
    rate: float,
    corridor: float,
    link_timeout: float,
    lead: float,
    after_stop: Literal["hold", "land", "return"],
    set_parameters: bool,
    set_gains: bool,
    signing_key: Path | None,
    flown: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Fly the trajectories as timed setpoints of position, velocity and acceleration.

    Switches every vehicle to the mode that follows setpoints, arms it, and flies the
    show from start to end. The whole fleet stops if a vehicle falls silent or leaves
    its corridor, and on Ctrl-C, SIGTERM or SIGHUP. --after-stop says what happens then.
    Exits with 0 if all vehicles flew to the end and landed, else with 1.

    \b
      showc stream output.mcap --connect udp:127.0.0.1:14550
      showc compare output.mcap output-flown.mcap
    """
    from showc.cli.console import progress
    from showc.vehicle_link.frames import read_key
    from showc.vehicle_link.stream import StreamOptions, stream_show

    record = flown or log.with_name(f"{log.stem}-flown.mcap")
    options = StreamOptions(
        rate=rate,
        corridor=corridor,
        link_timeout=link_timeout,
        lead=lead,
        after_stop=after_stop,
        set_parameters=set_parameters,
        set_gains=set_gains,
        systems=system_ids(drones, systems),
        key=None if signing_key is None else read_key(signing_key),
    )
    with progress(quiet=quiet or as_json) as watcher:
        report = stream_show(
            log,
            connections=connections,
            drones=drones,
            flown=record,
            options=options,
            progress=watcher,
        )
    if as_json:
        click.echo(json.dumps(report.to_json(), indent=1))
        return 0 if report.complete else 1
    for vehicle in report.vehicles:
        click.echo(
            f"drone {vehicle.drone}: {vehicle.phase}, {vehicle.setpoints} setpoints, "
            f"at most {vehicle.greatest_deviation:.2f} m off"
            + (f"; {vehicle.reason}" if vehicle.reason else "")
        )
    if report.rate:
        click.echo(
            f"setpoints: {report.rate:.1f} a second, longest gap "
            f"{report.longest_gap:.2f} s, sent within {report.longest_hold_up:.3f} s"
        )
    outcome = "flown to the end" if report.complete else f"ABORTED: {report.reason}"
    kept = f"no log: {report.unrecorded}" if report.unrecorded else f"log: {record}"
    click.echo(f"{outcome} (show time {report.show_time:.1f} s); {kept}")
    return 0 if report.complete else 1
