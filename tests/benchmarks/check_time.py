"""Processor time of `showc check`, beside that of starting Python with its libraries.

Run as ``python tests/benchmarks/check_time.py``. The ratio of both is the same on fast
and on slow machines.
"""

import math
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

HUNDRED = """\
showc: 1
drones: 100
formations:
  ring: {type: circle, radius: 45, centre: [0, 0, 30]}
  ball: {type: sphere, radius: 18, centre: [0, 0, 40]}
  wall: {type: grid, plane: front, step: 3}
  word: {type: text, text: SHOW, height: 30, spread: true}
  helix: {type: helix, radius: 20, height: 40, turns: 3}
  wave: {type: wave, step: 4}
transitions: [ring, ball, wall, word, helix, wave]
"""

THOUSAND = """\
showc: 1
drones: 1000
site: {volume: {min: [-400, -400, 0], max: [400, 400, 200]}}
formations:
  word: {type: text, text: "showc\\nflies", height: 90, draw: inside, spread: true}
  line: {type: text, text: showc, height: 100, spread: true}
  ball: {type: mesh, file: ball.obj, size: 110}
  egg: {type: mesh, file: egg.obj, size: 140}
transitions: [word, line, ball, egg]
"""


def globe(path, height):
    """Write a ball of 3,200 quadrilaterals, as high as said for a radius of one."""
    rings, sides = 40, 80
    lines = []
    for ring in range(rings + 1):
        polar = math.pi * ring / rings
        for side in range(sides):
            angle = math.tau * side / sides
            x, y = math.sin(polar) * math.cos(angle), math.sin(polar) * math.sin(angle)
            lines.append(f"v {x:.6f} {height * math.cos(polar):.6f} {y:.6f}")
    for ring in range(rings):
        for side in range(sides):
            here, beside = (
                ring * sides + side + 1,
                ring * sides + (side + 1) % sides + 1,
            )
            lines.append(f"f {here} {beside} {beside + sides} {here + sides}")
    path.write_text("\n".join(lines), encoding="utf-8")


def cpu_time(arguments, folder):
    """Least processor time of a few runs: what a machine without other work takes."""
    times = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, *arguments],
            cwd=folder,
            check=True,
            capture_output=True,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(
            after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        )
    return min(times)


def main():
    """Print a row for each show."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "hundred.yaml").write_text(HUNDRED, encoding="utf-8")
        (folder / "thousand.yaml").write_text(THOUSAND, encoding="utf-8")
        globe(folder / "ball.obj", 1.0)
        globe(folder / "egg.obj", 1.4)
        start_up = cpu_time(["-c", "import numpy, yaml, click"], folder)
        for show in ("hundred", "thousand"):
            check = cpu_time(["-m", "showc", "check", f"{show}.yaml"], folder)
            sys.stdout.write(
                f"{show:<10} {check:6.2f} s   {check / start_up:6.1f} x start-up\n"
            )


if __name__ == "__main__":
    main()
