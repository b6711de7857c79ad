"""Every command in the document on vehicles runs, with vehicles that answer."""

import json
import re
import shlex
from contextlib import ExitStack
from hashlib import sha256

import pytest
from mission.flights import START, hop_flight
from repository import ROOT
from vehicle_link.test_compare import fly_missions
from vehicle_link.test_stream import fleet
from vehicle_link.vehicle import free_port

from showc.log.writer import write_log
from showc.mission import mission_files

PAGE = ROOT / "showc" / "docs" / "vehicles.md"
COMMANDS = re.findall(r"^    showc (.+)$", PAGE.read_text("utf-8"), re.MULTILINE)


@pytest.fixture
def folder(tmp_path):
    """What ``showc compile`` writes, and the cards of a flight of it."""
    flight = hop_flight(3)
    made = mission_files(flight, start=START)
    listed = {name: sha256(data).hexdigest() for name, data in made.files.items()}
    manifest = {
        "fleet": made.fleet_token,
        "missions": {
            "autopilot": "ardupilot",
            "files": listed,
            "prediction": made.prediction,
        },
    }
    content = json.dumps(manifest).encode()
    log = tmp_path / "output.mcap"
    write_log(flight, log, manifest=content, predicted=made.predicted)
    (tmp_path / "output" / "missions").mkdir(parents=True)
    (tmp_path / "output" / "manifest.json").write_bytes(content)
    for name, data in made.files.items():
        (tmp_path / "output" / name).write_bytes(data)
    fly_missions(tmp_path / "logs", log)
    return tmp_path


@pytest.mark.slow
def test_commands_run(folder, run_showc):
    assert len(COMMANDS) >= 5
    flight = hop_flight(3)
    for line in COMMANDS:
        port = free_port()
        words = shlex.split(line.replace("0.0.0.0:14550", f"127.0.0.1:{port}"))
        with ExitStack() as stack:
            for vehicle in fleet(flight, port):
                stack.enter_context(vehicle)
            if words[0] == "stream":
                # A busy machine delays what would be late in an earnest flight.
                words += ["--link-timeout", "20"]
            run = run_showc(*words, cwd=folder)
        assert run.code == 0, f"showc {line}\n{run.out}\n{run.err}"
    assert (folder / "flight.html").exists()
    assert (folder / "output-flown.mcap").exists()
