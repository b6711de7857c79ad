"""``showc import``: a show of others as a script."""

from __future__ import annotations

from pathlib import Path

import click


class Instants(click.ParamType[tuple[float, ...]]):
    """Show times in seconds, with commas between them."""

    name = "times"

    def convert(
        self,
        value: str | tuple[float, ...],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> tuple[float, ...]:
        """Parse them."""
        if isinstance(value, tuple):
            return value
        try:
            return tuple(float(part) for part in value.split(","))
        except ValueError:
            self.fail(f"{value!r} is no list of seconds such as 30,60.5", param, ctx)


class Stretches(click.ParamType[tuple[tuple[float, float], ...]]):
    """Begin and end of stretches, in seconds, with commas between them."""

    name = "stretches"

    def convert(
        self,
        value: str | tuple[tuple[float, float], ...],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> tuple[tuple[float, float], ...]:
        """Parse them."""
        if isinstance(value, tuple):
            return value
        found = []
        for part in value.split(","):
            begin, _, end = part.partition("-")
            try:
                found.append((float(begin), float(end)))
            except ValueError:
                self.fail(
                    f"{part!r} is no stretch of seconds such as 30-60.5", param, ctx
                )
        return tuple(found)


@click.command(name="import")
@click.argument("show", type=click.Path(path_type=Path), metavar="SHOW")
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    required=True,
    metavar="SHOW.yaml",
    help="Where to put the script; its tables go into SHOW-formations.",
)
@click.option(
    "--at",
    type=Instants(),
    default=(),
    metavar="SECONDS,...",
    help="Make formations of these instants too: for shows that never hold.",
)
@click.option(
    "--moving",
    type=Stretches(),
    default=(),
    metavar="BEGIN-END,...",
    help="Make moving formations of these stretches too [s]: played as they are.",
)
@click.option("--force", is_flag=True, help="Replace a script that is there.")
def command(
    show: Path,
    output: Path,
    at: tuple[float, ...],
    moving: tuple[tuple[float, float], ...],
    force: bool,
) -> int:
    """Write a show of others as a script, to be solved again.

    Where the whole fleet holds in the air is a formation, with its colours;
    transitions lead from one to the next. A picture that turns, waves or grows
    between two holds is a moving formation: it is played as it is. Lights over a
    picture's time, site, fence, speeds and least distance come along.

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
    click.echo(
        f"{output}: {len(imported.pictures)} formations, "
        f"{len(found)} findings of showc check"
    )
    for lost in imported.lost:
        click.echo(f"not in the script: {lost}")
    again = output.with_suffix(".mcap")
    click.echo(f"next: showc compile {output} -o {again}; showc diff {show} {again}")
    return 0
