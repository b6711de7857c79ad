"""``showc check``: validate show scripts, without a solver."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from showc.cli.options import flag, outside_option, report_options

if TYPE_CHECKING:
    from showc.script import LoadResult


@click.command(name="check")
@click.argument("scripts", nargs=-1, required=True, metavar="SHOW.yaml...")
@report_options
@flag("--strict", text="Count warnings as errors.")
@click.option(
    "--select", multiple=True, metavar="CODE", help="Only these codes (SHW2: all 2xx)."
)
@click.option("--ignore", multiple=True, metavar="CODE", help="Leave out these codes.")
@flag("--fix", "fixing", text="Fix what has only one right answer.")
@outside_option
@flag("--exit-zero", text="Exit with 0 whatever is found.")
@flag("-q", "--quiet", text="Print nothing when all is well.")
def command(
    scripts: tuple[str, ...],
    style: str,
    output: Path | None,
    strict: bool,
    select: tuple[str, ...],
    ignore: tuple[str, ...],
    fixing: bool,
    allow_outside: bool,
    exit_zero: bool,
    quiet: bool,
) -> int:
    """Find mistakes in show scripts.

    Reads each SHOW.yaml and every file that it names. Reports all findings at once,
    each with file, line and column: syntax, keys, units, ranges, names, spacing of
    formations, flight volume, times, motions. Nothing is solved; a script takes a
    fraction of a second.

    --fix corrects mistakes that have only one possible correction: mistyped words,
    decimal commas, missing commas, units, unquoted colours.

    A comment "# showc: ignore[SHW303] why" at the end of a line hides that warning
    there.

    \b
      showc check shows/*.yaml
      showc check --strict --format github shows/*.yaml     in a CI job
      showc check --format sarif --output findings.sarif shows/grid.yaml
    """
    from showc.cli.console import colour_wanted
    from showc.script import Severity, load_show
    from showc.script.diagnostic import select_diagnostics
    from showc.script.render import render

    _refuse_unknown("select", select)
    _refuse_unknown("ignore", ignore)
    if fixing:
        for script in scripts:
            _fix(Path(script), allow_outside=allow_outside)
    results = [load_show(script, allow_outside=allow_outside) for script in scripts]
    found = select_diagnostics(
        [diagnostic for result in results for diagnostic in result.diagnostics],
        select=select,
        ignore=ignore,
        strict=strict,
    )
    sources = {result.path: result.text for result in results}
    colour = style == "text" and output is None and colour_wanted(sys.stdout)
    text = render(found, sources, style, colour=colour)
    if output is not None:
        from showc.files import write_file

        write_file(output, text.encode())
    elif style != "text":
        click.echo(text.rstrip("\n"))
    elif text.strip():
        click.echo(text.rstrip("\n"), color=colour)
    if style == "text" and not found and not quiet:
        many = f"{len(results)} scripts" if len(results) > 1 else results[0].path
        click.echo(f"{many}: no findings")
    if exit_zero:
        return 0
    if any(result.unreadable for result in results):
        return 2
    return int(any(item.severity == Severity.ERROR for item in found))


def _fix(script: Path, *, allow_outside: bool) -> None:
    """Fix a script and say what was fixed; the findings say what cannot be."""
    from showc.files import UnreadableFileError, read_file, rewrite_file
    from showc.script import read_show
    from showc.script.fixes import apply_fixes
    from showc.script.language.document import MAX_BYTES

    try:
        content = read_file(script, MAX_BYTES)
    except UnreadableFileError:
        return

    def read(given: bytes) -> LoadResult:
        return read_show(
            given, path=str(script), folder=script.parent, allow_outside=allow_outside
        )

    fixed = apply_fixes(content, read)
    if fixed.done:
        rewrite_file(script, fixed.content)
    for item in fixed.done:
        line = 0 if item.span is None else item.span.line
        click.echo(
            f"{script}:{line}: fixed [{item.code}]: {item.message}; now {item.fix}",
            err=True,
        )


def _refuse_unknown(option: str, asked: tuple[str, ...]) -> None:
    """Refuse what begins no code: it would leave out all findings, or none."""
    from showc.errors import UsageError
    from showc.script.codes import codes

    for code in asked:
        if not any(known.startswith(code) for known in codes()):
            raise UsageError(f"--{option} {code}: no finding's code begins so")
