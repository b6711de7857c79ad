"""Arrival into and departure from formations that move: what it costs over the bound.

Run ``python tests/benchmarks/joining.py [WORD ...]``. Each of ten scripts sends a fleet
from its pads into a formation that moves, and out of it: to a row at rest, or into
another formation that moves. It is compiled without a cache and proved by ``showc
verify`` with its script. Printed are the times of the moves that begin or end in
motion, the greatest least time of a single drone, and the proved lower bound.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from findings import failed

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT)]

from showc.fleet import SolveOptions  # noqa: E402
from showc.log.container import open_log  # noqa: E402
from showc.pipeline.compile import CompileOptions, compile_script  # noqa: E402
from showc.verify import verify_log  # noqa: E402
from showc.verify.decode import decoding  # noqa: E402

ASKED = 0.02
"""Greatest time over the bound, as a fraction."""


@dataclass(frozen=True, slots=True)
class Case:
    """A fleet, the formation that it joins, and where it goes from there."""

    name: str
    drones: int
    formation: str
    motion: str
    hold: float
    then: str | None = None
    """Motion of the formation that it joins next; None: a row at rest."""


RING = "{type: circle, radius: 8, centre: [10, 5, 22]}"
CASES = (
    Case("ring that turns", 6, RING, "{rotate: 160 deg}", 10.0),
    Case(
        "wide ring that turns slowly",
        16,
        "{type: circle, radius: 20, centre: [0, 10, 30]}",
        "{rotate: {angle: 90 deg}}",
        12.0,
    ),
    Case(
        "wheel",
        8,
        "{type: circle, radius: 7, centre: [0, 12, 20], "
        "transform: [{rotate: {angle: 90, axis: x}}]}",
        "{rotate: {angle: 180 deg, axis: y}}",
        12.0,
    ),
    Case("propeller", 7, "{type: line, length: 18, centre: [4, 0, 18]}",
         "{rotate: -150 deg}", 10.0),
    Case(
        "ring at four metres a second",
        4,
        "{type: circle, radius: 9, centre: [0, 0, 20]}",
        "{rotate: 250 deg}",
        10.0,
    ),
    Case(
        "grid that waves",
        16,
        "{type: grid, step: 3, centre: [0, 0, 15]}",
        "{wave: {amplitude: 1.5, period: 6, wavelength: 20}}",
        7.4,
    ),
    Case("ring that breathes", 10, RING, "{breathe: {scale: 1.3, period: 7}}", 8.0),
    Case(
        "grid that circles",
        9,
        "{type: grid, step: 5, centre: [-5, 8, 18]}",
        "{orbit: {radius: 1.2, period: 6, wavelength: 30}}",
        9.1,
    ),
    Case(
        "ring that turns and waves",
        8,
        RING,
        "{rotate: 90 deg}, {wave: {amplitude: 1, period: 6, wavelength: 25}}",
        9.0,
    ),
    Case("from one turn into the other", 6, RING, "{rotate: 120 deg}", 8.0,
         "{rotate: -120 deg}"),
)  # fmt: skip


def script(case: Case) -> str:
    """Write the script of a case."""
    second = (
        "  - {to: row, hold: 1}"
        if case.then is None
        else f"  - {{to: away, hold: 8, motion: [{case.then}], arrive: moving}}"
    )
    return f"""\
showc: 1
name: {case.name}
drones: {case.drones}
separation: 1.5
site: {{volume: {{min: [-80, -80, 0], max: [80, 80, 80]}}}}
pads: {{type: grid, step: 2.5}}
launch: {{altitude: 8, hold: 1}}
formations:
  it: {case.formation}
  row: {{type: line, length: {2.5 * case.drones}, centre: [0, -20, 12]}}
  away: {{type: circle, radius: 8, centre: [-12, -14, 14]}}
transitions:
  - to: it
    hold: {case.hold}
    motion: [{case.motion}]
    arrive: moving
    leave: moving
{second}
"""


def measured(case: Case, folder: Path) -> tuple[list[str], bool]:
    """Compile and prove a case; return lines of the table, and whether all is well."""
    path, log = folder / "show.yaml", folder / "show.mcap"
    path.write_text(script(case), encoding="utf-8")
    solve = SolveOptions(use_cache=False, jobs=1)
    compile_script(path, log, CompileOptions(missions=False, solve=solve))
    proved = not failed(verify_log(log, script=path))
    parts, joined = decoding(open_log(log))
    segments = joined([part() for part in parts]).segments
    kinds = [(one.message.kind, one.message.MOTION) for one in segments]
    motions = {at for at, (kind, motion) in enumerate(kinds) if kind == motion}
    lines, well = [], proved
    for at, one in enumerate(segments):
        moving = any(at + step in motions for step in (-1, 1))
        if at in motions or not moving:
            continue
        said = one.message.certificate
        over = one.duration / said.dual_bound - 1.0
        well &= over <= ASKED
        row = (
            case.name,
            str(case.drones),
            one.message.name,
            f"{one.duration:.3f}",
            f"{said.single_drone_minimum:.3f}",
            f"{said.dual_bound:.3f}",
            f"{over:.2%}",
            "yes" if proved else "NO",
        )
        lines.append(f"| {' | '.join(row)} |")
    return lines, well


def main(words: list[str]) -> int:
    """Measure the cases whose names have one of the words, or all; 1 if one fails."""
    say = sys.stdout.write
    say("| case | drones | move | time [s] | one drone [s] | bound [s] | over bound ")
    say("| proved |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n")
    failed = 0
    for case in CASES:
        if words and not any(word in case.name for word in words):
            continue
        with tempfile.TemporaryDirectory() as folder:
            lines, well = measured(case, Path(folder))
        say("\n".join([*lines, ""]))
        failed += not well
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
