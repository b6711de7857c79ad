"""What can go wrong, by the person that can act on it.

A :class:`ShowError` is for the user to fix: the command line prints its message,
never a traceback, and ends with its ``exit_code``. Anything else that escapes is
a fault of showc itself; the command line says so and leaves a report file.

Exit codes: 0 fine; 1 findings (a rule of the show is broken, a transition has no
solution, verification failed); 2 wrong usage, unreadable or damaged input.
"""

from __future__ import annotations

from typing import ClassVar


class ShowError(Exception):
    """Base of every fault that a user can fix.

    The message says what was found, what was wanted, where, and what to do.
    """

    exit_code: ClassVar[int] = 1


class UsageError(ShowError):
    """The command was called wrongly, or a file cannot be read or written."""

    exit_code: ClassVar[int] = 2


class DamagedFileError(ShowError):
    """A file is not what it claims to be; the message names the byte offset."""

    exit_code: ClassVar[int] = 2


class PlanError(ShowError):
    """A script that is well formed describes a show that cannot be flown."""


class SolveError(ShowError):
    """A transition has no solution under its limits.

    The message names the transition, the drone or pair, the constraint, and the
    time it would need.
    """


class ExportError(ShowError):
    """A result does not fit the format it is to be written in."""


def printable(text: str) -> str:
    """Return a text in which no sign steers a terminal or turns its direction round.

    Each such sign is replaced by one of the same width; line ends stay.
    """
    if text.isprintable():
        return text
    return "".join(
        sign if sign.isprintable() or sign == "\n" else "\N{REPLACEMENT CHARACTER}"
        for sign in text
    )


def escaped(text: str) -> str:
    """Return text in which nothing can move a cursor, end a line or hide.

    Whatever is not printable (control characters, line ends, marks of direction) is
    written as a backslash and its number.
    """
    return "".join(
        letter
        if letter.isprintable()
        else letter.encode("unicode_escape", "backslashreplace").decode("ascii")
        for letter in text
    )
