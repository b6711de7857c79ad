"""``showc verify``: prove a compiled show again, from its bytes alone."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from showc.cli.foreign import foreign_options, is_foreign, verify_foreign


@click.command(name="verify")
@click.argument("log", type=click.Path(path_type=Path), metavar="OUTPUT.mcap|SHOW")
@click.option(
    "-j",
    "--jobs",
    type=click.IntRange(min=1),
    help="Processes to prove in.  [default: one for each core]",
)
@click.option(
    "--script",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="SHOW.yaml",
    help="Trust this script, and not the one in the log, which must equal it.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option(
    "--no-missions",
    is_flag=True,
    help="Leave the mission files, the manifest and the exports beside the log out.",
)
@click.option("-q", "--quiet", is_flag=True, help="No progress; only the result.")
@foreign_options
def command(
    log: Path,
    jobs: int | None,
    script: Path | None,
    as_json: bool,
    no_missions: bool,
    quiet: bool,
    **rules: Any,  # noqa: ANN401 - options of shows of others
) -> int:
    """Prove a compiled show again, from its bytes alone, or judge a show of others.

    Shares no code with the compiler: reads every byte of the log, integrates the
    controls, bounds every limit and every pair's separation at every instant, compares
    samples, formations and missions. Prints a table of what was proved, with margins.

    Ends with 0 if all is proved, 1 if the show breaks a rule, 2 if the file is damaged
    or not a log of showc's.

    Of a folder that showc export wrote, the written files are proved again. Of a .skyc,
    .skyb files, a CSV zip, poly7 files, a .vviz or an animated glTF it says what the
    file says at every instant, whether that can be flown, and what the firmware makes
    of it, by the file's own rules and by those asked for.

    \b
      showc verify output.mcap
      showc verify output.mcap --json | jq .passed
      showc verify night.skyc --separation 2.5 --tilt 25
    """
    # One thread each: the processes share the cores already.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from showc.cli.console import colour_wanted, progress
    from showc.verify import render_text, verify_log

    if is_foreign(log):
        return verify_foreign(log, as_json=as_json, **rules)
    with progress(quiet=quiet or as_json) as watcher:
        verification = verify_log(
            log,
            missions=not no_missions,
            jobs=jobs,
            progress=watcher,
            script=script,
        )
        if not no_missions:
            from showc.export.beside import verify_beside

            watcher.stage("exports beside the log")
            verification = replace(
                verification, checks=(*verification.checks, *verify_beside(log))
            )
    if as_json:
        click.echo(json.dumps(verification.to_json(), indent=1))
    else:
        colour = colour_wanted(sys.stdout)
        click.echo(render_text(verification, colour=colour), color=colour)
    return verification.exit_code
