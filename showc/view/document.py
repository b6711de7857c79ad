"""Pieces of printable HTML: escaped text, tables, the page around them."""

from __future__ import annotations

import html
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any


def text(value: object) -> str:
    """Escape a value for HTML; arrows of plain characters become real ones."""
    return html.escape(str(value).replace("->", "→"))


def badge(verification: Mapping[str, Any] | None) -> str:
    """Return the verdict that ``showc verify --json`` gives; green only if proved."""
    if verification is None:
        return '<div class="verdict none">NOT VERIFIED<small>no proofs</small></div>'
    word, _, said = map(text, verification["verdict"].partition(": "))
    kind = "fail"
    if verification["proved"]:
        kind = "pass"
    elif verification["passed"]:
        kind = "open"
    return f'<div class="verdict {kind}">{word}<small>{said}</small></div>'


def clock(seconds: float) -> str:
    """Minutes and seconds, to a tenth."""
    tenths = round(seconds * 10.0)
    return f"{tenths // 600}:{tenths // 10 % 60:02d}.{tenths % 10}"


def figure(value: float | None, unit: str) -> str:
    """Return a quantity of a check with as many digits as a reader wants."""
    if value is None:
        return ""
    if value == int(value) and abs(value) < 1e15:
        shown = f"{int(value):,}"
    elif 1e-3 <= abs(value) < 1e6:
        shown = f"{value:.4g}" if abs(value) < 1000.0 else f"{value:,.0f}"
    else:
        shown = f"{value:.1e}"
    return f"{shown} {unit}".strip()


def place(where: Mapping[str, Any]) -> str:
    """Return where in the show a check found something."""
    parts = []
    if "pair" in where:
        parts.append(f"drones {where['pair'][0]} and {where['pair'][1]}")
    elif "drone" in where:
        parts.append(f"drone {where['drone']}")
    if "segment" in where:
        parts.append(str(where["segment"]))
    if "time" in where:
        parts.append(clock(where["time"]))
    if "file" in where:
        # The folder is the verifier's own; the name says enough.
        parts.append(str(where["file"]).rsplit("/", 1)[-1])
    return ", ".join(parts)


def table(
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    words: frozenset[int] = frozenset(),
    kind: str = "",
) -> str:
    """HTML table; the columns of index in ``words`` are set to the left.

    A row is the HTML of its cells, or of the whole row: a text.
    """
    head = "".join(
        f"<th{_left(index, words)}>{name}</th>" for index, name in enumerate(heads)
    )
    body = "".join(
        one if isinstance(one, str) else row(one, words=words) for one in rows
    )
    return (
        f'<table class="{kind}"><thead>'
        f"<tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    )


def row(
    cells: Sequence[str], *, kind: str = "", words: frozenset[int] = frozenset()
) -> str:
    """One row of a table; ``cells`` are HTML."""
    inner = "".join(
        f"<td{_left(index, words)}>{cell}</td>" for index, cell in enumerate(cells)
    )
    return f'<tr class="{kind}">{inner}</tr>' if kind else f"<tr>{inner}</tr>"


def _left(index: int, words: frozenset[int]) -> str:
    return ' class="text"' if index in words else ""


def small(value: str) -> str:
    """Return a line in small print under the cell's value."""
    return f"<small>{value}</small>" if value else ""


def document(title: str, body: str) -> str:
    """Return a whole page for screen and printer."""
    folder = files("showc.view") / "assets"
    return Template((folder / "document.html").read_text("utf-8")).substitute(
        title=text(title),
        style=(folder / "report.css").read_text("utf-8"),
        body=body,
    )
