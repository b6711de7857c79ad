"""``showc explain``: what a code means, an example, and how to mend it."""

from __future__ import annotations

import click


@click.command(name="explain")
@click.argument("code", required=False)
def command(code: str | None) -> int:
    """Explain a diagnostic code: its cause, an example, how to mend it.

    Without a code, list them all.

    \b
      showc explain SHW201
    """
    from showc.script.codes import CODES, explain

    if code is None:
        for name, entry in sorted(CODES.items()):
            click.echo(f"{name}  {entry.title}")
        return 0
    text = explain(code.upper())
    if text is None:
        from difflib import get_close_matches

        near = get_close_matches(code.upper(), CODES, n=3, cutoff=0.5)
        hint = f"; near it: {', '.join(near)}" if near else ""
        raise click.UsageError(
            f"there is no code {code!r}{hint} (showc explain lists them all)"
        )
    click.echo(text)
    return 0
