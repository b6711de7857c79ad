"""``showc verify`` for shows of others, and for exports of showc's own."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from pathlib import Path


SUFFIXES = {".skyc", ".skyb", ".zip", ".csv", ".traj", ".vviz", ".gltf", ".glb"}
"""Endings of files that are no logs of showc's."""


def is_foreign(path: Path) -> bool:
    """Whether ``path`` is a show of another format than showc's own log."""
    return path.is_dir() or path.suffix.lower() in SUFFIXES


def verify_foreign(path: Path, *, as_json: bool) -> int:
    """Judge a show of another format, print the result, and return the exit code."""
    from showc.cli.console import colour_wanted
    from showc.foreign.folder import is_export, verify_export
    from showc.foreign.verdict import verify_foreign as judged
    from showc.verify.report import render_text

    result = verify_export(path) if is_export(path) else judged(path)
    if as_json:
        click.echo(json.dumps(result.to_json(), indent=1))
    else:
        colour = colour_wanted(sys.stdout)
        click.echo(render_text(result, colour=colour), color=colour)
    return result.exit_code
