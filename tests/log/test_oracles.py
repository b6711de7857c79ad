"""Readers that others wrote agree with ours: TypeScript, Rust, Python."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

PACKAGES = ("@mcap/core@2", "@mcap/support@1")
SCRIPT = Path(__file__).parent / "read_with_mcap_core.cjs"


@pytest.fixture(scope="session")
def mcap_core():
    """Runs the TypeScript reader; its packages are fetched once a machine."""
    if not (shutil.which("node") and shutil.which("npm")):
        pytest.skip("node and npm are not installed")
    folder = Path(tempfile.gettempdir()) / f"showc-mcap-core-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    if not (folder / "node_modules" / "@mcap" / "support").exists():
        command = ["npm", "install", "--no-audit", "--no-fund", "--prefix", folder]
        fetched = subprocess.run(
            [*command, *PACKAGES], capture_output=True, text=True, check=False
        )
        if fetched.returncode:
            pytest.skip(f"npm cannot fetch {PACKAGES}: {fetched.stderr[-200:]}")
    script = folder / SCRIPT.name
    shutil.copyfile(SCRIPT, script)

    def run(path: Path) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["node", script, path], capture_output=True, text=True, check=False
        )

    return run


def test_mcap_core_reads_everything(mcap_core, gliding_bytes, gliding_log, tmp_path):
    path = tmp_path / "show.mcap"
    path.write_bytes(gliding_bytes)
    result = mcap_core(path)
    assert result.returncode == 0, result.stderr
    found = json.loads(result.stdout)
    assert found["streamed"] == found["counts"]
    assert sum(found["counts"].values()) == found["statistics"]
    assert found["counts"]["/fleet/state"] == gliding_log.times.size
    assert found["counts"]["/drone/0016/trajectory"] == len(gliding_log.segments)
    assert [name for name, _ in found["attachments"]] == list(gliding_log.attachments)
    assert found["header"]["profile"] == ""
    assert found["rules"]["duration"] == gliding_log.duration
    assert found["fields"][:4] == [
        ["x", 0, 7],
        ["y", 4, 7],
        ["z", 8, 7],
        ["red", 12, 1],
    ]
    assert np.array_equal(found["positions"], gliding_log.positions[-1])
    last = gliding_log.samples[-1, 0]
    assert found["state"]["thrust"] == last["u0"]
    assert found["state"]["position"]["y"] == last["y"]


def test_mcap_core_sees_damage(mcap_core, gliding_bytes, tmp_path):
    damaged = bytearray(gliding_bytes)
    damaged[len(damaged) // 2] ^= 0x10
    path = tmp_path / "damaged.mcap"
    path.write_bytes(damaged)
    assert mcap_core(path).returncode != 0


def test_python_mcap_decodes_every_message(vertical_bytes, vertical_log):
    reader = make_reader(
        BytesIO(vertical_bytes),
        validate_crcs=True,
        decoder_factories=[DecoderFactory()],
    )
    fleet = []
    for _, channel, _, decoded in reader.iter_decoded_messages():
        assert decoded is not None
        if channel.topic == "/fleet/state":
            fleet.append(np.frombuffer(decoded.data, dtype="<f4").reshape(4, 18)[:, :3])
    assert np.array_equal(np.stack(fleet), vertical_log.positions)


def test_rerun_finds_nothing_to_complain_about(gliding_bytes, tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is not installed (extra 'viewers')")
    path = tmp_path / "show.mcap"
    path.write_bytes(gliding_bytes)
    command = [Path(sys.executable).with_name("rerun"), "mcap", "check", path]
    result = subprocess.run(
        command, capture_output=True, text=True, timeout=60, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    damaged = bytearray(gliding_bytes)
    damaged[len(damaged) // 2] ^= 0x10
    path.write_bytes(damaged)
    result = subprocess.run(command, capture_output=True, timeout=60, check=False)
    assert result.returncode != 0
