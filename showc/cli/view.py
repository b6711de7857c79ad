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
def command(log: Path, output: Path | None, show: bool) -> int:
    """Make a page that plays the show in any browser.

    One self-contained HTML file, made and played without the network: the fleet in its
    colours, scrubbing, speed, orbit, plots of a chosen drone, the tightest encounter,
    the transitions as chapters.

    \b
      showc view output.mcap          writes output.html
    """
    from showc.files import write_file
    from showc.log.reader import read_log
    from showc.view import render_page

    page = output or log.with_suffix(".html")
    write_file(page, render_page(read_log(log)).encode())
    click.echo(f"wrote {page}; open it in a browser")
    if show:
        webbrowser.open(page.resolve().as_uri())
    return 0
