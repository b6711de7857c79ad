"""``showc import``: a foreign show as a script."""

from __future__ import annotations

from math import isfinite, nan
from pathlib import Path

import click

from showc.cli.options import FILE, SHOW, Written, flag


def _seconds(text: str) -> tuple[float, ...]:
    """Read show times, with commas between them [s]."""
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = (nan,)
    if not all(map(isfinite, found)):
        raise ValueError(f"{text!r} is no list of seconds such as 30,60.5")
    return found


def _stretches(text: str) -> tuple[tuple[float, float], ...]:
    """Read begins and ends of stretches, with commas between them [s]."""
    found = []
    for part in text.split(","):
        begin, _, end = part.partition("-")
        try:
            stretch = float(begin), float(end)
        except ValueError:
            stretch = nan, nan
        if not all(map(isfinite, stretch)):
            raise ValueError(f"{part!r} is no stretch of seconds such as 30-60.5")
        found.append(stretch)
    return tuple(found)


@click.command(name="import")
@click.argument("show", type=SHOW, metavar="SHOW")
@click.option(
    "-o",
    "--output",
    type=FILE,
    required=True,
    metavar="SHOW.yaml",
    help="Where to put the script.  Its tables go into SHOW-formations.",
)
@click.option(
    "--at",
    type=Written("times", _seconds),
    default=(),
    metavar="SECONDS,...",
    help="Also make formations at these times, for shows that never hold.",
)
@click.option(
    "--moving",
    type=Written("stretches", _stretches),
    default=(),
    metavar="BEGIN-END,...",
    help="Also make moving formations of these intervals [s], played as recorded.",
)
@flag("--force", text="Replace the script if it exists.")
def command(
    show: Path,
    output: Path,
    at: tuple[float, ...],
    moving: tuple[tuple[float, float], ...],
    force: bool,
) -> int:
    """Turn another tool's show into a script.

    Each hold of the whole fleet in the air becomes a formation with its colours, and
    transitions lead from one to the next. A formation that turns, waves or grows
    between two holds becomes a moving formation, which plays as recorded. Lights, site,
    fence, speeds and the smallest distance are copied.

    \b
      showc import night.skyc -o night.yaml
      showc import frames.zip -o night.yaml --at 30,60,90
      showc import dance.glb -o dance.yaml --moving 12-40
    """
    from showc.errors import UsageError
    from showc.files import write_file
    from showc.foreign.reading import read_show
    from showc.foreign.script import import_show
    from showc.script import load_show
    from showc.script.diagnostic import Severity
    from showc.script.language.wording import counted

    # Its own: the folder of the bare name is where compile puts the missions.
    folder = output.with_name(f"{output.stem}-formations")
    if not output.suffix:
        raise UsageError(f"{str(output)!r} has no ending; wanted a name such as a.yaml")
    taken = [path for path in (output, folder) if path.exists()]
    if taken and not force:
        raise UsageError(
            f"{str(taken[0])!r} is there already; choose another name, or --force"
        )
    imported = import_show(read_show(show), folder.name, at, moving)
    for name, table in imported.tables.items():
        write_file(output.parent / name, table.encode())
    write_file(output, imported.script.encode())
    found = load_show(output).diagnostics
    pictures = counted(len(imported.pictures), "formation")
    findings = counted(len(found), "finding")
    click.echo(f"{output}: {pictures}, {findings} of showc check")
    for lost in imported.lost:
        click.echo(f"not in the script: {lost}")
    again = output.with_suffix(".mcap")
    ahead = f"showc compile {output} -o {again}; showc diff {show} {again}"
    if any(one.severity is Severity.ERROR for one in found):
        ahead = f"showc check {output}, and mend the script: it cannot be compiled yet"
    click.echo(f"next: {ahead}")
    return 0
