"""Loading: from a script's bytes to a show, or to everything that is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from showc.files import OutsideFolderError, UnreadableFileError, inside, read_file
from showc.processes import OutOfTimeError, processor_time
from showc.script.diagnostic import Diagnostic, Severity, Suppressed, position
from showc.script.files import TAKEN, InputFiles
from showc.script.language.document import (
    MAX_BYTES,
    MAX_FOUND,
    Mapping,
    Node,
    Scalar,
    parse_document,
)
from showc.script.language.fields import FORMAT_VERSION, SECTIONS
from showc.script.language.reader import Reader
from showc.script.language.scalars import tempo_of
from showc.script.language.wording import shortened
from showc.script.mark import Mark
from showc.script.show import Source
from showc.script.suppression import apply_suppressions

if TYPE_CHECKING:
    from collections.abc import Mapping as TypingMapping
    from collections.abc import Sequence

    from showc.script.show import Show

MAX_SECONDS = 30.0
"""Processor time that reading a script may take [s]: five times what a hundred texts of
a thousand drones need."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadResult:
    """What reading a script gave."""

    show: Show | None
    """The show; None if there is an error."""
    diagnostics: tuple[Diagnostic, ...]
    """Everything found, in order of place; what the script passes over left out."""
    suppressed: tuple[Suppressed, ...]
    """What the script passes over, with its reasons."""
    text: str
    """The script as text, for pointing at lines; empty if unreadable."""
    path: str
    """As the user gave it."""
    unreadable: bool
    """Whether it is no YAML at all, so that it says nothing."""
    draft: Show | None = None
    """The show as far as it could be built, errors or not: to look at, not to fly."""

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """The findings that keep this from being a show."""
        wanted = Severity.ERROR
        return tuple(item for item in self.diagnostics if item.severity is wanted)

    @property
    def warnings(self) -> tuple[Diagnostic, ...]:
        """The findings that only deserve a look."""
        wanted = Severity.WARNING
        return tuple(item for item in self.diagnostics if item.severity is wanted)

    def exit_code(self, *, strict: bool = False) -> int:
        """Return 0 if all is well, 1 for findings, 2 if the script is unreadable.

        Parameters
        ----------
        strict
            Whether warnings count.
        """
        if self.unreadable:
            return 2
        return 1 if self.errors or (strict and self.warnings) else 0


def load_show(path: str | Path, *, allow_outside: bool = False) -> LoadResult:
    """Read a script and every file it names.

    Parameters
    ----------
    path
        Of the script. A link in it must not lead out of the folder that the path
        itself names; for a relative path without ``..`` that is the working folder.
    allow_outside
        Whether links may lead elsewhere, and files lie elsewhere than in the script's
        folder.

    Returns
    -------
    LoadResult
        Never raises for a fault of the script or of its files.
    """
    name, place = str(path), Path(path)
    try:
        if not allow_outside:
            near = not place.is_absolute() and ".." not in place.parts
            inside(place, Path() if near else place.parent)
        content = read_file(place, MAX_BYTES)
    except UnreadableFileError as fault:
        linked = isinstance(fault, OutsideFolderError)
        reason = "a link leads out of its folder" if linked else fault.reason
        found = Diagnostic(
            "SHW010",
            f"`{name}` cannot be read: {reason}",
            None,
            help="allow scripts behind links with --allow-outside"
            if linked
            else "give the path of a show script",
        )
        return LoadResult(None, (found,), (), "", name, unreadable=True)
    return read_show(
        content, path=name, folder=place.parent, allow_outside=allow_outside
    )


def read_show(
    content: bytes,
    *,
    path: str = "<stdin>",
    folder: Path | None = None,
    allow_outside: bool = False,
    attached: TypingMapping[str, bytes] | None = None,
) -> LoadResult:
    """Read a script from its bytes.

    Parameters
    ----------
    content
        The script.
    path
        What to call it.
    folder
        Where the files are that it names; None: the working folder.
    allow_outside
        Whether files may lie elsewhere.
    attached
        All files that it may name, by name: then none is read from the disk.

    Returns
    -------
    LoadResult
        Never raises for a fault of the script or of its files.
    """
    try:
        with processor_time(MAX_SECONDS):
            files = InputFiles(
                folder or Path(), outside=allow_outside, attached=attached
            )
            return _read(content, path, files)
    except OutOfTimeError:
        mark = Mark(path, 1, 1, 1, 2)
        found = Diagnostic(
            "SHW119",
            f"reading the script takes more than {MAX_SECONDS:g} s of processor time",
            mark,
            help="use fewer places, formations or smaller files",
        )
        return LoadResult(None, (found,), (), "", path, unreadable=False)


def _read(content: bytes, path: str, files: InputFiles) -> LoadResult:
    root, text, found = parse_document(content, path)
    if root is None or _syntax(found) or not isinstance(root, Mapping):
        if not found:
            found = [_no_script(path, root)]
        return LoadResult(None, _bounded(found, path), (), text, path, unreadable=True)
    start = Mark(path, 1, 1, 1, 1 + len(text.split("\n", 1)[0].rstrip("\r")))
    show, more = _build(root, start, Source(path, content), files)
    found += more
    if (name := PurePath(path).name) in TAKEN:
        text = f"a script cannot be called `{name}`: its log has a file of its own of "
        found.append(Diagnostic("SHW109", f"{text}this name", start, help="rename it"))
    kept, suppressed = apply_suppressions(text, path, found)
    kept = _bounded(kept, path)
    wrong = any(item.severity is Severity.ERROR for item in kept)
    return LoadResult(
        None if wrong else show,
        kept,
        suppressed,
        text,
        path,
        unreadable=False,
        draft=show,
    )


def _bounded(found: Sequence[Diagnostic], path: str) -> tuple[Diagnostic, ...]:
    """Return findings in order of place: the first ones, errors before warnings.

    The last says so if there may be more.
    """
    if len(found) < MAX_FOUND:
        return tuple(sorted(found, key=position))
    chosen = sorted(found, key=lambda item: item.severity is not Severity.ERROR)
    chosen = chosen[:MAX_FOUND]
    more = Diagnostic(
        "SHW119",
        f"there are {MAX_FOUND} findings or more; the others are not shown",
        Mark(path, 1, 1, 1, 2),
        help="correct these first, and check again",
        severity=chosen[0].severity,
    )
    return (*sorted(chosen, key=position), more)


def _syntax(found: list[Diagnostic]) -> bool:
    """Tell whether the document could not be read as a whole."""
    return any(item.code in {"SHW001", "SHW002", "SHW003", "SHW008"} for item in found)


def _no_script(path: str, root: Node | None) -> Diagnostic:
    what = "is empty" if root is None else "is not a mapping of keys"
    mark = Mark(path, 1, 1, 1, 2)
    return Diagnostic(
        "SHW011",
        f"the script {what}",
        mark,
        help="start from the script that `showc init` writes",
    )


def _build(
    root: Mapping, start: Mark, source: Source, files: InputFiles
) -> tuple[Show | None, list[Diagnostic]]:
    reader = Reader(tempo_of(root))
    version = root.get("showc")
    if version is not None and isinstance(version.value, Scalar):
        number = version.value.text
        if number.isdecimal() and number != str(FORMAT_VERSION):
            # Nothing is known of the keys of another version.
            reader.say(
                "SHW108",
                f"the script has format version {shortened(number)}; this showc reads "
                f"version {FORMAT_VERSION}",
                version.value.mark,
                help_text="use the showc for which the script was written",
            )
            return None, reader.found
    settings = reader.section(SECTIONS["show"], root, start)
    # Building imports numpy; a script that cannot be read need not wait for it.
    from showc.script.rules.geometry import geometry_findings  # noqa: PLC0415
    from showc.script.rules.holds import motion_findings  # noqa: PLC0415
    from showc.script.rules.idle import idle_findings  # noqa: PLC0415
    from showc.script.rules.operations import operation_findings  # noqa: PLC0415
    from showc.script.rules.timing import (  # noqa: PLC0415
        limit_findings,
        loose_findings,
        time_findings,
        timing_findings,
    )
    from showc.script.sections.build import Builder  # noqa: PLC0415

    sketch = Builder(settings, files, reader).sketch(source)
    found = list(reader.found)
    found += geometry_findings(sketch)
    found += timing_findings(sketch)
    found += time_findings(sketch)
    found += loose_findings(sketch)
    found += motion_findings(sketch)
    found += limit_findings(sketch)
    found += operation_findings(sketch)
    found += idle_findings(sketch)
    return sketch.show, found
