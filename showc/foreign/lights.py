"""Skybrush's light programs: bytecode to colours over time.

Durations and instants are variable-length whole numbers of frames of 20 ms. Colours are
linear light; a fade is linear in each channel.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

import numpy as np

from showc.errors import DamagedFileError
from showc.foreign.show import LightTrack

if TYPE_CHECKING:
    from collections.abc import Iterable

FRAME = 0.02
"""Length of a frame [s]: light programs count time in fiftieths of a second."""

END, NOP, SLEEP, WAIT_UNTIL, SET_COLOUR, SET_GREY, SET_BLACK, SET_WHITE = range(8)
"""Commands that last no time or a given one, by their number in Skybrush's bytecode."""
FADE_COLOUR, FADE_GREY, FADE_BLACK, FADE_WHITE = range(8, 12)
"""Commands that fade to a colour, in the order of those that set one."""
LOOP_BEGIN, LOOP_END, RESET_CLOCK, PYRO, PYRO_ALL = 12, 13, 14, 20, 21
"""Commands about the program itself, and two of pyrotechnics that carry a byte. Those
between, 16 to 19, are colours by channels of a transmitter, and jumps: refused."""

MOST_STEPS = 200_000
"""Commands after which a program is read no further: an hour at the frame rate."""

MOST_AT_ONCE = 100
"""Commands within one instant: a lamp shows the last of them, more only take time."""

MOST_COMMANDS = 2_000_000
"""Commands of all programs of a show that are played, whatever loops they have."""

_BYTES_EACH = 2
"""Length at least of a command that lasts [bytes]: its number and its duration."""

_DEEPEST = 4
"""Loops within loops that the firmware keeps."""


@dataclass(slots=True)
class Budget:
    """Commands that the programs of one show may have together."""

    most: int = MOST_COMMANDS
    """All of them."""
    spent: int = 0
    """Played so far."""

    @classmethod
    def of(cls, programs: Iterable[object]) -> Self:
        """Return that of a show: programs without loops never exceed it."""
        size = sum(len(one) for one in programs if isinstance(one, bytes))
        return cls(max(MOST_COMMANDS, size // _BYTES_EACH))


@dataclass(slots=True)
class _Loop:
    begin: int
    """Where its body begins [byte]."""
    left: int
    """Rounds after this one; -1 without end."""
    frame: int
    """When this round began."""


@dataclass(slots=True)
class _Player:
    """Runs one program."""

    program: bytes
    name: str
    until: int
    """Frame after which nothing is wanted."""
    budget: Budget
    """What the show's programs have left."""
    position: int = 0
    frame: int = 0
    times: list[int] = field(default_factory=lambda: [0])
    colours: list[tuple[int, int, int]] = field(default_factory=lambda: [(0, 0, 0)])
    loops: list[_Loop] = field(default_factory=list)
    steps: int = 0
    """Commands so far."""
    since: int = 0
    """Commands before those of this instant."""

    def _byte(self) -> int:
        if self.position >= len(self.program):
            raise DamagedFileError(
                f"{self.name}: the light program ends inside a command"
            )
        self.position += 1
        return self.program[self.position - 1]

    def _number(self) -> int:
        value = shift = 0
        while True:
            byte = self._byte()
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value
            if shift > 28:
                raise DamagedFileError(
                    f"{self.name}: byte {self.position} of the light program: a number "
                    "of more than 28 bits"
                )

    def _colour(self, command: int) -> tuple[int, int, int]:
        kind = command - (FADE_COLOUR if command >= FADE_COLOUR else SET_COLOUR)
        if kind == 0:
            return self._byte(), self._byte(), self._byte()
        level = {1: -1, 2: 0, 3: 255}[kind]
        level = self._byte() if level < 0 else level
        return level, level, level

    def _show(self, colour: tuple[int, int, int], fade: int) -> None:
        if self.times[-1] != self.frame:
            self.times.append(self.frame)
            self.colours.append(self.colours[-1])
        self.times.append(self.frame + fade)
        self.colours.append(colour)

    def run(self) -> None:
        """Play until the end, or until nothing more is wanted."""
        while (
            self.position < len(self.program)
            and self.frame <= self.until
            and self.steps < MOST_STEPS
        ):
            self.steps += 1
            before, command = self.frame, self._byte()
            if command == END:
                break
            self._step(command)
            if self.frame != before:
                self.since = self.steps
            elif self.steps - self.since > MOST_AT_ONCE:
                raise DamagedFileError(
                    f"{self.name}: byte {self.position - 1} of the light program: more "
                    f"than {MOST_AT_ONCE} commands at {self.frame * FRAME:g} s; export "
                    "the lights again, with one colour an instant"
                )
            if self.budget.spent + self.steps > self.budget.most:
                raise DamagedFileError(
                    f"{self.name}: the light programs up to this one have more than "
                    f"{self.budget.most:,} commands; export the lights again, with "
                    "fewer colours or shorter loops"
                )
        self.budget.spent += self.steps

    def _step(self, command: int) -> None:
        if SET_COLOUR <= command <= FADE_WHITE:
            colour, duration = self._colour(command), self._number()
            self._show(colour, duration if command >= FADE_COLOUR else 0)
            self.frame += duration
        elif command == SLEEP:
            self.frame += self._number()
        elif command == WAIT_UNTIL:
            self.frame = max(self.frame, self._number())
        elif command == LOOP_BEGIN:
            rounds = self._byte()
            if len(self.loops) >= _DEEPEST:
                raise DamagedFileError(
                    f"{self.name}: byte {self.position} of the light program: more than"
                    f" {_DEEPEST} loops within each other; the firmware keeps no more"
                )
            self.loops.append(_Loop(self.position, rounds - 1, self.frame))
        elif command == LOOP_END:
            self._again()
        elif command in {PYRO, PYRO_ALL}:
            self._byte()
        elif command not in {NOP, RESET_CLOCK}:
            raise DamagedFileError(
                f"{self.name}: byte {self.position - 1} of the light program: command "
                f"{command} is not known"
            )

    def _again(self) -> None:
        if not self.loops:
            raise DamagedFileError(
                f"{self.name}: byte {self.position - 1} of the light program: the end "
                "of a loop that does not begin"
            )
        loop = self.loops[-1]
        if loop.left == 0 or self.frame == loop.frame:
            # A round that takes no time would go on for ever within one instant.
            self.loops.pop()
            return
        loop.left = max(loop.left - 1, -1)
        loop.frame, self.position = self.frame, loop.begin


def read_lights(
    program: bytes, name: str, duration: float, budget: Budget | None = None
) -> LightTrack:
    """Colours that a program shows over ``duration`` [s].

    The ``budget`` is one for all programs of a show; None: this program has its own.

    Raises
    ------
    DamagedFileError
        If it is no program, or is beyond the budget; the message names the byte.
    """
    player = _Player(program, name, int(np.ceil(duration / FRAME)), budget or Budget())
    player.run()
    return LightTrack(
        np.array(player.times) * FRAME, np.array(player.colours, dtype=np.float64)
    )
