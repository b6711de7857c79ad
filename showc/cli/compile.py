"""``showc compile``: a show script into missions and a trajectory log."""

from __future__ import annotations

import json
import sys
from datetime import UTC, datetime
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, Literal

import click

from showc.cli.console import columns
from showc.cli.options import (
    SHOW,
    Whole,
    Written,
    cache_option,
    flag,
    given,
    jobs_option,
    outside_option,
    quiet_option,
)

if TYPE_CHECKING:
    from showc.flight import LegFlight
    from showc.pipeline.compile import Compiled
    from showc.script import LoadResult


def utc(text: str) -> datetime:
    """Read a time with its zone, such as 2026-06-01T20:00:00Z."""
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        wanted = "2026-06-01T20:00:00Z"
        raise ValueError(f"{text!r} is no time; wanted one such as {wanted}") from None
    if time.microsecond:
        raise ValueError(f"{text!r} has a fraction of a second; use whole ones")
    if time.tzinfo is None:
        raise ValueError(
            f"{text!r} names no time zone; write {text}Z for UTC, or {text}+02:00 for "
            "two hours ahead of it"
        )
    return time.astimezone(UTC)


@click.command(name="compile")
@click.argument("script", metavar="SHOW.yaml")
@click.option(
    "-o",
    "--output",
    "log",
    default="output.mcap",
    type=SHOW,
    metavar="PATH.mcap",
    help="Where to put the log; missions and manifest go into the folder PATH/.  "
    "[default: output.mcap]",
)
@click.option(
    "--start",
    type=Written("time", utc),
    help="Time at which the missions begin, with its zone (2026-06-01T20:00:00Z, or "
    "22:00:00+02:00).  Without it they can begin at one minute of any hour.",
)
@click.option(
    "--start-minute",
    type=Whole(0, 59),
    metavar="MINUTE",
    help="This minute of the hour.  [default: mission.start_minute of the script]",
)
@click.option(
    "--autopilot",
    type=click.Choice(["ardupilot", "px4"]),
    help="Dialect of the missions.  [default: mission.autopilot of the script]",
)
@jobs_option
@click.option(
    "--cluster",
    metavar="tls://HOST:PORT",
    help="Solve on the workers of this Dask scheduler instead.",
)
@given(
    "--effort",
    type=Whole(0, 100),
    metavar="N",
    default=1,
    help="Effort for shorter times where drones are crowded; 0 for a draft.",
)
@flag("--no-cache", text="Solve everything again.")
@cache_option
@outside_option
@flag("--no-missions", text="Write only the log, to be flown by showc stream.")
@flag("--strict", text="Do not compile a script with warnings.")
@flag(
    "--json",
    "as_json",
    text="Print the result as JSON, and progress as lines of JSON.",
)
@quiet_option
def command(
    script: str,
    log: Path,
    start: datetime | None,
    start_minute: int | None,
    autopilot: Literal["ardupilot", "px4"] | None,
    jobs: int | None,
    cluster: str | None,
    effort: int,
    no_cache: bool,
    cache_dir: Path | None,
    allow_outside: bool,
    no_missions: bool,
    strict: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Solve a show script, and write missions and a trajectory log.

    Finds the fastest flight for every transition, within the aircraft's dynamics, the
    limits and the separation, and writes

    \b
      PATH.mcap                           trajectory log, exact and sampled
      PATH/manifest.json                  inputs, versions, hashes, and how good it is
      PATH/missions/drone_0001.waypoints  a mission for each drone

    If anything fails or is interrupted, the files of an earlier run stay as they are.
    Transitions that were solved before come from a cache.

    \b
      showc compile shows/grid.yaml
      showc compile my-show.yaml -o night.mcap --start 2026-06-01T20:00:00Z
    """
    from showc.cli.console import progress
    from showc.errors import UsageError
    from showc.export.stage import folder_for, refuse_foreign
    from showc.fleet.options import SolveOptions
    from showc.pipeline.compile import (
        CompileOptions,
        RejectedScriptError,
        compile_script,
    )

    if start is not None and start_minute is not None:
        raise UsageError("--start names the minute already; leave --start-minute out")
    solve = SolveOptions(
        effort=effort,
        jobs=jobs,
        cluster=cluster,
        cache=cache_dir,
        use_cache=not no_cache,
    )
    options = CompileOptions(
        solve=solve,
        start=start,
        start_minute=start_minute,
        autopilot=autopilot,
        missions=not no_missions,
        strict=strict,
        allow_outside=allow_outside,
    )

    def accepted(result: LoadResult) -> None:
        if result.diagnostics and not (quiet or as_json):
            report(result, as_json=False)
        # What is in the way of an export is said before anything is solved.
        for wish in result.show.exports if result.show is not None else ():
            refuse_foreign(folder_for(log, wish.to))

    try:
        with progress(quiet=quiet, as_json=as_json) as watcher:
            compiled = compile_script(script, log, options, watcher, accepted)
    except RejectedScriptError as rejected:
        report(rejected.result, as_json=as_json)
        return rejected.result.exit_code(strict=strict) or 1
    lines, proved = exports(compiled)
    if as_json:
        click.echo(json.dumps(summary(compiled), indent=1))
    else:
        click.echo("\n".join([table(compiled), *lines]))
    return 1 if compiled.refused or not proved else 0


def exports(compiled: Compiled) -> tuple[list[str], bool]:
    """Write the other formats that the script asks for, and say what came of it."""
    wishes = compiled.flight.itinerary.show.exports
    if not wishes:
        return [], True
    from showc.cli.export import write_wishes

    return write_wishes(compiled.log, wishes)


def report(result: LoadResult, *, as_json: bool) -> None:
    """Print what was found in a script: for people to standard error."""
    from showc.cli.console import colour_wanted
    from showc.script.render import render

    colour = not as_json and colour_wanted(sys.stderr)
    text = render(
        result.diagnostics,
        {result.path: result.text},
        "json" if as_json else "text",
        colour=colour,
    )
    click.echo(text.rstrip("\n"), err=not as_json, color=colour)


def summary(compiled: Compiled) -> dict[str, Any]:
    """Machine-readable result: the paths, and the manifest."""
    return {
        "log": str(compiled.log),
        "folder": str(compiled.folder),
        "manifest": compiled.manifest,
    }


def _row(flown: LegFlight, start: float, name: str) -> tuple[str, ...]:
    """Return the line of a leg or of a group's move."""
    certificate = flown.certificate
    least, bound = certificate.single_drone_minimum, certificate.dual_bound
    near = certificate.closest
    passing = certificate.statistics.get("passing_bound")
    pair = f", pair {passing:.3f} s" if passing is not None else ""
    return (
        name,
        f"{start:.3f} s",
        f"{flown.duration:.3f} s",
        f"{least:.3f} s{pair}" if least > 0.0 else "",
        _over(flown) if least > 0.0 else "",
        f"{bound:.3f} s" if bound > 0.0 else "",
        f"{near.drone_a + 1} and {near.drone_b + 1}: {near.distance:.2f} m"
        if near
        else "",
    )


def _over(flown: LegFlight) -> str:
    """Say how far above its least time a leg is, unless the script sets its time."""
    longer = flown.certificate.gap > _NEAR
    if longer and flown.leg.duration is not None:
        return "by script"
    return f"{100.0 * flown.certificate.gap:.2f} %"


_NEAR = 0.01
"""Gap up to which a time that the script sets is about the least one."""


def table(compiled: Compiled) -> str:
    """Lay the result out for people: a line a leg, and where everything lies."""
    from showc.script.language.wording import counted

    manifest = compiled.manifest
    music = compiled.flight.itinerary.show.music
    head, offset = ("starts", 0.0) if music is None else ("music time", music.offset)
    rows: list[tuple[str, ...]] = [
        ("leg", head, "takes", "minimum", "over", "bound", "closest pair")
    ]
    for flown, start in zip(compiled.flight.legs, compiled.flight.starts, strict=True):
        rows.append(_row(flown, float(start) - offset, flown.leg.name))
        # Moves of groups with times of their own, below the whole.
        rows += [
            _row(move, (move.leg.depart or 0.0) - offset, f"  {move.leg.name}")
            for move in flown.parts
        ]
    lines = columns(rows, (0, 6))
    minutes, seconds = divmod(manifest["duration"], 60.0)
    lines += [
        "",
        (
            f"{manifest['show']['name']}: {counted(manifest['drones'], 'drone')}, "
            f"{int(minutes)} min {seconds:.1f} s, "
            f"up to {manifest['greatest_height']:.1f} m high"
        ),
        f"  log       {compiled.log}",
        *(
            [f"  missions  {compiled.folder / 'missions'}"]
            if manifest["missions"]["files"]
            else []
        ),
        f"  manifest  {compiled.folder / 'manifest.json'}",
    ]
    notes = [one for one in compiled.warnings if one != compiled.refused]
    lines += [f"  note: {note}" for note in notes]
    if compiled.refused:
        lines.append(f"error: {compiled.refused}")
    log, site = quote(str(compiled.log)), compiled.flight.itinerary.show.site
    lines.append(f"next: showc verify {log}")
    if site.ceiling is not None or site.audience or site.buildings:
        lines.append(f"      showc safety {log} for ceiling, audience and buildings")
    return "\n".join(lines)
