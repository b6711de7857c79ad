"""Accidents: commands killed at many instants, and disks that are full.

``python tests/fuzz/accidents.py [--instants N]`` tries each command and signal at so
many instants of its life; the tests try a few.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from repository import ROOT

PATIENCE = 2.0
"""After which nothing of a killed command runs any more [s]."""
SIGNALS = {
    "SIGKILL": -signal.SIGKILL,
    "SIGTERM": 130,
    "SIGINT": 130,
}
"""Signals, and the exit code that a command ends with that hears them."""


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

    def begin(self):
        """Start the command in a session of its own."""
        name, _, word = self.mark.partition("=")
        return subprocess.Popen(
            [sys.executable, "-m", "showc", *self.arguments],
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

    def end(self, name, delay):
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
        early = {0, SIGNALS[name], -getattr(signal, name), -signal.SIGINT}
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


CAMPAIGNS = (compile_again, verify_again)


def main():
    """Run all campaigns."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instants", type=int, default=100)
    given = parser.parse_args()
    faults = 0
    for campaign in CAMPAIGNS:
        with tempfile.TemporaryDirectory() as place:
            found = list(campaign(Path(place), given.instants))
        print(*found, sep="\n")
        print(f"{campaign.__name__}: {given.instants} instants, {len(found)} faults")
        faults += len(found)
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
