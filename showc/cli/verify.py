"""``showc verify``: prove a compiled show again, from its bytes alone."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from showc.cli.foreign import foreign_options, is_foreign, verify_foreign
from showc.cli.options import (
    FILE,
    flag,
    jobs_option,
    quiet_option,
    report_options,
    show_argument,
)

if TYPE_CHECKING:
    from showc.cli.foreign import Rules
    from showc.verify.report import Verification


@click.command(name="verify")
@show_argument
@jobs_option
@click.option(
    "--script",
    type=FILE,
    metavar="SHOW.yaml",
    help="Trust this script, and not the one in the log, which must equal it.",
)
@report_options
@flag(
    "--no-missions",
    text="Leave the mission files, the manifest and the exports beside the log out.",
)
@quiet_option
@foreign_options
def command(
    log: Path,
    jobs: int | None,
    script: Path | None,
    style: str,
    output: Path | None,
    no_missions: bool,
    quiet: bool,
    rules: Rules,
) -> int:
    """Prove a compiled show from its bytes alone, or judge another tool's show.

    Shares no code with the compiler: reads every byte of the log, integrates the
    controls, bounds every limit and every pair's separation at every instant, compares
    samples, formations and missions. Prints a table of what was proved, with margins.

    Exits with 0 if everything is proved, 1 if the show breaks a rule, 2 if the file is
    damaged or not a showc log.

    For a folder that showc export wrote, the exported files are proved again. A .skyc,
    .skyb files, a CSV zip, poly7 files, a .vviz and an animated glTF are judged at
    every instant, by the file's own rules and by those asked for: can it be flown, and
    what does the firmware make of it?

    \b
      showc verify output.mcap
      showc verify night.skyc --format sarif --output findings.sarif
      showc verify output.mcap --json | jq .passed
      showc verify night.skyc --separation 2.5 --tilt 25
    """
    if is_foreign(log):
        verification = verify_foreign(log, rules)
    else:
        verification = _proved(
            log,
            missions=not no_missions,
            jobs=jobs,
            script=script,
            quiet=quiet or style != "text",
        )
    colour = False
    if style == "json":
        text = json.dumps(verification.to_json(), indent=1)
    elif style == "text":
        from showc.cli.console import colour_wanted
        from showc.cli.findings import render_text

        colour = output is None and colour_wanted(sys.stdout)
        text = render_text(verification, colour=colour)
    else:
        from showc.cli.findings import render_findings

        text = render_findings(verification, style).rstrip("\n")
    if output is not None:
        from showc.files import write_file

        write_file(output, (text + "\n").encode())
    else:
        click.echo(text, color=colour)
    return verification.exit_code


def _proved(
    log: Path, *, missions: bool, jobs: int | None, script: Path | None, quiet: bool
) -> Verification:
    """Prove a log of showc's, and the exports beside it."""
    from showc.cli.console import progress
    from showc.verify import verify_log

    with progress(quiet=quiet) as watcher:
        verification = verify_log(
            log, missions=missions, jobs=jobs, progress=watcher, script=script
        )
        if not missions:
            return verification
        from showc.export.beside import verify_beside

        watcher.stage("exports beside the log")
        checks = (*verification.checks, *verify_beside(log))
        return replace(verification, checks=checks)
