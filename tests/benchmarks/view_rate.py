"""Frames a second of a page that plays a show, and what one of them costs.

Run as ``python tests/benchmarks/view_rate.py OUTPUT.mcap``, or with a page that `view`
made. A headless Chromium draws it in software; the cost is the processor time of all
its processes, which other work on the machine changes less than the rate.
"""

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "view"))

from browser import open_browser

from showc.__main__ import run

SECONDS = 8.0
COUNT = """(() => { window.frames_ = 0;
  const step = () => { window.frames_ += 1; requestAnimationFrame(step); };
  requestAnimationFrame(step); })()"""


def processor_time(folder):
    """Return the processor time of all processes that use a profile's folder [s]."""
    total = 0.0
    for place in Path("/proc").glob("[0-9]*"):
        try:
            if str(folder).encode() in (place / "cmdline").read_bytes():
                fields = (place / "stat").read_text("utf-8").rpartition(")")[2].split()
                total += (int(fields[11]) + int(fields[12])) / 100.0
        except OSError:
            continue
    return total


def main(log):
    """Measure a page of a log."""
    with tempfile.TemporaryDirectory() as place:
        page, profile = Path(place) / "show.html", Path(place) / "profile"
        if log.suffix == ".html":
            page = log
        elif run(["view", str(log), "-o", str(page)]):
            sys.exit("the page could not be made")
        with open_browser(profile) as tab:
            tab.open(page, "play=1&t=20")
            tab.evaluate(COUNT)
            time.sleep(1.0)
            used, begin = processor_time(profile), time.perf_counter()
            first = tab.evaluate("window.frames_")
            time.sleep(SECONDS)
            frames = tab.evaluate("window.frames_") - first
            taken = time.perf_counter() - begin
            used = processor_time(profile) - used
    cost = 1000.0 * used / max(frames, 1)
    sys.stdout.write(
        f"{frames / taken:.1f} frames a second, {cost:.1f} ms of processor time each\n"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
