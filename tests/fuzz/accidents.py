"""Accidents: commands that are ended at many instants, and disks that fill up.

``python tests/fuzz/accidents.py [--instants N]`` tries each command and signal at so
many instants of its life; the tests try a few.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from repository import ROOT
from vehicle_link.vehicle import Vehicle, free_port

from showc.geodesy import SiteFrame
from showc.script import load_show
from showc.vehicle_link.flown import read_flown

PATIENCE = 2.0
"""After which nothing of a killed command runs any more [s]."""
SIGNALS = {
    "SIGKILL": -signal.SIGKILL,
    "SIGTERM": 130,
    "SIGINT": 130,
}
"""Signals, and the exit code that a command ends with that hears them."""
FULL = """
import errno, os, sys
from pathlib import Path

left = int(sys.argv[1])

def limited(real, writes=lambda *given: True, once=False):
    def call(*given, **named):
        global left
        if writes(*given, *named.values()):
            left -= 1
            if left == -1 or left < 0 and not once:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(*given, **named)
    return call

os.fsync, os.mkdir = limited(os.fsync), limited(os.mkdir)
Path.open = limited(Path.open, lambda path, mode="r", *_: "w" in mode)
for name in ("mkdir", "touch"):
    setattr(Path, name, limited(getattr(Path, name)))
# The way back of a rename needs no more room than its way there has freed.
for name in ("replace", "rename"):
    setattr(Path, name, limited(getattr(Path, name), once=True))
from showc.__main__ import run
code = run(sys.argv[2:])
print("FULL" if left < 0 else "FREE", file=sys.stderr)
sys.exit(code)
"""
"""Runs a command on a disk that is full after as many steps that write as said."""
PAIR = """showc: 1
name: Pair
drones: 2
pads: {type: grid, step: 4}
formations:
  it: {type: line, spacing: 4, centre: [0, 6, 12]}
transitions: [it]
"""
ABLE = {
    "WPNAV_SPEED": 1500.0,
    "WPNAV_SPEED_UP": 600.0,
    "WPNAV_SPEED_DN": 600.0,
    "WPNAV_ACCEL": 500.0,
    "WPNAV_ACCEL_Z": 500.0,
    "ANGLE_MAX": 4500.0,
    "PSC_JERK_XY": 20.0,
    "PSC_JERK_Z": 20.0,
}
"""Parameters with which a vehicle follows a show."""


def contents(folder):
    """Every file of a folder, by its path, with what it holds."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def running(word):
    """Numbers of the processes that carry a word in their environment."""
    found = set()
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            state = (folder / "stat").read_text().rpartition(")")[2].split()[0]
            if state != "Z" and word in (folder / "environ").read_bytes():
                found.add(int(folder.name))
        except OSError:
            continue
    return found


class Accident:
    """A command over former results, to be ended early.

    Parameters
    ----------
    folder
        Where it works; its results lie in ``folder/out``.
    arguments
        Of showc.
    """

    def __init__(self, folder, arguments):
        self.folder, self.arguments = folder, arguments
        self.out = folder / "out"
        self.out.mkdir(parents=True, exist_ok=True)
        self.mark = f"SHOWC_MARK={folder}"

    def begin(self, steps=None):
        """Start the command in a session of its own; on a full disk after steps."""
        name, _, word = self.mark.partition("=")
        how = ["-m", "showc"] if steps is None else ["-c", FULL, str(steps)]
        return subprocess.Popen(
            [sys.executable, *how, *self.arguments],
            cwd=ROOT,
            env={**os.environ, name: word, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )

    def whole(self):
        """Run the command to its end; return how long it took [s]."""
        begun = time.monotonic()
        process = self.begin()
        _, said = process.communicate(timeout=600)
        assert process.returncode == 0, said
        return time.monotonic() - begun

    def fill(self, steps, answers=(0, 2)):
        """Run it on a disk that fills up: whether it did, and what is wrong then."""
        process = self.begin(steps)
        _, said = process.communicate(timeout=600)
        full = b"FULL" in said
        if process.returncode in answers and b"Traceback" not in said:
            if full and b"No space left on device" not in said:
                return full, ["a full disk is not mentioned"]
            return full, []
        return full, [f"ended with {process.returncode}: {said[-800:]!r}"]

    def end(self, name, delay, answers=()):
        """End the command by a signal after a while; return what is wrong then."""
        process = self.begin()
        try:
            process.wait(delay)
        except subprocess.TimeoutExpired:
            process.send_signal(getattr(signal, name))
        faults = []
        try:
            _, said = process.communicate(timeout=60)
        except subprocess.TimeoutExpired:
            said = b""
            faults.append(f"still there after a minute, ended: {process.poll()}")
        # Python itself ends so where an interrupt fell into code made from text.
        early = {0, SIGNALS[name], -getattr(signal, name), -signal.SIGINT, *answers}
        if process.returncode not in early:
            faults.append(f"ended with {process.returncode}: {said[-500:]!r}")
        if process.returncode == SIGNALS[name] and b"Traceback" in said:
            faults.append(said[-500:].decode(errors="replace"))
        limit = time.monotonic() + PATIENCE
        while (left := running(self.mark.encode())) and time.monotonic() < limit:
            time.sleep(0.02)
        if left:
            faults.append(f"{len(left)} processes live on")
            for number in left:
                os.kill(number, signal.SIGKILL)
        return faults


def compile_again(folder, instants, names=tuple(SIGNALS)):
    """End a compile over former results at many instants; yield what is wrong."""
    script = folder / "swap.yaml"
    text = (ROOT / "shows" / "swap.yaml").read_text()
    script.write_text(text)
    out = folder / "out" / "show.mcap"
    arguments = ["compile", str(script), "-o", str(out), "-q", "--no-cache", "-j", "2"]
    accident = Accident(folder, arguments)
    accident.whole()
    first = contents(accident.out)
    # The same show under another name: other bytes, as many processes.
    script.write_text(text.replace("name: ", "name: New "))
    span = accident.whole()
    second = contents(accident.out)
    assert first.keys() == second.keys() and first != second
    for number in range(instants):
        name = names[number % len(names)]
        delay = span * 1.05 * (number + 0.5) / instants
        for fault in accident.end(name, delay):
            yield f"compile, {name} after {delay:.2f} s: {fault}"
        left = {
            path: content
            for path, content in contents(accident.out).items()
            if not path.startswith(".")
        }
        if left not in (first, second):
            yield f"compile, {name} after {delay:.2f} s: results are not whole"
    accident.whole()
    if contents(accident.out) != second:
        names = sorted(contents(accident.out))
        yield f"compile: after the next run there is {names}"


def compile_when_full(folder, instants):
    """Compile over former results on a disk that fills up; yield what is wrong."""
    script = folder / "pair.yaml"
    script.write_text(PAIR)
    out = folder / "out" / "show.mcap"
    arguments = ["compile", str(script), "-o", str(out), "-q", "--no-cache", "-j", "1"]
    accident = Accident(folder, arguments)
    accident.whole()
    before = contents(accident.out)
    script.write_text(PAIR.replace("Pair", "Two"))
    for steps in range(instants):
        full, faults = accident.fill(steps)
        yield from (f"compile, disk full after {steps} steps: {it}" for it in faults)
        if not full:
            break
        if contents(accident.out) != before:
            yield f"compile, disk full after {steps} steps: the former are not whole"
    if instants > 30 and contents(accident.out).keys() != before.keys():
        yield f"compile: after the next run there is {sorted(contents(accident.out))}"


def verify_again(folder, instants, names=tuple(SIGNALS)):
    """End a verification at many instants; yield what is wrong."""
    out = folder / "out" / "show.mcap"
    script = str(ROOT / "shows" / "swap.yaml")
    Accident(folder, ["compile", script, "-o", str(out), "-q", "-j", "2"]).whole()
    accident = Accident(folder, ["verify", str(out), "-q", "-j", "2"])
    before = contents(accident.out)
    span = accident.whole()
    for number in range(instants):
        name = names[number % len(names)]
        delay = span * (number + 0.5) / instants
        for fault in accident.end(name, delay):
            yield f"verify, {name} after {delay:.2f} s: {fault}"
    if contents(accident.out) != before:
        yield "verify: it has left or changed files"


@contextmanager
def flying(script, port):
    """Vehicles on the pads of a show, in the wall's time."""
    show = load_show(script).show
    frame = SiteFrame.of(show.site)
    origin = (show.site.latitude, show.site.longitude, show.site.altitude)
    with ExitStack() as stack:
        for index, pad in enumerate(show.formations["pads"].points):
            east, north, up = frame.to_enu(pad)
            vehicle = Vehicle(
                port,
                index + 1,
                origin=origin,
                stands=(north, east, -up),
                parameters=ABLE,
            )
            stack.enter_context(vehicle)
        yield


def linked(folder, command, more=()):
    """Compile a pair; an accident of a command on a link, its script and its port."""
    script = folder / "pair.yaml"
    script.write_text(PAIR)
    made = folder / "made" / "show.mcap"
    made.parent.mkdir()
    Accident(folder, ["compile", str(script), "-o", str(made), "-q", "-j", "1"]).whole()
    port = free_port()
    what = made if command == "stream" else made.with_suffix("")
    link = ["--connect", f"udpin:127.0.0.1:{port}", "-q"]
    return Accident(folder, [command, str(what), *link, *more]), script, port


def upload_again(folder, instants, names=tuple(SIGNALS)):
    """End uploads at many instants, and fill the disk; yield what is wrong."""
    record = folder / "out" / "audit.json"
    accident, script, port = linked(folder, "upload", ["--audit", str(record)])
    with flying(script, port):
        accident.whole()
        span = accident.whole()
    for number in range(instants):
        before = json.loads(record.read_bytes())["uploads"]
        name = names[number % len(names)]
        delay = span * (number + 0.5) / instants
        with flying(script, port):
            for fault in accident.end(name, delay):
                yield f"upload, {name} after {delay:.2f} s: {fault}"
        if json.loads(record.read_bytes())["uploads"][: len(before)] != before:
            yield f"upload, {name} after {delay:.2f} s: the record has lost uploads"
    for steps in range(instants):
        before = record.read_bytes()
        with flying(script, port):
            full, faults = accident.fill(steps)
        yield from (f"upload, disk full after {steps} steps: {it}" for it in faults)
        if not full:
            break
        if record.read_bytes() != before:
            yield f"upload, disk full after {steps} steps: the record has changed"
    with flying(script, port):
        accident.whole()
    if contents(accident.out).keys() != {record.name}:
        yield f"upload: after the next run there is {sorted(contents(accident.out))}"


def stream_again(folder, instants, names=tuple(SIGNALS)):
    """End streams at many instants, and fill the disk; yield what is wrong."""
    flown = folder / "out" / "flown.mcap"
    accident, script, port = linked(folder, "stream", ["--flown", str(flown)])
    with flying(script, port):
        span = accident.whole()
    for number in range(instants):
        before = flown.read_bytes()
        name = names[number % len(names)]
        delay = span * (number + 0.5) / instants
        with flying(script, port):
            # A stream that hears a signal brings the fleet to rest, and says so by 1.
            for fault in accident.end(name, delay, {1}):
                yield f"stream, {name} after {delay:.2f} s: {fault}"
        if flown.read_bytes() != before and name == "SIGKILL":
            yield f"stream, {name} after {delay:.2f} s: the former log has changed"
    for steps in range(min(instants, 12)):
        before = flown.read_bytes()
        with flying(script, port):
            full, faults = accident.fill(steps)
        yield from (f"stream, disk full after {steps} steps: {it}" for it in faults)
        if not full:
            break
        if flown.read_bytes() != before:
            yield f"stream, disk full after {steps} steps: the former has changed"
    with flying(script, port):
        accident.whole()
    if contents(accident.out).keys() != {flown.name} or len(read_flown(flown)) != 2:
        yield f"stream: after the next run there is {sorted(contents(accident.out))}"


CAMPAIGNS = (
    compile_again,
    compile_when_full,
    verify_again,
    upload_again,
    stream_again,
)


def main():
    """Run all campaigns."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instants", type=int, default=100)
    known = {campaign.__name__: campaign for campaign in CAMPAIGNS}
    parser.add_argument("campaigns", nargs="*", choices=[*known, []])
    given = parser.parse_args()
    faults = 0
    for campaign in [known[name] for name in given.campaigns] or CAMPAIGNS:
        with tempfile.TemporaryDirectory() as place:
            found = list(campaign(Path(place), given.instants))
        print(*found, sep="\n")
        print(f"{campaign.__name__}: {given.instants} instants, {len(found)} faults")
        faults += len(found)
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
