"""``showc export``: a solved show in the formats that other systems fly or draw."""

from __future__ import annotations

import sys
from math import floor
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import click

from showc.cli.options import FOLDER, Real, json_option, log_argument
from showc.script.language.wording import counted
from showc.script.show import Export
from showc.verify.report import figure

if TYPE_CHECKING:
    from showc.export.solved import SolvedShow
    from showc.export.stage import Exported
    from showc.verify.report import Check

FORMATS = (
    "skyc",
    "skyb",
    "skybrush-csv",
    "poly7",
    "crazyflie",
    "vviz",
    "gltf",
    "kml",
)


def written(log: Path, solved: SolvedShow, wish: Export, folder: Path) -> Exported:
    """Write a show in one format, proved as it was written."""
    from showc.export.stage import ExportOptions, export
    from showc.log.additions import digest_of

    source = {"log": log.name, "data_sha256": digest_of(log)}
    lead = ExportOptions.usual(wish.to).lead if wish.lead is None else wish.lead
    options = ExportOptions(round(lead, 3), wish.tolerance, wish.separation)
    return export(solved, source, wish.to, folder, options)


def _solved(log: Path) -> SolvedShow:
    """Read what there is to write."""
    from showc.export.solved import solved_show
    from showc.log.reader import read_log
    from showc.processes import give_back

    logged = read_log(log)
    # A script that this version cannot read leaves no room for drones that stray.
    solved = solved_show(logged, logged.read_script().show)
    del logged
    give_back()
    return solved


_NAMED = 3
"""Findings of an export that are said at once."""


def _found(check: Check) -> str:
    """Return what was found, where, and what to do about it, on one line."""
    said = f"{check.code} {check.name}{figure(check)}"
    if str(check.where):
        said += f", {check.where}"
    if check.code == "VRF504" and check.value:
        left = max(floor(100.0 * check.value) / 100.0, 0.0)
        return (
            f"{said}: give drones room to stray, or the export `separation: {left:g}`"
        )
    return f"{said}: {check.notes[-1]}" if check.notes and check.value else said


def write_wishes(log: Path, wishes: tuple[Export, ...]) -> tuple[list[str], bool]:
    """Write what a script asks for; return lines, and whether all is proved."""
    from showc.export.stage import folder_for

    solved = _solved(log)
    lines, proved = [], True
    for wish in wishes:
        folder = folder_for(log, wish.to)
        exported = written(log, solved, wish, folder)
        failed = [check for check in exported.checks if check.verdict == "fail"]
        said = f"{counted(len(failed), 'finding')}: showc verify {folder}"
        lines.append(f"  export    {folder}: {said if failed else 'proved'}")
        lines += [f"    {_found(check)}" for check in failed[:_NAMED]]
        proved = proved and exported.proved
    return lines, proved


@click.command(name="export")
@log_argument
@click.option(
    "--to",
    "form",
    type=click.Choice(FORMATS),
    required=True,
    help="Format to write.",
)
@click.option(
    "-o",
    "--output",
    "folder",
    type=FOLDER,
    metavar="FOLDER",
    help="Where to put the files.  [default: OUTPUT-FORMAT beside the log]",
)
@click.option(
    "--lead",
    type=Real(0.0, 600.0),
    metavar="SECONDS",
    help="Time for which the fleet stands before the show begins.  [default: 10 for "
    "skyc and skyb, else 0]",
)
@click.option(
    "--tolerance",
    type=Real(0.001, 1.0),
    metavar="METRES",
    default=0.01,
    help="Greatest deviation of the written flight from the solved one.  "
    "[default: 0.01]",
)
@click.option(
    "--separation",
    type=Real(0.0, 100.0),
    metavar="METRES",
    help="Distance that drones must keep in flight.  [default: the script's]",
)
@json_option
def command(
    log: Path,
    form: str,
    folder: Path | None,
    lead: float | None,
    tolerance: float,
    separation: float | None,
    as_json: bool,
) -> int:
    """Write a compiled show in a format of another system.

    \b
      skyc          Skybrush's compiled show, for Live, Viewer and the server
      skyb          Skybrush's binary files, one per drone, as its firmware reads them
      skybrush-csv  one table per drone, as Studio for Blender imports them
      poly7         polynomial pieces (Crazyswarm, uav_trajectories)
      crazyflie     compressed trajectories, as a Crazyflie's memory holds them
      vviz          Finale 3D, Depence, Verge
      gltf          an animated scene for renders
      kml           the site and the ways on a map

    The flights are fitted to the format's time grid, with a stated error. The written
    files are then read back and proved: separation, limits, volume, fence, what the
    firmware accepts, and whether show mode was measured to follow such a flight. The
    manifest export.json says what was proved; showc verify FOLDER proves it again.

    Exits with 0 if everything is proved, 1 if a check fails. The files are written in
    both cases, and their manifest gives the result.

    \b
      showc export output.mcap --to skyb
      showc export output.mcap --to skyc -o night-skyc
    """
    from showc.cli.console import colour_wanted
    from showc.cli.findings import render_text
    from showc.export.stage import folder_for
    from showc.foreign.folder import MANIFEST, MAPS
    from showc.verify.report import Verification

    solved = _solved(log)
    folder = folder or folder_for(log, form)
    exported = written(log, solved, Export(form, tolerance, separation, lead), folder)
    if as_json:
        click.echo((folder / MANIFEST).read_text(encoding="utf-8").rstrip("\n"))
        return 0 if exported.proved else 1
    if form in MAPS:
        click.echo(f"wrote {folder}: a drawing, nothing is flown by it")
        for lost in exported.written.lost:
            click.echo(f"cannot carry: {lost}")
        return 0
    result = Verification(
        str(folder),
        solved.rules.name,
        solved.drones,
        exported.written.duration,
        f"held against the rules of {log.name}",
        exported.checks,
    )
    colour = colour_wanted(sys.stdout)
    click.echo(render_text(result, colour=colour), color=colour)
    fit = ", ".join(f"{key} {value:g}" for key, value in exported.written.fit.items())
    click.echo(f"fit: {fit}" if fit else "as solved")
    for lost in exported.written.lost:
        click.echo(f"cannot carry: {lost}")
    click.echo(f"next: showc verify {quote(str(folder))}")
    return 0 if exported.proved else 1
