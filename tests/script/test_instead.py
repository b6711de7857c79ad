"""Every corrected example mends what its finding is about."""

import pytest
import yaml

from showc.script import load_show
from showc.script.codes import codes

REST = {
    "showc": "1",
    "drones": "16",
    "formations": "{ring: {type: circle, radius: 10}, star: {like: ring}}",
    "transitions": "[ring]",
}
"""What a script needs besides an example, by key."""

PLACES = {"ring", "a", "b"}
"""Formations that examples show alone."""

MENDED = [code for code in codes().values() if code.instead]


def keys_of(part, otherwise=frozenset()):
    """Keys at the top of an example; some are broken on purpose."""
    try:
        return set(yaml.safe_load(part))
    except yaml.YAMLError:
        return set(otherwise)


def script(part, keys):
    """Make an example, with those keys at its top, a whole script."""
    rest = dict(REST)
    if keys <= PLACES:
        lines = "".join(f"  {line}\n" for line in part.splitlines())
        part = f"formations:\n{lines}"
        rest["transitions"] = f"[{', '.join(sorted(keys))}]"
        keys = {"formations"}
    elif "row" in part:
        rest["transitions"] = "[row]"
    missing = {key: value for key, value in rest.items() if key not in keys}
    return "".join(f"{key}: {value}\n" for key, value in missing.items()) + part + "\n"


def findings(tmp_path, text):
    path = tmp_path / "show.yaml"
    path.write_text(text, "utf-8")
    return load_show(path).diagnostics


@pytest.mark.parametrize("code", MENDED, ids=lambda code: code.code)
def test_what_stands_under_use_instead_has_no_such_finding(tmp_path, code):
    keys = keys_of(code.instead)
    mended = findings(tmp_path, script(code.instead, keys))
    assert code.code not in {one.code for one in mended}
    assert [one for one in mended if one.severity == "error"] == []
    # And what stands above it has, in the same surroundings.
    own = keys_of(code.example, keys)
    broken = findings(tmp_path, script(code.example, own | (keys & {"drones"})))
    assert code.code in {one.code for one in broken}


def test_findings_say_what_to_use_instead():
    # Faults of files, and what no other line of a script would mend.
    elsewhere = {"003", "008", "010", "011", "109", "110", "305", "401"}
    assert {code for code in codes() if not codes()[code].instead} == {
        f"SHW{number}" for number in elsewhere
    }
