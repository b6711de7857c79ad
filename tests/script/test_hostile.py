"""Scripts and files that are made to hurt end in findings, in little time and memory.

Each runs in a process of its own under limits of processor time and memory, as the
command does, so that a hang or a flood is a failure and not the end of the tests.
"""

import json
import os
import struct
import zlib
from pathlib import Path

import pytest
from confined import run_confined

from showc.log.schema import ADDITIONS, LAYOUT_NAME, MANIFEST_NAME
from showc.script import load_show


def checked(folder, *arguments):
    """Check a script; its findings, its exit code and what was printed."""
    code, said = run_confined(folder, "check", "--json", *arguments)
    return json.loads(said)["diagnostics"], code, said


def codes(found):
    return {item["code"] for item in found}


def show(formation, drones=4, more=""):
    return (
        f"showc: 1\ndrones: {drones}\n{more}"
        f"formations:\n  it: {formation}\ntransitions: [it]\n"
    )


def png(width, height):
    """A picture that promises pixels, and holds a few compressed bytes."""

    def chunk(kind, content):
        body = kind + content
        return (
            struct.pack(">I", len(content)) + body + struct.pack(">I", zlib.crc32(body))
        )

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(b"\0" * 1000))
        + chunk(b"IEND", b"")
    )


SVG = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">'
RECT = '<rect width="9" height="9"/>'


def doubling_svg():
    groups = [f'<g id="a0">{RECT}</g>']
    groups += [
        f'<g id="a{n}"><use href="#a{n - 1}"/><use href="#a{n - 1}"/></g>'
        for n in range(1, 30)
    ]
    return (SVG + "".join(groups) + "</svg>").encode()


def doubling_gltf():
    nodes = [{"mesh": 0}] + [{"children": [n, n]} for n in range(30)]
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "nodes": nodes,
            "scenes": [{"nodes": [30]}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"count": 3, "componentType": 5126, "type": "VEC3"}],
        }
    ).encode()


FILES = {
    "a PNG of 3 gigapixels": ("image", "a.png", png(60_000, 50_000), "SHW119"),
    "a PNG of 100 megapixels": ("image", "a.png", png(10_000, 10_000), "SHW119"),
    "a PNG cut short": ("image", "a.png", png(100, 100)[:60], "SHW110"),
    "quotes in a CSV": ("csv", "a.csv", b'x,y,z\n"1,2,3\n' * 4, "SHW110"),
    "a CSV of one long cell": ("csv", "a.csv", b"1,2,3\n" + b"9" * 500_000, "SHW110"),
    "a CSV of 3 million rows": ("csv", "a.csv", b"1,2,3\n" * 3_000_000, "SHW109"),
    "a CSV of 600,000 rows": ("csv", "a.csv", b"1,2,3\n" * 600_000, "SHW119"),
    "SVG that uses itself": (
        "svg",
        "a.svg",
        f'{SVG}<g id="a">{RECT}<use xlink:href="#a"/></g></svg>'.encode(),
        "SHW119",
    ),
    "SVG nested 10,000 deep": (
        "svg",
        "a.svg",
        (SVG + "<g>" * 10_000 + RECT + "</g>" * 10_000 + "</svg>").encode(),
        "SHW119",
    ),
    "SVG that doubles 30 times": ("svg", "a.svg", doubling_svg(), "SHW119"),
    "SVG with entities that grow": (
        "svg",
        "a.svg",
        (
            '<!DOCTYPE s [<!ENTITY a "'
            + "x" * 1000
            + '">'
            + "".join(
                f'<!ENTITY {chr(98 + n)} "{f"&{chr(97 + n)};" * 10}">' for n in range(9)
            )
            + f"]>{SVG}<text>&j;</text></svg>"
        ).encode(),
        "SHW110",
    ),
    "PLY with a trillion vertices": (
        "mesh",
        "a.ply",
        (
            b"ply\nformat binary_little_endian 1.0\nelement vertex 1%s\n"
            b"property float x\nend_header\n" % (b"0" * 12)
        ),
        "SHW119",
    ),
    "STL without a solid": ("mesh", "a.stl", b"facet normal 0 0 1\n", "SHW110"),
    "STL that is text": ("mesh", "a.stl", b"solid x\nendsolid x\n", "SHW110"),
    "binary STL of many": (
        "mesh",
        "a.stl",
        b"\0" * 80 + struct.pack("<I", 4_000_000_000),
        "SHW110",
    ),
    "OBJ of 64 MB": ("mesh", "a.obj", b"v 1 2 3\n" * 8_000_000, "SHW109"),
    "OBJ with endless numbers": (
        "mesh",
        "a.obj",
        b"v 0 0 0\nv 1e308 0 0\nv 0 1e308 0\nv 1 1 nan\nf 1 2 3\nf 1 2 4\n",
        "SHW110",
    ),
    "glTF whose nodes double": ("mesh", "a.gltf", doubling_gltf(), "SHW110"),
    "a font of noise": ("text", "a.ttf", b"\0\1\0\0" + bytes(range(256)), "SHW110"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_hostile_file_is_a_finding(name, tmp_path):
    kind, file, content, code = FILES[name]
    (tmp_path / file).write_bytes(content)
    word = "text: A, font" if kind == "text" else "file"
    script = show(f"{{type: {kind}, {word}: {file}}}")
    (tmp_path / "show.yaml").write_text(script)
    found, ended, _ = checked(tmp_path, "show.yaml")
    assert codes(found) >= {code}
    assert ended == 1


def chain(length, upwards):
    rows = [f"  f{n}: {{like: f{n - 1}}}" for n in range(1, length)]
    rows = ["  f0: {type: circle, radius: 9}", *rows]
    if not upwards:
        rows.reverse()
    return (
        "showc: 1\ndrones: 4\nformations:\n"
        + "\n".join(rows)
        + f"\ntransitions: [f{length - 1}]\n"
    )


def ring(length):
    rows = [f"  f{n}: {{like: f{(n + 1) % length}}}" for n in range(length)]
    return (
        "showc: 1\ndrones: 4\nformations:\n" + "\n".join(rows) + "\ntransitions: [f0]\n"
    )


def doubling(times):
    rows = ["  f0: {type: circle, count: 1}"]
    rows += [
        f"  f{n}: {{parts: [{{like: f{n - 1}}}, {{like: f{n - 1}}}]}}"
        for n in range(1, times + 1)
    ]
    return "showc: 1\nformations:\n" + "\n".join(rows) + f"\ntransitions: [f{times}]\n"


def keys(count, form):
    rows = "".join(form.format(n) for n in range(count))
    return f"showc: 1\ndrones: 4\nformations:\n{rows}transitions: [f0]\n"


KEYS = [f"{n:x}" for n in range(500_000)]
ANCHORS = ", ".join(f"&a{n} [*a]" for n in range(90_000))
GROW = ", ".join(["{scale: 1000}"] * 100)
SCRIPTS = {
    "a chain of 1,900": (chain(1900, upwards=True), {"SHW119"}),
    "a chain of 1,900 backwards": (chain(1900, upwards=False), {"SHW119"}),
    "a chain of 3,000": (chain(3000, upwards=False), {"SHW119"}),
    "a ring of 1,900": (ring(1900), {"SHW119"}),
    "a million parts": (doubling(20), {"SHW119"}),
    "scaled by a thousand a hundred times": (
        show(f"{{type: circle, radius: 9, transform: [{GROW}]}}"),
        {"SHW104"},
    ),
    "100,000 formations": (
        keys(100_000, "  f{}: {{type: circle}}\n"),
        {"SHW008"},
    ),
    "20,000 formations": (keys(20_000, "  f{}: {{type: circle}}\n"), {"SHW119"}),
    "45,000 unknown keys": (
        show("{type: circle}", more="".join(f"key{n}: 1\n" for n in range(45_000))),
        {"SHW101", "SHW119"},
    ),
    "45,000 keys twice": (
        show("{type: circle}", more="name: x\n" * 45_000),
        {"SHW004", "SHW119"},
    ),
    "groups of everyone, often": (
        show(
            "{type: circle}",
            more="groups:\n"
            + "".join(
                f"  g{n}: [{', '.join(['1-10000'] * 100)}]\n" for n in range(100)
            ),
        ),
        {"SHW116"},
    ),
    "a version of 5,000 digits": (f"showc: {'9' * 5000}\n", {"SHW108"}),
    "a number of a million digits": (
        show("{type: circle, radius: " + "9" * 1_000_000 + "}"),
        {"SHW103"},
    ),
    "a word of a million letters": (
        show("{type: " + "x" * 1_000_000 + "}"),
        {"SHW106"},
    ),
    "a hundred thousand comments that pass over nothing": (
        show("{type: circle}") + "# showc: ignore[SHW303] x\n" * 100_000,
        {"SHW117"},
    ),
    "fifteen heaps of 10,000": (
        "showc: 1\ndrones: 10000\nformations:\n"
        + "".join(f"  f{n}: {{type: circle, radius: 0.01}}\n" for n in range(15))
        + "transitions: [f0]\n",
        {"SHW201"},
    ),
    "thousands of places in letters, spread": (
        "showc: 1\ndrones: 10000\nformations:\n"
        + "".join(
            f"  f{n}: {{type: text, text: O, draw: inside, spread: true}}\n"
            for n in range(5)
        )
        + "transitions: [f0]\n",
        {"SHW118"},
    ),
    "twelve moves of 10,000": (
        (
            "showc: 1\ndrones: 10000\n"
            "site: {volume: {min: [-900, -900, 0], max: [900, 900, 99]}}\n"
            "formations:\n  wall: {type: grid, step: 3}\n"
            "  field: {type: grid, step: 4, plane: ground, centre: [0, 0, 30]}\n"
            f"transitions: [{', '.join(['wall', 'field'] * 6)}]\n"
        ),
        {"SHW305"},
    ),
    "half a million keys": (
        show("{type: circle}", more="name:\n " + ":\n ".join(KEYS)),
        {"SHW008"},
    ),
    "half a million keys in braces": (
        show("{type: circle}", more=f"name: {{{','.join(KEYS)}}}\n"),
        {"SHW008"},
    ),
    "a fence of 100,000 corners": (
        show("{type: circle}", more=f"site: {{fence: [{'[1, 2], ' * 100_000}]}}\n"),
        {"SHW008"},
    ),
    "90,000 anchors": (
        show(
            "{type: circle}",
            more="x: &a [1]\ny: [" + ANCHORS + "]\n",
        ),
        {"SHW008"},
    ),
    "9,000 places at one point, spread": (
        show(
            f"{{type: points, spread: true, points: [{'[1, 1, 10], ' * 9000}]}}",
            drones=9000,
        ),
        {"SHW203"},
    ),
    "60 texts of 10,000": (
        "showc: 1\ndrones: 10000\nformations:\n"
        + "".join(f"  t{n}: {{type: text, text: HELLO {n}}}\n" for n in range(60))
        + "transitions: [t0]\n",
        {"SHW119"},
    ),
    "a thousand moves of 10,000": (
        (
            "showc: 1\ndrones: 10000\n"
            "formations:\n  a: {type: grid, step: 3}\n  b: {type: grid, step: 4}\n"
            f"transitions: [{', '.join(['a', 'b'] * 500)}]\n"
        ),
        {"SHW119"},
    ),
    "10,000 drones in moves to formations that are not there": (
        f"showc: 1\ndrones: 10000\nformations: {{}}\ntransitions: [{'a, ' * 200}]\n",
        {"SHW107"},
    ),
    "epoch before logs begin": (
        show("{type: circle}", more="epoch: 0001-01-01T00:00:00Z\n"),
        {"SHW104"},
    ),
    "epoch after logs end": (
        show("{type: circle}", more="epoch: 9999-12-31T00:00:00Z\n"),
        {"SHW104"},
    ),
}


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_hostile_script_is_a_finding(name, tmp_path):
    script, wanted = SCRIPTS[name]
    (tmp_path / "show.yaml").write_text(script)
    found, ended, printed = checked(tmp_path, "show.yaml")
    assert codes(found) >= wanted
    assert bool(ended) == any(item["severity"] == "error" for item in found)
    assert len(found) <= 150
    assert len(printed) < 400_000


def test_a_parking_takes_as_many_places_as_drones_wait(tmp_path):
    (tmp_path / "show.yaml").write_text(
        "showc: 1\ndrones: 9\nparking: {type: line, centre: [0, -40, 15], spacing: 3}\n"
        "formations:\n  ring: {type: circle, radius: 9, count: 5}\n"
        "  pair: {type: line, count: 2}\ntransitions: [ring, pair]\n"
    )
    result = load_show(tmp_path / "show.yaml", allow_outside=True)
    assert result.errors == ()
    assert len(result.show.formations["parking"].points) == 7


@pytest.mark.parametrize("name", [MANIFEST_NAME, LAYOUT_NAME, *ADDITIONS])
def test_names_that_logs_have_for_their_own_files_are_refused(name, tmp_path):
    (tmp_path / name).write_text(show("{type: csv, file: a.csv}"))
    (tmp_path / "show.yaml").write_text(show(f"{{type: csv, file: '{name}'}}"))
    (tmp_path / "a.csv").write_text("0,0,9\n4,0,9\n")
    for script in (name, "show.yaml"):
        found, ended, _ = checked(tmp_path, script)
        assert ended == 1
        (wrong,) = [one for one in found if one["code"] == "SHW109"]
        assert "a file of its own of this name" in wrong["summary"]


@pytest.mark.parametrize("what", ["/dev/zero", "pipe", "folder"])
def test_only_regular_files_are_read(what, tmp_path):
    path = Path(what) if what.startswith("/") else tmp_path / what
    if what == "pipe":
        os.mkfifo(path)
    elif what == "folder":
        path.mkdir()
    found, ended, _ = checked(tmp_path, str(path))
    assert (codes(found), ended) == ({"SHW010"}, 2)
    assert "expected a regular file" in found[0]["summary"]
    (tmp_path / "show.yaml").write_text(show(f"{{type: csv, file: {path}}}"))
    found, ended, _ = checked(tmp_path, "--allow-outside", "show.yaml")
    assert (codes(found), ended) == ({"SHW109"}, 1)
    assert "expected a regular file" in found[0]["summary"]


@pytest.mark.parametrize("how", ["absolute", "parent", "link", "linked folder"])
def test_files_outside_the_folder_are_not_read_and_not_shown(how, tmp_path):
    secret, folder = tmp_path / "secret", tmp_path / "shows"
    secret.mkdir()
    folder.mkdir()
    (secret / "key.csv").write_text("hunter2,0,0\n")
    name = {
        "absolute": str(secret / "key.csv"),
        "parent": "../secret/key.csv",
        "link": "here.csv",
        "linked folder": "there/key.csv",
    }[how]
    (folder / "here.csv").symlink_to(secret / "key.csv")
    (folder / "there").symlink_to(secret)
    (folder / "show.yaml").write_text(show(f"{{type: csv, file: {name}}}"))
    found, _, printed = checked(folder, "show.yaml")
    assert codes(found) == {"SHW109"}
    assert "--allow-outside" in found[0]["help"]
    assert "hunter2" not in printed
    found, _, printed = checked(folder, "--allow-outside", "show.yaml")
    assert codes(found) == {"SHW110"}
    assert "hunter2" not in printed


def test_a_link_as_script_is_not_followed_elsewhere(tmp_path):
    (tmp_path / "secret").write_text("hunter2: [\n")
    folder = tmp_path / "shows"
    folder.mkdir()
    (folder / "show.yaml").symlink_to(tmp_path / "secret")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "show.yaml").write_text("hunter2: [\n")
    (folder / "more").symlink_to(tmp_path / "elsewhere")
    for name in ("show.yaml", "more/show.yaml", str(folder / "show.yaml")):
        found, ended, printed = checked(folder, name)
        assert (codes(found), ended) == ({"SHW010"}, 2)
        assert "hunter2" not in printed
    found, _, _ = checked(folder, "--allow-outside", "show.yaml")
    assert codes(found) == {"SHW001"}


def test_a_hundred_warnings_are_no_error(tmp_path):
    rows = "".join(f"  f{n}: {{type: line, spacing: 1.6}}\n" for n in range(150))
    names = ", ".join(f"f{n}" for n in range(150))
    (tmp_path / "show.yaml").write_text(
        f"showc: 1\ndrones: 4\nformations:\n{rows}transitions: [{names}]\n"
    )
    result = load_show(tmp_path / "show.yaml")
    assert result.show is not None
    assert len(result.warnings) == 101
    assert result.warnings[-1].code == "SHW119"


@pytest.mark.parametrize("sign", ["\x1b", "\a", "\n", "\t", "\u202e", "\u2066"])
def test_names_that_would_steer_a_terminal_are_findings(tmp_path, sign):
    written = json.dumps(f"a{sign}b")
    show = f"showc: 1\nname: {written}\ndrones: 4\nformations: {{it: {{type: grid}}}}\n"
    show += f"transitions: [{{to: it, name: {written}}}]\n"
    (tmp_path / "show.yaml").write_text(show)
    found = load_show(str(tmp_path / "show.yaml")).errors
    assert [item.code for item in found] == ["SHW103", "SHW103"]
    assert all(f"U+{ord(sign):04X}" in item.message for item in found)


def test_names_of_other_tongues_and_signs_are_none(tmp_path):
    names = "Été\u00a02026, שלום, 星空, 👩\u200d🚀"
    show = f"showc: 1\nname: {names}\ndrones: 2\n"
    show += 'formations: {it: {type: text, text: "I\\nI"}}\ntransitions: [it]\n'
    (tmp_path / "show.yaml").write_text(show)
    assert not load_show(str(tmp_path / "show.yaml")).errors
