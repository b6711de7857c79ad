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


def measure(folder):
    """Yield the wall time of each save [s]."""
    script = folder / "show.yaml"
    script.write_text(SCRIPT.replace("RADIUS", "30"), encoding="utf-8")
    command = [sys.executable, "-m", "showc", "preview", str(script)]
    command += ["--cache-dir", str(folder / "cache")]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        url = re.search(r"http://\S+", server.stdout.readline()).group()
        with open_browser(folder / "browser") as tab:
            tab.visit(f"{url}?play=0&t=20")
            for number in range(SAVES):
                time.sleep(3.0)
                drawn = tab.evaluate("live.drawn ?? 0")
                radius = f"{30.5 + 0.5 * number:g}"
                script.write_text(SCRIPT.replace("RADIUS", radius), encoding="utf-8")
                begin = time.perf_counter()
                while tab.evaluate("live.drawn ?? 0") == drawn:
                    time.sleep(0.005)
                yield time.perf_counter() - begin
    finally:
        server.terminate()
        server.wait(timeout=20)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        times = sorted(measure(Path(name)))
    each = " ".join(f"{one:.2f}" for one in times)
    middle, load = times[len(times) // 2], os.getloadavg()[0]
    sys.stdout.write(f"{each} s; median {middle:.2f} s, load {load:.1f}\n")
