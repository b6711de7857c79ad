"""Time from saving a script of 500 drones until a browser has drawn the change.

Run as ``python tests/benchmarks/preview_time.py``. It starts ``showc preview`` and a
headless Chromium, saves the script again and again with one formation changed, and
prints the wall time of each save until the page has drawn it, as seen from outside.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "view"))

from browser import open_browser

SCRIPT = """\
showc: 1
name: Five hundred
drones: 500
site: {volume: {min: [-150, -150, 0], max: [150, 150, 150]}}
pads: {type: grid, step: 3 m}
formations:
  ball: {type: sphere, radius: RADIUS, centre: [0, 0, 60], colour: gold}
  wave: {type: wave, step: 4 m, amplitude: 3 m, centre: [0, 0, 50], colour: aquamarine}
  wall: {type: grid, plane: front, step: 3 m, centre: [0, 0, 60], colour: deepskyblue}
transitions: [ball, wall, wave, wall, ball]
"""
SAVES = 10


def cpu_time(process):
    """Processor time of a process so far [s]; what it does after is not in it."""
    fields = Path(f"/proc/{process}/stat").read_text("utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(folder):
    """Yield the wall time of each save, and the server's processor time [s]."""
    script = folder / "show.yaml"
    script.write_text(SCRIPT.replace("RADIUS", "40"), encoding="utf-8")
    command = [sys.executable, "-m", "showc", "preview", str(script)]
    command += ["--cache-dir", str(folder / "cache")]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        url = re.search(r"http://\S+", server.stdout.readline()).group()
        with open_browser(folder / "browser") as tab:
            tab.visit(f"{url}?play=0&t=20")
            for number in range(SAVES):
                time.sleep(3.0)
                radius = 40.5 + 0.5 * number
                text = SCRIPT.replace("RADIUS", f"{radius:g}")
                used = cpu_time(server.pid)
                script.write_text(text, encoding="utf-8")
                begin = time.perf_counter()
                # The ball is the highest formation: 60 m and its radius.
                drawn = f"live.top > {59.75 + radius}"
                while not tab.evaluate(drawn):
                    time.sleep(0.005)
                wall = time.perf_counter() - begin
                yield wall, cpu_time(server.pid) - used
    finally:
        server.terminate()
        server.wait(timeout=20)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        found = list(measure(Path(name)))
    for what, times in zip(
        ("wall", "server's processor"), zip(*found, strict=True), strict=True
    ):
        each = " ".join(f"{one:.2f}" for one in sorted(times))
        middle = sorted(times)[len(times) // 2]
        sys.stdout.write(f"{what} time {each} s; median {middle:.2f} s\n")
    sys.stdout.write(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\n")
