"""Formatting changes how a script looks and never what it says."""

import random
import re
import stat

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from repository import ROOT

from showc.__main__ import run
from showc.script import read_show
from showc.script.language.document import Mapping, Scalar, parse_document
from showc.script.language.layout import format_script

WORDS = st.sampled_from(
    ["ring", "9.50", "0x1F", "yes", "2 m", "1e3", "é", '"a: b"', "'it''s'", '"#ff8800"']
)
KEYS = st.sampled_from(["to", "hold", "it", '"a b"', "colour", "x-1"])
TREES = st.recursive(
    WORDS,
    lambda inner: (
        st.lists(inner, min_size=1, max_size=4)
        | st.dictionaries(KEYS, inner, min_size=1, max_size=4)
    ),
    max_leaves=14,
)


class Untidy:
    """Writes a tree as a person in a hurry does: every blank is a matter of chance."""

    def __init__(self, seed):
        self.chance = random.Random(seed)
        self.comments = 0

    def comment(self):
        self.comments += 1
        return f"#{self.chance.choice(['', ' '])}note {self.comments}: [x], {{y}}"

    def end(self):
        line = " " * self.chance.randrange(3)
        if self.chance.random() < 0.3:
            line = f" {line}{self.comment()}"
        lines = [line]
        while self.chance.random() < 0.3:
            blank = " " * self.chance.randrange(9)
            own = self.comment() if self.chance.random() < 0.5 else ""
            lines.append(blank + own)
        return "\n".join(lines) + "\n"

    def space(self, least=1):
        return " " * self.chance.randint(least, 3)

    def flow(self, tree):
        if isinstance(tree, str):
            return tree
        joint = f"{self.space(0)},{self.space()}"
        if self.chance.random() < 0.2:
            joint = f",{self.end()}{' ' * self.chance.randrange(60, 64)}"
        if isinstance(tree, list):
            inner = joint.join(map(self.flow, tree))
            return f"[{self.space(0)}{inner}{self.space(0)}]"
        inner = joint.join(
            f"{key}:{self.space()}{self.flow(value)}" for key, value in tree.items()
        )
        return f"{{{self.space(0)}{inner}{self.space(0)}}}"

    def block(self, tree, column):
        """Lines of a tree at a column, the first without its blanks."""
        if isinstance(tree, str) or self.chance.random() < 0.2:
            if isinstance(tree, str) and self.chance.random() < 0.1:
                deep = " " * (column + self.chance.randrange(3))
                return f"|\n{deep}some text\n\n{deep}  more\n"
            return self.flow(tree) + self.end()
        lines = []
        if isinstance(tree, list):
            for item in tree:
                gap = self.space()
                deep = column + 1 + len(gap)
                lines.append(f"-{gap}{self.block(item, deep)}")
        else:
            for key, value in tree.items():
                if isinstance(value, str):
                    gap = self.space()
                    if self.chance.random() < 0.2:
                        gap = (
                            f"{self.end()}{' ' * (column + self.chance.randint(1, 4))}"
                        )
                    lines.append(f"{key}:{gap}{self.block(value, column + 1)}")
                    continue
                level = isinstance(value, list) and self.chance.random() < 0.4
                deep = column if level else column + self.chance.randint(1, 5)
                inner = self.block(value, deep)
                flow = inner.lstrip().startswith(("[", "{"))
                deep = column + 1 if flow else deep
                beside = flow and self.chance.random() < 0.7
                start = self.space() if beside else f"{self.end()}{' ' * deep}"
                lines.append(f"{key}:{start}{inner}")
        return (" " * column).join(lines)


def said(node):
    if isinstance(node, Scalar):
        return node.text, node.plain
    if isinstance(node, Mapping):
        return [(entry.key, said(entry.value)) for entry in node]
    return [said(item) for item in node.items]


def notes(text):
    return re.findall(r"# ?note \d+: \[x\], \{y\}", text)


@settings(max_examples=300, deadline=None)
@given(TREES.filter(lambda tree: not isinstance(tree, str)), st.integers(0, 10**6))
def test_what_is_said_and_every_comment_stay(tree, seed):
    text = Untidy(seed).block(tree, 0)
    root, _, found = parse_document(text.encode(), "it")
    assert root is not None and not found, text
    result = format_script(text)
    again, _, _ = parse_document(result.encode(), "it")
    assert said(again) == said(root)
    assert notes(result) == notes(text)
    assert format_script(result) == result
    assert not re.search(r"[ \t]\n|\n\n\n|\t", result)


@pytest.mark.parametrize(
    "path", sorted((ROOT / "shows").glob("*.yaml")), ids=lambda path: path.name
)
def test_shows_of_the_project_have_the_layout(path):
    text = path.read_text("utf-8")
    assert format_script(text) == text


@pytest.mark.parametrize(
    ("written", "formatted"),
    [
        ("a:   1\r\nb:\r\n- x\r\n-    y", "a: 1\nb:\n  - x\n  - y\n"),
        ("\ufeffa : {b :1 , c: [ 1,2 ] }", "a: {b :1, c: [1, 2]}\n"),
        ("\n\n# top\n\n\n\na: 1   #why\n\n\n", "# top\n\na: 1 #why\n"),
        (
            "a:\n    b: 1\n    # of b\n# of a\nc: 2\n",
            "a:\n  b: 1\n  # of b\n# of a\nc: 2\n",
        ),
        ("a: |+\n     x\n\n\nb: 1\n", "a: |+\n     x\n\n\nb: 1\n"),
        # At the end of the text too, line breaks may be part of a value.
        ("a:  >+\n  x\n  y\n\n\n", "a: >+\n  x\n  y\n\n\n"),
        ("a:  |\n  x\n\n\n", "a: |\n  x\n"),
        ("a:  |\n  x", "a: |\n  x"),
        ("a:  |+\n  x\n\n# why\n\n", "a: |+\n  x\n\n# why\n"),
        ("", ""),
        ("# only\n", "# only\n"),
    ],
)
def test_the_layout(written, formatted):
    assert format_script(written) == formatted


def test_the_command_replaces_the_file_and_keeps_its_permissions(tmp_path, capsys):
    path = tmp_path / "show.yaml"
    path.write_text("showc:   1\ndrones: 4\n", "utf-8")
    path.chmod(0o640)
    assert run(["fmt", "--check", str(path)]) == 1
    assert run(["fmt", "--diff", str(path)]) == 1
    assert "-showc:   1\n+showc: 1\n" in capsys.readouterr().out
    assert path.read_text("utf-8").startswith("showc:   1")
    assert run(["fmt", str(path)]) == 0
    assert path.read_text("utf-8") == "showc: 1\ndrones: 4\n"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert run(["fmt", "--check", str(path)]) == 0


def test_what_is_no_yaml_is_left_alone(tmp_path, capsys):
    path = tmp_path / "show.yaml"
    path.write_text("showc: [1\n", "utf-8")
    assert run(["fmt", str(path)]) == 2
    assert "SHW001" in capsys.readouterr().err
    assert path.read_text("utf-8") == "showc: [1\n"


@pytest.mark.parametrize(
    ("written", "formatted"),
    [("", ""), ("\n\n", ""), ("# none yet\n", "# none yet\n"), ("---", "---\n")],
)
def test_an_empty_script_has_a_layout_too(tmp_path, capsys, written, formatted):
    path = tmp_path / "show.yaml"
    path.write_text(written, "utf-8")
    differs = written != formatted
    assert run(["fmt", "--check", str(path)]) == differs
    assert bool(capsys.readouterr().out) == differs
    assert run(["fmt", str(path)]) == 0
    assert path.read_text("utf-8") == formatted


def test_what_would_say_something_else_is_left_alone(tmp_path, capsys):
    path = tmp_path / "show.yaml"
    path.write_text("a:  1\nb:\n  i\u2028t: x\n", "utf-8")
    before = path.read_bytes()
    assert run(["fmt", str(path)]) == 2
    assert "left as it is" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_check_mends_the_file_and_reports_the_rest(tmp_path, capsys):
    path = tmp_path / "show.yaml"
    path.write_bytes(
        b"\xef\xbb\xbfshowc: 1\r\ndrones: 4\r\nformatons:\r\n"
        b"  it: {type: circle, radius: 9 meters}\r\ntransitions: [it, gone]\r\n"
    )
    assert run(["check", "--fix", str(path)]) == 1
    out = capsys.readouterr()
    assert out.err.count("fixed [") == 2 and "no formation `gone`" in out.out
    assert path.read_bytes() == (
        b"\xef\xbb\xbfshowc: 1\r\ndrones: 4\r\nformations:\r\n"
        b"  it: {type: circle, radius: 9 m}\r\ntransitions: [it, gone]\r\n"
    )
    assert read_show(path.read_bytes(), folder=tmp_path).errors
