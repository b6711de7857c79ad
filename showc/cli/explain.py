"""``showc explain``: what a code means, an example, and what to do."""

from __future__ import annotations

import click


@click.command(name="explain")
@click.argument("code", required=False)
def command(code: str | None) -> int:
    """Explain a finding or a check: its cause, and what to do.

    Without a code, lists all codes.

    \b
      showc explain SHW201
      showc explain VRF321
    """
    from showc.codes import explained
    from showc.safety import codes as safety
    from showc.script import codes as script
    from showc.verify import codes as verify

    known = {**script.codes(), **verify.codes(), **safety.codes()}
    if code is None:
        for name in sorted(known):
            click.echo(f"{name}  {known[name].title}")
        return 0
    text = explained(code, known)
    if text is None:
        from difflib import get_close_matches

        near = get_close_matches(code.upper(), known, n=3, cutoff=0.5)
        hint = f"; did you mean {', '.join(near)}?" if near else ""
        raise click.UsageError(
            f"there is no code {code!r}{hint} (showc explain lists them all)"
        )
    click.echo(text)
    return 0
