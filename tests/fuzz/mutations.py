"""Mutations by grammar: of scripts by the field table, of files by what they hold."""

import copy
import re
import struct

import yaml
from fuzz.seeds import FILES, SCRIPTS

from showc.script.language import kinds
from showc.script.language.fields import SECTIONS, resolve
from showc.script.language.quantity import units_of

JUNK = [
    None, True, False, "", "no", "x", "~", ".nan", "-.inf", "1e308", "-1e-308", "1e999",
    "0x10", "1:30", "1_000", "-0", "00", "1 m", "5 deg", "9-1", "1-99999999", "ghost",
    "#ff", "# ff", [], {}, [[]], [[[[[[]]]]]], [1, 2, 3], {"type": "circle"},
    {"parts": []}, {"x": 1}, [None], "\u4f60\u200d\u202e", "a" * 300, "9" * 400,
    10**30, "{", "*a", "&a", "!!python/object", "<<", "../../etc/passwd", "/dev/zero",
    "%s%n", "\x07", "\ud7ff",
]  # fmt: skip
NUMBERS = [
    "0", "-1", "1", "255", "256", "1e308", "-1e308", "1e-320", "nan", "inf", "65536",
    "2147483648", "4294967295", "99999999999999999999", "0.1", "-0.0", "1e9", ".", "-",
]  # fmt: skip
WORDS = [0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF]


def _fields(kind, found):
    """All kinds that a key may have anywhere in the table, by key."""
    kind = resolve(kind)
    if id(kind) in found["seen"]:
        return
    found["seen"][id(kind)] = kind
    match kind:
        case kinds.Section():
            sections = (kind, *kind.variants)
            for field in (field for section in sections for field in section.fields):
                found["kinds"].setdefault(field.key, []).append(field.kind)
                _fields(field.kind, found)
        case kinds.Items() | kinds.Table():
            _fields(kind.item, found)
        case kinds.Either():
            for option in kind.options:
                _fields(option, found)
        case _:
            pass


_found = {"seen": {}, "kinds": {}}
_fields(SECTIONS["show"], _found)
KINDS = _found["kinds"]


def number(kind, chance):
    """A number at, inside or just beyond the ends of its range, some with a unit."""
    low = kind.minimum if kind.minimum is not None else -1e6
    high = kind.maximum if kind.maximum is not None else 1e6
    if isinstance(kind, kinds.Integer):
        few = [low, low - 1, min(high, low + 5), min(high, 200), high, high + 1]
        # The largest fleets are sound, and a matter of patience: one in a while.
        return chance.choice(few[:4] * 8 + few)
    value = chance.choice(
        [low, high, 0.0, low - 1e-9, high * 1.001, chance.uniform(low, high)]
        + [max(low, min(high, chance.uniform(0.0, 30.0)))] * 6
    )
    if kind.unit and chance.random() < 0.2:
        return f"{value:.6g} {chance.choice(units_of(kind.unit))}"
    return float(f"{value:.6g}")


def value(kind, chance, depth=0):
    """A value that a kind takes, mostly."""
    kind = resolve(kind)
    if chance.random() < 0.05:
        return copy.deepcopy(chance.choice(JUNK))
    made = None
    match kind:
        case kinds.Quantity() | kinds.Integer():
            made = number(kind, chance)
        case kinds.Choice():
            made = chance.choice(kind.options)
        case kinds.Flag():
            made = chance.random() < 0.5
        case kinds.Text():
            made = chance.choice(["A", "HI", "2-7", "1-4", "long" * 30, "\u00df\n?"])
        case kinds.Paint():
            made = chance.choice(["red", "#12f", "#ff880000", "nocolour"])
        case kinds.Moment():
            made = chance.choice(["2026-01-01", "1969-12-31", "9999-12-31T23:59:59-12"])
        case kinds.File():
            made = chance.choice([*FILES, "none.csv", "../up.csv", ".", "a\0b"])
        case kinds.Reference():
            made = chance.choice(["ring", "twin", "both", "word", "left", "me", "pads"])
        case kinds.Items():
            most = min(kind.most, 12)
            count = chance.choice([kind.least, most, chance.randint(0, most + 1)])
            made = [value(kind.item, chance, depth + 1) for _ in range(count)]
        case kinds.Table():
            names = chance.sample(["ring", "twin", "me", "you", "left"], 2)
            made = {name: value(kind.item, chance, depth + 1) for name in names}
        case kinds.Either():
            made = value(chance.choice(kind.options), chance, depth)
        case kinds.Section():
            made = section(kind, chance, depth)
        case _:
            pass
    return made


def section(kind, chance, depth):
    """A mapping with some of a section's keys, and one of those that exclude others."""
    if depth > 4:
        return {}
    fields = list(kind.fields)
    made = {}
    if kind.one_of:
        chosen = chance.choice(kind.one_of)
        fields = [f for f in fields if f.key not in kind.one_of or f.key == chosen]
    for field in fields:
        often = field.required or field.key in kind.one_of
        if chance.random() < (0.95 if often else 0.2):
            made[field.key] = value(field.kind, chance, depth + 1)
    variant = kind.variant(str(made.get(kind.tag))) if kind.tag else None
    for field in variant.fields if variant else ():
        if chance.random() < (0.95 if field.required else 0.4):
            made[field.key] = value(field.kind, chance, depth + 1)
    return made


def _places(node, path=()):
    if path:
        yield path
    if isinstance(node, dict):
        for key, inner in node.items():
            yield from _places(inner, (*path, key))
    elif isinstance(node, list):
        for index, inner in enumerate(node):
            yield from _places(inner, (*path, index))


def _at(node, path):
    for step in path:
        node = node[step]
    return node


def tree(chance):
    """The script with one to six of its nodes changed."""
    script = yaml.load(chance.choice(SCRIPTS), yaml.BaseLoader)  # noqa: S506 - texts
    for _ in range(chance.randint(1, 6)):
        places = list(_places(script))
        if not places:
            break
        path = chance.choice(places)
        parent, last = _at(script, path[:-1]), path[-1]
        key = next((step for step in reversed(path) if isinstance(step, str)), "")
        match chance.randrange(8):
            case 0:
                del parent[last]
            case 1:
                parent[last] = copy.deepcopy(chance.choice(JUNK))
            case 2:
                parent[last] = copy.deepcopy(_at(script, chance.choice(places)))
            case 3 if isinstance(parent, list):
                parent += copy.deepcopy(parent) * chance.choice([1, 1, 3, 30])
            case 4 if isinstance(parent, dict):
                key = chance.choice(list(KINDS))
                parent[key] = value(chance.choice(KINDS[key]), chance)
            case 5 if isinstance(parent, dict):
                parent[f"{last}{chance.choice(['s', '_', 'X', ' '])}"] = parent.pop(
                    last
                )
            case _:
                if key in KINDS:
                    parent[last] = value(chance.choice(KINDS[key]), chance)
                else:
                    parent[last] = [parent[last]]
    return yaml.safe_dump(script, sort_keys=False, width=1000, allow_unicode=True)


_SIGNS = [
    b"\t", b"{", b"}", b"[", b"]", b": ", b"- ", b"&a ", b"*a ", b"'", b'"', b"\x00",
    b"\xff", b"#", b"|", b">", b"---\n", b"\r", b"? ", b"!!set ", b"\n  ", b"<<: *a\n",
]  # fmt: skip


def script(chance):
    """A script, changed as a tree, as a text, or both."""
    whole = chance.random() < 0.2
    content = (chance.choice(SCRIPTS) if whole else tree(chance)).encode(
        errors="replace"
    )
    if chance.random() < 0.4:
        content = data(content, chance, _SIGNS)
    return content


_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def data(content, chance, signs=()):
    """Bytes with one to eight changes: bits, words, numbers, pieces."""
    made = bytearray(content)
    for _ in range(chance.randint(1, 8)):
        if not made:
            return bytes(made)
        at = chance.randrange(len(made))
        end = at + chance.choice([1, 2, 4, 20, 200])
        match chance.randrange(10):
            case 0:
                made[at] ^= 1 << chance.randrange(8)
            case 1:
                made[at] = chance.randrange(256)
            case 2:
                word = chance.choice(WORDS)
                form = chance.choice(["<I", ">I", "<H", ">H", "<Q"])
                size = struct.calcsize(form)
                made[at : at + size] = struct.pack(form, word % 256**size)
            case 3:
                del made[at:end]
            case 4:
                made[at:at] = made[at:end] * chance.choice([1, 2, 100])
            case 5:
                other = chance.randrange(len(made))
                made[at:at] = made[other : other + end - at]
            case 6 if chance.random() < 0.3:
                del made[at:]
            case 7 if signs:
                made[at:at] = chance.choice(signs)
            case _:
                # Numbers of texts and heads; far from any, a byte.
                near = _NUMBER.search(bytes(made[at : at + 200]))
                if near is None:
                    made[at] = 255
                else:
                    made[at + near.start() : at + near.end()] = chance.choice(
                        NUMBERS
                    ).encode()
    return bytes(made)
