"""The JSON Schema of show scripts (draft-07), made from the field table.

What an editor checks with it is what showc checks, except for what only the whole
script can tell: spacing, names of formations, numbers of places.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

from showc.script.language import kinds
from showc.script.language.colours import COLOUR_NAMES
from showc.script.language.fields import SECTIONS
from showc.script.language.instants import LENGTH
from showc.script.language.quantity import NUMBER, units_of
from showc.script.language.wording import range_text, wanted_text

if TYPE_CHECKING:
    from collections.abc import Iterable

Schema = dict[str, object]

_FORMATION = SECTIONS["formation"]

SCHEMA_ID = "urn:showc:show-script:1"
"""Name of the schema, with the version of the script format."""


def schema_text() -> str:
    """Return what stands in ``schemas/show.schema.json``."""
    return json.dumps(show_schema(), indent=2, ensure_ascii=False) + "\n"


def show_schema() -> Schema:
    """Return the schema as what JSON can hold."""
    definitions: dict[str, Schema] = {}
    root = _object(SECTIONS["show"], definitions)
    definitions["formation"] = _formation(definitions)
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "$id": SCHEMA_ID,
        "title": "showc show script",
        **root,
        "definitions": dict(sorted(definitions.items())),
    }


def _object(section: kinds.Section, definitions: dict[str, Schema]) -> Schema:
    """Return the schema of a section as a mapping."""
    schema: Schema = {
        "description": section.description,
        "type": "object",
        "properties": {
            field.key: _property(field, definitions) for field in section.fields
        },
        "additionalProperties": False,
    }
    required = [field.key for field in section.fields if field.required]
    if required:
        schema["required"] = required
    if section.one_of:
        schema["oneOf"] = [{"required": [key]} for key in section.one_of]
    return schema


def _formation(definitions: dict[str, Schema]) -> Schema:
    """Return the schema of a formation: one alternative for each type, like, parts.

    And a bare name, which is short for ``like``.
    """
    common = {
        field.key: _property(field, definitions)
        for field in _FORMATION.fields
        if field.key not in _FORMATION.one_of
    }
    alternatives: list[Schema] = []
    for variant in _FORMATION.variants:
        own = {field.key: _property(field, definitions) for field in variant.fields}
        needed = [field.key for field in variant.fields if field.required]
        alternatives.append(
            {
                "title": variant.name,
                "description": variant.description,
                "type": "object",
                "properties": {"type": {"const": variant.name}, **own, **common},
                "required": ["type", *needed],
                "additionalProperties": False,
            }
        )
    for key in ("like", "parts"):
        field = _FORMATION.field(key)
        if field is not None:
            alternatives.append(
                {
                    "title": key,
                    "description": field.description,
                    "type": "object",
                    "properties": {key: _property(field, definitions), **common},
                    "required": [key],
                    "additionalProperties": False,
                }
            )
            if key == _FORMATION.short:
                alternatives.append(_kind(field.kind, definitions))
    return {"description": _FORMATION.description, "anyOf": alternatives}


def _property(field: kinds.Field, definitions: dict[str, Schema]) -> Schema:
    """Return the schema of a key, its meaning, default and examples included."""
    schema = dict(_kind(field.kind, definitions))
    text = field.description
    details = _details(field)
    if details:
        text += f" ({details})"
    if "$ref" in schema:
        # Draft-07 ignores what stands beside a reference.
        schema = {"allOf": [schema]}
    schema["description"] = text
    if field.default is not None:
        schema["default"] = field.default
    if field.examples:
        schema["examples"] = list(field.examples)
    return schema


def _details(field: kinds.Field) -> str:
    """Return unit, range and default in words."""
    parts = []
    kind = field.kind
    if isinstance(kind, kinds.Quantity):
        if kind.unit:
            parts.append(f"in {kind.unit}")
        if range_text(kind):
            parts.append(range_text(kind))
    elif isinstance(kind, kinds.Either | kinds.Items):
        parts.append(wanted_text(kind))
    if field.default_text:
        parts.append(f"default: {field.default_text}")
    return "; ".join(parts)


def _kind(kind: kinds.Kind, definitions: dict[str, Schema]) -> Schema:
    """Return the schema of a kind."""
    schema: Schema
    match kind:
        case kinds.Named():
            schema = {"$ref": f"#/definitions/{kind.name}"}
        case kinds.Section():
            schema = _section(kind, definitions)
        case kinds.Either():
            schema = _any_of(_kind(item, definitions) for item in kind.options)
        case kinds.Items():
            schema = {
                "type": "array",
                "items": _kind(kind.item, definitions),
                "minItems": kind.least,
                "maxItems": kind.most,
            }
        case kinds.Table():
            schema = {
                "type": "object",
                "propertyNames": {
                    "pattern": f"^{kinds.NAME.pattern}$",
                    "maxLength": 60,
                },
                "additionalProperties": _kind(kind.item, definitions),
            }
        case _:
            schema = _scalar(kind, definitions)
    return schema


def _section(kind: kinds.Section, definitions: dict[str, Schema]) -> Schema:
    if kind is _FORMATION:
        return {"$ref": "#/definitions/formation"}
    if kind.name not in definitions:
        definitions[kind.name] = {}  # holds the place while the section is walked
        whole = _object(kind, definitions)
        field = kind.field(kind.short) if kind.short else None
        if field is not None:
            short = _kind(field.kind, definitions)
            whole = {
                "description": kind.description,
                "anyOf": [short, whole],
            }
        if kind.name == "transform":
            whole["minProperties"] = 1
        definitions[kind.name] = whole
    return {"$ref": f"#/definitions/{kind.name}"}


def _any_of(options: Iterable[Schema]) -> Schema:
    flat: list[object] = []
    for option in options:
        inner = option.get("anyOf")
        flat += inner if isinstance(inner, list) and len(option) == 1 else [option]
    return {"anyOf": flat}


def _scalar(kind: kinds.Kind, definitions: dict[str, Schema]) -> Schema:  # noqa: C901, PLR0912 - one case a kind
    schema: Schema
    match kind:
        case kinds.Quantity():
            schema = _quantity(kind, definitions)
        case kinds.Integer():
            schema = {
                "type": "integer",
                "minimum": kind.minimum,
                "maximum": kind.maximum,
            }
        case kinds.Text():
            schema = {"type": ["string", "number"], "maxLength": kind.max_length}
            if kind.pattern:
                schema["type"] = "string"
                schema["pattern"] = f"^({kind.pattern})$"
                if re.fullmatch(kind.pattern, "1"):
                    schema = {"anyOf": [schema, {"type": "integer", "minimum": 1}]}
        case kinds.Choice():
            schema = {"type": "string", "enum": list(kind.options)}
        case kinds.Flag():
            schema = {"type": "boolean"}
        case kinds.Moment():
            schema = {"type": "string", "pattern": r"^\d{4}-\d{2}-\d{2}"}
        case kinds.Time():
            definitions.setdefault("time", _time())
            schema = {"$ref": "#/definitions/time"}
        case kinds.Paint():
            definitions.setdefault("colour_value", _paint())
            schema = {"$ref": "#/definitions/colour_value"}
        case kinds.File():
            schema = {"type": "string", "minLength": 1}
        case kinds.Reference():
            schema = {"type": "string", "pattern": f"^{kinds.NAME.pattern}$"}
        case _:
            raise TypeError(f"no schema for {kind!r}")
    return schema


def _quantity(kind: kinds.Quantity, definitions: dict[str, Schema]) -> Schema:
    number: Schema = {"type": "number"}
    if kind.positive:
        number["exclusiveMinimum"] = 0
    elif kind.minimum is not None:
        number["minimum"] = kind.minimum
    if kind.maximum is not None:
        number["maximum"] = kind.maximum
    units = units_of(kind.unit)
    name = "quantity_" + re.sub(
        r"\W+", "_", kind.unit.replace("²", "2") or "share"
    ).strip("_")
    if name not in definitions:
        symbols = "|".join(re.escape(unit).replace(r"\ ", " ") for unit in units)
        clocked = ""
        if kind.unit == "s":
            units += "beats", "bars", "00:04.5"
            clocked = rf"|{LENGTH}|[\d:;.@]+"
        definitions[name] = {
            "title": f"A number with a unit: {', '.join(units)}",
            "type": "string",
            "pattern": rf"^\s*({NUMBER}\s*({symbols}){clocked})\s*$",
        }
    return {"anyOf": [number, {"$ref": f"#/definitions/{name}"}]}


def _time() -> Schema:
    return {
        "title": "24.5, 01:20.5, 00:01:20:12@25, bar 12, beat 3.5 or @chorus in "
        "quotes; a length may be added: bar 9 + 2 beats",
        "anyOf": [{"type": "number"}, {"type": "string", "minLength": 1}],
    }


def _paint() -> Schema:
    names = "|".join(map(_any_case, COLOUR_NAMES))
    return {
        "title": "A CSS colour name, [255, 136, 0], or hexadecimal in quotes "
        '("#ff8800")',
        "anyOf": [
            # For completion; then the same in capitals or both.
            {"type": "string", "enum": list(COLOUR_NAMES)},
            {"type": "string", "pattern": f"^({names})$"},
            {"type": "string", "pattern": "^#?([0-9a-fA-F]{3}|[0-9a-fA-F]{6})$"},
            {"type": "string", "pattern": rf"^{_any_case('rgb')}[aA]?\([ 0-9,]+\)$"},
            {
                "type": "array",
                "items": {"type": "integer", "minimum": 0, "maximum": 255},
                "minItems": 3,
                "maxItems": 3,
            },
        ],
    }


def _any_case(word: str) -> str:
    """Return a pattern of a word in small letters, capitals or both."""
    return "".join(f"[{letter}{letter.upper()}]" for letter in word)
