"""Reading never raises, whatever the bytes, and every value knows its place."""

import random

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from repository import ROOT

from showc.script import read_show
from showc.script.language.document import (
    MAX_BYTES,
    Mapping,
    Scalar,
    Sequence,
    parse_document,
)
from showc.script.render import FORMATS, render

SCRIPT = (ROOT / "shows" / "chapters.yaml").read_bytes()


def plain(node):
    """What the document says, as lists, dictionaries and texts."""
    if isinstance(node, Mapping):
        return {entry.key: plain(entry.value) for entry in node}
    if isinstance(node, Sequence):
        return [plain(item) for item in node.items]
    return node.text


def scalars(node):
    if isinstance(node, Mapping):
        for entry in node:
            yield Scalar(entry.key, True, entry.mark)
            yield from scalars(entry.value)
    elif isinstance(node, Sequence):
        for item in node.items:
            yield from scalars(item)
    else:
        yield node


def test_the_tree_is_what_yaml_says():
    root, _, found = parse_document(SCRIPT, "x.yaml")
    assert found == []
    assert plain(root) == yaml.load(SCRIPT, yaml.BaseLoader)  # noqa: S506 - texts only


def test_every_value_stands_where_its_mark_says():
    root, text, _ = parse_document(SCRIPT, "x.yaml")
    lines = text.split("\n")
    for node in scalars(root):
        mark = node.mark
        assert mark.line == mark.end_line
        there = lines[mark.line - 1][mark.column - 1 : mark.end_column - 1]
        assert there.strip("\"'") == node.text


json_like = st.recursive(
    st.text("abc xyz0123é漢", min_size=1, max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text("abcé", min_size=1, max_size=5), inner, max_size=4)
    ),
    max_leaves=20,
)


@given(json_like)
def test_any_tree_is_read_back(value):
    content = yaml.safe_dump(value, allow_unicode=True).encode()
    root, _, found = parse_document(content, "x.yaml")
    assert found == []
    assert plain(root) == value


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.binary(max_size=300))
def test_any_bytes_are_answered(content):
    result = read_show(content, path="noise.yaml")
    assert result.show is None
    assert result.exit_code() in {1, 2}
    assert all(item.code for item in result.errors)


@pytest.mark.parametrize("seed", range(60))
def test_a_damaged_script_is_answered_in_every_format(seed):
    chance = random.Random(seed)
    content = bytearray(SCRIPT)
    for _ in range(chance.randint(1, 6)):
        at = chance.randrange(len(content))
        match chance.randrange(4):
            case 0:
                content[at] = chance.randrange(256)
            case 1:
                del content[at : at + chance.randint(1, 40)]
            case 2:
                content[at:at] = chance.choice(
                    [b"\t", b"{", b"]", b": ", b"- ", b"&a ", b"*a ", b"'", b"\x00"]
                )
            case _:
                content = content[: max(at, 1)]
    result = read_show(bytes(content), path="damaged.yaml")
    assert (result.show is None) == bool(result.errors)
    for form in FORMATS:
        render(result.diagnostics, {result.path: result.text}, form)


def test_too_many_bytes():
    result = read_show(b"#" * (MAX_BYTES + 1))
    assert [item.code for item in result.diagnostics] == ["SHW008"]


def test_too_deep():
    result = read_show(b"a: " + b"[" * 100 + b"]" * 100)
    assert [item.code for item in result.diagnostics] == ["SHW008"]
    assert "deep" in result.diagnostics[0].message


def test_an_alias_inside_what_it_names():
    result = read_show(b"a: &a [*a]\n")
    assert [item.code for item in result.diagnostics] == ["SHW009"]


def test_an_alias_is_no_key():
    result = read_show(b"a: &a b\n*a : c\n")
    assert [item.code for item in result.diagnostics] == ["SHW009"]


def test_aliases_give_the_same_value(show):
    made = show(
        "drones: 4\nformations:\n  one: &one {type: circle, radius: 5}\n  two: *one\n"
        "transitions: [one, two]\n"
    )
    one, two = made.formations["one"], made.formations["two"]
    assert one.points.tolist() == two.points.tolist()


def test_a_byte_order_mark_and_windows_line_ends_are_no_fault():
    content = b"\xef\xbb\xbf" + SCRIPT.replace(b"\n", b"\r\n")
    result = read_show(content)
    assert result.diagnostics == ()
    assert result.show.source.content == content
