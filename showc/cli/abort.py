"""``showc abort``: how the fleet comes down from any moment of a show."""

from __future__ import annotations

import json
from pathlib import Path

import click

from showc.cli.options import (
    Real,
    given,
    jobs_option,
    log_argument,
    output_option,
    quiet_option,
)


@click.command(name="abort")
@log_argument
@given(
    "--every",
    type=Real(0.5, 600.0),
    metavar="SECONDS",
    default=10.0,
    help="Time between two rows of the table.",
)
@output_option(
    "TABLE.json",
    "Where to put the table.  [default: OUTPUT-abort.json]",
)
@jobs_option
@quiet_option
def command(
    log: Path, every: float, output: Path | None, jobs: int | None, quiet: bool
) -> int:
    """Plan and prove how to land the fleet, for regular moments of the show.

    First the fleet stops along its paths, which keeps every distance. Then all drones
    descend where they are, if this keeps the separation. Otherwise they fly home to the
    pads, or back along the plan. Every descent and return is planned and proved. The
    table and its flights go into the log, where showc verify proves them again and
    showc report prints them. The table also goes into a file beside the log.

    \b
      showc abort output.mcap --every 2
    """
    from showc.abort import abort_table
    from showc.cli.console import progress
    from showc.files import write_file
    from showc.fleet.options import SolveOptions
    from showc.log.additions import add, digest_of
    from showc.log.reader import read_log
    from showc.log.schema import ABORT_NAME
    from showc.safety.assessment import show_of
    from showc.view.document import clock

    digest = digest_of(log)
    # Of the samples nothing is needed.
    logged = read_log(log, 1.0)
    with progress(quiet=quiet) as watcher:
        table = abort_table(
            logged, show_of(logged), every, SolveOptions(jobs=jobs), watcher
        )
    message = table.to_message(digest)
    add(log, ABORT_NAME, message.SerializeToString(deterministic=True), digest)
    place = output or log.with_name(f"{log.stem}-abort.json")
    content = {"log": log.name, "data_sha256": digest, "rows": table.to_json()}
    write_file(place, (json.dumps(content, indent=1) + "\n").encode())
    for row in table.rows:
        click.echo(
            f"at {clock(row.time)}: stands in {row.stop:.2f} s, {row.way} in "
            f"{row.duration:.1f} s"
        )
    longest = table.longest
    click.echo(f"longest: {longest.total:.1f} s, from {clock(longest.time)}")
    click.echo(f"added to {log}; wrote {place}")
    return 0
