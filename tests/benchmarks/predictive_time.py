"""Time of one step of the predictive controller, for one drone on one core.

Run as ``python tests/benchmarks/predictive_time.py OUTPUT.mcap [RUNS]``. A step every
10 ms is to be done within 10 ms. Printed are median, 99th percentile and greatest
processor time, and the error that the controller leaves beside those of flatness.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from showc.log.reader import read_log
from showc.safety.assessment import show_of
from showc.simulate import predictive
from showc.simulate.campaign import Model, course_of, fly
from showc.simulate.results import Weather
from showc.simulate.tracking import Course, Gains

WEATHER = Weather(8.0, "moderate", 1)


def main(log: Path, runs: int) -> None:
    logged = read_log(log)
    show, whole = show_of(logged), course_of(logged)
    times = []
    command = predictive.Predictor.command

    def timed(self, *arguments):
        begin = time.process_time()
        found = command(self, *arguments)
        times.append(1000.0 * (time.process_time() - begin))
        return found

    predictive.Predictor.command = timed
    models = {
        "flatness without observer": Model(replace(Gains(), observer=0.0)),
        "flatness with observer": Model(),
        "predictive": Model(predictive=True),
    }
    errors = {name: [] for name in models}
    for run in range(runs):
        # Each run has a wind of its own direction, and the next drone.
        mine = [run % logged.drones]
        course = Course(
            whole.times,
            whole.state[:, mine],
            whole.control[:, mine],
            whole.acceleration[:, mine],
        )
        for name, model in models.items():
            found = fly(show, course, WEATHER, [run], model)[0]
            errors[name].append(float(np.sqrt(np.mean(found.errors**2))))
            _say(
                f"run {run + 1}, {name}: {errors[name][-1]:.3f} m RMS, "
                f"{100.0 * found.saturated.mean():.2f} % limited, up to "
                f"{100.0 * found.used.max():.1f} % of a limit"
            )
    for name, each in errors.items():
        _say(f"{name}: {np.sqrt(np.mean(np.square(each))):.3f} m RMS")
    middle, most = np.percentile(times, [50.0, 99.0])
    _say(
        f"{len(times)} steps: median {middle:.1f} ms, 99th percentile {most:.1f} ms, "
        f"greatest {max(times):.1f} ms"
    )


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1)
