"""``showc fmt``: one layout for all scripts."""

from __future__ import annotations

from pathlib import Path

import click

from showc.cli.options import flag


@click.command(name="fmt")
@click.argument("scripts", nargs=-1, required=True, metavar="SHOW.yaml...")
@flag("--check", text="Change nothing; exit with 1 if the layout would change.")
@flag("--diff", text="Change nothing; print what would change.")
def command(scripts: tuple[str, ...], check: bool, diff: bool) -> int:
    """Format show scripts.

    Makes indentation, spaces and blank lines uniform. Values, comments, and their order
    and lines stay. Before a file is replaced, the formatted script is checked to be the
    same show. A file that is not valid YAML stays as it is, and its findings are
    printed.

    \b
      showc fmt my-show.yaml
      showc fmt --check shows/*.yaml        in a CI job
    """
    from showc.errors import UsageError
    from showc.files import UnreadableFileError, read_file, rewrite_file
    from showc.script.language.document import MAX_BYTES, parse_document
    from showc.script.language.layout import format_script
    from showc.script.render import render

    code = 0
    for name in scripts:
        path = Path(name)
        try:
            content = read_file(path, MAX_BYTES)
        except UnreadableFileError as fault:
            click.echo(f"error: {name!r} cannot be read: {fault.reason}", err=True)
            code = 2
            continue
        _, text, found = parse_document(content, name)
        if found:
            click.echo(render(found, {name: text}).rstrip("\n"), err=True)
            code = 2
            continue
        try:
            formatted = format_script(text)
        except UsageError as fault:
            click.echo(f"error: {name!r} is left as it is: {fault}", err=True)
            code = 2
            continue
        if formatted.encode() == content:
            continue
        if diff:
            click.echo(_difference(text, formatted, name), nl=False)
        if check or diff:
            click.echo(f"{name}: would be formatted", err=diff)
            code = code or 1
        else:
            rewrite_file(path, formatted.encode())
            click.echo(f"{name}: formatted")
    return code


def _difference(before: str, after: str, name: str) -> str:
    from difflib import unified_diff

    lines = unified_diff(
        before.splitlines(),
        after.splitlines(),
        name,
        f"{name} (formatted)",
        lineterm="",
    )
    return "".join(f"{line}\n" for line in lines)
