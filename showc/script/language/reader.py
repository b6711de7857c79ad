"""The reader: a document's tree, read by the field table into settings.

Nothing stops it: what is wrong becomes a diagnostic and marks its section broken, and
the rest is read on.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from showc.script.diagnostic import Diagnostic, Label, ScriptError, once
from showc.script.language.document import (
    MAX_FOUND,
    Entry,
    Mapping,
    Node,
    Scalar,
    Sequence,
    as_node,
)
from showc.script.language.fields import resolve
from showc.script.language.kinds import (
    Choice,
    Either,
    Field,
    Items,
    Kind,
    Paint,
    Quantity,
    Section,
    Table,
)
from showc.script.language.meaning import (
    MEANT,
    about_braces,
    about_brackets,
    about_colours,
    about_commas,
    about_missing,
    about_names,
    about_one_of,
    about_variants,
    flat,
    instead_of,
    meant,
    mixed_colour,
    spaced,
    torn,
    whole_values,
    with_commas,
)
from showc.script.language.scalars import certain, no_word, read_scalar, suggestion
from showc.script.language.settings import Setting, Settings, Value
from showc.script.language.wording import (
    counted,
    form_of,
    section_text,
    shortened,
    wanted_text,
)

if TYPE_CHECKING:
    from showc.script.language.instants import Tempo
    from showc.script.mark import Mark


_FORMS: dict[type, type] = {Section: Mapping, Table: Mapping, Items: Sequence}
"""Forms of nodes that kinds take, where it is not a single value."""


class _BadValueError(Exception):
    """The value is not used; why is in the findings already."""


class Reader:
    """Reads nodes by kinds and collects what is wrong, up to :data:`MAX_FOUND`."""

    def __init__(self, tempo: Tempo | None = None) -> None:
        self.tempo = tempo
        """Of the music, in which lengths may be counted."""
        self.found: list[Diagnostic] = []
        """What is wrong, in the order it was met."""
        self._meant: set[tuple[int, str]] = set()
        """Keys that unknown ones were probably meant to be, by their mapping."""

    @property
    def full(self) -> bool:
        """Whether nothing more is collected, so that advice need not be sought."""
        return len(self.found) >= MAX_FOUND

    def say(
        self,
        code: str,
        message: str,
        span: Mark,
        *,
        label: str = "",
        secondary: tuple[Label, ...] = (),
        notes: tuple[str, ...] = (),
        help_text: str = "",
        fix: str = "",
    ) -> None:
        """Add an error."""
        if self.full:
            return
        self.found.append(
            Diagnostic(
                code,
                shortened(message),
                span,
                label=label,
                secondary=secondary,
                notes=notes,
                help=shortened(help_text),
                fix=fix,
            )
        )

    def refuse(self, fault: ScriptError, span: Mark) -> None:
        """Add an error that was found where its place was not known."""
        self.say(
            fault.code,
            str(fault),
            span,
            notes=fault.notes,
            help_text=fault.help,
            fix=fault.fix,
        )

    def _bad(
        self, code: str, message: str, span: Mark, advice: str = "", fix: str = ""
    ) -> _BadValueError:
        """Add an error and return what to raise."""
        self.say(code, message, span, help_text=advice, fix=fix)
        return _BadValueError()

    def _unfit(  # noqa: PLR0917 - what is wanted, what is there, what to do
        self, kind: Kind, node: Node, span: Mark, key: str, advice: str, fix: str = ""
    ) -> _BadValueError:
        """Say that a value has another form than its kind."""
        message = f"`{key}` is {form_of(node)}; expected {wanted_text(kind)}"
        return self._bad("SHW103", message, node.mark.near(span), advice, fix)

    def section(self, section: Section, node: Node, span: Mark) -> Settings:
        """Read a section.

        Parameters
        ----------
        section
            What it may hold.
        node
            What it does hold.
        span
            Where to point when something is missing: its key.
        """
        settings = Settings(section.name, span)
        node, name = whole_values(node), ""
        if not isinstance(node, Mapping):
            if section.short:
                name = section.name
                given = Entry(section.short, node.mark, node)
                node = Mapping({given.key: given}, node.mark)
            else:
                advice = about_braces(section, node)
                self._unfit(section, node, span, section.name, advice)
                settings.broken = True
                return settings
        fields = self._fields(section, node, settings)
        self._written(section, fields, node, settings, name)
        self._exclusive(section, node, settings)
        self._missing(fields, node, settings)
        return settings

    def _fields(
        self, section: Section, node: Mapping, settings: Settings
    ) -> tuple[Field, ...] | None:
        """Return the fields that hold here; None: the variant is not known."""
        entry = node.get(section.tag) if section.tag else None
        if entry is None and section.tag in section.one_of:
            # What else may stand here depends on what is not said.
            said = any(node.get(key) is not None for key in section.one_of)
            return section.fields if said else None
        if entry is None:
            return section.fields
        word = entry.value.text if isinstance(entry.value, Scalar) else ""
        variant = section.variant(word)
        if variant is None:
            settings.broken = True
            return None
        return section.fields + variant.fields

    def _written(
        self,
        section: Section,
        fields: tuple[Field, ...] | None,
        node: Mapping,
        settings: Settings,
        name: str,
    ) -> None:
        """Read what is written; ``name`` is for messages, if the key is not written."""
        known = {field.key: field for field in fields or section.fields}
        for entry in node:
            field = known.get(entry.key)
            if field is None:
                lacks = fields is None and section.tag and not node.get(section.tag)
                only = [key for key in section.one_of if node.get(key) is None]
                if fields is not None or (lacks and meant(entry.key, only)):
                    self._unknown(section, known, entry, node)
                    settings.broken = True
                continue
            try:
                value = self.value(
                    field.kind, entry.value, entry.mark, name or entry.key
                )
            except _BadValueError:
                settings.broken = True
                continue
            mark = entry.value.mark.near(entry.mark)
            settings.values[entry.key] = Setting(value, mark, entry.mark)
            if section.name != "show" and _has_broken(value):
                settings.broken = True

    def _unknown(
        self, section: Section, known: dict[str, Field], entry: Entry, node: Mapping
    ) -> None:
        if self.full:
            return
        rest = torn(entry, node)
        if rest is not None:
            self.found.append(rest)
            return
        # What excludes a key that is there is not meant.
        chosen = any(node.get(key) is not None for key in section.one_of)
        absent = [
            key
            for key in known
            if node.get(key) is None and not (chosen and key in section.one_of)
        ]
        if right := spaced(entry):
            self._meant.add((id(node), right.split(":")[0]))
            self.say(
                "SHW101",
                f"`{entry.key}` has no space after the colon",
                entry.mark,
                help_text=f"write `{right}`",
                fix=right,
            )
            return
        near = MEANT.get(entry.key.lower(), "")
        known_as = near in absent
        advice = "" if known_as else instead_of(entry.key, section.name, absent)
        if not known_as:
            near = "" if advice else suggestion(entry.key, absent)
        if near:
            self._meant.add((id(node), near))
        tag = node.get(section.tag) if section.tag else None
        where = f" in {section_text(section.name)}"
        if tag is not None and isinstance(tag.value, Scalar):
            where += f" of type `{tag.value.text}`"
        otherwise = f"keys here: {', '.join(sorted(absent))}"
        self.say(
            "SHW101",
            f"unknown key `{entry.key}`{where}",
            entry.mark,
            help_text=f"did you mean `{near}`?" if near else advice or otherwise,
            fix=near if known_as else certain(entry.key, absent),
        )

    def _exclusive(self, section: Section, node: Mapping, settings: Settings) -> None:
        if not section.one_of:
            return
        given = [node.get(key) for key in section.one_of]
        present = [entry for entry in given if entry is not None]
        choices = ", ".join(f"`{key}`" for key in section.one_of)
        if not present:
            settings.broken = True
            meant = any((id(node), key) in self._meant for key in section.one_of)
            only = len(section.one_of) == len(section.fields)
            if meant or not node.whole or (only and node.entries):
                return  # there, under another name: said already
            self.say(
                "SHW102",
                f"{section_text(section.name)} needs one of {choices}",
                settings.mark,
                help_text=about_variants(section, node) or f"add one of {choices}",
            )
        elif len(present) > 1:
            settings.broken = True
            first, second = present[0], present[1]
            self.say(
                "SHW111",
                f"`{first.key}` and `{second.key}` cannot stand together in "
                f"`{section.name}`",
                second.mark,
                secondary=(Label(first.mark, "the other one"),),
                help_text=about_one_of(section),
            )

    def _missing(
        self, fields: tuple[Field, ...] | None, node: Mapping, settings: Settings
    ) -> None:
        for field in fields or ():
            if node.get(field.key) is not None:
                continue
            meant = (id(node), field.key) in self._meant or not node.whole
            if field.required and meant:
                settings.broken = True  # there, under a mistyped name: said already
            elif field.required:
                settings.broken = True
                self.say(
                    "SHW102",
                    f"{section_text(settings.name)} needs `{field.key}`",
                    settings.mark,
                    help_text=about_missing(field),
                )
            elif field.default is not None:
                default = as_node(field.default, settings.mark)
                value = self.value(field.kind, default, settings.mark, field.key)
                settings.values[field.key] = Setting(
                    value, settings.mark, settings.mark, written=False
                )

    def value(self, kind: Kind, node: Node, span: Mark, key: str) -> Value:
        """Read a value; its faults are in ``found`` when it raises."""
        kind = resolve(kind)
        if isinstance(node, Scalar):
            self._empty(node, span, key, kind)
        match kind:
            case Either():
                self._misspelt(kind, node, key)
                self._formless(kind, node, span, key)
                return self.value(self._choose(kind, node), node, span, key)
            case Section():
                return self.section(kind, node, span)
            case Table():
                return self._table(kind, node, span, key)
            case Items():
                return self._items(kind, node, span, key)
            case _:
                if isinstance(kind, Paint) and isinstance(node, Sequence):
                    node = mixed_colour(node)
                if not isinstance(node, Scalar):
                    advice = about_colours(node) if isinstance(kind, Paint) else ""
                    raise self._unfit(kind, node, span, key, advice)
                try:
                    return read_scalar(kind, node, key, self.tempo)
                except ScriptError as fault:
                    self.refuse(fault, node.mark.first_line)
                    raise _BadValueError from None

    def _empty(self, node: Scalar, span: Mark, key: str, kind: Kind) -> None:
        if node.plain and node.text in {"", "~", "null", "Null", "NULL"}:
            advice, fix = f"give {wanted_text(kind)}", ""
            if _paints(kind) and node.comment:
                fix = f'"{node.comment}"'
                advice = f"`#` begins a comment: write `{fix}`, with the quotes"
            elif isinstance(kind, Section) and not kind.short:
                advice += ", indented below, or leave the key out"
            raise self._bad(
                "SHW103",
                f"`{key}` has no value",
                node.mark if node.text or fix else span,
                advice,
                fix,
            )

    def _misspelt(self, kind: Either, node: Node, key: str) -> None:
        """Refuse a word that is none of a choice, where a number would do as well."""
        known = [
            word
            for option in kind.options
            if isinstance(option, Choice)
            for word in option.options
        ]
        numbers = all(
            isinstance(one, Choice | Quantity | Items) for one in kind.options
        )
        if not known or not numbers or not isinstance(node, Scalar):
            return
        if node.text[:1].isalpha() and node.text not in known:
            otherwise = f"give {wanted_text(kind)}"
            self.refuse(no_word(key, node.text, known, otherwise), node.mark)
            raise _BadValueError

    def _formless(self, kind: Either, node: Node, span: Mark, key: str) -> None:
        """Refuse keys, or a list, where no option has this form."""
        options = [resolve(option) for option in kind.options]
        lists = [one for one in options if isinstance(one, Items)]
        forms: tuple[type, ...] = (Section, Table)
        if isinstance(node, Sequence):
            forms = (Section, Items, Paint)
        fits = any(isinstance(one, forms) for one in options)
        if not isinstance(node, Scalar) and not fits:
            advice = about_brackets(lists[0], node) if lists else ""
            for table in (one for one in options if isinstance(one, Table)):
                advice = about_names(table)
            raise self._unfit(kind, node, span, key, advice)

    def _choose(self, kind: Either, node: Node) -> Kind:
        """Return the option whose form the node has; the first, if none has."""
        options = [resolve(option) for option in kind.options]
        for option in options:
            form = _FORMS.get(type(option), Scalar)
            if isinstance(node, form) and not _other_word(option, node, len(options)):
                return option
        return next((item for item in options if isinstance(item, Section)), options[0])

    def _table(self, kind: Table, node: Node, span: Mark, key: str) -> Settings:
        settings = Settings(key, span)
        if not isinstance(node, Mapping):
            raise self._unfit(kind, node, span, key, about_names(kind))
        if len(node.entries) > kind.most:
            raise self._bad(
                "SHW119",
                f"`{key}` has {len(node.entries)} entries; at most {kind.most} are "
                "read",
                node.mark.near(span),
            )
        for entry in node:
            if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]{0,59}", entry.key) is None:
                self.say(
                    "SHW103",
                    f"`{entry.key}` cannot be the name of a {kind.what}",
                    entry.mark,
                    help_text="names have letters from a to z, digits, - and _, begin "
                    "with a letter, and have at most 60 characters",
                )
                settings.broken = True
            try:
                value = self.value(kind.item, entry.value, entry.mark, entry.key)
            except _BadValueError:
                settings.broken = True
                value = None
            mark = entry.value.mark.near(entry.mark)
            settings.values[entry.key] = Setting(value, mark, entry.mark)
        return settings

    def _items(self, kind: Items, node: Node, span: Mark, key: str) -> list[Setting]:
        node = whole_values(node)
        commas = with_commas(kind, node) if node.mark.on_one_line else ""
        advice = about_commas(kind, node)
        if not isinstance(node, Sequence):
            advice = advice or about_brackets(kind, node)
            raise self._unfit(kind, node, span, key, advice, commas)
        if nested := flat(kind, node):
            raise self._bad(
                "SHW103",
                f"`{key}` is a list of numbers; expected {wanted_text(kind)}",
                node.mark.near(span),
                f"write `{nested}`",
                nested if node.mark.on_one_line else "",
            )
        size = len(node.items)
        if not kind.least <= size <= kind.most:
            raise self._bad(
                "SHW112",
                f"`{key}` has {counted(size, 'element')}; expected {wanted_text(kind)}",
                node.mark.near(span),
                advice,
                commas,
            )
        elements: list[Setting] = []
        sound = True
        first = len(self.found)
        for item in node.items:
            try:
                value = self.value(kind.item, item, item.mark.first_line, key)
            except _BadValueError:
                sound = False
                continue
            elements.append(Setting(value, item.mark, item.mark.first_line))
        self.found[first:] = once(self.found[first:])
        if not sound:
            raise _BadValueError
        return elements


def _other_word(option: Kind, node: Node, options: int) -> bool:
    """Tell whether a word is none of a choice that is not the only possibility."""
    if not isinstance(option, Choice) or not isinstance(node, Scalar):
        return False
    return options > 1 and node.text not in option.options


def _has_broken(value: Value) -> bool:
    """Tell whether a section, or one in a list, was not read whole."""
    if isinstance(value, list):
        return any(
            isinstance(item, Setting) and _has_broken(item.value) for item in value
        )
    return isinstance(value, Settings) and value.broken


def _paints(kind: Kind) -> bool:
    return isinstance(kind, Paint) or (
        isinstance(kind, Section) and kind.name == "colour"
    )
