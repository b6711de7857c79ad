"""``showc init``: a first show script."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from shlex import quote

import click

from showc.cli.options import FILE, flag


def template_text(name: str) -> str:
    """Return a commented script that is a complete show, of that title."""
    text = (files("showc.script") / "template.yaml").read_text(encoding="utf-8")
    quoted = name.replace("\\", "\\\\").replace('"', '\\"')
    return text.replace('"My first show"', f'"{quoted}"')


@click.command(name="init")
@click.argument(
    "script",
    default="show.yaml",
    type=FILE,
    metavar="[SHOW.yaml]",
)
@click.option("--name", default="My first show", help="Title of the show.")
@flag("--force", text="Replace the file if it exists.")
def command(script: Path, name: str, force: bool) -> int:
    """Write a first show script to start from, with comments that explain it.

    \b
      showc init my-show.yaml
    """
    from showc.errors import UsageError
    from showc.files import write_file

    if script.exists() and not force:
        raise UsageError(f"{str(script)!r} exists; choose another name, or use --force")
    write_file(script, template_text(name).encode())
    click.echo(f"wrote {script}; next: showc check {quote(str(script))}")
    return 0
