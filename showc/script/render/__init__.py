"""Rendering: findings as text, JSON, SARIF, annotations and JUnit."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from showc.codes import Code
    from showc.script.diagnostic import Diagnostic

FORMATS = ("text", "json", "sarif", "github", "junit")
"""Names of the formats."""


def render(
    diagnostics: Iterable[Diagnostic],
    sources: Mapping[str, str],
    form: str = "text",
    *,
    colour: bool = False,
    rules: Mapping[str, Code] | None = None,
) -> str:
    """Return findings in a format.

    Parameters
    ----------
    diagnostics
        What was found.
    sources
        Text of each file that was checked, by path; files without findings count.
    form
        One of ``FORMATS``.
    colour
        Whether to colour text for a terminal.
    rules
        What SARIF says of the codes; None: those of scripts.

    Raises
    ------
    ValueError
        If the format is unknown.
    """
    # Each format brings libraries of its own; only the one asked for is imported.
    found = list(diagnostics)
    match form:
        case "text":
            from showc.script.render.text import render_text  # noqa: PLC0415

            return render_text(found, sources, colour=colour)
        case "json":
            from showc.script.render.programs import render_json  # noqa: PLC0415

            return render_json(found, sources)
        case "sarif":
            from showc.script.codes import codes  # noqa: PLC0415
            from showc.script.render.sarif import render_sarif  # noqa: PLC0415

            return render_sarif(found, sources, codes() if rules is None else rules)
        case "github":
            from showc.script.render.programs import render_github  # noqa: PLC0415

            return render_github(found)
        case "junit":
            from showc.script.render.programs import render_junit  # noqa: PLC0415

            return render_junit(found, sources)
        case _:
            raise ValueError(f"unknown format {form!r}, known are {FORMATS}")


__all__ = ["FORMATS", "render"]
