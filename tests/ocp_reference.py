"""Reference pages of the core's public names, from their own signatures and words."""

from __future__ import annotations

import ast
import inspect
import re
from dataclasses import is_dataclass
from enum import Enum
from textwrap import dedent

from showc import ocp

FOLDER = "reference"
_SECTIONS = ("Parameters", "Returns", "Raises", "Attributes")


def pages() -> dict[str, str]:
    """Markdown of each page by its name; ``index`` lists the others."""
    found = {name: _page(name, getattr(ocp, name)) for name in ocp.__all__}
    rows = [
        f"| [`{name}`]({name}.md) | {_first(getattr(ocp, name))} |" for name in found
    ]
    lines = [
        "# Reference of `showc.ocp`",
        "",
        "How it works stands in [the optimal control core](../ocp.md), its use in",
        "[optimal control by example](../ocp-tutorial.md).",
        "",
        "| name | what it is |",
        "| --- | --- |",
        *rows,
    ]
    return {"index": "\n".join(lines) + "\n", **found}


def _first(thing: object) -> str:
    """First sentence of a docstring, in one line."""
    words = " ".join(inspect.getdoc(thing).split("\n\n")[0].split())
    return _linked(words).replace("|", "\\|")


def _linked(text: str) -> str:
    """Docstring markup as Markdown: code, and names without their module."""
    text = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text)
    return text.replace("``", "`")


def _words(text: str) -> str:
    """Give a docstring as Markdown: sections as lists."""
    lines, out, section = text.split("\n"), [], ""
    for number, line in enumerate(lines):
        following = lines[number + 1] if number + 1 < len(lines) else ""
        if line in _SECTIONS and set(following) == {"-"}:
            section = line
            out += [f"*{line}*", ""]
        elif line and set(line) == {"-"}:
            continue
        elif section and line and not line.startswith(" "):
            out.append(f"- `{line}`")
        elif section and line:
            out.append(f"  {line.strip()}")
        else:
            out.append(line)
    return _linked("\n".join(out))


def _signature(name: str, thing: object) -> str:
    """One line of code as a user would write it; types where there are any."""
    try:
        text = str(inspect.signature(thing))
    except (TypeError, ValueError):
        return name
    text = re.sub(r"<factory>|<object object at 0x\w+>", "...", text)
    text = text.replace("'", "").replace("(self, ", "(").replace("(self)", "()")
    return f"{name}{text.replace(' -> None', '')}"


def _notes(cls: type) -> dict[str, str]:
    """Words below each field of a class, read from its source."""
    tree = ast.parse(dedent(inspect.getsource(cls))).body[0]
    assert isinstance(tree, ast.ClassDef)
    found, name = {}, ""
    for node in tree.body:
        value = getattr(node, "value", None)
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            name = node.target.id
            default = f" = {ast.unparse(node.value)}" if node.value else ""
            found[name] = f"`{name}: {ast.unparse(node.annotation)}{default}`"
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            name = node.targets[0].id
            found[name] = f"`{name}`: {ast.literal_eval(node.value)}"
        elif name and isinstance(value, ast.Constant) and isinstance(value.value, str):
            found[name] += f": {_linked(' '.join(value.value.split()))}"
            name = ""
        else:
            name = ""
    return found


def _page(name: str, thing: object) -> str:
    lines = [f"# `showc.ocp.{name}`", ""]
    if isinstance(thing, type) and issubclass(thing, Exception):
        return "\n".join([*lines, _words(inspect.getdoc(thing))]) + "\n"
    if not (isinstance(thing, type) and issubclass(thing, Enum)):
        lines += ["```text", _signature(name, thing), "```", ""]
    lines += [_words(inspect.getdoc(thing) or "")]
    if isinstance(thing, type):
        shown = is_dataclass(thing) or issubclass(thing, Enum)
        fields = _notes(thing) if shown else {}
        if fields:
            lines += ["", "## Fields", "", *(f"- {text}" for text in fields.values())]
        for key, member in vars(thing).items():
            inner = member.fget if isinstance(member, property) else member
            inner = getattr(inner, "__func__", inner)
            if key.startswith("_") or not inspect.isfunction(inner):
                continue
            plain = isinstance(member, property)
            title = key if plain else _signature(key, inner)
            lines += ["", f"## `{key}`", "", "```text", title, "```", ""]
            lines += [_words(inspect.getdoc(inner) or "")]
    return "\n".join(line.rstrip() for line in lines).rstrip() + "\n"
