"""Lights as programs: colours that fade evenly between instants, and their bytecode.

A drone's sampled light is written with the fewest fades that a single pass finds: from
each instant the fade goes on as long as one straight line in every channel passes all
samples within a tolerance (the swing filter; Elmeleegy et al. 2009, Online piece-wise
linear approximation of numerical streams with precision guarantees).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.foreign.lights import (
    END,
    FADE_BLACK,
    FADE_COLOUR,
    FADE_GREY,
    FADE_WHITE,
    FRAME,
    SET_BLACK,
    SET_COLOUR,
    SET_GREY,
    SET_WHITE,
    SLEEP,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import ByteArray, FloatArray, IntArray


TOLERANCE = 4.0
"""Greatest difference of a channel, of 255, that a fade may have from the samples: no
eye sees 1.6 % on a moving lamp."""


@dataclass(frozen=True, slots=True, eq=False)
class LightNodes:
    """The light of one drone: colours at frames, fading evenly in between."""

    frames: IntArray
    """Increasing, in frames of 20 ms, shape (n,)."""
    colours: ByteArray
    """Linear light, shape (n, 3)."""


def light_nodes(
    times: FloatArray, lights: ByteArray, lead: float
) -> tuple[LightNodes, ...]:
    """Find the fades of all drones.

    Parameters
    ----------
    times
        When lights were sampled, increasing, shape (T,) [s].
    lights
        Linear light, shape (T, drones, 3).
    lead
        How much later everything happens [s].

    Returns
    -------
    tuple of LightNodes
        One for each drone; the last node is at the last sample.
    """
    frame = np.rint((times + lead) / FRAME).astype(np.int64)
    keep = np.append(np.diff(frame) > 0, True)
    frame, lights = frame[keep], lights[keep]
    drones = lights.shape[1]
    chosen: list[list[tuple[int, ByteArray]]] = [[] for _ in range(drones)]
    begin = np.full(drones, frame[0], dtype=np.float64)
    colour = lights[0].astype(np.float64)
    for drone in range(drones):
        chosen[drone].append((int(frame[0]), lights[0, drone].copy()))
    low = np.full((drones, 3), -np.inf)
    high = np.full((drones, 3), np.inf)
    for step in range(1, frame.size):
        now = lights[step].astype(np.float64)
        since = (frame[step] - begin)[:, None]
        lower = np.maximum(low, (now - TOLERANCE - colour) / since)
        upper = np.minimum(high, (now + TOLERANCE - colour) / since)
        # The line must also meet the sample itself where it ends.
        slope = (now - colour) / since
        broken = ((slope < low - 1e-12) | (slope > high + 1e-12)).any(axis=1)
        for drone in np.flatnonzero(broken).tolist():
            node = int(frame[step - 1]), lights[step - 1, drone].copy()
            chosen[drone].append(node)
            begin[drone] = node[0]
            colour[drone] = node[1]
            span = float(frame[step] - node[0])
            lower[drone] = (now[drone] - TOLERANCE - colour[drone]) / span
            upper[drone] = (now[drone] + TOLERANCE - colour[drone]) / span
        low, high = lower, upper
    result = []
    for drone, nodes in enumerate(chosen):
        if nodes[-1][0] != frame[-1]:
            nodes.append((int(frame[-1]), lights[-1, drone].copy()))
        result.append(
            LightNodes(
                np.array([node[0] for node in nodes]),
                np.array([node[1] for node in nodes], dtype=np.uint8),
            )
        )
    return tuple(result)


def bytecode(nodes: LightNodes) -> bytes:
    """Return the program that shows these colours, dark before the first."""
    program = bytearray()
    first = int(nodes.frames[0])
    if first:
        program += _command(SET_COLOUR, (0, 0, 0), first)
    shown = (0, 0, 0)
    for begin, end, before, after in _spans(nodes):
        if before != shown:
            program += _command(SET_COLOUR, before, 0)
        if after == before:
            program += bytes([SLEEP]) + varuint(end - begin)
        else:
            program += _command(FADE_COLOUR, after, end - begin)
        shown = after
    # A player that is asked beyond a fade goes on fading: the end is a plain colour.
    program += _command(SET_COLOUR, (0, 0, 0), 1)
    program.append(END)
    return bytes(program)


Colour = tuple[int, int, int]


def _spans(nodes: LightNodes) -> Iterator[tuple[int, int, Colour, Colour]]:
    """Start, end, and the two colours of each fade; equal neighbours are joined."""
    frames = nodes.frames.tolist()
    colours = [tuple(colour) for colour in nodes.colours.tolist()]
    begin = 0
    for index in range(1, len(frames)):
        still = index + 1 < len(frames) and (
            colours[index + 1] == colours[index] == colours[begin]
        )
        if not still:
            yield frames[begin], frames[index], colours[begin], colours[index]
            begin = index


def _command(family: int, colour: Colour, duration: int) -> bytes:
    """Shortest command that sets or fades to ``colour``; ``family`` is the general."""
    grey, black, white = (
        (SET_GREY, SET_BLACK, SET_WHITE)
        if family == SET_COLOUR
        else (FADE_GREY, FADE_BLACK, FADE_WHITE)
    )
    if colour == (0, 0, 0):
        head = bytes([black])
    elif colour == (255, 255, 255):
        head = bytes([white])
    elif colour[0] == colour[1] == colour[2]:
        head = bytes([grey, colour[0]])
    else:
        head = bytes([family, *colour])
    return head + varuint(duration)


def varuint(value: int) -> bytes:
    """Whole number in groups of seven bits, the lowest first."""
    result = bytearray()
    while value > 0x7F:
        result.append(value & 0x7F | 0x80)
        value >>= 7
    result.append(value)
    return bytes(result)
