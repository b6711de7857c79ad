"""``exports:`` in a script: compile writes them, proved."""

import json
import os
import shutil
import zipfile
from dataclasses import replace
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from unittest.mock import patch

import pytest
from click.testing import CliRunner

from showc.cli.compile import command
from showc.cli.verify import command as verify
from showc.errors import UsageError
from showc.export.asked import show_with_exports
from showc.export.beside import verify_beside
from showc.export.skyc import Entry, archive, entries_of
from showc.export.solved import solved_show
from showc.export.stage import ExportOptions, export, refuse_foreign
from showc.foreign.folder import verify_export
from showc.log.additions import digest_of
from showc.log.reader import read_log
from showc.script import load_show

SCRIPT = """showc: 1
name: Up and down
separation: 1.6 m
pads: {type: line, count: 2, spacing: 4 m}
formations:
  high: {type: line, count: 2, spacing: 4 m, centre: [0, 0, 14]}
transitions:
  - {to: high, hold: 1 s}
exports: [kml, crazyflie, {to: skyb, separation: 1.5 m, lead: 12 s}]
"""
MORE = ("skyc", "skyb", "skybrush-csv", "vviz", "gltf")


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A log with its exports beside it."""
    folder = tmp_path_factory.mktemp("wishes")
    path, log = folder / "show.yaml", folder / "show.mcap"
    path.write_text(SCRIPT)
    arguments = [str(path), "-o", str(log), "--no-missions", "-q", "-j", "1"]
    arguments += ["--cache-dir", str(folder / "cache")]
    run = CliRunner().invoke(command, arguments, standalone_mode=False)
    assert run.return_value == 0, run.output
    return log


def test_wishes_are_read(tmp_path):
    path = tmp_path / "show.yaml"
    path.write_text(SCRIPT)
    kml, crazyflie, skyb = load_show(path).show.exports
    assert (crazyflie.to, crazyflie.lead) == ("crazyflie", None)
    assert (kml.to, kml.separation, kml.lead, kml.tolerance) == (
        "kml",
        None,
        None,
        0.01,
    )
    assert (skyb.to, skyb.separation, skyb.lead) == ("skyb", 1.5, 12.0)


@pytest.mark.parametrize(
    ("separation", "exports", "tracking"),
    [
        ("1.6 m", "[skyc]", 0.08),
        ("1.6 m", "[kml, {to: skyb, lead: 12 s}]", 0.08),
        ("{distance: 1.6 m, tracking: 0}", "[skyc]", 0.0),
        ("{distance: 1.6 m, tracking: 0.3 m}", "[skyc]", 0.3),
        ("1.6 m", "[{to: skyc, separation: 1.4 m}]", 0.0),
        ("1.6 m", "[gltf]", 0.0),
    ],
)
def test_what_show_mode_takes_is_planned_for_unless_written(
    separation, exports, tracking, tmp_path
):
    path = tmp_path / "show.yaml"
    head = SCRIPT.split("exports:", maxsplit=1)[0].replace("1.6 m", separation)
    path.write_text(f"{head}exports: {exports}\n")
    show = load_show(path).show
    assert show.tracking == tracking
    assert show.separation.distance == pytest.approx(1.6 + 2.0 * tracking)


def test_compile_writes_and_proves_what_a_script_asks_for(compiled):
    folder = compiled.parent
    manifest = json.loads((folder / "show-skyb" / "export.json").read_text())
    assert manifest["proved"] and manifest["fit"]["lead_s"] == 12.0
    assert manifest["rules"]["separation_flown"] == 1.5
    assert verify_export(folder / "show-skyb").passed
    assert (folder / "show-kml" / "show.kml").is_file()


@pytest.fixture
def beside(compiled, tmp_path):
    """A copy of the log and its exports, to be spoilt."""
    for name in ("show.mcap", "show-skyb", "show-kml", "show-crazyflie"):
        source = compiled.with_name(name)
        copy = shutil.copy if source.is_file() else shutil.copytree
        copy(source, tmp_path / name)
    return tmp_path / "show.mcap"


def failed(log, form=""):
    """Codes of checks that fail, of one format or of all."""
    found = (
        one
        for one in verify_beside(log, show_with_exports(log))
        if one.group.endswith(form)
    )
    return {check.code for check in found if check.verdict == "fail"}


def test_verify_of_a_log_proves_the_exports_beside_it(beside):
    checks = verify_beside(beside, show_with_exports(beside))
    assert failed(beside) == set()
    groups = {check.group for check in checks}
    assert groups == {"export kml", "export crazyflie", "export skyb"}
    off = next(check for check in checks if check.code == "VRF584")
    assert 0.0 < off.value <= off.limit == 0.01
    run = CliRunner().invoke(verify, [str(beside), "-q"], standalone_mode=False)
    assert "flights of the log" in run.output


def test_an_export_that_is_missing_is_a_fault(beside):
    shutil.rmtree(beside.with_name("show-kml"))
    assert failed(beside) == {"VRF583"}


def test_an_export_whose_manifest_was_made_to_agree_is_found_out(beside):
    """Files of another show, every hash right, rules that allow anything."""
    folder = beside.with_name("show-skyb")
    manifest = json.loads((folder / "export.json").read_text())
    one, other = sorted(folder.glob("*.skyb"))
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)
    for path in (one, other):
        manifest["files"][path.name] = sha256(path.read_bytes()).hexdigest()
    manifest["rules"]["separation"]["distance"] = 0.0
    (folder / "export.json").write_text(json.dumps(manifest))
    assert verify_export(folder).check("VRF581").verdict == "pass"
    assert failed(beside) >= {"VRF584"}


def test_an_export_of_fewer_flights_is_refused_before_they_are_proved(beside):
    folder = beside.with_name("show-skyb")
    manifest = json.loads((folder / "export.json").read_text())
    gone = min(folder.glob("*.skyb"))
    gone.unlink()
    del manifest["files"][gone.name]
    (folder / "export.json").write_text(json.dumps(manifest))
    checks = verify_beside(beside, show_with_exports(beside))
    checks = [one for one in checks if one.group == "export skyb"]
    assert [one.code for one in checks if one.verdict == "fail"] == ["VRF584"]
    assert "flights, the log" in checks[-1].notes[0]
    assert len(checks) == 2


def altered(log, form, name, change, words=len):
    """Codes that fail with a file and the manifest changed, and a hash that fits."""
    folder = log.with_name(f"{log.stem}-{form}")
    path = folder / name
    path.write_bytes(change(path.read_bytes()))
    manifest = json.loads((folder / "export.json").read_text())
    manifest["files"][name] = sha256(path.read_bytes()).hexdigest()
    words(manifest)
    (folder / "export.json").write_text(json.dumps(manifest))
    return failed(log, form)


@pytest.mark.parametrize(
    ("form", "name", "change"),
    [
        ("skyb", "showmode.parm", lambda text: text + b"FENCE_ENABLE,0\n"),
        ("kml", "show.kml", lambda text: text.replace(b"47.39", b"48.39")),
    ],
)
def test_what_an_export_says_besides_flights_is_of_the_log(beside, form, name, change):
    assert "VRF583" in altered(beside, form, name, change)


@pytest.mark.parametrize(
    "words",
    [
        lambda manifest: manifest.update(show="Another"),
        lambda manifest: manifest.update(more=1),
        lambda manifest: manifest["rules"].update(separation_flown=0.1),
        lambda manifest: manifest["fit"].update(position_error_m=0.0),
        lambda manifest: manifest["checks"][0].update(code="VRF999"),
        lambda manifest: manifest["checks"].clear(),
        lambda manifest: manifest.pop("cannot_carry"),
        lambda manifest: manifest.update(checks={"a": 1}),
    ],
)
def test_what_the_manifest_of_an_export_says_is_of_the_log(beside, words):
    same = lambda content: content  # noqa: E731
    assert altered(beside, "skyb", "showmode.parm", same) == set()
    assert altered(beside, "skyb", "showmode.parm", same, words) == {"VRF583"}


def test_what_lies_unseen_beside_an_export_is_found(beside):
    for make in (lambda path: path.mkdir(), lambda path: path.symlink_to("/nowhere")):
        make(beside.with_name("show-skyb") / "more")
        assert failed(beside) == {"VRF581"}
        shutil.rmtree(beside.with_name("show-skyb") / "more", ignore_errors=True)
        (beside.with_name("show-skyb") / "more").unlink(missing_ok=True)
    assert failed(beside) == set()


def packed_again(content, change, more):
    """The same archive, packed otherwise, with entries changed."""
    with zipfile.ZipFile(BytesIO(content)) as one:
        entries = [(name, change(name, one.read(name))) for name in one.namelist()]
    with patch("showc.export.skyc.LEVEL", 1):
        return archive([Entry.of(*entry) for entry in entries]) + more


@pytest.mark.parametrize(
    ("change", "more", "found"),
    [
        (lambda _, data: data, b"", set()),
        (lambda _, data: data, b"x", {"VRF583"}),
        (
            lambda _, data: data.replace(b'"orientation":', b'"orientation":1'),
            b"",
            {"VRF583"},
        ),
        (lambda _, data: data.replace(b'"return"', b'"none"'), b"", {"VRF583"}),
    ],
)
def test_a_show_file_is_of_the_log_however_it_is_packed(wished, change, more, found):
    assert codes(wished, "skyc") == set()

    def other(content):
        return packed_again(content, change, more)

    path = wished.with_name(f"{wished.stem}-skyc") / "show.skyc"
    assert other(path.read_bytes()) != path.read_bytes()
    assert altered(wished, "skyc", "show.skyc", other) == found


@pytest.fixture(scope="module")
def wished(tmp_path_factory):
    """A log that asks for every format with lights or yaw, and is without them yet."""
    folder = tmp_path_factory.mktemp("more")
    path, log = folder / "show.yaml", folder / "show.mcap"
    path.write_text(
        SCRIPT.split("exports:", maxsplit=1)[0] + f"exports: [{', '.join(MORE)}]\n"
    )
    arguments = [str(path), "-o", str(log), "--no-missions", "-q", "-j", "1"]
    run = CliRunner().invoke(command, arguments, standalone_mode=False)
    assert run.return_value == 0, run.output
    return log


def codes(log, form, **changed):
    """Failures of one format after it was written of a changed show."""
    source = {"log": log.name, "data_sha256": digest_of(log)}
    logged = read_log(log)
    show = replace(solved_show(logged, logged.read_script().show), **changed)
    folder = log.with_name(f"{log.stem}-{form}")
    options = ExportOptions.usual(form)
    export(show, source, form, folder, options)
    return failed(log, form)


@pytest.mark.parametrize("form", MORE)
def test_an_export_with_other_lights_is_found_out(wished, form):
    """Written by the export itself, of the same flight and log in other colours."""
    solved = solved_show(read_log(wished))
    assert codes(wished, form) == set()
    assert codes(wished, form, lights=solved.lights // 2) == {"VRF583", "VRF585"}
    late = solved.lights.copy()
    late[: late.shape[0] // 2] = 0
    assert codes(wished, form, lights=late) == {"VRF583", "VRF585"}


@pytest.mark.parametrize("form", ["skyc", "skyb"])
def test_an_export_with_another_yaw_is_found_out(wished, form):
    solved = solved_show(read_log(wished))
    turned = list(solved.flights)
    coefficients = turned[1].coefficients.copy()
    coefficients[-1, :, 3] += 0.02
    turned[1] = replace(turned[1], coefficients=coefficients)
    assert "VRF586" in codes(wished, form, flights=tuple(turned))


def test_an_export_of_another_log_is_found_out(beside):
    folder = beside.with_name("show-skyb")
    manifest = json.loads((folder / "export.json").read_text())
    manifest["source"]["data_sha256"] = "0" * 64
    (folder / "export.json").write_text(json.dumps(manifest))
    assert failed(beside) == {"VRF583"}


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("{", '{"proved": false,', 1),
        lambda text: text.replace('"distance"', '"distance": 0.2, "distance"', 1),
        lambda text: text.replace('"name": "', '"name": "un', 1),
        lambda text: text.replace('"group": "', '"group": "un', 1),
        lambda text: text.replace('"code": ', '"odd": 1, "code": ', 1),
        lambda text: text.replace('"format_version": 1', '"format_version": NaN', 1),
    ],
)
def test_an_export_whose_manifest_says_something_else_is_found_out(beside, change):
    path = beside.with_name("show-skyb") / "export.json"
    text = path.read_text()
    assert change(text) != text
    path.write_text(change(text))
    assert failed(beside, "skyb") != set()
    path.write_text(text, encoding="utf-16")
    assert failed(beside, "skyb") != set()


def make_pipe(path):
    path.unlink()
    os.mkfifo(path)


def make_folder(path):
    path.unlink()
    path.mkdir()


@pytest.mark.parametrize("change", [Path.unlink, make_pipe, make_folder])
def test_an_export_that_lacks_a_file_is_a_finding_among_others(beside, change):
    for path in beside.with_name("show-skyb").glob("*.skyb"):
        change(path)
    assert failed(beside) != set()
    groups = {one.group for one in verify_beside(beside, show_with_exports(beside))}
    assert groups == {"export kml", "export crazyflie", "export skyb"}


def test_an_export_that_cannot_be_listed_is_a_finding(beside, monkeypatch):
    closed, listed = beside.with_name("show-skyb"), Path.iterdir

    def iterdir(path):
        if path == closed:
            raise PermissionError(13, "Permission denied", str(path))
        return listed(path)

    monkeypatch.setattr(Path, "iterdir", iterdir)
    assert failed(beside) == {"VRF583"}


def test_an_export_that_cannot_be_read_is_a_finding(beside):
    (beside.with_name("show-skyb") / "export.json").write_text("[")
    assert failed(beside) != set()


def test_a_folder_with_more_than_an_export_is_not_replaced(beside):
    folder = beside.with_name("show-skyb")
    (folder / "diary.txt").write_text("mine")
    with pytest.raises(UsageError, match="diary"):
        refuse_foreign(folder)
    (folder / "diary.txt").unlink()
    refuse_foreign(folder)
    (folder / "export.json").write_text("{}")
    with pytest.raises(UsageError, match="something else"):
        refuse_foreign(folder)


def test_an_export_keeps_what_is_left_once_drones_have_strayed(tmp_path):
    path, log = tmp_path / "show.yaml", tmp_path / "show.mcap"
    path.write_text(
        SCRIPT.replace("1.6 m", "{distance: 3.8 m, tracking: 8 cm}").replace(
            "[kml, crazyflie, {to: skyb, separation: 1.5 m, lead: 12 s}]", "[skyc]"
        )
    )
    arguments = [str(path), "-o", str(log), "--no-missions", "-q", "-j", "1"]
    run = CliRunner().invoke(command, arguments, standalone_mode=False)
    assert run.return_value == 0, run.output
    assert failed(log) == set()
    manifest = json.loads((tmp_path / "show-skyc" / "export.json").read_text())
    assert manifest["rules"]["separation"]["distance"] == pytest.approx(3.8)
    assert manifest["rules"]["separation_flown"] == pytest.approx(3.8)


def test_an_archive_is_not_unpacked_beyond_what_is_wanted():
    packed = archive([Entry.of("one", bytes(1_000_000)), Entry.of("two", b"2")])
    assert len(packed) < 10_000
    assert [len(content) for _, content in entries_of(packed)] == [1_000_000, 1]
    assert entries_of(packed, 1_000_001)
    with pytest.raises(ValueError, match="more than 1,000,000 bytes"):
        entries_of(packed, 1_000_000)


def test_nothing_is_hidden_behind_an_entry_of_an_archive():
    one = Entry.of("one", b"1")
    assert entries_of(archive([one])) == [("one", b"1")]
    more = replace(one, packed=one.packed + b"evil")
    for wrong in (more, replace(one, size=2), replace(one, crc=1)):
        with pytest.raises(ValueError, match=r"^one is"):
            entries_of(archive([wrong]))
    with pytest.raises(ValueError, match="more than its entries"):
        entries_of(archive([one])[:-2] + b"\x04\0evil")


def test_an_archive_of_more_entries_than_a_zip_counts_is_refused():
    content = BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as packed:
        for number in range(1 << 16):
            packed.writestr(f"{number:05d}", b"")
    with pytest.raises(ValueError, match="format"):
        entries_of(content.getvalue(), 1)
