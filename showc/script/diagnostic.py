"""The diagnostic: one finding about a script, with its place, numbers and remedy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from showc.script.mark import Mark


class Severity(StrEnum):
    """How bad a finding is."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Label:
    """A second place that has to do with the finding."""

    span: Mark
    """Where."""
    text: str
    """What it has to do with it."""


@dataclass(frozen=True, slots=True)
class Spot:
    """What a finding is about, in the picture."""

    formation: str
    """Name of a formation."""
    places: tuple[int, ...]
    """Its places, counting from 0."""


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One finding."""

    code: str
    """Stable code, ``SHW`` and three digits; never given to anything else later."""
    message: str
    """What is wrong, in one line without a full stop."""
    span: Mark | None
    """Where; None: in no particular place of the script."""
    label: str = ""
    """Short text that stands beside the carets."""
    secondary: tuple[Label, ...] = ()
    """Other places that have to do with it."""
    notes: tuple[str, ...] = ()
    """The numbers: values, limits, drones, times."""
    help: str = ""
    """What to do about it."""
    fix: str = ""
    """Text to put in place of the span's, where that is certain; else empty."""
    spot: Spot | None = None
    """What it is about, if that is places of one formation."""
    severity: Severity = Severity.ERROR
    """Whether the show can be used at all."""


class ScriptError(ValueError):
    """Something in a script is wrong, found where its place is not known.

    Parameters
    ----------
    code
        Code of the diagnostic.
    message
        What is wrong.
    key
        Key of the section at which it stands; empty: the value or section at hand.
    help_text
        What to do.
    fix
        Text to put in its place, if that is certain.
    notes
        The numbers.
    """

    def __init__(
        self,
        code: str,
        message: str,
        *,
        key: str = "",
        help_text: str = "",
        fix: str = "",
        notes: tuple[str, ...] = (),
    ) -> None:
        super().__init__(message)
        self.code, self.key, self.help = code, key, help_text
        self.fix, self.notes = fix, notes

    def of(self, what: str, code: str = "") -> ScriptError:
        """Return the same, said of a key or the like, under another code if asked."""
        return ScriptError(
            code or self.code, f"{what}: {self}", help_text=self.help, fix=self.fix
        )


def once(found: list[Diagnostic]) -> list[Diagnostic]:
    """Keep the first finding about a list, if all of them say the same.

    Findings that can be fixed are all kept: each has its own place.
    """
    alike = {(item.code, item.message, item.fix) for item in found}
    if len(found) < 2 or len(alike) > 1 or found[0].fix:
        return found
    note = f"{len(found)} elements of the list are like this"
    return [replace(found[0], notes=(*found[0].notes, note))]


@dataclass(frozen=True, slots=True)
class Suppressed:
    """A finding that the script asks to pass over."""

    diagnostic: Diagnostic
    """The finding."""
    reason: str
    """Why the script passes over it."""


def position(diagnostic: Diagnostic) -> tuple[str, int, int, str, str]:
    """Return what diagnostics are sorted by: file, line, column, code, message."""
    span = diagnostic.span
    if span is None:
        return "", 0, 0, diagnostic.code, diagnostic.message
    return span.path, span.line, span.column, diagnostic.code, diagnostic.message


def select_diagnostics(
    diagnostics: Iterable[Diagnostic],
    *,
    select: Iterable[str] = (),
    ignore: Iterable[str] = (),
    strict: bool = False,
) -> tuple[Diagnostic, ...]:
    """Keep the diagnostics a caller wants to see.

    Parameters
    ----------
    diagnostics
        What was found.
    select
        Codes, or beginnings of codes (``SHW3``), to keep; none: all.
    ignore
        Codes, or beginnings of codes, to leave out. Errors are never left out: a
        script that has one is not a show.
    strict
        Whether warnings become errors.
    """
    wanted, unwanted = tuple(select), tuple(ignore)
    kept = []
    for diagnostic in diagnostics:
        if diagnostic.severity is not Severity.ERROR:
            if wanted and not diagnostic.code.startswith(wanted):
                continue
            if unwanted and diagnostic.code.startswith(unwanted):
                continue
            if strict:
                kept.append(replace(diagnostic, severity=Severity.ERROR))
                continue
        kept.append(diagnostic)
    return tuple(kept)
