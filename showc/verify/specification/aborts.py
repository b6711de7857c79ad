"""What was added to a log: the abort table, proved row by row; simulated flights.

The legs of the table are flown from rest to the ground. What the kernel proves of legs
of the show it proves of them, with the limits that the script gives moves and landings.
"""

from __future__ import annotations

import hashlib
import re
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from google.protobuf.message import DecodeError

from showc.log import showc_pb2 as pb
from showc.log.schema import ABORT_NAME, WIND_NAME
from showc.script.fence import inside_polygon
from showc.verify.decode import read_aborts
from showc.verify.kernel.choreography import MOMENT, REACHED, joined_up
from showc.verify.kernel.dynamics import radius, ties
from showc.verify.kernel.limits import extremes, kept
from showc.verify.kernel.separation import closest_of, encounter_parts, separated
from showc.verify.kernel.show import LoggedShow, Statement
from showc.verify.report import agreement
from showc.verify.samples import flown
from showc.verify.specification.compare import differences, read_json
from showc.verify.specification.demands import limits_message, upright

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from showc.script.show import Show
    from showc.verify.kernel.show import Segment
    from showc.verify.mcap import LogFile
    from showc.verify.report import Check

GROUNDED = 0.05
"""Height over the pads up to which a drone stands on the ground [m]."""
_LEGS = {
    pb.AbortRow.DOWN_IN_PLACE: [pb.Segment.LAND],
    pb.AbortRow.HOME: [pb.Segment.APPROACH, pb.Segment.LAND],
}


def bound_to(log: LogFile, added: list[str]) -> Check:
    """Hold each thing that was ``added`` against the log that it names."""
    begin = min(one.position for one in log.attachments if one.name in added)
    wanted = hashlib.sha256(log.view[:begin]).hexdigest()
    other = [name for name in added if _named(log, name) != wanted]
    found = agreement("VRF108", (f"{name!r} is of another log" for name in other))
    note = "simulated flights are an estimate: nothing of them is proved"
    return replace(found, notes=(*found.notes, *[note] * (WIND_NAME in added)))


def _named(log: LogFile, name: str) -> object:
    """Return the hash of the log that an addition names; None if it names none."""
    content = log.attachment(name) or b""
    with suppress(DecodeError, ValueError, LookupError, TypeError):
        if name == ABORT_NAME:
            return pb.AbortTable.FromString(content).data_sha256
        return read_json(content)["data_sha256"]
    return None


class Aborts:
    """The proof of an abort table: that of a ``log`` which holds what is ``logged``."""

    def __init__(self, log: LogFile, logged: LoggedShow, script: Show) -> None:
        self.logged, self.script = logged, script
        rules = pb.Rules.FromString(logged.rules.SerializeToString())
        sink = upright(script.limits, script.landing.descent_speed)
        del rules.limits[:]
        rules.limits.extend(map(limits_message, (script.limits, sink)))
        self.table, legs = read_aborts(log, rules)
        self.show = LoggedShow(rules, legs, logged.epoch)

    def parts(self) -> list[Callable[[], Any]]:
        """Return the work, in parts for :meth:`checks`."""
        legs, rules = self.show.segments, self.show.rules
        return [
            *(partial(radius, one, rules.vehicle) for one in legs),
            *(partial(extremes, one, rules) for one in legs),
            *encounter_parts(self.show),
        ]

    def checks(self, found: list[Any]) -> tuple[Check, list[Statement]]:
        """Return what the parts came to."""
        show, many = self.show, len(self.show.segments)
        radii, limits, near = (found[k * many :][:many] for k in range(3))
        wrong = [*self.strange(), *self._rows()]
        for one, met in zip(show.segments, near, strict=True):
            said = one.message.certificate.closest.distance
            if abs(said - (0.0 if met is None else met.upper)) > REACHED:
                wrong.append(f"“{one.message.name}” claims {said:g} m as nearest")
        joined = []
        for row in self.table.rows:
            legs = tuple(show.segments[leg] for leg in row.legs)
            show.rules.duration = row.duration
            if legs:
                joined += joined_up(replace(show, segments=legs))[:-1]
        rows = agreement("VRF351", wrong)
        note = f"{len(self.table.rows)} rows, every {self.table.every:g} s"
        back = sum(r.way == pb.AbortRow.BACK_ALONG_THE_PLAN for r in self.table.rows)
        if back:
            note += f"; {back} of them fly back along the plan, which is not proved"
            rows = replace(rows, verdict="fail" if wrong else "warning")
        stated = [
            _one("VRF352", ties(show, radii)),
            _one("VRF353", kept(show, radii, limits)),
            _one("VRF354", [separated(show, radii, closest_of(near))]),
            _one("VRF355", joined),
        ]
        return replace(rows, notes=(note, *rows.notes)), stated if joined else []

    def strange(self) -> Iterator[str]:
        """Say what legs claim beside what the theorems are about: of that, nothing."""
        for number, leg in enumerate(self.table.legs):
            words = f"abort [0-9]+: {pb.Segment.Kind.Name(leg.kind).lower()}"
            wanted = pb.Segment(
                index=number,
                name=leg.name if re.fullmatch(words, leg.name) else words,
                places=leg.drones,
            )
            met = leg.certificate.closest
            if leg.certificate.HasField("closest"):
                wanted.certificate.closest.distance = met.distance
            # The theorems are about these.
            for key in ("kind", "start", "duration", "limits"):
                setattr(wanted, key, getattr(leg, key))
            wanted.drones.extend(leg.drones)
            wanted.goals.extend(leg.goals)
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
            if abs(row.time - time) > MOMENT or kinds != _LEGS.get(row.way, []):
                yield f"at {time:g} s: it is of another time, or flies other legs"
            elif limits != [kind == pb.Segment.LAND for kind in kinds]:
                yield f"at {time:g} s: a leg has the limits of another kind"
            elif abs(self._stands(row) - row.rest) > MOMENT:
                yield f"at {time:g} s: the clock does not come to rest at {row.rest:g}"
            elif row.way != pb.AbortRow.BACK_ALONG_THE_PLAN:
                yield from (f"at {time:g} s: {one}" for one in self._ends(row, legs))

    def _stands(self, row: pb.AbortRow) -> float:
        """Show time at which the clock of a row rests [s]; infinite if it does not."""
        period, end = self.table.period, self.logged.duration
        rates = 1.0 + period * np.cumsum([0.0, *row.changes])
        time = row.time + period * float(np.sum(0.5 * (rates[1:] + rates[:-1])))
        slows = rates.min() >= -MOMENT and not (np.diff(rates) > MOMENT).any()
        rests = rates[-1] < MOMENT or time >= end
        return min(time, end) if slows and rests else np.inf

    def _ends(self, row: pb.AbortRow, legs: list[Segment]) -> Iterator[str]:
        """Say what is wrong with where a row begins, and where it ends."""
        script, site = self.script, self.script.site
        now = min(max(row.rest, 0.0), self.logged.duration)
        places = flown(self.logged, np.array([now]))[:3, 0].T
        pads = script.formations[script.pads].points[: len(places)]
        goals = places * (1.0, 1.0, 0.0) + (0.0, 0.0, pads[:, 2].min())
        taken = [people.points for people in site.audience if people.area]
        taken += [building.corners for building in site.buildings]
        if row.way == pb.AbortRow.HOME:
            goals, taken = pads, []
        ends = [one.ends() for one in legs] or [(places, places)]
        if np.abs(ends[0][0][:, :3] - places).max() > REACHED:
            yield "it does not begin where the fleet stands"
        away = np.linalg.norm(ends[-1][1][:, None, :3] - goals, axis=2).min(axis=1)
        if away.max() > (REACHED if legs else GROUNDED):
            yield "it does not end on the ground"
        if legs and any(inside_polygon(goals, area).any() for area in taken):
            yield "it ends among people, or on a building"


def _one(code: str, stated: list[Statement]) -> Statement:
    """Return what several statements come to: the first that fails, if one does."""
    bad = [one for one in stated if one.holds is False]
    return replace([*bad, *stated][0], code=code) if stated else Statement(code, None)
