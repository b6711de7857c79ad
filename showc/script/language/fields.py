"""The field table: every key of a script, its unit, range, default and meaning.

The table lies in ``fields.toml``, and the keys of each type of formation in its own
module. The reader, ``schemas/show.schema.json`` and the reference in the documents are
all made from it.
"""

from __future__ import annotations

import tomllib
from importlib import resources
from typing import Any

from showc.script.formations import SHAPES
from showc.script.language import kinds
from showc.vehicle.presets import PRESETS

FORMAT_VERSION = 1
"""Version of the script format that this reader understands."""

BOARDS = {
    "4k": 161,
    "8k": 303,
    "15k": 303,
    "16k": 650,
    "32k": 1306,
    "f4": 303,
    "f405": 303,
    "pixhawk": 650,
    "cube": 650,
    "fmuv3": 650,
    "sitl": 650,
    "h743": 1306,
}
"""Autopilot boards, and the items with home that fit: ArduPilot keeps 15 bytes of each,
less 4 bytes."""

_WORDS = {"presets": PRESETS, "shapes": SHAPES, "boards": BOARDS}
"""Choices whose words are the names of what other tables hold."""
_PLAIN: dict[str, kinds.Kind] = {
    "flag": kinds.Flag(),
    "moment": kinds.Moment(),
    "time": kinds.Time(),
    "colour": kinds.Paint(),
}


class _Sections:
    """Builds the sections of the table, each once, those within it first."""

    def __init__(self, table: dict[str, Any]) -> None:
        self.named = table.pop("kinds")
        self.table = table
        self.built: dict[str, kinds.Section | None] = {}

    def section(self, name: str) -> kinds.Section | kinds.Named:
        """Return a section; inside itself, its name."""
        if name not in self.built:
            self.built[name] = None
            said = self.table[name]
            keys = said.pop("keys")
            if "one_of" in said:
                said["one_of"] = tuple(said["one_of"])
            if "tag" in said:
                said["variants"] = tuple(shape.section for shape in SHAPES.values())
            fields = tuple(self.field(key, **entry) for key, entry in keys.items())
            self.built[name] = kinds.Section(name, fields=fields, **said)
        return self.built[name] or kinds.Named(name)

    def field(self, key: str, kind: str | dict[str, Any], **said: Any) -> kinds.Field:  # noqa: ANN401 - as the table says it
        """Return a key of a section."""
        found = self.kind(kind)
        if isinstance(found, kinds.Section):
            said.setdefault("description", found.description)
        said["examples"] = tuple(said.get("examples", ()))
        return kinds.Field(key, found, **said)

    def kind(self, said: str | dict[str, Any]) -> kinds.Kind:  # noqa: C901, PLR0911 - one case a kind
        """Return a kind, by its name or as the table describes it."""
        if isinstance(said, str):
            return _PLAIN[said] if said in _PLAIN else self.kind(self.named[said])
        match said:
            case {"unit": unit}:
                low = said.get("above", said.get("from"))
                return kinds.Quantity(
                    unit,
                    None if low is None else float(low),
                    float(said["to"]) if "to" in said else None,
                    positive="above" in said,
                    store=said.get("store", ""),
                )
            case {"whole": [least, most]}:
                return kinds.Integer(least, most)
            case {"words": words}:
                return kinds.Choice(
                    tuple(_WORDS[words] if isinstance(words, str) else words)
                )
            case {"text": length}:
                return kinds.Text(length, said.get("pattern", ""), said.get("says", ""))
            case {"list": item}:
                return kinds.Items(self.kind(item), *said.get("of", ()))
            case {"either": options}:
                return kinds.Either(tuple(self.kind(one) for one in options))
            case {"file": endings}:
                return kinds.File(tuple(endings))
            case {"name_of": what}:
                return kinds.Reference(what)
            case {"table": item, "of": what}:
                return kinds.Table(self.kind(item), what)
            case {"section": name}:
                return self.section(name)
            case _:
                raise TypeError(f"there is no kind {said!r}")


def _sections() -> dict[str, kinds.Section]:
    """Return every section by its name."""
    text = resources.files(__package__).joinpath("fields.toml").read_text("utf-8")
    read = _Sections(tomllib.loads(text))
    for name in list(read.table):
        read.section(name)
    return {name: one for name, one in read.built.items() if one is not None}


SECTIONS = _sections()
"""Every section of a script by its name; types of formations are variants of one."""


def resolve(kind: kinds.Kind) -> kinds.Kind:
    """Return the section a name stands for; other kinds as they are."""
    return SECTIONS[kind.name] if isinstance(kind, kinds.Named) else kind
