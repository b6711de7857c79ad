"""``showc schema``: the JSON Schema of show scripts."""

from __future__ import annotations

import click


@click.command(name="schema")
def command() -> int:
    """Print the JSON Schema of show scripts.

    Editors with YAML support use it to complete and check scripts. The first line of a
    script names it:

    \b
      # yaml-language-server: $schema=show.schema.json
      showc schema > show.schema.json
    """
    from showc.script.language.schema import schema_text

    click.echo(schema_text().rstrip("\n"))
    return 0
