"""Time of each part of the safety case of a log.

Run as ``python tests/benchmarks/safety_time.py OUTPUT.mcap [WIND]``. Printed are time
that passes, processor time of this process and of its copies, and the area of the
footprint.
"""

import resource
import sys
import time
from pathlib import Path

from showc.log.reader import read_log
from showc.safety.assessment import authority_within, show_of
from showc.safety.failure import failures
from showc.safety.fall import Fall
from showc.safety.ground import ROUNDING, Footing, area, boxes_of, hull, widened
from showc.safety.landing import FallTable
from showc.safety.pieces import flight_pieces, flown_legs
from showc.safety.stop import Motion, stops
from showc.safety.volumes import Flying, buffers
from showc.vehicle.power import SEA_LEVEL, air_density


class Watch:
    """Says how long each part took."""

    def __init__(self) -> None:
        self.last = self.now()

    @staticmethod
    def now():
        copies = resource.getrusage(resource.RUSAGE_CHILDREN)
        return time.perf_counter(), time.process_time(), copies.ru_utime

    def say(self, part: str) -> None:
        now = self.now()
        wall, own, copies = (b - a for a, b in zip(self.last, now, strict=True))
        sys.stdout.write(f"{part}: {wall:.1f} s, {own:.1f} + {copies:.1f} s of CPU\n")
        self.last = now


def main(log: Path, wind: float | None) -> None:
    watch = Watch()
    logged = read_log(log, 2.5)
    show = show_of(logged)
    risk, vehicle = show.site.risk, show.vehicle
    wind = risk.wind if wind is None else wind
    watch.say("reading")
    pieces = flight_pieces(flown_legs(logged))
    watch.say(f"decoding {len(pieces)} pieces of {logged.drones} drones")
    boxes = boxes_of(pieces, risk.ground)
    high = float(boxes.height_high.max()) + ROUNDING
    speed = float(boxes.speed_high.max()) + ROUNDING
    climbs = boxes.climb_low.min() - ROUNDING, boxes.climb_high.max() + ROUNDING
    thin = min(air_density(show.site.altitude + high), SEA_LEVEL)
    fall = Fall(vehicle.mass, show.body.drag_area, wind, vehicle.gravity, thin)
    falls = FallTable.covering(fall, climbs, speed, high)
    footprint = hull(pieces, Footing(falls, 0.5 * show.body.size, risk.ground))
    geography = hull(pieces, Footing())
    flying = Flying(
        speed + wind, high, show.body.size, show.limits.tilt, vehicle.gravity
    )
    width = buffers(flying, risk)
    around = widened(geography, width.contingency)
    for each in (width.one_to_one, width.ballistic):
        widened(around, each)
    watch.say(f"footprint ({area(footprint):.0f} m²) and volumes")
    flights = pieces.flights()
    found = failures(flights, fall, show.body.size, risk.ground)
    watch.say(f"one drone fails ({100.0 * found.share:.1f} % may meet another)")
    velocity = [flight.select([3, 4, 5]) for flight in flights]
    stopped = stops(Motion.of(velocity), authority_within(show), 1.0)
    watch.say(f"stops (longest {stopped.longest:.2f} s)")


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else None)
