"""``showc preview``: a page that follows the script while it is written."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import click

from showc.cli.options import Whole, cache_option, flag, outside_option


@click.command(name="preview")
@click.argument("script", metavar="SHOW.yaml")
@click.option(
    "--port",
    type=Whole(0, 65535),
    metavar="PORT",
    default=0,
    help="Port to listen on.  [default: any free port]",
)
@flag("--solve", text="Solve in the background, as compile does.")
@flag("--open", "show", text="Open the page in the browser.")
@cache_option
@outside_option
def command(
    script: str,
    port: int,
    solve: bool,
    show: bool,
    cache_dir: Path | None,
    allow_outside: bool,
) -> int:
    """Show a script in the browser while it is written.

    The page shows formations, and moves along straight lines, at once. It updates with
    every save, and marks the findings of check. With --solve, solved transitions
    replace the straight lines. Only this machine can open the page. Ctrl-C ends the
    preview.

    \b
      showc preview my-show.yaml --solve
    """
    from showc.errors import UsageError
    from showc.fleet.options import SolveOptions
    from showc.preview.server import Server
    from showc.preview.session import Session

    path = Path(script)
    if not path.is_file():
        raise UsageError(f"{script!r} cannot be read; give the path of a show script")
    session = Session(
        path, SolveOptions(cache=cache_dir), solve=solve, allow_outside=allow_outside
    )
    try:
        server = Server(session, port)
    except OSError as error:
        raise UsageError(
            f"cannot listen on port {port}: {error.strerror}; leave --port out to take "
            "one that is free"
        ) from None
    click.echo(f"{server.url}  follows {script}; Ctrl-C ends it")
    server.start()
    if show:
        webbrowser.open(server.url)
    try:
        session.follow()
    except KeyboardInterrupt:
        click.echo("")
    finally:
        server.shutdown()
        server.server_close()
    return 0
