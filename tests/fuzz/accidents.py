"""Accidents: commands that are ended at many instants, and disks that fill up.

``python tests/fuzz/accidents.py [--instants N] [--accidents NAME ...] [COMMAND ...]``
tries each command with each accident at so many instants of its life; the tests try a
few.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from repository import ROOT, running
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
FULL = "full"
"""The accident that fills the disk at an instant."""
ROOM = 64 * 2**20
"""Size of the disk that is filled [bytes]: several times what a command needs."""
EVERY = 10
"""After how many instants the next run is let go to its end."""
STEPS = """
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
launch: {altitude: 3}
landing: {altitude: 3}
formations:
  it: {type: line, spacing: 4, centre: [0, 3, 5]}
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
    """Every file of a folder, by its path, with what it holds; hidden ones left out."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    }


class Command:
    """A command over former results, to be ended early.

    Parameters
    ----------
    folder
        Where it works: its results lie in ``out``, its cache in ``cache``, what is
        temporary in ``tmp``.
    """

    name = ""
    full_answers = (0, 2)
    """Exit codes on a full disk."""
    signal_answers = ()
    """Further exit codes of one that heard a signal."""

    def __init__(self, folder):
        self.folder = folder
        self.out = folder / "out"
        for name in ("out", "cache", "tmp"):
            (folder / name).mkdir(parents=True)
        self.mark = f"SHOWC_MARK={folder}"
        self.arguments = self.prepare()

    def prepare(self):
        """Make the former results; return the arguments."""
        raise NotImplementedError

    def world(self):
        """What must be there while it runs."""
        return nullcontext()

    def renew(self):
        """Make ready for another run."""

    def broken(self, before):
        """Say what is wrong with the former results, empty if nothing."""
        now = contents(self.out)
        return "" if now == before else f"there is {sorted(now)}, not as before"

    def begin(self, arguments=None, steps=None):
        """Start it in a session of its own; on a full disk after steps."""
        name, _, word = self.mark.partition("=")
        how = ["-m", "showc"] if steps is None else ["-c", STEPS, str(steps)]
        return subprocess.Popen(
            [sys.executable, *how, *(arguments or self.arguments)],
            cwd=self.folder,
            env={
                **os.environ,
                name: word,
                "PYTHONPATH": str(ROOT),
                "TMPDIR": str(self.folder / "tmp"),
                "XDG_CACHE_HOME": str(self.folder / "cache"),
            },
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )

    def whole(self, arguments=None):
        """Run it to its end; return how long it took [s]."""
        self.renew()
        with self.world():
            begun = time.monotonic()
            process = self.begin(arguments)
            _, said = process.communicate(timeout=600)
        assert process.returncode == 0, said
        return time.monotonic() - begun

    def litter(self):
        """What is left after a run to the end that should not be."""
        hidden = list(self.out.rglob(".*"))
        kept = list((self.folder / "cache").rglob("*.showc-part*"))
        return [
            path.relative_to(self.folder).as_posix()
            for path in (*hidden, *kept, *(self.folder / "tmp").iterdir())
        ]

    def _ended(self, process, patience):
        """Wait; return what is wrong with how long it took, and what it said."""
        faults = []
        try:
            _, said = process.communicate(timeout=patience)
        except subprocess.TimeoutExpired:
            said = b""
            faults.append(f"still there after {patience} s, ended: {process.poll()}")
            process.kill()
        limit = time.monotonic() + PATIENCE
        while (left := running(self.mark.encode())) and time.monotonic() < limit:
            time.sleep(0.02)
        if left:
            faults.append(f"{len(left)} processes live on")
            for number in left:
                with suppress(ProcessLookupError):
                    os.kill(number, signal.SIGKILL)
        return faults, said

    def full(self, code, said):
        """Judge the answer of a run on a disk that may have been full."""
        if code not in self.full_answers or b"Traceback" in said:
            return [f"ended with {code}: {said[-1500:]!r}"]
        if code and b"No space left on device" not in said:
            return [f"a full disk is not mentioned: {said[-500:]!r}"]
        return []

    def fill_after(self, steps):
        """Run it on a disk that fills up by steps: whether it did, what is wrong."""
        self.renew()
        with self.world():
            process = self.begin(steps=steps)
            faults, said = self._ended(process, 600)
        if b"FULL" in said and b"No space left on device" not in said:
            faults.append("a full disk is not mentioned")
        return b"FULL" in said, faults + self.full(process.returncode, said)

    def fill(self, delay):
        """Fill its disk after a while; return what is wrong then."""
        self.renew()
        filler = self.folder / "filler"
        with self.world():
            process = self.begin()
            with suppress(subprocess.TimeoutExpired):
                process.wait(delay)
            with filler.open("wb", buffering=0) as stream, suppress(OSError):
                while stream.write(bytes(2**16)):
                    pass
            faults, said = self._ended(process, 600)
        filler.unlink()
        return faults + self.full(process.returncode, said)

    def end(self, name, delay):
        """End it by a signal after a while; return what is wrong then."""
        self.renew()
        with self.world():
            process = self.begin()
            try:
                process.wait(delay)
            except subprocess.TimeoutExpired:
                process.send_signal(getattr(signal, name))
            faults, said = self._ended(process, 60)
        code = process.returncode
        # Python itself ends so where an interrupt fell into code made from text.
        early = {SIGNALS[name], -getattr(signal, name), -signal.SIGINT}
        if code not in {0, *early, *self.signal_answers}:
            faults.append(f"ended with {code}: {said[-500:]!r}")
        if code == SIGNALS[name] and b"Traceback" in said:
            faults.append(said[-500:].decode(errors="replace"))
        return faults


class Compile(Command):
    """A compile with a cache, over the results of another script."""

    name = "compile"

    def prepare(self):
        self._script = self.folder / "show.yaml"
        self._texts = [PAIR.replace("Pair", word) for word in ("Old", "New")]
        log = self.out / "show.mcap"
        arguments = ["compile", str(self._script), "-o", str(log), "-q", "-j", "2"]
        self._results = []
        for text in self._texts:
            self._script.write_text(text)
            self.whole(arguments)
            self._results.append(contents(self.out))
        first, second = self._results
        assert first.keys() == second.keys()
        assert first != second
        self._number = 0
        return arguments

    def renew(self):
        # What is solved already would be over at once; what is half written stays.
        for path in (self.folder / "cache").rglob("*.leg"):
            path.unlink()
        for path in (self.folder / "cache").rglob("*.parts"):
            shutil.rmtree(path)
        if hasattr(self, "_number"):
            self._number += 1
            self._script.write_text(self._texts[self._number % 2])

    def broken(self, before):
        del before
        now = contents(self.out)
        return "" if now in self._results else f"there is {sorted(now)}, not whole"


class Verify(Command):
    """A verification that writes its report over a former one."""

    name = "verify"

    def prepare(self):
        script, log = self.folder / "show.yaml", self.out / "show.mcap"
        script.write_text(PAIR)
        self.whole(["compile", str(script), "-o", str(log), "-q", "-j", "2"])
        report = ["--json", "--output", str(self.out / "report.json")]
        arguments = ["verify", str(log), "-q", "-j", "2", *report]
        self.whole(arguments)
        return arguments


class Linked(Command):
    """A command on a link to two vehicles."""

    def prepare(self):
        self._script = self.folder / "pair.yaml"
        self._script.write_text(PAIR)
        made = self.folder / "made" / "show.mcap"
        made.parent.mkdir()
        self.port = 0
        self.whole(["compile", str(self._script), "-o", str(made), "-q", "-j", "1"])
        self.port = free_port()
        link = ["--connect", f"udpin:127.0.0.1:{self.port}", "-q"]
        what, more = self.object(made)
        return [self.name, str(what), *link, *more]

    @contextmanager
    def world(self):
        if not self.port:
            yield
            return
        show = load_show(self._script, allow_outside=True).show
        frame = SiteFrame.of(show.site)
        origin = (show.site.latitude, show.site.longitude, show.site.altitude)
        with ExitStack() as stack:
            for index, pad in enumerate(show.formations["pads"].points):
                east, north, up = frame.to_enu(pad)
                vehicle = Vehicle(
                    self.port,
                    index + 1,
                    origin=origin,
                    stands=(north, east, -up),
                    parameters=ABLE,
                )
                stack.enter_context(vehicle)
            yield


class Upload(Linked):
    """An upload that adds to a record."""

    name = "upload"

    def object(self, made):
        self._record = self.out / "audit.json"
        return made.with_suffix(""), ["--audit", str(self._record)]

    def broken(self, before):
        was = json.loads(before[self._record.name])["uploads"] if before else []
        now = json.loads(self._record.read_bytes())["uploads"]
        return "" if now[: len(was)] == was else "the record has lost uploads"


class Stream(Linked):
    """A flight whose record replaces a former one."""

    name = "stream"
    # One that hears a signal brings the fleet to rest, and says so by 1.
    signal_answers = (1,)

    def object(self, made):
        self._flown = self.out / "flown.mcap"
        return made, ["--flown", str(self._flown)]

    def broken(self, before):
        if contents(self.out).keys() - before.keys():
            return f"there is {sorted(contents(self.out))}"
        return "" if len(read_flown(self._flown)) == 2 else "the record is not whole"


COMMANDS = {kind.name: kind for kind in (Compile, Verify, Upload, Stream)}


def campaign(command, accidents, instants):
    """Let accidents in turn befall a command at many instants; yield what is wrong."""
    span = command.whole()
    for number in range(instants):
        accident = accidents[number % len(accidents)]
        delay = span * 1.05 * (number + 0.5) / instants
        what = f"{command.name}, {accident} after {delay:.2f} s"
        before = contents(command.out)
        if accident == FULL:
            found = command.fill(delay)
        else:
            found = command.end(accident, delay)
        yield from (f"{what}: {fault}" for fault in found)
        if fault := command.broken(before):
            yield f"{what}: {fault}"
        if number % EVERY == EVERY - 1 or number == instants - 1:
            command.whole()
            if litter := command.litter():
                yield f"{what}: after the next run there is {litter}"


def filling(command, most):
    """Fill a command's disk after each of its steps that write; yield what is wrong."""
    command.whole()
    for steps in range(most):
        before = contents(command.out)
        full, faults = command.fill_after(steps)
        what = f"{command.name}, disk full after {steps} steps"
        yield from (f"{what}: {fault}" for fault in faults)
        if fault := command.broken(before):
            yield f"{what}: {fault}"
        if not full:
            break
    command.whole()
    if litter := command.litter():
        yield f"{command.name}: after the next run there is {litter}"


@contextmanager
def disk():
    """Provide a small disk of its own; None where this user may make none."""
    with tempfile.TemporaryDirectory() as place:
        make = ["mount", "-t", "tmpfs", "-o", f"size={ROOM}", "none", place]
        if subprocess.run(make, capture_output=True, check=False).returncode:
            yield None
            return
        try:
            yield Path(place)
        finally:
            subprocess.run(["umount", "-l", place], check=True)


def tried(kind, accident, instants):
    """Try an accident on a command; the faults, None if it cannot be tried here."""
    with ExitStack() as stack:
        if accident == FULL:
            place = stack.enter_context(disk())
            if place is None:
                return None
        else:
            place = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        return list(campaign(kind(place / "it"), (accident,), instants))


def main():
    """Try all accidents."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instants", type=int, default=100)
    known = ["SIGKILL", "SIGTERM", FULL]
    parser.add_argument("--accidents", nargs="+", choices=known, default=known)
    parser.add_argument("commands", nargs="*", choices=[*COMMANDS, []])
    given = parser.parse_args()
    faults = 0
    for name in given.commands or COMMANDS:
        for accident in given.accidents:
            begun = time.monotonic()
            found = tried(COMMANDS[name], accident, given.instants)
            if found is None:
                print(f"{name}, {accident}: this user may make no disk", flush=True)
                continue
            print(*found, sep="\n", end="\n" if found else "")
            print(
                f"{name}, {accident}: {given.instants} instants, {len(found)} faults, "
                f"{time.monotonic() - begun:.0f} s",
                flush=True,
            )
            faults += len(found)
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
