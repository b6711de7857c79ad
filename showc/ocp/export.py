"""A solution as arrays, as a table in a file, and as a drawing.

Nothing here needs a library besides NumPy; a data frame needs pandas.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from html import escape
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.ocp.fault import StatementError, check_known
from showc.ocp.solution import ROWS

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.ocp.solution import Solution


_WIDTH, _HEIGHT = 640.0, 120.0
"""Size of one panel [px]."""
_LEFT, _TOP, _GAP = 90.0, 24.0, 34.0
"""Room left of the panels, above the first and between them [px]."""
_COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf")


def arrays(solution: Solution, rows: int = ROWS) -> dict[str, dict[str, FloatArray]]:
    """Sample every phase at equally spaced instants.

    Parameters
    ----------
    solution
        What was solved.
    rows
        Instants of each phase, both ends included; at least 2.

    Returns
    -------
    dict
        For each phase by name: ``time``, then every state and control by name, each of
        shape (rows,), in the problem's own units.
    """
    if rows < 2:
        raise StatementError(f"{rows} rows are asked for; wanted 2 or more")
    found = {}
    for part in solution.phases:
        time = np.linspace(part.start, part.end, rows)
        columns = {"time": time}
        columns |= dict(zip(part.state_names, part.states(time).T, strict=True))
        columns |= dict(zip(part.control_names, part.controls(time).T, strict=True))
        found[part.name] = columns
    return found


def table(solution: Solution, rows: int = ROWS) -> str:
    """Return the arrays as CSV: a column for the phase, the time and every quantity.

    A phase leaves empty what it does not have.
    """
    sampled = arrays(solution, rows)
    names = list(dict.fromkeys(name for part in sampled.values() for name in part))
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["phase", *names])
    for phase, columns in sampled.items():
        for row in range(rows):
            cells = [
                repr(float(columns[name][row])) if name in columns else ""
                for name in names
            ]
            writer.writerow([phase, *cells])
    return text.getvalue()


def frame(solution: Solution, rows: int = ROWS) -> Any:  # noqa: ANN401 - of pandas
    """Return the same table as a ``pandas.DataFrame``.

    Raises
    ------
    ImportError
        If pandas is not installed.
    """
    try:
        import pandas as pd  # type: ignore[import-untyped,import-not-found,unused-ignore]  # noqa: PLC0415
    except ImportError:
        raise ImportError(
            "a data frame needs pandas (pip install pandas); arrays() and to_csv() "
            "need nothing"
        ) from None
    return pd.read_csv(StringIO(table(solution, rows)))


@dataclass(frozen=True, slots=True)
class Drawing:
    """Every state and control of a solution over time, as SVG; notebooks show it."""

    svg: str

    def _repr_svg_(self) -> str:
        return self.svg

    def save(self, path: str | Path) -> None:
        """Write the drawing to a file whose name ends in ``.svg``.

        Raises
        ------
        StatementError
            If the name promises another format.
        """
        target = Path(path)
        if target.suffix.lower() != ".svg":
            raise StatementError(
                f"{target.name!r} is no name of an SVG; end it in .svg"
            )
        target.write_text(self.svg, encoding="utf-8")


def drawing(solution: Solution, names: tuple[str, ...] = ()) -> Drawing:
    """Draw states and controls over time, a panel for each name.

    Parameters
    ----------
    solution
        What was solved.
    names
        What is drawn; all by default. Of a vector, its elements share a panel.
    """
    known = {n for part in solution.phases for n in part.state_names}
    known |= {n for part in solution.phases for n in part.control_names}
    known |= {name.split("[")[0] for name in known}
    check_known(names, sorted(known), "a drawing")
    series: dict[str, list[tuple[str, FloatArray, FloatArray]]] = {}
    for part in solution.phases:
        curves = [(n, part.states, i) for i, n in enumerate(part.state_names)]
        curves += [(n, part.controls, j) for j, n in enumerate(part.control_names)]
        share = 1e-9 + (1.0 - 2e-9) * np.linspace(0.0, 1.0, 25)
        breaks = part.states.breaks
        # Just inside the borders of intervals, so that jumps are drawn as jumps.
        times = (breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel()
        for name, curve, index in curves:
            whole = name.split("[")[0]
            if not names or name in names or whole in names:
                values = curve(times)[:, index]
                series.setdefault(whole, []).append((name, times, values))
    begin, end = solution.phases[0].start, solution.phases[-1].end
    height = _TOP + len(series) * (_HEIGHT + _GAP)
    space = 'xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" font-size="12"'
    parts = [f'<svg {space} width="{_LEFT + _WIDTH + 20:g}" height="{height:g}">']
    for number, (title, curves_of_panel) in enumerate(series.items()):
        top = _TOP + number * (_HEIGHT + _GAP)
        parts += _panel(title, curves_of_panel, top, (begin, end))
    parts.append("</svg>")
    return Drawing("\n".join(parts))


def _panel(
    title: str,
    curves: list[tuple[str, FloatArray, FloatArray]],
    top: float,
    span: tuple[float, float],
) -> list[str]:
    """Frame, ticks and curves of one panel."""
    low = min(float(values.min()) for _, _, values in curves)
    high = max(float(values.max()) for _, _, values in curves)
    room = 0.05 * (high - low) or 0.5 * (abs(high) or 1.0)
    low, high = low - room, high + room
    width = (span[1] - span[0]) or 1.0
    place = f'x="{_LEFT:g}" y="{top:g}" width="{_WIDTH:g}" height="{_HEIGHT:g}"'
    parts = [
        f'<rect {place} fill="none" stroke="#999"/>',
        f'<text x="{_LEFT:g}" y="{top - 6:g}">{escape(title)}</text>',
    ]
    for value, at in ((high - room, 0.05), (low + room, 0.95)):
        y = top + at * _HEIGHT + 4.0
        words = f"{value:.4g}"
        parts.append(
            f'<text x="{_LEFT - 6:g}" y="{y:g}" text-anchor="end">{words}</text>'
        )
    y = top + _HEIGHT + 14.0
    for time, side, shift in ((span[0], "start", 0.0), (span[1], "end", _WIDTH)):
        where = f'x="{_LEFT + shift:g}" y="{y:g}" text-anchor="{side}"'
        parts.append(f"<text {where}>{time:.4g}</text>")
    hues = {name: i for i, name in enumerate(dict.fromkeys(n for n, _, _ in curves))}
    for name, times, values in curves:
        across = _LEFT + (times - span[0]) / width * _WIDTH
        down = top + (high - values) / (high - low) * _HEIGHT
        pairs = zip(across, down, strict=True)
        points = " ".join(f"{a:.2f},{b:.2f}" for a, b in pairs)
        hue = _COLOURS[hues[name] % len(_COLOURS)]
        parts.append(
            f'<polyline fill="none" stroke="{hue}" stroke-width="1.5" '
            f'points="{points}"><title>{escape(name)}</title></polyline>'
        )
    return parts
