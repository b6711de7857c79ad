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
    help="Trust this script instead of the one in the log, which must be the same.",
)
@report_options
@flag(
    "--no-missions",
    text="Skip the missions, the manifest and the exports beside the log.",
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
    """Prove a compiled show from its files alone, or check another tool's show.

    Shares no planning code with the compiler. Reads every byte of the log, integrates
    the controls, and bounds every limit and the separation of every pair at every
    instant. Compares samples, formations and missions with the script. Prints a table
    of what was proved, with margins.

    Exits with 0 if everything is proved, 1 if the show breaks a rule, 2 if the file is
    damaged or not a showc log.

    For a folder written by showc export, the exported files are proved again. Shows of
    other tools are a .skyc, .skyb files, a CSV zip, poly7 files, a .vviz or an animated
    glTF. They are checked at every instant, by the rules in the file and the options
    given: whether the show can be flown, and what the firmware does with it.

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
    return int(not verification.passed)


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
        from showc.export.asked import show_with_exports

        show = show_with_exports(log)
        if show is None:
            return verification
        from showc.export.beside import verify_beside

        watcher.stage("checking exports beside the log")
        checks = (*verification.checks, *verify_beside(log, show))
        return replace(verification, checks=checks)
