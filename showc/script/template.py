"""The template: the script that ``showc init`` writes to start from."""

from __future__ import annotations

from importlib.resources import files


def template_text(name: str = "My first show") -> str:
    """Return a commented script that is a complete show.

    Parameters
    ----------
    name
        Title of the show; written in quotes.
    """
    text = (files("showc.script") / "template.yaml").read_text(encoding="utf-8")
    quoted = name.replace("\\", "\\\\").replace('"', '\\"')
    return text.replace('"My first show"', f'"{quoted}"')
