"""``showc view``: a page that plays the show in any browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

import click

from showc.cli.foreign import foreign_options, is_foreign, judge_foreign
from showc.cli.options import FILE, SHOW, flag, output_option, show_argument

if TYPE_CHECKING:
    from showc.cli.foreign import Rules
    from showc.view.scene import SecondFleet


@click.command(name="view")
@show_argument
@output_option(
    "PAGE.html",
    "Where to put the page.  [default: OUTPUT.html]",
)
@flag("--open", "show", text="Open it in the browser.")
@flag("--no-verify", text="Do not verify the log. The page says so.")
@flag("--music", text="Put the recording named in the script into the page.")
@click.option(
    "--flown",
    type=SHOW,
    multiple=True,
    metavar="RECORD",
    help="Draw a real flight beside the solved one.  Can be repeated.",
)
@click.option(
    "--layout",
    type=FILE,
    metavar="LAYOUT.json",
    help="Also write a layout for Foxglove and Lichtblick.",
)
@foreign_options
def command(
    log: Path,
    output: Path | None,
    show: bool,
    no_verify: bool,
    music: bool,
    flown: tuple[Path, ...],
    layout: Path | None,
    rules: Rules,
) -> int:
    """Make a page that plays the show in any browser.

    Writes one HTML file that needs no network. It shows the fleet in its colours above
    a timeline with chapters and cues, plots of one drone and of the whole fleet against
    its limits, and the closest pair. It can also show the predicted flights of the
    missions, and the tubes that showc simulate found in wind. showc verify runs first,
    and the page shows its verdict. Music plays in step: a file chosen in the page, or
    with --music the recording named in the script.

    With --flown, the page shows a real flight in place of the predicted one. RECORD is
    a log written by showc stream, a .BIN, a .tlog, or a folder of these.

    Shows of other tools play as well, with the findings of showc verify: a .skyc, .skyb
    files, a CSV zip, poly7 files, a .vviz, an animated glTF, or a folder written by
    showc export. The page lists what such a file leaves unknown. Other viewers read the
    log itself: --layout writes a layout for Foxglove and Lichtblick.

    \b
      showc view output.mcap          writes output.html
      showc view night.skyc           writes night.html
    """
    page = output or log.with_suffix(".html")
    if is_foreign(log):
        misplaced = no_verify or music or bool(flown) or layout is not None
        verdict: str | None = _draw_foreign(log, page, misplaced, rules)
    else:
        verdict = _draw(log, page, no_verify, music, flown)
        if layout is not None:
            _write_layout(log, layout)
    if verdict is not None:
        click.echo(verdict)
    click.echo(f"wrote {page}; open it in a browser")
    if show:
        webbrowser.open(page.resolve().as_uri())
    return 0


def _write_layout(log: Path, layout: Path) -> None:
    """Write the layout that a log carries for other viewers."""
    from showc.files import write_file
    from showc.log.reader import read_log
    from showc.log.schema import LAYOUT_NAME

    write_file(layout, read_log(log).attachments[LAYOUT_NAME])
    click.echo(f"wrote {layout}; import it in Foxglove or Lichtblick")


def _draw_foreign(log: Path, page: Path, misplaced: bool, rules: Rules) -> str:
    """Write the page of a foreign show; return the verdict."""
    from showc.errors import UsageError
    from showc.files import write_file
    from showc.view.foreign import render_foreign

    if misplaced:
        raise UsageError(
            f"{log}: --no-verify, --music, --flown and --layout are for showc's own "
            "logs; leave them out"
        )
    judged = judge_foreign(log, rules)
    write_file(page, render_foreign(judged).encode())
    return str(judged.verification["verdict"])


def _draw(
    log: Path, page: Path, no_verify: bool, music: bool, flown: tuple[Path, ...]
) -> str | None:
    """Write the page of a log; return the verdict."""
    from showc.errors import UsageError
    from showc.files import write_file
    from showc.log.reader import read_log
    from showc.verify import verify_log
    from showc.view import render_page
    from showc.view.scene import Soundtrack

    logged = read_log(log)
    fleet = _flown_fleet(log, flown) if flown else None
    verdict = None if no_verify else verify_log(log, jobs=None).to_json()
    script = logged.read_script().show
    soundtrack = Soundtrack.of(None if script is None else script.music)
    recording = b""
    if music:
        name = "" if soundtrack is None else soundtrack.file
        if name not in logged.attachments:
            raise UsageError(
                "the script names no recording: add `music: {file: …}` and compile "
                "again, or choose a file in the page"
            )
        recording = logged.attachments[name]
    html = render_page(logged, verdict, soundtrack, recording, flown=fleet)
    write_file(page, html.encode())
    return None if verdict is None else str(verdict["verdict"])


def _flown_fleet(log: Path, flown: tuple[Path, ...]) -> SecondFleet:
    """Read what was flown, in the time of the page."""
    import numpy as np

    from showc.errors import UsageError
    from showc.vehicle_link.overlay import load_flown
    from showc.view.scene import SecondFleet
    from showc.view.second_fleet import frame_times, mission_times

    flight = load_flown(log, flown)
    times = frame_times(flight.show)
    missions = flight.course.kind == "missions"
    places = flight.places(mission_times(flight.show, times) if missions else times)
    if np.isnan(places).all():
        raise UsageError(
            f"{flown[0]}: has no position between 0 and {times[-1]:.1f} s of the "
            "show; give the record of a flight of this compile"
        )
    return SecondFleet("As flown", times, places, shown=True)
