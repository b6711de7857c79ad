"""Fleets in minimum time: whole compiles, beside what others would fly.

Run ``python tests/benchmarks/fleet_table.py --help``. Every case is a script; what is
timed is ``showc compile`` of it in a fresh process, files included, with all descendant
processes: time, processor time, greatest memory. First nothing is known; then, for each
transition of the table, a compile in which that transition alone is missing in the
cache. What was compiled is proved by ``showc verify`` of the same run. Beside it:

- ``ruckig``: one shared straight-line profile by ruckig (Berscheid and Kroeger 2021)
  under the same velocity limits, the acceleration of level flight at the greatest tilt
  and the jerk of the greatest body rate; and how many drones it takes beyond a limit of
  the full dynamics.
- ``law``: T = max(1.5 d / v, sqrt(6 d / a)) for the longest way, the duration law of
  common show tools.
"""

from __future__ import annotations

import argparse
import compileall
import json
import math
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from benchmarks.fleet_shows import Case, FleetShow, all_shows, growth  # noqa: E402
from benchmarks.household import Needed, run  # noqa: E402

from showc.fleet import SolveOptions  # noqa: E402
from showc.fleet.execution.cache import leg_key  # noqa: E402
from showc.fleet.shared_profile.flat import attitude  # noqa: E402
from showc.plan import build_itinerary  # noqa: E402
from showc.script import load_show  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.plan.itinerary import Itinerary, Leg

HEADS = (
    "transition", "asked", "compile [s]", "cpu [s]", "peak [MiB]", "t_f [s]",
    "over minimum", "over bound", "nearest [m]", "ruckig [s]", "law [s]",
)  # fmt: skip
WHOLE = (
    "show", "legs", "flight [s]", "compile [s]", "of the flight", "cpu [s]",
    "peak [MiB]", "verify [s]", "of the compile", "its cpu [s]", "its peak [MiB]",
    "proved", "replay [mm]", "files",
)  # fmt: skip
ABOUT = """\
Whole compiles of scripts in fresh processes, files included, then their proof. Times
are wall-clock and processor time of all processes, memory is the greatest of all
together. In the first table the transition alone is missing in the cache: what it takes
to solve it, and to write all files of the show. In the second, nothing is known before,
and `verify` is the median of three runs; asked of the ten pictures are less than three
times the flight, and less than a tenth of the compile.
`ruckig`: the shared straight-line profile under the same limits on velocity, level
acceleration and jerk (drones beyond a limit of the full dynamics, and the worst use of
one); `law`: T = max(1.5 d / v, sqrt(6 d / a)) for the longest way.
"""
PAGE = ROOT / "showc" / "docs" / "benchmarks.md"
TITLE = "## Fleets\n"
REFUSED = "the autopilot would make"
"""Words of the compiler where it has no missions that are proved apart."""


@dataclass(frozen=True, slots=True)
class Workshop:
    """Where one show is compiled, over and over."""

    folder: Path
    jobs: int | None
    start: str | None
    """When the missions start (UTC)."""

    @property
    def log(self) -> Path:
        """The compiled log."""
        return self.folder / "show.mcap"

    def showc(self, *arguments: str) -> Needed:
        """Run showc in a fresh process."""
        jobs = [] if self.jobs is None else ["--jobs", str(self.jobs)]
        command = [sys.executable, "-m", "showc", *arguments, *jobs]
        return run(command, self.folder, environment={"PYTHONPATH": str(ROOT)})

    def compile(self, *, missions: bool) -> Needed:
        """Compile the show from what the cache has."""
        clock = [] if self.start is None else ["--start", self.start]
        more = clock if missions else ["--no-missions"]
        cache = str(self.folder / "cache")
        return self.showc(
            "compile", "show.yaml", "-o", "show.mcap", "-q", "--cache-dir", cache, *more
        )

    def forget(self, itinerary: Itinerary, leg: Leg) -> None:
        """Take a leg out of the cache."""
        key = leg_key(leg, itinerary.show, SolveOptions())
        (self.folder / "cache" / key[:2] / f"{key}.leg").unlink()


def measured(show: FleetShow, jobs: int | None) -> Iterator[tuple[str, Sequence[str]]]:
    """Rows of one show: of the whole, then of its transitions, with their table."""
    with tempfile.TemporaryDirectory(prefix="showc-fleet-") as place:
        shop = Workshop(Path(place), jobs, show.start)
        (shop.folder / "show.yaml").write_text(show.script)
        for name, content in show.files.items():
            (shop.folder / name).write_text(content)
        missions = True
        cold = shop.compile(missions=True)
        if cold.code == 1 and REFUSED in cold.output:
            reason = next(line for line in cold.output.splitlines() if REFUSED in line)
            yield "note", (f"{show.name}: log only; {reason.strip()}",)
            missions = False
            (shop.folder / "cache").rename(shop.folder / "former")
            cold = shop.compile(missions=False)
        if cold.code != 0:
            yield "note", (f"{show.name}: {_last(cold.output)}",)
            return
        manifest = json.loads((shop.folder / "show" / "manifest.json").read_text())
        yield "whole", _whole(show, shop, cold, manifest, missions=missions)
        result = load_show(str(shop.folder / "show.yaml"))
        assert result.show is not None
        itinerary = build_itinerary(result.show)
        for case in show.cases:
            leg = next(
                leg
                for leg in itinerary.legs
                if leg.transition == case.index and leg.kind == "transition"
            )
            shop.forget(itinerary, leg)
            needed = shop.compile(missions=missions)
            yield "leg", _transition(show, case, leg, needed, manifest)


def _last(output: str) -> str:
    return " ".join(output.strip().splitlines()[-1:])


def _whole(
    show: FleetShow,
    shop: Workshop,
    cold: Needed,
    manifest: dict[str, Any],
    *,
    missions: bool,
) -> Sequence[str]:
    proofs = [shop.showc("verify", "show.mcap", "--json", "-q") for _ in range(3)]
    proof = sorted(proofs, key=lambda one: one.wall)[1]
    found = json.loads(proof.output) if proof.code in (0, 1) else {"checks": []}
    deviation = [
        check["value"] for check in found["checks"] if check["code"] == "VRF301"
    ]
    legs = [leg for leg in manifest["segments"] if leg["kind"] != "hold"]
    return (
        show.name,
        str(len(legs)),
        f"{manifest['duration']:.0f}",
        f"{cold.wall:.1f}",
        f"{cold.wall / manifest['duration']:.2f}",
        f"{cold.processor:.1f}",
        f"{cold.memory:.0f}",
        f"{proof.wall:.1f}",
        f"1/{cold.wall / proof.wall:.1f}",
        f"{proof.processor:.1f}",
        f"{proof.memory:.0f}",
        "yes" if found.get("passed") else "NO",
        f"{1000.0 * max(deviation, default=math.nan):.3f}",
        "missions, log" if missions else "log",
    )


def _transition(
    show: FleetShow, case: Case, leg: Leg, needed: Needed, manifest: dict[str, Any]
) -> Sequence[str]:
    flown = manifest["segments"][leg.index]
    certificate = flown["certificate"]
    time = flown["duration"]
    way = leg.goal - leg.start
    peer, beyond, use = ruckig_profile(way, leg)
    asked = f"{100.0 * case.gap:g} %, {show.memory:.0f} MiB"
    if case.time is not None:
        asked = f"{case.time:g} s, {asked}"
    return (
        case.label,
        asked,
        f"{needed.wall:.1f}",
        f"{needed.processor:.1f}",
        f"{needed.memory:.0f}",
        f"{time:.3f}",
        f"{100.0 * certificate['gap']:.2f} %",
        f"{100.0 * (time / certificate['dual_bound'] - 1.0):.2f} %",
        f"{certificate['closest']['distance']:.3f}",
        f"{peer:.2f} ({beyond} beyond, {use:.2f})",
        f"{duration_law(way, leg):.2f}",
    )


def ruckig_profile(way: np.ndarray, leg: Leg) -> tuple[float, int, float]:
    """Time of ruckig's shared profile, drones beyond a limit, and the worst use."""
    from ruckig import InputParameter, Result, Ruckig, Trajectory

    limits, gravity = leg.limits, 9.80665
    pull = gravity * math.tan(limits.tilt)
    longest = float(np.linalg.norm(way, axis=1).max())
    wanted = InputParameter(1)
    wanted.current_position, wanted.target_position = [0.0], [1.0]
    wanted.max_velocity = [limits.velocity_max[0] / np.abs(way).max()]
    wanted.max_acceleration = [pull / longest]
    wanted.max_jerk = [gravity * limits.body_rate[0] / longest]
    flight = Trajectory(1)
    if Ruckig(1).calculate(wanted, flight) not in (Result.Working, Result.Finished):
        raise RuntimeError("ruckig found no profile")
    times = np.linspace(0.0, flight.duration, 400)
    second = np.array([flight.at_time(float(t))[2][0] for t in times])
    third = np.gradient(second, times)
    use = np.concatenate(
        [
            _use(part[:, None, :], second, third, leg)
            for part in np.array_split(way, math.ceil(way.shape[0] / 500))
        ]
    )
    return flight.duration, int((use > 1.001).sum()), float(use.max())


def _use(
    way: np.ndarray, second: np.ndarray, third: np.ndarray, leg: Leg
) -> np.ndarray:
    """Greatest tilt and body rate of drones (n,), over their limits."""
    thrust = way * second[:, None]
    thrust[..., 2] += 9.80665
    turning = way * third[:, None]
    flown = attitude(thrust, turning, np.zeros_like(turning), 0.0)
    tilt = np.abs([flown.roll[0], flown.pitch[0]]).max(axis=(0, 2))
    rate = np.abs([flown.roll[1], flown.pitch[1]]).max(axis=(0, 2))
    return np.maximum(tilt / leg.limits.tilt, rate / leg.limits.body_rate[0])


def duration_law(way: np.ndarray, leg: Leg) -> float:
    """T = max(1.5 d / v, sqrt(6 d / a)) for the longest way [s]."""
    longest = float(np.linalg.norm(way, axis=1).max())
    pull = 9.80665 * math.tan(leg.limits.tilt)
    return max(
        1.5 * longest / leg.limits.velocity_max[0], math.sqrt(6 * longest / pull)
    )


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def tell(text: str) -> None:
    """Report progress."""
    sys.stderr.write(f"{text} (load {os.getloadavg()[0]:.1f})\n")
    sys.stderr.flush()


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay rows out as a Markdown table."""
    lines = ["| " + " | ".join(heads) + " |", "| --- " * len(heads) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def write(text: str) -> None:
    """Put the tables into their section of the documentation."""
    page = PAGE.read_text(encoding="utf-8")
    before, found, after = page.partition(TITLE)
    if not found:
        raise ValueError(f"{PAGE} has no section {TITLE.strip()!r}")
    _, mark, rest = after.partition("\n## ")
    PAGE.write_text(f"{before}{TITLE}\n{text}\n{mark}{rest}", encoding="utf-8")


def growth_line(rows: Sequence[Sequence[str]]) -> str:
    """Say with which power of the number of drones the processor time grows."""
    drones = np.array([float(row[0].split()[0].replace(",", "")) for row in rows])
    spent = np.array([float(row[3]) for row in rows])
    power = float(np.polyfit(np.log(drones), np.log(spent), 1)[0])
    return (
        f"Processor time grows with the number of drones to the power of {power:.2f}."
    )


def words(loads: Sequence[float]) -> str:
    """Say how busy the machine was when each show began, this benchmark included."""
    return f"load {min(loads):.1f} to {max(loads):.1f} as the shows began"


def main() -> None:
    """Print the tables."""
    shows = {**all_shows(), **growth()}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shows", nargs="*", help=f"of: {', '.join(shows)}")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    parser.add_argument(
        "--write", action="store_true", help="put the tables into the documentation"
    )
    arguments = parser.parse_args()
    if unknown := set(arguments.shows) - set(shows):
        parser.error(f"no such show: {', '.join(sorted(unknown))}")
    # As an installer leaves it: no compile pays for what is done once.
    compileall.compile_dir(ROOT / "showc", quiet=1)
    chosen = {key: shows[key] for key in arguments.shows or shows}
    rows: dict[str, list[Sequence[str]]] = {"whole": [], "leg": [], "note": []}
    grown: list[Sequence[str]] = []
    loads = []
    for key, show in chosen.items():
        loads.append(os.getloadavg()[0])
        tell(show.name)
        for kind, row in measured(show, arguments.jobs):
            tell("  " + " | ".join(row))
            rows[kind].append(row)
            if kind == "leg" and key in growth():
                grown.append(row)
    missing = sorted(set(shows) - set(chosen))
    text = "\n".join(
        [
            ABOUT,
            f"{arguments.jobs} processes; other work on the machine: {words(loads)}.\n",
            f"{table(HEADS, rows['leg'])}\n",
            table(WHOLE, rows["whole"]),
            *(f"\n- {note[0]}" for note in rows["note"]),
            *([f"\n{growth_line(grown)}"] if len(grown) > 1 else []),
            *([f"\nNot run: {', '.join(missing)}."] if missing else []),
        ]
    )
    say(text)
    if arguments.write:
        write(text)


if __name__ == "__main__":
    main()
