"""``showc abort``: how the fleet comes down from any moment of a show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from showc.cli.beside import ABORT, place_of, read_beside, write_beside


def rows_of(log: Path) -> list[dict[str, Any]]:
    """Return the rows that were planned for a log; none if there is no table of it."""
    return read_beside(
        log, ABORT, lambda content: [_row(row) for row in content["rows"]], []
    )


def longest_of(rows: list[dict[str, Any]]) -> float | None:
    """Return how long the longest abort of a table takes [s]; None: no table."""
    return max((float(row["total"]) for row in rows), default=None)


def _row(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row as the page wants it, whatever the file holds."""
    closest = row["closest"]
    numbers = ("time", "stop", "duration", "total")
    return {name: float(row[name]) for name in numbers} | {
        "way": str(row["way"]),
        "closest": None if closest is None else float(closest),
    }


@click.command(name="abort")
@click.argument(
    "log", type=click.Path(dir_okay=False, path_type=Path), metavar="OUTPUT.mcap"
)
@click.option(
    "--every",
    type=click.FloatRange(0.5, 600.0),
    default=10.0,
    show_default=True,
    help="Time between two rows, in seconds.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="TABLE.json",
    help="Where to put the table.  [default: OUTPUT-abort.json]",
)
@click.option("--jobs", type=click.IntRange(min=1), help="Processes to work with.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
def command(
    log: Path, every: float, output: Path | None, jobs: int | None, quiet: bool
) -> int:
    """Plan and prove how the fleet comes down, from a grid of moments.

    The fleet's one clock is brought to rest, which keeps every distance. Then all
    drones go straight down where they are, if they stay apart; else home to the pads;
    else back along the plan. Ways down and home come from the fleet planner, and every
    one is proved. The table goes into a file beside the log; showc report prints it.

    \b
      showc abort output.mcap --every 2
    """
    from showc.abort import abort_table
    from showc.cli.console import progress
    from showc.fleet.options import SolveOptions
    from showc.log.reader import read_log
    from showc.safety.assessment import show_of
    from showc.view.document import clock

    logged = read_log(log)
    with progress(quiet=quiet) as watcher:
        table = abort_table(
            logged, show_of(logged), every, SolveOptions(jobs=jobs), watcher
        )
    place = output or place_of(log, ABORT)
    write_beside(log, place, {"rows": table.to_json()})
    for row in table.rows:
        click.echo(
            f"at {clock(row.time)}: stands in {row.stop:.2f} s, {row.way} in "
            f"{row.duration:.1f} s"
        )
    longest = table.longest
    click.echo(
        f"longest: {longest.total:.1f} s, from {clock(longest.time)}; wrote {place}"
    )
    return 0
