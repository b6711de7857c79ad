"""Layout: a script's indentation, spaces and blank lines made uniform.

Only the blanks between tokens change: every token and every comment stays as it was
written, on a line of its own if it had one. A formatter that reads and writes values
anew would lose comments in places, and the author's way of writing numbers.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import yaml

from showc.errors import UsageError
from showc.script.language.document import LOADER, Mapping, Node, Scalar, parse_document

STEP = 2
"""Columns of each level of indentation."""
_OPENING = (yaml.FlowSequenceStartToken, yaml.FlowMappingStartToken)
_CLOSING = (yaml.FlowSequenceEndToken, yaml.FlowMappingEndToken)
_TIGHT_BEFORE = (yaml.FlowEntryToken, yaml.ValueToken, *_CLOSING)
"""Tokens that follow the one before without a space."""
_BLOCKS = (yaml.BlockMappingStartToken, yaml.BlockSequenceStartToken)
_VALUES = (yaml.ScalarToken, yaml.AliasToken, yaml.AnchorToken, *_OPENING)
_BLOCK_STYLES = {"|", ">"}
_WITHOUT_TEXT = (
    *_BLOCKS,
    yaml.BlockEndToken,
    yaml.StreamStartToken,
    yaml.StreamEndToken,
)


def format_script(text: str) -> str:
    """Return a script with uniform layout, which says exactly the same.

    Parameters
    ----------
    text
        A script that :func:`parse_document` reads without a finding.

    Returns
    -------
    str
        Two columns a level. One space after colons, commas and dashes and before a
        comment behind a value, none inside brackets. At most one blank line together,
        lines ended by a line feed. Formatting it again changes nothing.

    Raises
    ------
    UsageError
        If the result did not say the same: line breaks within a value that are no line
        feeds (U+0085, U+2028) may do that.
    """
    text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    result = _Layout(text).result()
    if _said(text) != _said(result):
        raise UsageError(
            "its layout cannot be changed without changing what it says; look for "
            "unusual line breaks (U+0085, U+2028) in it"
        )
    return result


def _said(text: str) -> object:
    """Return what a script says, for comparison: no places, no comments."""
    root, _, _ = parse_document(text.encode(), "")
    return _values(root)


def _values(node: Node | None) -> object:
    match node:
        case Scalar():
            return node.text, node.plain
        case Mapping():
            return [(entry.key, _values(entry.value)) for entry in node]
        case None:
            return None
        case _:
            return [_values(item) for item in node.items]


@dataclass(slots=True)
class _Block:
    """A block of lines with a common indentation."""

    column: int
    """As written."""
    indent: int
    """As it will be."""
    kind: str
    """``mapping``, ``list``, or ``level``: a list no deeper than its key, which has
    no token of its own."""


@dataclass(slots=True)
class _Layout:
    """Writes the tokens of a script with other blanks between them."""

    text: str
    blocks: list[_Block] = field(default_factory=list)
    closed: list[_Block] = field(default_factory=list)
    """Blocks that have ended since the token before."""
    begun: bool = False
    """Whether a key or a block has begun since the token before."""
    depth: int = 0
    """Brackets that are open."""
    out: list[str] = field(default_factory=list)
    place: int = 0
    """How far the text is written."""
    last: Any = None
    """Token before."""

    def result(self) -> str:
        """Return the whole text."""
        for token in yaml.scan(self.text, Loader=LOADER):
            self._take(token)
        rest, written = self.text[self.place :], len(self.out)
        self._gap(len(self.text), 0, 0, None)
        whole = "".join(self.out).lstrip("\n")
        if len(self.out) == written and _in_block(self.last):
            # Line breaks at the end of the text may be part of its last value.
            return f"{whole}\n" if "\n" in rest else whole
        whole = whole.rstrip("\n")
        return f"{whole}\n" if whole else ""

    def _take(self, token: Any) -> None:  # noqa: ANN401 - of a library without types
        if isinstance(token, yaml.BlockEndToken):
            self._leave_level()
            self.closed.append(self.blocks.pop())
            return
        if isinstance(token, _BLOCKS):
            indent = self.blocks[-1].indent + STEP if self.blocks else 0
            mapping = isinstance(token, yaml.BlockMappingStartToken)
            kind = "mapping" if mapping else "list"
            self.begun = True
            self.blocks.append(_Block(token.start_mark.column, indent, kind))
            return
        if isinstance(token, yaml.KeyToken) and not self.depth:
            self._leave_level()
            self.begun = True
        start, end = token.start_mark.index, token.end_mark.index
        if isinstance(token, _WITHOUT_TEXT) or start == end:
            return
        column = token.start_mark.column
        block = self.blocks[-1] if self.blocks else _Block(0, 0, "mapping")
        if isinstance(token, yaml.BlockEntryToken) and block.kind == "mapping":
            self.blocks.append(_Block(column, block.indent + STEP, "level"))
        if isinstance(token, _CLOSING):
            self.depth -= 1
        base = self.blocks[-1].indent if self.blocks else 0
        if isinstance(token, _VALUES) and not (self.begun or self.depth):
            base += STEP  # a value on a line of its own
        self._gap(start, column, base + STEP * self.depth, token)
        raw = self.text[start:end]
        if _in_block(token):
            # The lines after it that are part of the token and not of its value.
            raw = raw.rstrip(" ") if "+" in raw.split("\n", 1)[0] else _ended(raw)
        self.out.append(self._written(token, raw))
        self.place, self.last = start + len(raw), token
        self.closed.clear()
        self.begun = False
        if isinstance(token, _OPENING):
            self.depth += 1

    def _leave_level(self) -> None:
        if self.blocks and self.blocks[-1].kind == "level":
            self.closed.append(self.blocks.pop())

    def _written(self, token: Any, raw: str) -> str:  # noqa: ANN401
        """Return a token's text, its further lines moved along with its block."""
        if "\n" not in raw:
            return raw
        lines = raw.split("\n")
        block = self.blocks[-1] if self.blocks else _Block(0, 0, "mapping")
        if token.style in _BLOCK_STYLES:
            shift = block.indent - block.column
            moved = [_shifted(line, shift) for line in lines[1:]]
        else:
            indent = " " * (block.indent + STEP * (self.depth + 1))
            bare = [line.strip(" \t") for line in lines[1:]]
            moved = [line and indent + line for line in bare]
        return "\n".join([lines[0].rstrip(" \t"), *moved])

    def _gap(self, end: int, column: int, indent: int, token: Any) -> None:  # noqa: ANN401
        """Write what stands between two tokens: blanks, line breaks, comments."""
        lines = self.text[self.place : end].split("\n")
        if self.out and not self.out[-1].endswith("\n"):
            trailing = lines[0].strip()
            if trailing:
                self.out.append(f" {trailing}")
            elif len(lines) == 1:
                if token is not None:
                    self.out.append(self._space(token))
                return
            lines = lines[1:]
        blank = 0
        for line in lines[:-1]:
            comment = line.strip()
            if not comment:
                blank += 1
                continue
            self._break(blank)
            blank = 0
            deep = self._comment_indent(len(line) - len(line.lstrip()), column, indent)
            self.out.append(" " * deep + comment)
        last = lines[-1].strip() if token is None and lines else ""
        if last:
            self._break(blank)
            deep = self._comment_indent(0, column, indent)
            self.out.append(" " * deep + last)
        if token is not None:
            self._break(blank)
            self.out.append(" " * indent)

    def _break(self, blank: int) -> None:
        """End a line, and leave one blank if there were some."""
        if not self.out:
            return
        if not self.out[-1].endswith("\n"):
            self.out.append("\n")
        if blank:
            self.out.append("\n")

    def _comment_indent(self, written: int, column: int, indent: int) -> int:
        """Return how deep a comment on a line of its own stands.

        It goes with the next token, or with the block around it that it was level with.
        """
        if written != column:
            for block in (*self.blocks, *self.closed):
                if block.column == written:
                    return block.indent
        return indent

    def _space(self, token: Any) -> str:  # noqa: ANN401
        """Return the blank between two tokens on one line."""
        if isinstance(self.last, (yaml.ValueToken, yaml.AliasToken)):
            return " "
        tight = isinstance(token, _TIGHT_BEFORE) or isinstance(self.last, _OPENING)
        return "" if tight else " "


def _in_block(token: Any) -> bool:  # noqa: ANN401 - of a library without types
    """Tell whether a token is a text of lines, after ``|`` or ``>``."""
    return isinstance(token, yaml.ScalarToken) and token.style in _BLOCK_STYLES


def _ended(raw: str) -> str:
    """Return a text of lines without the blank ones at its end."""
    return re.sub(r"(\n *)+\Z", "", raw)


def _shifted(line: str, shift: int) -> str:
    """Return a line further to the right, or to the left as far as it has blanks."""
    if not line.strip():
        return line[-shift:] if shift < 0 else line and " " * shift + line
    if shift >= 0:
        return " " * shift + line
    blanks = len(line) - len(line.lstrip(" "))
    return line[min(-shift, blanks) :]
