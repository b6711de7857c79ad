"""``showc report``: the page on which a show is signed off."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from showc.cli.foreign import foreign_options, is_foreign, judge_foreign
from showc.cli.options import Whole, output_option, quiet_option, show_argument

if TYPE_CHECKING:
    from showc.cli.foreign import Rules


@click.command(name="report")
@show_argument
@output_option(
    "PAGE.html",
    "Where to put the page.  [default: OUTPUT-report.html; with --leg, "
    "OUTPUT-leg-N-drone-N.html]",
)
@click.option(
    "--leg",
    type=Whole(min=0),
    metavar="N",
    help="Draw this leg's solution instead: states, controls, margins, mesh.",
)
@click.option(
    "--drone",
    type=Whole(min=1),
    metavar="N",
    default=1,
    help="Drone for --leg.",
)
@quiet_option
@foreign_options
def command(
    log: Path,
    output: Path | None,
    leg: int | None,
    drone: int,
    quiet: bool,
    rules: Rules,
) -> int:
    """Make a report page to sign.

    Verifies the log first, and shows what was proved: site map with fence, table of
    transitions (duration, bound, gap, smallest separation, greatest speed and tilt),
    margins, safety case, mission prediction, hashes. The page is made for printing.

    For another tool's show (see showc view), the report says what is proved of the
    file, whether it can be flown, what the firmware does with it, and what is unknown.

    \b
      showc report night.skyc                    writes night-report.html
      showc report output.mcap                   writes output-report.html
      showc report output.mcap --leg 2 --drone 5    one drone's solution, as plots
    """
    from showc.cli.console import progress
    from showc.errors import UsageError
    from showc.files import write_file
    from showc.log.reader import read_log
    from showc.safety.assessment import safety_case
    from showc.verify import verify_log
    from showc.view import render_leg, render_report

    page = output or log.with_name(f"{log.stem}-report.html")
    if is_foreign(log):
        if leg is not None:
            raise UsageError(f"{log}: --leg is for showc's own logs; leave it out")
        return _report_foreign(log, page, rules)
    logged = read_log(log)
    if leg is not None:
        if leg >= len(logged.segments):
            raise UsageError(
                f"there is no leg {leg}; the log has legs 0 to "
                f"{len(logged.segments) - 1}"
            )
        if drone > logged.rules.drones:
            raise UsageError(
                f"there is no drone {drone}; the fleet has {logged.rules.drones}"
            )
        page = output or log.with_name(f"{log.stem}-leg-{leg}-drone-{drone}.html")
        write_file(page, render_leg(logged, leg, drone - 1).encode())
        click.echo(f"wrote {page}; open it in a browser")
        return 0
    with progress(quiet=quiet) as watcher:
        verification = verify_log(log, progress=watcher)
    case = safety_case(logged)
    content = render_report(logged, verification.to_json(), case)
    write_file(page, content.encode())
    click.echo(verification.to_json()["verdict"])
    missing = ", ".join(sorted({one.code for one in case.errors}))
    click.echo(f"safety of the site: {f'NOT MET ({missing})' if missing else 'met'}")
    click.echo(f"wrote {page}; open it in a browser")
    return int(not verification.passed)


def _report_foreign(log: Path, page: Path, rules: Rules) -> int:
    """Write the report of a foreign show; return what showc verify would."""
    from hashlib import file_digest

    from showc.files import write_file
    from showc.view.foreign import render_foreign_report

    judged = judge_foreign(log, rules)
    hashes = {}
    for file in sorted(log.iterdir()) if log.is_dir() else [log]:
        if file.is_file():
            with file.open("rb") as stream:
                hashes[file.name] = file_digest(stream, "sha256").hexdigest()
    write_file(page, render_foreign_report(judged, hashes).encode())
    click.echo(judged.verification["verdict"])
    click.echo(f"wrote {page}; open it in a browser")
    return int(judged.verification["exit_code"])
