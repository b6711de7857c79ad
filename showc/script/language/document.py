"""The document: a script's YAML as a tree in which everything knows its place.

The tree is built from libyaml's events and not from its nodes. So depth, size and
aliases are counted before anything grows, and a plain ``no`` or ``1:30`` is still the
text the author wrote when it is judged.
"""

from __future__ import annotations

import gc
import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import yaml

from showc.script.diagnostic import Diagnostic, Label
from showc.script.language.syntax import syntax_fault
from showc.script.mark import Mark

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.script.language.kinds import Plain

MAX_BYTES = 4_000_000
"""Largest script that is read [bytes]."""
MAX_NODES = 100_000
"""Most keys and values a script may have once its aliases are written out: twice what
ten thousand places take, in half a second."""
MAX_DEPTH = 40
"""Deepest nesting."""
MAX_FOUND = 100
"""Findings after which reading ends: more of them help to mend the first."""

_COLOUR_COMMENT = re.compile(r"[ \t]+(#[0-9a-fA-F]{3,8})\s*$")
LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True, slots=True)
class Scalar:
    """A single value, as written."""

    text: str
    """Its text, quotes taken away."""
    plain: bool
    """Whether it stands without quotes."""
    mark: Mark
    size: int = 1
    comment: str = ""
    """Colour such as ``#ff8800`` that YAML takes for a comment where it was to stand;
    then the mark is that of the comment."""


@dataclass(frozen=True, slots=True)
class Sequence:
    """A list of nodes."""

    items: tuple[Node, ...]
    mark: Mark
    size: int = 1


@dataclass(frozen=True, slots=True)
class Entry:
    """A key and its value."""

    key: str
    mark: Mark
    """Where the key stands."""
    value: Node


@dataclass(frozen=True, slots=True)
class Mapping:
    """Keys and values, in the order written, each key once."""

    entries: dict[str, Entry]
    """By their keys."""
    mark: Mark
    size: int = 1
    whole: bool = True
    """Whether all that the script has in it is here."""

    def get(self, key: str) -> Entry | None:
        """Return the entry of a key, if it is there."""
        return self.entries.get(key)

    def before(self, entry: Entry) -> Entry | None:
        """Return what stands before an entry, if anything does."""
        found = None
        for one in self:
            if one is entry:
                return found
            found = one
        return None

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries.values())


Node = Scalar | Sequence | Mapping


def as_node(value: Plain, mark: Mark) -> Node:
    """Return a default of the field table as the node a script would give."""
    if isinstance(value, dict):
        entries = {
            key: Entry(key, mark, as_node(item, mark)) for key, item in value.items()
        }
        return Mapping(entries, mark)
    if isinstance(value, list):
        return Sequence(tuple(as_node(item, mark) for item in value), mark)
    if isinstance(value, bool):
        return Scalar("true" if value else "false", plain=True, mark=mark)
    return Scalar(str(value), plain=True, mark=mark)


@dataclass(slots=True)
class _Frame:
    """A collection that is still open."""

    mapping: bool
    mark: Mark
    anchor: str | None
    key: tuple[str, Mark] | None = None
    items: list[Node] = field(default_factory=list)
    entries: dict[str, Entry] = field(default_factory=dict)
    skipping: bool = False
    size: int = 1
    whole: bool = True


class _RefusedError(Exception):
    """Reading cannot go on."""


def parse_document(
    content: bytes, path: str
) -> tuple[Node | None, str, list[Diagnostic]]:
    """Parse a script.

    Parameters
    ----------
    content
        The file's bytes.
    path
        Its path as the user gave it, for the marks.

    Returns
    -------
    tuple
        The root of the tree, or None if there is none to be had; the text, in which
        bytes that are not UTF-8 are replaced; what was found, codes SHW001 to SHW011.
    """
    text, found = _decode(content, path)
    found += _tabs(text, path)
    if found:
        return None, text, found
    builder = _Builder(path)
    root = builder.build(text)
    return root, text, builder.found


def _decode(content: bytes, path: str) -> tuple[str, list[Diagnostic]]:
    if len(content) > MAX_BYTES:
        message = f"the script has {len(content)} bytes; at most {MAX_BYTES} are read"
        return "", [
            Diagnostic(
                "SHW008",
                message,
                Mark(path, 1, 1, 1, 2),
                help="put long lists of points into CSV files",
            )
        ]
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        before = content[: fault.start].decode("utf-8")
        line = before.count("\n") + 1
        column = len(before) - (before.rfind("\n") + 1) + 1
        found = Diagnostic(
            "SHW003",
            f"byte {content[fault.start]:#04x} at offset {fault.start} is not UTF-8",
            Mark(path, line, column, line, column + 1),
            help="save the script as UTF-8",
        )
        return content.decode("utf-8", errors="replace"), [found]
    return text, []


def _tabs(text: str, path: str) -> list[Diagnostic]:
    if "\t" not in text:
        return []
    found: list[Diagnostic] = []
    for number, line in enumerate(text.split("\n"), start=1):
        indent = line[: len(line) - len(line.lstrip())]
        if "\t" in indent and line.strip():
            if len(found) == MAX_FOUND:
                break
            column = indent.index("\t") + 1
            found.append(
                Diagnostic(
                    "SHW002",
                    "a tab in the indentation",
                    Mark(path, number, column, number, len(indent) + 1),
                    help="indent with spaces; YAML forbids tabs there",
                )
            )
    return found


class _Builder:
    """Turns events into the tree."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.found: list[Diagnostic] = []
        self.anchors: dict[str, Node | None] = {}
        self.frames: list[_Frame] = []
        self.root: Node | None = None
        self.documents = 0
        self.total = 0
        self.lines: list[str] = []

    def build(self, text: str) -> Node | None:
        """Read all events; return the root, or None if reading cannot go on."""
        # A tree has no cycles, and looking for some takes as long as the reading.
        self.lines = text.split("\n")
        collecting = gc.isenabled()
        gc.disable()
        try:
            return self._built(text)
        finally:
            if collecting:
                gc.enable()

    def _built(self, text: str) -> Node | None:
        try:
            for event in yaml.parse(text, Loader=LOADER):
                self._take(event)
                if len(self.found) >= MAX_FOUND:
                    return None
        except _RefusedError:
            return None
        except yaml.MarkedYAMLError as fault:
            self.found.append(syntax_fault(fault, self.lines, self.path))
            return None
        except yaml.reader.ReaderError as fault:
            # An index of libyaml's, a sign of the pure reader's.
            sign = fault.character
            code = sign if isinstance(sign, int) else ord(str(sign)[0])
            line = text.count("\n", 0, fault.position) + 1
            column = fault.position - text.rfind("\n", 0, fault.position)
            self._say(
                "SHW001",
                f"a control character (code {code:#04x})",
                Mark(self.path, line, column, line, column + 1),
                help="remove it",
            )
            return None
        return self.root

    def _say(self, code: str, message: str, span: Mark, **more: Any) -> None:  # noqa: ANN401
        self.found.append(Diagnostic(code, message, span, **more))

    def _mark(self, event: yaml.Event) -> Mark:
        start: Any = event.start_mark
        end: Any = event.end_mark
        return Mark(
            self.path, start.line + 1, start.column + 1, end.line + 1, end.column + 1
        )

    def _take(self, event: yaml.Event) -> None:
        match event:
            case yaml.ScalarEvent():
                self._scalar(event)
            case yaml.AliasEvent():
                self._alias(event)
            case yaml.SequenceStartEvent() | yaml.MappingStartEvent():
                self._open(event)
            case yaml.SequenceEndEvent() | yaml.MappingEndEvent():
                self._close(event)
            case yaml.DocumentStartEvent():
                self.documents += 1
                if self.documents > 1:
                    self._say(
                        "SHW009",
                        "a second YAML document in one file",
                        self._mark(event),
                        help="one file holds one show: remove the `---`",
                    )
                    raise _RefusedError
            case _:
                pass

    def _scalar(self, event: yaml.ScalarEvent) -> None:
        mark = self._mark(event)
        self._tag(event.tag, mark)
        frame = self.frames[-1] if self.frames else None
        if frame is not None and frame.mapping and frame.key is None:
            self._spend(1, mark)
            frame.size += 1
            self._key(frame, event.value, mark)
            return
        node = Scalar(event.value, event.implicit[0] and not event.style, mark)
        if not event.value and node.plain:
            node = self._commented(node)
        self._place(node, event.anchor)

    def _commented(self, node: Scalar) -> Scalar:
        """Return an empty value with the colour behind it that is a comment, if any."""
        mark = node.mark
        line = self.lines[mark.line - 1] if mark.line <= len(self.lines) else ""
        found = _COLOUR_COMMENT.match(line, mark.column - 1)
        if found is None:
            return node
        start, end = (found.start(1) + 1, found.end(1) + 1)
        span = replace(mark, column=start, end_line=mark.line, end_column=end)
        return replace(node, mark=span, comment=found.group(1))

    def _tag(self, tag: str | None, mark: Mark) -> None:
        if tag is not None:
            self._say(
                "SHW009",
                f"the YAML tag `{tag.replace('tag:yaml.org,2002:', '!!')}`",
                mark,
                help="remove it: scripts hold plain text, numbers, lists and keys",
            )

    def _key(self, frame: _Frame, key: str, mark: Mark) -> None:
        frame.key = (key, mark)
        frame.skipping = key in frame.entries or key == "<<"
        if key == "<<":
            frame.whole = False
            self._say(
                "SHW009",
                "the YAML merge key `<<`",
                mark,
                help="write the keys out; for formations there is `like:`",
            )
        elif frame.skipping:
            first = frame.entries[key].mark
            self._say(
                "SHW004",
                f"the key `{key}` stands twice",
                mark,
                secondary=(Label(first, "first here"),),
                help="keep one of them",
            )

    def _alias(self, event: yaml.AliasEvent) -> None:
        mark = self._mark(event)
        name = event.anchor
        frame = self.frames[-1] if self.frames else None
        if frame is not None and frame.mapping and frame.key is None:
            self._say("SHW009", "a key that is an alias", mark, help="use a word")
            raise _RefusedError
        if name not in self.anchors:
            self._say("SHW001", f"the alias `*{name}` names nothing before it", mark)
            raise _RefusedError
        node = self.anchors[name]
        if node is None:
            self._say(
                "SHW009",
                f"the alias `*{name}` stands inside what it names",
                mark,
                help="write the value out",
            )
            raise _RefusedError
        self._spend(node.size, mark)
        self._place(node, None, counted=True)

    def _spend(self, size: int, mark: Mark) -> None:
        """Take keys and values from what a script may have."""
        self.total += size
        if self.total > MAX_NODES:
            self._say(
                "SHW008",
                f"more than {MAX_NODES} keys and values, with aliases written out",
                mark,
                help="put long lists of points into CSV files",
            )
            raise _RefusedError

    def _open(self, event: yaml.CollectionStartEvent) -> None:
        mark = self._mark(event)
        self._tag(event.tag, mark)
        mapping = isinstance(event, yaml.MappingStartEvent)
        frame = self.frames[-1] if self.frames else None
        if frame is not None and frame.mapping and frame.key is None:
            self._say(
                "SHW009", "a key that is a list or a mapping", mark, help="use a word"
            )
            raise _RefusedError
        if len(self.frames) >= MAX_DEPTH:
            self._say(
                "SHW008", f"nested more than {MAX_DEPTH} deep", mark, help="flatten it"
            )
            raise _RefusedError
        if event.anchor is not None:
            self.anchors[event.anchor] = None
        self.frames.append(_Frame(mapping, mark, event.anchor))

    def _close(self, event: yaml.Event) -> None:
        frame = self.frames.pop()
        start = frame.mark
        stop = self._mark(event)
        span = Mark(
            start.path, start.line, start.column, stop.end_line, stop.end_column
        )
        node: Node
        if frame.mapping:
            node = Mapping(frame.entries, span, frame.size, frame.whole)
        else:
            node = Sequence(tuple(frame.items), span, frame.size)
        self._place(node, frame.anchor)

    def _place(self, node: Node, anchor: str | None, *, counted: bool = False) -> None:
        if not counted:
            self._spend(1, node.mark)
        if anchor is not None:
            self.anchors[anchor] = node
        if not self.frames:
            self.root = node
            return
        frame = self.frames[-1]
        frame.size += node.size
        if not frame.mapping:
            frame.items.append(node)
            return
        assert frame.key is not None  # noqa: S101 - the parser pairs keys and values
        key, mark = frame.key
        if not frame.skipping:
            frame.entries[key] = Entry(key, mark, node)
        frame.key = None
