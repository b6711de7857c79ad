"""What is given mutated data: commands and readers, each in a process of its own."""

import hashlib
import io
import json
import logging
import os
import random
import resource
import shutil
import signal
import sys
import traceback
import zipfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fuzz import mutations
from fuzz.seeds import FILES, SHOWS, show_with
from repository import ROOT

from showc.__main__ import run
from showc.errors import ShowError

ANSWERS = {0, 1, 2}
"""Exit codes of a command that has understood, or said why not."""


@dataclass(frozen=True)
class Ending:
    """How one case ended."""

    fault: str
    """What is wrong with how it ended; empty if nothing is."""
    seconds: float
    """Processor time [s], start-up left out."""
    memory: float
    """Largest resident memory, the libraries included [bytes]."""


class Subject:
    """Something that reads data: makes cases, and tries one in a folder."""

    name = ""

    def prepare(self, folder):
        """Write what all cases share."""

    def case(self, chance):
        """The files of one case, by name."""
        raise NotImplementedError

    def attempt(self, folder, case):
        """Read a case; whatever escapes is a fault."""
        raise NotImplementedError


def command(*arguments):
    """Run a command; its exit code must be an answer, and no report may be left."""
    code = run(list(arguments))
    if code not in ANSWERS:
        report = Path("showc-crash.txt")
        raise AssertionError(report.read_text() if report.exists() else f"exit {code}")


class Scripts(Subject):
    """Mutated scripts, with sound files beside them, through ``check``."""

    name = "scripts"

    def prepare(self, folder):
        for name, make in FILES.items():
            (folder / name).write_bytes(make())

    def case(self, chance):
        return {"show.yaml": mutations.script(chance)}

    def attempt(self, folder, case):
        del folder, case
        command("check", "show.yaml")


class Inputs(Subject):
    """Sound scripts with mutated files, through ``check``."""

    name = "inputs"

    def __init__(self):
        self._seeds = {name: make() for name, make in FILES.items()}

    def case(self, chance):
        name = chance.choice(list(self._seeds))
        content = mutations.data(self._seeds[name], chance)
        return {name: content, "show.yaml": show_with(name)}

    def attempt(self, folder, case):
        del folder, case
        command("check", "show.yaml")


def compiled(folder):
    """A small show, compiled once for all cases."""
    log = folder / "compiled" / "swap.mcap"
    if not log.exists():
        done = run(
            ["compile", str(ROOT / "shows" / "swap.yaml"), "-o", str(log), "-q"]
            + ["--cache-dir", str(folder / "cache"), "--jobs", "1"]
        )
        assert done == 0
    return log


class Logs(Subject):
    """Mutated logs through ``verify`` and the reader of the viewers."""

    name = "logs"

    def prepare(self, folder):
        self._log = compiled(folder).read_bytes()

    def case(self, chance):
        return {"show.mcap": mutations.data(self._log, chance)}

    def attempt(self, folder, case):
        del case
        command("verify", "show.mcap", "--jobs", "1", "-q")
        command("view", str(folder / "show.mcap"), "-o", str(folder / "show.html"))


class Missions(Subject):
    """A sound log with mutated files beside it, through ``verify`` and the upload."""

    name = "missions"

    def prepare(self, folder):
        log = compiled(folder)
        shutil.copy(log, folder / "show.mcap")
        self._files = {
            str(path.relative_to(log.parent / "swap")): path.read_bytes()
            for path in (log.parent / "swap").rglob("*")
            if path.is_file()
        }

    def case(self, chance):
        files = dict(self._files)
        name = chance.choice(list(files))
        files[name] = mutations.data(files[name], chance)
        if chance.random() < 0.5 and name != "manifest.json":
            # As somebody would who knows the format: the hash is made right.
            manifest = json.loads(files["manifest.json"])
            digest = hashlib.sha256(files[name]).hexdigest()
            manifest["missions"]["files"][name] = digest
            files["manifest.json"] = json.dumps(manifest).encode()
        return {f"show/{name}": content for name, content in files.items()}

    def attempt(self, folder, case):
        from showc.vehicle_link.folder import read_fleet

        del case
        with suppress(ShowError):
            read_fleet(folder / "show")
        command("verify", "show.mcap", "--jobs", "1", "-q")


class Caches(Subject):
    """Mutated entries of the cache, their checksums made right."""

    name = "caches"

    def prepare(self, folder):
        from showc.plan import build_itinerary
        from showc.progress import Silent
        from showc.script import load_show

        compiled(folder)
        self._show = load_show(ROOT / "shows" / "swap.yaml").show
        self._legs = build_itinerary(self._show, Silent()).legs
        self._entries = sorted((folder / "cache").rglob("*.leg"))
        self._contents = [path.read_bytes() for path in self._entries]

    def case(self, chance):
        content = chance.choice(self._contents)
        if chance.random() < 0.2:
            return {"entry": mutations.data(content, chance)}
        with np.load(io.BytesIO(content[40:])) as arrays:
            kept = {name: np.array(arrays[name]) for name in arrays}
        name = chance.choice(list(kept))
        match chance.randrange(5):
            case 0:
                del kept[name]
            case 1:
                kept[name] = kept[name][:-1] if kept[name].ndim else kept[name]
            case 2:
                other = chance.choice(list(kept))
                kept[name] = kept[other]
            case 3 if name != "note":
                flat = kept[name].reshape(-1)
                flat[chance.randrange(flat.size)] = chance.choice([0, -1, 10**6])
            case _:
                changed = mutations.data(kept["note"].tobytes(), chance)
                kept["note"] = np.frombuffer(changed, dtype=np.uint8)
        stream = io.BytesIO()
        np.savez(stream, **kept)
        payload = stream.getvalue()
        return {"entry": b"showcleg" + hashlib.sha256(payload).digest() + payload}

    def attempt(self, folder, case):
        from showc.fleet.execution.cache import Cache
        from showc.fleet.proof import flaw

        key = "ab" * 32
        path = folder / "mine" / "ab" / f"{key}.leg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(case["entry"])
        for leg in self._legs:
            flight = Cache(folder / "mine", 10**9).find(key, leg)
            if flight is not None:
                flaw(flight, self._show)


class Messages(Subject):
    """Mutated datagrams to the ground's end of a link."""

    name = "messages"

    def prepare(self, folder):
        from pymavlink.dialects.v20 import ardupilotmega as m

        from showc.vehicle_link.frames import Codec

        del folder
        codec = Codec()
        self._frames = [
            codec.pack(message)
            for message in (
                m.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3),
                m.MAVLink_mission_request_int_message(255, 190, 3, 0),
                m.MAVLink_mission_ack_message(255, 190, 0, 0),
                m.MAVLink_param_value_message(b"WPNAV_SPEED", 500.0, 9, 900, 3),
                m.MAVLink_statustext_message(6, b"PreArm: no"),
                m.MAVLink_local_position_ned_message(9, 1, 2, 3, 4, 5, 6),
                m.MAVLink_autopilot_version_message(
                    1, 2, 3, 4, 5, *[b"12345678"] * 3, 1, 2, 3
                ),
            )
        ]

    def case(self, chance):
        stream = b"".join(chance.choices(self._frames, k=chance.randint(1, 30)))
        return {"datagrams": mutations.data(stream, chance, self._frames)}

    def attempt(self, folder, case):
        from showc.vehicle_link.frames import Codec, Framer

        del folder
        chance = random.Random(len(case["datagrams"]))
        for key in (None, b"k" * 32):
            codec = Codec(key)
            framer = Framer(codec)
            rest = case["datagrams"]
            while rest:
                size = chance.randint(1, 600)
                for _, frame in framer.feed(rest[:size]):
                    codec.trusted(frame)
                rest = rest[size:]


class Shows(Subject):
    """Mutated shows of others, packed soundly, through ``verify`` and ``import``."""

    name = "shows"

    def case(self, chance):
        name = chance.choice(list(SHOWS))
        content = mutations.data(SHOWS[name](), chance, [b"[]", b"{}", b"null", b"1e9"])
        if name.endswith((".skyc", ".zip")) and chance.random() < 0.9:
            stream = io.BytesIO()
            with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
                inner = "show.json" if name.endswith(".skyc") else "d1.csv"
                archive.writestr(inner, content)
            content = stream.getvalue()
        return {name: content}

    def attempt(self, folder, case):
        del folder
        (name,) = case
        command("verify", name)
        command("import", name, "-o", "show.yaml")


SUBJECTS = {
    kind.name: kind
    for kind in (Scripts, Inputs, Logs, Missions, Caches, Messages, Shows)
}


def tried(subject, folder, case, limit=30):
    """Try a case in a copy of this process, under limits; how it ended."""
    for name, content in case.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    said = folder / "said.txt"
    sys.stdout.flush()
    sys.stderr.flush()
    process = os.fork()
    if process == 0:
        _child(subject, folder, case, limit, said)
    _, status, used = os.wait4(process, 0)
    code = os.waitstatus_to_exitcode(status)
    fault = ""
    if code in {-signal.SIGXCPU, -signal.SIGKILL}:
        fault = f"more than {limit} s"
    elif code:
        fault = f"ended with {code}: " + said.read_text(errors="replace")[-3000:]
    elif "Traceback" in (text := said.read_text(errors="replace")):
        fault = text[-3000:]
    unit = 1 if sys.platform == "darwin" else 1024
    return Ending(fault, used.ru_utime + used.ru_stime, used.ru_maxrss * unit)


def _child(subject, folder, case, limit, said):
    status = 1
    try:
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 1))
        os.chdir(folder)
        descriptor = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(descriptor, 1)
        os.dup2(descriptor, 2)
        sys.stdout, sys.stderr = (os.fdopen(number, "w") for number in (1, 2))
        # What is logged is told to standard error, as in the command.
        logging.root.handlers.clear()
        subject.attempt(folder, case)
        status = 0
    except BaseException:  # noqa: BLE001 - all of it is told
        os.write(2, traceback.format_exc().encode(errors="replace"))
    finally:
        try:
            sys.stdout.flush()
            sys.stderr.flush()
        finally:
            os._exit(status)
