"""``showc view``: a page that plays the show in any browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import click


@click.command(name="view")
@click.argument(
    "log", type=click.Path(dir_okay=False, path_type=Path), metavar="OUTPUT.mcap"
)
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PAGE.html",
    help="Where to put the page.  [default: OUTPUT.html]",
)
@click.option("--open", "show", is_flag=True, help="Open it in the browser.")
@click.option(
    "--no-verify", is_flag=True, help="Prove nothing; the page says that it is not."
)
def command(log: Path, output: Path | None, show: bool, no_verify: bool) -> int:
    """Make a page that plays the show in any browser.

    One self-contained HTML file, made and played without the network: the fleet in its
    colours, scrubbing, speed, orbit, plots of a chosen drone, the tightest encounter,
    the transitions as chapters, and the verdict of showc verify, which is run first.

    \b
      showc view output.mcap          writes output.html
    """
    from showc.files import write_file
    from showc.log.reader import read_log
    from showc.verify import verify_log
    from showc.view import render_page

    logged = read_log(log)
    verdict = None if no_verify else verify_log(log, jobs=None).to_json()
    page = output or log.with_suffix(".html")
    write_file(page, render_page(logged, verdict).encode())
    if verdict is not None:
        click.echo(verdict["verdict"])
    click.echo(f"wrote {page}; open it in a browser")
    if show:
        webbrowser.open(page.resolve().as_uri())
    return 0
