"""What was added to a log: the abort table, proved row by row; simulated flights.

The legs of the table are flown from rest to the ground. What the kernel proves of legs
of the show it proves of them, with the limits that the script gives moves and landings.

On the way to rest, and back along the plan, all drones are where the plan has them at
one time, whose rate r changes by r' over a period. They fly the velocity r v and the
acceleration r² a + r' v. In a period these are mixtures of the values at its two rates,
of which Bernstein coefficients of v and a, of the same degree, enclose each.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.log import showc_pb2 as pb
from showc.log.facts import named_digest
from showc.log.schema import WIND_NAME, message_of
from showc.script.fence import inside_polygon
from showc.verify.decode import read_aborts
from showc.verify.kernel.bernstein import elevate, part
from showc.verify.kernel.choreography import MOMENT, REACHED, joined_up
from showc.verify.kernel.dynamics import radius, ties
from showc.verify.kernel.limits import extremes, kept
from showc.verify.kernel.separation import closest_of, encounter_parts, separated
from showc.verify.kernel.show import LoggedShow, PieceTable, Seen, Statement, worst
from showc.verify.report import Check, agreement, check_of
from showc.verify.samples import flown
from showc.verify.specification.cover import differences

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from showc.arrays import FloatArray
    from showc.log.container import LogFile
    from showc.script.show import Show
    from showc.verify.kernel.show import Segment

GROUNDED = 0.05  # height over the pads of a drone that stands on the ground [m]
SLACK = 0.01
"""What accelerations may be beyond those that are allowed [m/s²]: of flown ones that is
known (:mod:`showc.verify.kernel.limits`). Speeds under 1 mm/s are left out."""
BACK = pb.AbortRow.BACK_ALONG_THE_PLAN
_LEGS: dict[int, list[int]] = {
    pb.AbortRow.ON_THE_GROUND: [],
    BACK: [],
    pb.AbortRow.DOWN_IN_PLACE: [pb.Segment.LAND],
    pb.AbortRow.HOME: [pb.Segment.APPROACH, pb.Segment.LAND],
}
_FREE = "kind", "start", "duration", "limits", "drones", "goals"
"""What legs say that theorems are about."""


def bound_to(log: LogFile, added: list[str]) -> Check:
    """Hold each thing that was ``added`` against the log that it names, and follows."""
    begin = min(one.position for one in log.attachments if one.name in added)
    behind, wanted = all(c.span[1] <= begin for c in log.chunks), log.before(added)
    named = {one: named_digest(one, log.attachment(one) or b"") for one in added}
    other = [one for one in added if named[one] != wanted or not behind]
    found = agreement("VRF108", (f"{name!r} is of another log" for name in other))
    note = "simulated flights are an estimate: nothing of them is proved"
    return replace(found, notes=(*found.notes, *[note] * (WIND_NAME in added)))


class Aborts:
    """The proof of an abort table: that of a ``log`` which holds what is ``logged``."""

    def __init__(self, log: LogFile, logged: LoggedShow, script: Show) -> None:
        self.logged, self.script = logged, script
        rules = pb.Rules.FromString(logged.rules.SerializeToString())
        sink = script.limits.upright(script.landing.descent_speed)
        del rules.limits[:]
        rules.limits.extend(message_of(pb.Limits, one) for one in (script.limits, sink))
        self.table, legs = read_aborts(log, rules)
        self.sound = list[pb.AbortRow]()  # rows whose clocks rest when they say
        self.show = LoggedShow(rules, legs, logged.epoch)

    def parts(self) -> list[Callable[[], Any]]:
        """Return the work, in parts for :meth:`checks`."""
        legs, rules = self.show.segments, self.show.rules
        return [
            *(partial(radius, one, rules.vehicle) for one in legs),
            *(partial(extremes, one, rules) for one in legs),
            *encounter_parts(self.show),
        ]

    def checks(self, found: list[Any]) -> list[Check]:
        """Return what the parts came to."""
        show, many = self.show, len(self.show.segments)
        radii, limits, near = (found[k * many :][:many] for k in range(3))
        wrong = [*self.strange(), *self._rows()]
        for one, met in zip(show.segments, near, strict=True):
            said = one.message.certificate.closest.distance
            if abs(said - (0.0 if met is None else met.upper)) > REACHED:
                wrong.append(f"“{one.message.name}” claims {said:g} m as nearest")
        joined = []
        flights = ((tuple(row.legs), row.duration) for row in self.table.rows)
        for own, show.rules.duration in dict.fromkeys(flights):
            if legs := tuple(show.segments[leg] for leg in own):
                joined += joined_up(replace(show, segments=legs))[:-1]
        rows = agreement("VRF351", wrong)
        note = f"{len(self.table.rows)} rows, every {self.table.every:g} s"
        period = self.table.period
        down = [period * len(r.changes) + r.duration * bool(r.legs) for r in self.sound]
        note += f"; on the ground within {max(down, default=0.0):.1f} s"
        stated = [
            _one("VRF352", ties(show, radii)),
            _one("VRF353", kept(show, radii, limits)),
            _one("VRF354", [separated(show, radii, closest_of(near))]),
            _one("VRF355", joined),
        ]
        clock = worst("VRF356", SLACK, "m/s²", self._beyond())
        every = map(check_of, [*(stated if joined else ()), clock])
        return [replace(rows, notes=(note, *rows.notes)), *every]

    def strange(self) -> Iterator[str]:
        """Say what legs claim beside what the theorems are about: of that, nothing."""
        for number, leg in enumerate(self.table.legs):
            words = f"abort [0-9]+: {pb.Segment.Kind.Name(leg.kind).lower()}"
            free = {key: getattr(leg, key) for key in _FREE}
            wanted = pb.Segment(index=number, places=leg.drones, **free)
            wanted.name = leg.name if re.fullmatch(words, leg.name) else words
            if leg.certificate.HasField("closest"):
                said = leg.certificate.closest.distance
                wanted.certificate.closest.distance = said
            yield from differences(leg, wanted)

    def _rows(self) -> Iterator[str]:
        """Say what is wrong with rows: every moment, from where drones stand, down."""
        times = np.arange(0.0, self.logged.duration, self.table.every)
        if len(self.table.rows) != times.size:
            yield f"there are {len(self.table.rows)} rows, not {times.size}"
        for row, time in zip(self.table.rows, times.tolist(), strict=False):
            legs = [self.show.segments[leg] for leg in row.legs]
            kinds = [one.message.kind for one in legs]
            limits = [one.message.limits for one in legs]
            if abs(row.time - time) > MOMENT or kinds != _LEGS.get(row.way):
                yield f"at {time:g} s: it is of another time, or flies other legs"
            elif row.duration and row.way == pb.AbortRow.ON_THE_GROUND:
                yield f"at {time:g} s: it is on the ground, and takes time"
            elif limits != [kind == pb.Segment.LAND for kind in kinds]:
                yield f"at {time:g} s: a leg has the limits of another kind"
            elif abs(self._stands(row) - row.rest) > MOMENT:
                yield f"at {time:g} s: the clock does not come to rest at {row.rest:g}"
            else:
                self.sound.append(row)
                ends = self._ends(row, legs) if row.way != BACK else ()
                yield from (f"at {time:g} s: {one}" for one in ends)

    def _clock(self, row: pb.AbortRow) -> tuple[FloatArray, FloatArray]:
        """Return rates and show times of a row, where its periods begin and end."""
        rates = 1.0 + self.table.period * np.cumsum([0.0, *row.changes])
        ways = 0.5 * self.table.period * (rates[1:] + rates[:-1])
        return rates, row.time + np.cumsum([0.0, *ways])

    def _stands(self, row: pb.AbortRow) -> float:
        """Show time at which the clock of a row rests [s]; infinite if it does not.

        Back along the plan it then runs to the plan's begin, within limits of speed.
        """
        (rates, times), end = self._clock(row), self.logged.duration
        rest = rates.size - 1
        if row.way == BACK:
            rest = int((rates < MOMENT).argmax())
            limits, back = self.script.limits, rates[rest:]
            speeds = np.array([limits.velocity_min, limits.velocity_max])
            fastest = min(1.0, float((-speeds / speeds[::-1]).min()))
            over, periods = back.size - 1, row.duration / self.table.period
            within = np.abs(back + 0.5 * fastest).max() <= 0.5 * fastest + MOMENT
            if not (within and times[-1] < MOMENT and abs(over - periods) < MOMENT):
                return np.inf
        stop = rates[: rest + 1]
        slows = stop.min() >= -MOMENT and np.diff(stop).clip(min=0.0).sum() <= MOMENT
        rests = rates[rest] < MOMENT or times[rest] >= end
        return min(float(times[rest]), end) if slows and rests else np.inf

    def _beyond(self) -> Iterator[Seen]:
        """By how much clocks that change exceed accelerations that are allowed [m/s²].

        The script's limits, or what half the weight, tilt and thrust leave; and what
        the plan itself flies there, slowed as much.
        """
        limits, vehicle = self.script.limits, self.script.vehicle
        down = limits.acceleration_down or 0.5 * vehicle.gravity
        level = limits.acceleration or (vehicle.gravity - down) * np.tan(limits.tilt)
        most = min(limits.thrust_max, vehicle.thrust_max) / vehicle.mass
        room = np.sqrt(max(most**2 - level**2, 0.0)) - vehicle.gravity
        allowed = np.array([level, limits.acceleration_up or max(room, 0.0), down])
        table = PieceTable.joined([_speeds(one) for one in self.logged.segments])
        begin, end, drones, speed = table.start, table.end, table.owner, table.state
        width, slope = end - begin, elevate(table.slope(speed), speed.shape[1] - 1)
        for row in self.sound:
            rates, times = self._clock(row)
            every = np.sort(np.stack([times[:-1], times[1:]], axis=1), axis=1)
            changes = np.array(row.changes)[:, None, None]
            changed = np.flatnonzero(changes)
            # In blocks, so that pairs with curves do not fill the memory.
            for some in np.array_split(changed, 1 + changed.size * end.size // 50_000):
                ends = every[some]
                of, met = np.nonzero((begin <= ends[:, 1:]) & (ends[:, :1] <= end))
                low, high = np.clip((ends[of].T - begin[met]) / width[met], 0.0, 1.0)
                v, a = part(speed[met], low, high), part(slope[met], low, high)
                for rate in (rates[some[of]], rates[some[of] + 1]):
                    square = rate[:, None, None] ** 2
                    own = np.maximum(allowed, _greatest(square * slope[met]))
                    over = _greatest(square * a + changes[some[of]] * v) - own
                    yield Seen("stop", ends[of, 0], drones[met], over.max(axis=1))

    def _ends(self, row: pb.AbortRow, legs: list[Segment]) -> Iterator[str]:
        """Say what is wrong with where a row begins, and where it ends."""
        script, site = self.script, self.script.site
        now = min(max(row.rest, 0.0), self.logged.duration)
        places = flown(self.logged, np.array([now]))[0, :, :3]
        pads = script.formations[script.pads].points[: len(places)]
        goals = places * (1.0, 1.0, 0.0) + (0.0, 0.0, pads[:, 2].min())
        taken = [people.points for people in site.audience if people.area]
        taken += [building.corners for building in site.buildings]
        if row.way == pb.AbortRow.DOWN_IN_PLACE and np.ptp(pads[:, 2]) > GROUNDED:
            yield "it goes down in place, and pads are at different heights"
        elif row.way != pb.AbortRow.DOWN_IN_PLACE:
            goals, taken = pads, []
        ends = [one.ends() for one in legs] or [(places, places)]
        if np.abs(ends[0][0][:, :3] - places).max() > REACHED:
            yield "it does not begin where the fleet stands"
        away = np.linalg.norm(ends[-1][1][:, None, :3] - goals, axis=2).min(axis=1)
        if away.max() > (REACHED if legs else GROUNDED):
            yield "it does not end on the ground"
        if legs and any(inside_polygon(goals, area).any() for area in taken):
            yield "it ends among people, or on a building"


def _speeds(one: Segment) -> PieceTable:
    """Return the velocities alone, by show time."""
    start, end = one.start + one.table.start, one.start + one.table.end
    state, control = one.table.state[:, :, 3:6], one.table.control[:, :, :0]
    return replace(one.table, start=start, end=end, state=state, control=control)


def _greatest(acceleration: FloatArray) -> FloatArray:
    """Bound what curves (n, k, 3) have sideways, upwards and downwards, (n, 3)."""
    x, y, z = np.moveaxis(acceleration, 2, 0)
    return np.asarray(np.stack([np.hypot(x, y), z, -z], axis=2).max(axis=1))


def _one(code: str, stated: list[Statement]) -> Statement:
    """Return what several statements come to: the first that fails, if one does."""
    bad = [one for one in stated if one.holds is False]
    return replace([*bad, *stated][0], code=code) if stated else Statement(code, None)
