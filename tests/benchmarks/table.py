"""Tables that read well both on a terminal and as Markdown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

MISSING = "–"


def _two_digits(value: float) -> str:
    return f"{value:.2g}" if value < 99.5 else f"{float(f'{value:.2g}'):.0f}"


def error(value: float | None) -> str:
    """Write a relative error with one digit, for example ``4e-07``."""
    if value is None:
        return MISSING
    if not math.isfinite(value):
        return "diverges"
    if value < 1e-14:
        return "0"
    return f"{value:.0e}" if value < 1.0 else _two_digits(value)


def seconds(value: float | None) -> str:
    """Write a time with three significant digits and no exponent [s]."""
    if value is None:
        return MISSING
    if value == 0.0:
        return "0"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"


def percent(value: float | None) -> str:
    """Write a fraction as a percentage with two significant digits."""
    if value is None:
        return MISSING
    if value < 5e-9:
        return "0"
    if value < 0.001:
        return f"{value:.0e}"
    return f"{_two_digits(100.0 * value)} %"


def length(value: float | None) -> str:
    """Write a length in the unit that suits it [m]."""
    if value is None:
        return MISSING
    if not math.isfinite(value):
        return "diverges"
    for factor, unit in ((1.0, "m"), (1e2, "cm"), (1e3, "mm")):
        if value * factor >= 0.995:
            return f"{_two_digits(value * factor)} {unit}"
    return f"{value * 1e3:.1g} mm"


def ratio(value: float | None) -> str:
    """Write how many times something is more."""
    if value is None:
        return MISSING
    return f"{_two_digits(value)} x"


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out a table with aligned columns; the first is left-aligned.

    Raises
    ------
    ValueError
        If a row has not as many cells as the header.
    """
    for row in rows:
        if len(row) != len(header):
            raise ValueError(
                f"row {list(row)} has {len(row)} cells; wanted {len(header)}"
            )
    cells = [[cell.replace("|", "\\|") for cell in row] for row in (header, *rows)]
    widths = [max(3, *(len(row[i]) for row in cells)) for i in range(len(header))]

    def line(row: Sequence[str]) -> str:
        first = row[0].ljust(widths[0])
        rest = [cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True)]
        return "| " + " | ".join([first, *rest]) + " |"

    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    return "\n".join(
        [line(cells[0]), "| " + " | ".join(rule) + " |", *map(line, cells[1:])]
    )
