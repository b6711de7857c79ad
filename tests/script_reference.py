"""The reference of show scripts, Markdown, made from the field table."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from showc.script.language.fields import FORMAT_VERSION, SECTIONS
from showc.script.language.kinds import Either, Field, Items, Kind, Section, Table
from showc.script.language.quantity import UNITS
from showc.script.language.wording import wanted_text

if TYPE_CHECKING:
    from collections.abc import Iterator

SHOW, FORMATION = SECTIONS["show"], SECTIONS["formation"]
_HEAD = f"""# Show scripts

<!-- Made from the program's own table; `make docs` writes it anew. -->

A show script is a YAML file in UTF-8 that describes a show from take-off to landing.
Most keys have defaults, so that a short script is complete:

```yaml
showc: 1
drones: 16
formations:
  ring: {{type: circle, radius: 10, centre: [0, 0, 25], colour: gold}}
transitions:
  - {{to: ring, hold: 5}}
```

The [guide](guide.md) introduces the keys by task, the [gallery](gallery.md) by
pictures. This page lists every key of format version {FORMAT_VERSION}. Editors that
know JSON Schema complete and check them. `showc schema` prints the schema, and the
first line of a script names it:

```yaml
# yaml-language-server: $schema=show.schema.json
```

**Show frame.** Positions are in metres from the site's origin: x to the right, y ahead
along the site's heading, z up. With heading 0 these are east, north and up. The ground
is at z = 0.

**YAML.** A *mapping* has keys and values: `{{to: ring, hold: 5}}` in braces, or one key
a line, indented. A *list* has elements: `[0, 0, 25]` in brackets, or one element a
line, each after a dash.

**Quantities.** A number without a unit is in the unit that its key documents. Other
units of the same kind may be written with the number: `20 deg`, `0.35 rad`, `18 km/h`,
`250 g`. The units are:
"""

_FORMATIONS = """
## Formations

A formation has a `type` with keys of its own, or is `like` another formation, or
consists of `parts`. A bare name stands for `like`. showc draws the formation about its
own origin, applies the changes in `transform`, moves it to `centre`, and checks its
`spacing`. Places are numbered from 1 in the order that each type documents. With a
fixed assignment, drone 1 flies to place 1.
"""

_ORDER = (
    "origin", "volume", "colour", "transform", "rotate", "effect",
    "motion", "rotating", "breathing", "waving", "orbiting",
)  # fmt: skip


def page() -> str:
    """Return the reference page."""
    lines = [_HEAD.rstrip("\n"), ""]
    kinds: dict[str, list[str]] = {}
    for unit in UNITS.values():
        kinds.setdefault(unit.dimension, []).append(f"`{unit.symbol}`")
    lines += [f"- {kind}: {', '.join(symbols)}" for kind, symbols in kinds.items()]
    lines += ["", "## Top level", "", SHOW.description, "", *_table(SHOW.fields)]
    sections = {section.name: section for section in _sections(SHOW)}
    inner = [name for name in sections if name not in {"show", "formation"}]
    for name in (name for name in inner if name not in _ORDER):
        lines += _chapter(sections[name], 2)
        if name == "transition":
            for inner_name in ("motion", "rotating", "breathing", "waving", "orbiting"):
                lines += _chapter(sections[inner_name], 3)
        if name == "site":
            lines += _chapter(sections["origin"], 3) + _chapter(sections["volume"], 3)
    lines += [_FORMATIONS.rstrip("\n"), "", *_table(FORMATION.fields)]
    for name in ("colour", "transform", "rotate", "effect"):
        lines += _chapter(sections[name], 3)
    lines += ["", "## Types of formations"]
    for variant in FORMATION.variants:
        lines += ["", f"### `type: {variant.name}`", "", variant.description]
        if variant.fields:
            lines += ["", *_table(variant.fields)]
    return "\n".join(lines) + "\n"


def _chapter(section: Section, level: int) -> list[str]:
    short = ""
    if section.short:
        short = f" A bare value stands for `{section.short}`."
    return [
        "",
        f"{'#' * level} `{section.name}`",
        "",
        section.description + short,
        "",
        *_table(section.fields),
    ]


def _table(fields: tuple[Field, ...]) -> list[str]:
    lines = ["| key | value | default | meaning |", "| --- | --- | --- | --- |"]
    for field in fields:
        wanted = _cell(wanted_text(field.kind))
        lines.append(
            f"| `{field.key}` | {wanted} | {_default(field)} | {_meaning(field)} |"
        )
    return lines


def _default(field: Field) -> str:
    if field.required:
        return "required"
    if field.default_text:
        return _cell(field.default_text)
    if field.default is None or field.default == {}:
        named = isinstance(field.kind, Section) and field.default == {}
        return f"see [`{field.key}`](#{field.kind.name})" if named else "none"
    if isinstance(field.default, str):
        return f"`{field.default}`"
    return f"`{json.dumps(field.default)}`"


def _meaning(field: Field) -> str:
    text = _cell(field.description)
    if field.examples:
        shown = ", ".join(f"`{_cell(_flow(item))}`" for item in field.examples)
        text += f" For example {shown}."
    return text


def _flow(value: object) -> str:
    """Return a value as YAML's flow style writes it."""
    if isinstance(value, dict):
        inner = ", ".join(f"{key}: {_flow(item)}" for key, item in value.items())
        return f"{{{inner}}}"
    if isinstance(value, list):
        return f"[{', '.join(_flow(item) for item in value)}]"
    if isinstance(value, str) and value.startswith("#"):
        return f'"{value}"'
    return value if isinstance(value, str) else json.dumps(value)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _sections(kind: Kind) -> Iterator[Section]:
    """Yield every section under a kind, itself first, each once by name."""
    match kind:
        case Section():
            yield kind
            for field in kind.fields:
                yield from _sections(field.kind)
        case Items():
            yield from _sections(kind.item)
        case Table():
            yield from _sections(kind.item)
        case Either():
            for option in kind.options:
                yield from _sections(option)
        case _:
            return
