"""Options that several verbs have, and the kinds of values that they take."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from showc.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    Decorator = Callable[[Callable[..., int]], Callable[..., int]]

FILE = click.Path(dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)
SHOW = click.Path(path_type=Path)
"""A log, or a foreign show: a file or a folder."""

REPORTS = ("text", "json", "sarif", "github", "junit")
"""Formats of findings."""
_MOST = 10_000
"""Greatest number of a drone."""


class Real(click.FloatRange):
    """A finite number in a range."""

    name = "number"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Read it."""
        found = float(super().convert(value, param, ctx))
        if not isfinite(found):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return found


class Whole(click.IntRange):
    """A whole number in a range."""

    name = "whole number"


def given(*names: str, **more: Any) -> Decorator:
    """Return an option of which the help shows the default."""
    return click.option(*names, show_default=True, **more)


def flag(*names: str, text: str) -> Decorator:
    """Return an option without a value."""
    return click.option(*names, is_flag=True, help=text)


def output_option(metavar: str, text: str, **more: Any) -> Decorator:
    """Return the option that says where a result goes."""
    kind = {"type": FILE} | more
    return click.option("-o", "--output", metavar=metavar, help=text, **kind)


log_argument = click.argument("log", type=FILE, metavar="OUTPUT.mcap")
"""A log of showc's own."""
show_argument = click.argument("log", type=SHOW, metavar="OUTPUT.mcap|SHOW")
"""Such a log, or a foreign show."""
json_option = flag("--json", "as_json", text="Print the result as JSON.")
quiet_option = flag("-q", "--quiet", text="Print only the result, without progress.")
outside_option = flag(
    "--allow-outside",
    text="Also read files outside the script's folder, and follow links.",
)
cache_option = click.option(
    "--cache-dir",
    type=FOLDER,
    help="Folder for solved transitions.  [default: showc in the user's cache folder]",
)
jobs_option = click.option(
    "-j",
    "--jobs",
    type=Whole(min=1),
    metavar="N",
    help="Number of worker processes.  [default: one for each core]",
)


def report_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add the options that say how findings are printed, and where."""
    for option in (
        click.option(
            "--output",
            type=FILE,
            metavar="FILE",
            help="Write the findings to a file instead of standard output.",
        ),
        click.option(
            "--json", "style", flag_value="json", help="Short for --format json."
        ),
        click.option(
            "--format",
            "style",
            type=click.Choice(REPORTS),
            default="text",
            help="How to print the findings.  [default: text]",
        ),
    ):
        command = option(command)
    return command


class Written(click.ParamType[Any]):
    """A value that a function reads; its ValueError says what is wrong.

    Parameters
    ----------
    name
        Of what is written, for the help.
    read
        Takes the text.
    """

    def __init__(self, name: str, read: Callable[[str], object]) -> None:
        self.name, self._read = name, read

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Any:
        """Read it, unless that is done already."""
        if not isinstance(value, str):
            return value
        try:
            return self._read(value)
        except ValueError as fault:
            self.fail(str(fault), param, ctx)


def numbers(text: str) -> list[int]:
    """Read ``1-20,23`` as sorted drone numbers, counting from 1."""
    chosen: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        try:
            low, high = int(first), int(last if dash else first)
        except ValueError:
            low, high = 0, 0
        if not 1 <= low <= high <= _MOST:
            raise ValueError(
                f"{part!r} names no drones; give numbers from 1, such as 1-20,23"
            )
        chosen.update(range(low, high + 1))
    return sorted(chosen)


def connected(command: Callable[..., int]) -> Callable[..., int]:
    """Add the options of verbs that talk to vehicles: by which links, to which."""
    for option in (
        click.option(
            "--signing-key",
            type=click.Path(exists=True, dir_okay=False, path_type=Path),
            metavar="FILE",
            help="Sign all messages and accept only signed ones (MAVLink 2).  FILE "
            "contains 64 hexadecimal digits, or the passphrase of the vehicles.",
        ),
        click.option(
            "--drones",
            type=Written("drones", numbers),
            metavar="1-20,23",
            help="Only these drones.  [default: all of them]",
        ),
        click.option(
            "--systems",
            type=Written("systems", numbers),
            metavar="1-20",
            help="MAVLink system ids of these drones, in the same order, for fleets "
            "on several networks.  [default: the drones' numbers]",
        ),
        click.option(
            "--connect",
            "connections",
            multiple=True,
            required=True,
            metavar="udp:HOST:PORT",
            help="Link to the vehicles: udp: or udpin:HOST:PORT listens, "
            "udpout:HOST:PORT calls.  Can be repeated.",
        ),
    ):
        command = option(command)
    return command


def system_ids(
    drones: list[int] | None, systems: list[int] | None
) -> dict[int, int] | None:
    """Return the system ids of drones by their numbers; None: these are the ids.

    Raises
    ------
    UsageError
        If both are given, and not as many of one as of the other.
    """
    if systems is None:
        return None
    if drones is None:
        # All of them; how many these are, the show says.
        return dict(enumerate(systems, 1))
    if len(drones) != len(systems):
        raise UsageError(
            f"--systems has {len(systems)} ids, --drones {len(drones)} drones; "
            "give the same number of both, such as --drones 251-500 --systems 1-250"
        )
    return dict(zip(drones, systems, strict=True))
