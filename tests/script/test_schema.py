"""The schema, the reference and the program say the same."""

import json
import subprocess
import sys

import pytest
import yaml
from generate import GENERATED
from jsonschema import Draft7Validator
from repository import ROOT, SHOWS

from showc.cli.init import template_text
from showc.script import read_show
from showc.script.language.schema import show_schema

SCHEMA = ROOT / "schemas" / "show.schema.json"


@pytest.mark.parametrize("path", GENERATED, ids=lambda path: path.name)
def test_what_is_generated_is_up_to_date(path):
    assert path.read_text(encoding="utf-8") == GENERATED[path](), "run make docs"


def test_it_is_a_schema():
    Draft7Validator.check_schema(show_schema())


def properties(schema, path=""):
    """Every property with its place."""
    for key, value in schema.get("properties", {}).items():
        yield f"{path}.{key}", value
        yield from properties(value, f"{path}.{key}")
    for part in ("anyOf", "oneOf", "allOf"):
        for index, option in enumerate(schema.get(part, [])):
            yield from properties(option, f"{path}/{part}{index}")
    for name, definition in schema.get("definitions", {}).items():
        yield from properties(definition, f"#{name}")
    if isinstance(schema.get("items"), dict):
        yield from properties(schema["items"], f"{path}[]")
    if isinstance(schema.get("additionalProperties"), dict):
        yield from properties(schema["additionalProperties"], f"{path}.*")


def test_every_key_is_described():
    keys = dict(properties(show_schema()))
    assert len(keys) > 100
    bare = [
        path
        for path, schema in keys.items()
        if not schema.get("description") and "const" not in schema
    ]
    assert bare == []


@pytest.mark.parametrize("path", SHOWS, ids=lambda path: path.stem)
def test_shows_keep_the_schema(path):
    subprocess.run(
        [sys.executable, "-m", "check_jsonschema", "--schemafile", SCHEMA, path],
        check=True,
        capture_output=True,
    )
    first = path.read_text(encoding="utf-8").split("\n")[0]
    assert first == "# yaml-language-server: $schema=../schemas/show.schema.json"


BASE = {
    "showc": 1,
    "drones": 4,
    "formations": {"ring": {"type": "circle", "radius": 8}},
    "transitions": [{"to": "ring"}],
}


def variants():
    """Scripts with one thing changed, and whether they are right."""
    for key, value, right in [
        ("separation", 2, True),
        ("separation", "2 m", True),
        ("separation", "200 cm", True),
        ("separation", "2 kg", False),
        ("separation", -2, False),
        ("separation", "wide", False),
        ("separation", {"distance": 2, "shape": "ellipsoid"}, True),
        ("separation", {"shape": "ball"}, False),
        ("limits", {"tilt": 200}, False),
        ("limits", {"tilt": "0.3 rad"}, True),
        ("limits", {"speed": [4, 4, 2]}, True),
        ("limits", {"speed": [4, 4]}, False),
        ("limits", {"velocity": 4}, False),
        ("vehicle", "crazyflie-28g", True),
        ("vehicle", "kite", False),
        ("vehicle", {"preset": "formation-625g", "mass": "650 g"}, True),
        ("groups", {"left": "1-2", "right": [3, "4"]}, True),
        ("groups", {"left": "one"}, False),
        ("yaw", "free", True),
        ("yaw", "loose", False),
        ("name", 7, True),
        ("name", "7", True),
        ("epoch", "2025-06-01T21:30:00Z", True),
        ("epoch", "tomorrow", False),
        ("pads", {"type": "grid", "step": 3}, True),
        ("pads", "ring", True),
        ("site", {"volume": {"min": [-50, -50, 0]}}, True),
        ("site", {"volume": {"min": [-50, -50]}}, False),
        ("site", {"fence": [[-40, -40], [40, -40], [0, 40]]}, True),
        ("site", {"fence": [[0, 0], [9, 9]]}, False),
        ("transitions", ["ring"], True),
        ("transitions", [], False),
        ("transitions", [{"to": "ring", "effect": "rainbow"}], True),
        ("transitions", [{"to": "ring", "effect": {"kind": "glow"}}], False),
        ("transitions", [{"to": "ring", "fade": "linear", "hold": "3 s"}], True),
        ("transitions", [{"to": "ring", "hold": "3 m"}], False),
        ("transitions", [{"hold": 3}], False),
    ]:
        yield {**BASE, key: value}, right
    for more, right in [
        ({"again": "ring"}, True),
        ({"again": "a ring"}, False),
        ({"two": {"parts": ["ring", {"like": "ring"}]}}, True),
        ({"two": {"parts": []}}, False),
    ]:
        yield {**BASE, "formations": {**BASE["formations"], **more}}, right
    for changes, right in [
        ({"colour": "gold"}, True),
        ({"colour": "golden"}, False),
        ({"colour": "LightGoldenrodYellow"}, True),
        ({"colour": {"gradient": ["RED", "Blue"]}}, True),
        ({"colour": "RGB(255, 136, 0)"}, True),
        ({"colour": "#ff8800"}, True),
        ({"colour": {"gradient": ["red", "blue"], "along": [0, 0, 1]}}, True),
        ({"colour": {"gradient": ["red"]}}, False),
        ({"colour": {"solid": "red", "each": ["red"]}}, False),
        ({"transform": [{"rotate": 45}, {"scale": [1, 1, 2]}]}, True),
        ({"transform": [{"rotate": 45, "shift": [0, 0, 1]}]}, False),
        ({"spread": True}, True),
        ({"spread": "maybe"}, False),
        ({"rows": 2}, False),
        ({"like": "ring"}, False),
        ({"type": "torus"}, False),
    ]:
        ring = {**BASE["formations"]["ring"], **changes}
        yield {**BASE, "formations": {"ring": ring}}, right


@pytest.mark.parametrize(
    ("script", "right"), list(variants()), ids=lambda value: str(value)[-60:]
)
def test_editor_and_program_agree(script, right):
    editor = not list(Draft7Validator(show_schema()).iter_errors(script))
    content = yaml.safe_dump(script, sort_keys=False).encode()
    found = {item.code for item in read_show(content).errors}
    program = not any(code[3] in "01" for code in found)
    assert program == right, found
    assert editor == right


def test_the_template_is_a_show_and_keeps_the_schema():
    text = template_text('Über "uns" \\o/')
    result = read_show(text.encode())
    assert result.show is not None
    assert result.diagnostics == ()
    assert result.show.name == 'Über "uns" \\o/'
    assert list(Draft7Validator(show_schema()).iter_errors(yaml.safe_load(text))) == []


def test_the_schema_is_read_by_other_programs():
    assert json.loads(SCHEMA.read_text(encoding="utf-8")) == show_schema()
