"""Options of the commands that talk to vehicles: over which links, to which of them."""

from __future__ import annotations

from pathlib import Path

import click

_MOST = 10_000
"""Greatest number of a drone."""


def numbers(
    context: click.Context, option: click.Parameter, value: str | None
) -> list[int] | None:
    """Parse ``1-20,23`` into sorted drone numbers, counting from 1."""
    if value is None:
        return None
    chosen: set[int] = set()
    for part in value.split(","):
        first, dash, last = part.strip().partition("-")
        try:
            low, high = int(first), int(last if dash else first)
        except ValueError:
            low, high = 0, 0
        if not 1 <= low <= high <= _MOST:
            raise click.BadParameter(
                f"{part!r} names no drones; give numbers from 1, such as 1-20,23",
                context,
                option,
            )
        chosen.update(range(low, high + 1))
    return sorted(chosen)


connect_option = click.option(
    "--connect",
    "connections",
    multiple=True,
    required=True,
    metavar="udp:HOST:PORT",
    help="Link to the vehicles: udp: or udpin:HOST:PORT listens, udpout:HOST:PORT "
    "calls.  May be given more than once.",
)
"""Links, one or more."""

drones_option = click.option(
    "--drones",
    callback=numbers,
    metavar="1-20,23",
    help="Only these drones.  [default: all of them]",
)
"""A part of the fleet."""

signing_key_option = click.option(
    "--signing-key",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Sign all messages and heed only signed ones (MAVLink 2).  FILE holds 64 "
    "hexadecimal digits, or the passphrase given to the vehicles.",
)
"""The key that ground station and vehicles share."""
