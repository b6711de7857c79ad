"""What the autopilots will make of the missions, proved again from the files' bytes.

Drones fly straight lines from place to place, and beyond their ends by the overshoot at
most. A line is a polynomial of degree 1, so that the kernel's proof of the fence holds
for it, concave fences included.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.documents.values import unlike
from showc.log import showc_pb2 as pb
from showc.verify.kernel.fence import RESOLUTION as TOUCHES
from showc.verify.kernel.fence import enclosed
from showc.verify.kernel.show import LoggedShow, xyz
from showc.verify.missions import separation
from showc.verify.missions.law import CONSTANTS, KNOWN
from showc.verify.report import Check, Place, agreement, checked

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from showc.arrays import FloatArray, IntArray
    from showc.script.show import Show
    from showc.verify.kernel.separation import Encounter
    from showc.verify.missions.legs import FleetLegs
    from showc.verify.specification.demands import Move

_UNREADABLE = LookupError, TypeError, ValueError, AttributeError, OverflowError
_TOGETHER = 256  # drones that are looked at together: few enough for the memory
_WORD = re.compile(r"[\w:.,+ -]{1,80}", re.ASCII)  # an encoding or a time


def check_flight(
    fleet: FleetLegs,
    show: LoggedShow,
    described: Mapping[str, Any],
    script: Show,
    logged: list[Move],
) -> list[Check]:
    """Prove what ArduCopter will make of a fleet's missions, as ``described`` there.

    They fly ``logged`` moves, with the script's slack after the latest end of a leg.
    """
    reached, ends = visits(fleet, show, logged)
    if ends.verdict == "fail":  # what drones fly instead is no matter of the show
        return [ends]
    own = any(one.message.kind == pb.Segment.APPROACH for one in show.segments)
    wanted = show.rules.separation
    apart = {
        "VRF411": separation.nearest_timed(fleet, wanted),
        "VRF412": separation.nearest_untimed(fleet, wanted, landing=False),
        "VRF413": separation.nearest_untimed(fleet, wanted, landing=True),
        "VRF417": separation.nearest_landing(fleet, wanted),
    }
    return [
        ends,
        *_check_slots(fleet, reached, logged, script.mission.slack, own=own),
        *boundaries(fleet, show.rules.site),
        *(_apart(code, found, wanted.distance) for code, found in apart.items()),
        _as_claimed(apart, fleet, show, described, logged),
    ]


def visits(
    fleet: FleetLegs, show: LoggedShow, logged: list[Move]
) -> tuple[IntArray, Check]:
    """Whether each mission visits the ends of its drone's moves in order.

    Returns which leg each move of each drone ends, (drones, moves); -1 where that was
    not found, and for the moves of others.
    """
    # A drone's own stops first, in order; for all others stands the last one, nowhere.
    stops = np.full((fleet.drones, 2 + len(logged), 3), np.nan)
    stops[:, 0] = show.segments[0].ends()[0][:, :3]
    for number, move in enumerate(logged, 1):
        stops[move.drones, number] = move.goals
    turns = np.argsort(np.isnan(stops[:, :, 0]), axis=1, kind="stable")
    goals = np.take_along_axis(stops, turns[:, :, None], axis=1)
    turns[np.isnan(goals[:, :, 0])] = len(logged) + 1
    visited, off = _visits(fleet, goals, _begun(fleet, goals, turns)[turns])
    lost = np.isfinite(goals[:, :, 0]) & (visited < 0)
    extra = np.diff(visited, axis=1) - KNOWN["most_legs"] * np.diff(turns, axis=1)
    extra[:, 0] += 1  # a launch is a take-off and a climb
    extra[visited[:, 1:] < 0] = 0
    # A landing flies level to above its pad first, where it begins beside it.
    aside = np.abs(fleet.end - fleet.begin)[fleet.first[1:] - 1, :2].max(axis=1)
    faults = [visited[:, 0] != 0, lost.any(1), visited.max(1) != np.diff(fleet.first)]
    faults += [aside > 2.0 * KNOWN["place"][0], extra.max(axis=1) > 0]
    wrong = np.any(faults, axis=0)
    worst = int(np.argmax(wrong if wrong.any() else off))
    first = turns[worst, [lost[worst].argmax(), 1 + extra[worst].argmax()]] - 1
    one, other = (logged[min(way, len(logged) - 1)].name for way in first)
    found = np.full(turns.shape, -1)
    legs = np.where(visited < 0, -1, visited + fleet.first[:-1, None] - 1)
    np.put_along_axis(found, turns, legs, axis=1)
    found[worst + 1 if wrong.any() else fleet.drones :] = -1
    count = np.count_nonzero(found[:, 1:-1] >= 0)
    notes = (
        "no item flies to the pad in its turn",
        f"no item flies to the end of “{one}” in its turn",
        "flies on after its landing in the log",
        "begins its landing beside its pad",
        f"flies {extra[worst].max()} legs more for “{other}” than any such move has",
        f"{count:,} places, to 1e-7 degrees and 1.2 cm of height",
    )
    note = notes[int(np.argmax([*(fault[worst] for fault in faults), True]))]
    facts = "VRF404", not wrong.any(), float(off[worst]), 1.0, "of the resolution"
    return found[:, 1:-1], checked(*facts, where=Place(worst + 1), notes=(note,))


def _begun(fleet: FleetLegs, goals: FloatArray, turns: IntArray) -> FloatArray:
    """When the first drones leave for each of the stops [s], or for the next one.

    By drones that stop elsewhere: of others :func:`_visits` has to be given it. The
    stops ``turns`` (drones, stops) of each drone are its ``goals`` (drones, stops, 3).
    """
    begun, none = np.full(turns.shape[1], np.inf), np.full(turns.shape, -np.inf)
    moved = np.abs(np.diff(goals, axis=1)).max(axis=2) > 2.0 * CONSTANTS["rounding"]
    if np.any(np.isfinite(goals[:, 1:, 0]) & ~moved):
        visited, _ = _visits(fleet, goals, none)
        drone, turn = np.nonzero(moved & (visited[:, 1:] >= 0))
        leg = fleet.first[drone] + visited[drone, turn]
        leaves = np.append(fleet.release, np.nan)[leg]
        np.fmin.at(begun, turns[drone, turn + 1], leaves)
    return np.append(np.minimum.accumulate(begun[-2::-1])[::-1], -np.inf)


def _visits(
    fleet: FleetLegs, goals: FloatArray, begun: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Which of its places are each drone's ``goals`` (drones, stops, 3), one at least.

    Up to one that is not found, -1; also returns how far off the worst is, over what
    the format stores, (drones,). A drone that makes way, and is back before it flies to
    another stop, or left before others have ``begun`` for it, stops when it is back.
    """
    found, worst = np.full(begun.shape, -1), np.zeros(fleet.drones)
    for begin in range(0, fleet.drones, _TOGETHER):
        drones = slice(begin, begin + _TOGETHER)
        first, end = fleet.first[:-1][drones, None], fleet.first[1:][drones, None]
        rank = np.arange(int((end - first).max()) + 1)
        leg = np.minimum(first + rank, end) - 1
        places, left = fleet.end[leg], fleet.release[leg]
        places[:, 0], left[:, 0] = fleet.begin[first[:, 0]], np.nan
        places[rank > end - first] = np.inf
        stops = goals[drones, :, None].swapaxes(0, 1)
        every = (np.abs(places - stop) / KNOWN["place"] for stop in stops)
        here, going = np.zeros((len(leg), 1), dtype=np.int64), np.full(len(leg), True)
        for number, (off, following) in enumerate(pairwise(every)):
            ratio, total = np.where(rank >= here, off.max(2), np.inf), off.sum(axis=2)
            fits = ratio <= 1.0
            here = np.where(fits.any(1), fits.argmax(1), ratio.argmin(1))[:, None]
            until = ((following.max(axis=2) <= 1.0) & (rank >= here)).argmax(axis=1)
            back = fits & ~np.pad(fits, ((0, 0), (1, 0)))[:, :-1]
            late = left < begun[drones, number + 1, None]
            back &= np.where(until[:, None] > here, rank < until[:, None], late)
            here = np.maximum(here, (back * rank).max(axis=1, keepdims=True))
            # Legs may be shorter than the resolution: of two that fit, the nearer.
            nearer = fits[:, 1:] & (total[:, 1:] < total[:, :-1])
            here += np.take_along_axis(np.pad(nearer, ((0, 0), (0, 1))), here, axis=1)
            ratio = np.take_along_axis(ratio, here, axis=1)[:, 0]
            going &= np.isfinite(goals[drones, number, 0])
            worst[drones][going] = np.maximum(worst[drones], ratio)[going]
            going &= ratio <= 1.0
            found[drones, number][going] = here[going, 0]
    return found, worst


def _check_slots(
    fleet: FleetLegs, reached: IntArray, logged: list[Move], slack: float, *, own: bool
) -> Iterator[Check]:
    """Whether no drone leaves before a move has ended, and none waits for nothing.

    A move has ended when all its drones have flown it, at the latest, with the lag of
    the clock and a pause, and have held what the log holds. What follows moves of
    groups waits for all of them. So do landings, but after an approach of their
    ``own``. The fleet as a whole waits no longer: no slot is an hour late.
    """
    flights, timed = fleet.profiles, np.flatnonzero(fleet.timed)
    lag, pause = CONSTANTS["clock_lag"], max(slack, CONSTANTS["settling"])
    likely = fleet.release + flights.followed(0.0) + 0.5 * lag
    latest = flights.followed(flights.late) + lag + pause
    over, climb = fleet.release + latest, fleet.first[:-1] + 1
    climbed = fleet.climbs + 2.0 * CONSTANTS["spread"] + pause
    likely[climb] = over[climb] = climbed
    leaves, (alone, lit) = fleet.leaves, fleet.alone.T
    legs = np.concatenate([timed, alone.astype(np.int64)])
    slots = np.stack([fleet.release, np.fmax(over, likely)])[:, timed]
    slots = np.concatenate([slots, [lit, lit]], axis=1).T
    spare = [(legs, slots[:, 0] - over[legs - 1])]
    done, rests = climbed.copy(), [(-np.inf, float(climbed.max()))]
    # A move that no drone flies takes what is waited after each, or as in the log.
    at, aside, least = climb - 1, 0.0, (latest - flights.duration).max()
    flown: list[tuple[Move, float, float]] = []
    for number, move in enumerate(logged[:-1]):
        if number and move.segment != logged[number - 1].segment:
            done[:] = done.max()
            spare.append((at + 1, leaves[at + 1] - done))
        ends, on = reached[move.drones, number], at[move.drones] + 1
        shift = np.abs(fleet.end[ends] - fleet.end[at[move.drones]])
        stays, at[move.drones] = shift.max(axis=1) < 2.0 * CONSTANTS["rounding"], ends
        flown.append((move, leaves[on[~stays]].min(initial=np.inf), likely[ends].max()))
        begun = max(float(done[move.drones].max()), flown[-1][2])
        begun = begun if number else float(fleet.climbs.max()) - CONSTANTS["tick"]
        end, follows = max(float(over[ends].max()), begun + move.held), ends + 1
        if move is logged[-2]:
            end = max(arrives for *_, arrives in flown) - pause
            follows = ends[stays] + 1 if own else fleet.first[1:] - 1
        done[move.drones] = end
        aside = aside + max(least, move.duration) if stays.all() else 0.0
        rests.append((begun, end + aside))
        spare.append((follows, leaves[follows] - end))
    after, every = (np.concatenate(one) for one in zip(*spare, strict=True))
    worst, leg = float(every.min()), after[int(np.argmin(every))]
    where = Place(int(fleet.owner[leg]) + 1, time=float(leaves[leg]))
    # Flown in less time than in the log, a move that is to arrive leaves later.
    late = [(b - one.duration, min(a, b)) for one, a, b in flown if one.cue]
    spans = np.concatenate([slots, rests, np.reshape(late, (-1, 2))])
    waited, when = _waited(fleet, reached, logged, legs, spans)
    note = f"{legs.size:,} slots, at least {pause:g} s after the latest end"
    value, holds = worst if legs.size else 0.0, worst >= -CONSTANTS["same"]
    if not holds:
        note = f"released {-worst:.2f} s too early after line {fleet.lines[leg - 1]}"
    elif waited > 0.0:
        value, holds, where = -waited, False, Place(time=when)
        note = f"no drone flies for {waited:.1f} s longer than slots need"
    yield checked("VRF408", holds, value, 0.0, "s", where=where, notes=(note,))
    ended = np.sort([*slots[: timed.size, 1], *(end for _, end in rests)])
    yield from _check_cues(flown, ended)


def _check_cues(
    flown: list[tuple[Move, float, float]], ended: FloatArray
) -> Iterator[Check]:
    """Whether moves keep the script's times, if show time 0 is as the first have it.

    With each move stands when its first drone leaves, infinite if none does, and when
    its last has come; ``ended`` is when legs and holds surely have, increasing [s]. A
    late move must leave straight after one of these. One of groups may leave in time
    for the log's flight, and fly more slowly.
    """
    segments, found = [one.segment for one, *_ in flown if one.cue], []
    cued = [one for one in flown if one[0].cue and one[1] < np.inf]
    for move, left, comes in cued:
        time, arrives = move.cue or (0.0, False)
        off = (comes if arrives else left) - time
        slow = left + arrives * move.duration - time
        late = min(slow, off) if segments.count(move.segment) > 1 else off
        waits = left - ended[np.searchsorted(ended, left + CONSTANTS["tick"]) - 1]
        begins = move.segment == segments[0]
        found.append((off, late, waits - CONSTANTS["clear"], begins))
    if not found:
        return
    off, late, waits, first = np.array(found).T
    own = off[first > 0.0]
    shift = max(float((own if own.size else off).min()), 0.0)
    wrong = np.maximum(np.minimum(late - shift, waits), shift - off)
    worst, most = int(np.argmax(wrong)), CONSTANTS["on_cue"]
    note = f"{off.size:,} moves; show time 0 is {shift:.1f} s after the missions begin"
    facts = bool(wrong[worst] <= most), float(wrong[worst]), most, "s"
    where = Place(segment=cued[worst][0].name, time=cued[worst][1])
    yield checked("VRF418", *facts, where=where, notes=(note,))


def _waited(
    fleet: FleetLegs,
    reached: IntArray,
    logged: list[Move],
    legs: IntArray,
    spans: FloatArray,
) -> tuple[float, float]:
    """By how much missions wait longer than the log before a move, and until when [s].

    They wait while no drone needs the time before a slot, holds aside: of one move that
    is one wait, of any drones. The first of the ``spans``, from when to when time is
    needed, (n, 2) [s], are those of the slots before ``legs`` (m,).
    """
    order = np.argsort(spans[:, 0], kind="stable")
    before, idle = np.maximum.accumulate(spans[order, 1]), np.zeros(len(spans))
    longer = spans[order[1:], 0] - before[:-1] - 2.0 * CONSTANTS["tick"]
    idle[order[1:]] = np.maximum(longer, 0.0)
    idle[legs.size :] = 0.0
    begin = np.array([one.start for one in logged])
    over = np.maximum.accumulate(begin + [m.duration + m.held for m in logged])
    still = np.maximum(begin - over[np.searchsorted(begin, begin) - 1], 0.0)
    ends, rows = np.maximum.accumulate(reached, axis=1), pairwise(fleet.first.tolist())
    some = [np.searchsorted(e, np.arange(*r)) for e, r in zip(ends, rows, strict=True)]
    of = np.minimum(np.concatenate(some), still.size - 1)[legs]
    # Waits of the log before a move without a slot are those before the next one.
    slots, of = np.unique(of, return_inverse=True)
    still = np.bincount(np.searchsorted(slots, np.arange(still.size)), still)
    # Groups side by side may leave in another order than in the log.
    left = [spans[: legs.size, 0][of == k].min() for k in range(slots.size)]
    order = np.lexsort((left, [logged[k].segment for k in slots]))
    waits = np.bincount(of, idle[: legs.size])[order] - still[: slots.size]
    longest = float(waits.max(initial=-np.inf)) - CONSTANTS["spin_up"]
    return longest, float(spans[int(np.argmax(idle)), 0])


def boundaries(fleet: FleetLegs, site: pb.Site) -> Iterator[Check]:
    """Hold all lines against walls and fence, with what is flown beyond their ends.

    Lines keep the fence's margin, from the walls where these are the fence; what is
    flown beyond their ends may use it up.
    """
    excess = fleet.profiles.excess.copy()
    # A landing ends on the ground.
    excess[fleet.first[1:] - 1] = 1.0
    beyond = fleet.begin + excess[:, None] * (fleet.end - fleet.begin)
    low, high, margin = xyz(site.volume_min), xyz(site.volume_max), site.fence_margin
    inset = np.array([0.0 if len(site.fence) else margin] * 2 + [0.0])
    spare = [
        (np.minimum(places - low, high - places) - less).min(axis=1)
        for places, less in ((fleet.begin, inset), (fleet.end, inset), (beyond, 0.0))
    ]
    nearest = np.min(spare, axis=0)
    leg = int(np.argmin(nearest))
    yield _boundary("VRF415", fleet, float(nearest[leg]), leg)
    if not len(site.fence):
        return
    fence, found = np.array(site.fence).reshape(-1, 2), []
    ways = (fleet.begin, fleet.end, margin), (fleet.end, beyond, 0.0)
    for begin, end, less in ways:
        lines = np.stack([begin[:, :2], end[:, :2]], axis=1)
        lower, leg = enclosed(lines, fence)
        found.append((lower - less if lower >= TOUCHES else -np.inf, leg))
    yield _boundary("VRF416", fleet, *min(found))


def _boundary(code: str, fleet: FleetLegs, spare: float, leg: int) -> Check:
    way = f"tightest on the way to the place of line {fleet.lines[leg]}"
    note = "with what is flown beyond the ends of legs, but for the format's rounding"
    facts = code, spare >= -CONSTANTS["rounding"], spare, 0.0, "m to spare"
    return checked(*facts, where=Place(int(fleet.owner[leg]) + 1), notes=(way, note))


def _apart(code: str, found: Encounter, wanted: float) -> Check:
    if found.upper == np.inf:
        return checked(code, "pass", notes=("no two drones meet",))
    limit = wanted - CONSTANTS["rounding"] - 3.0 * separation.RESOLUTION
    bound = found.upper - separation.RESOLUTION
    less = f"{wanted:g} m less {wanted - limit:g} m"
    note = f"{less} of the format's rounding and of the proofs' resolution"
    where = Place(pair=(found.pair[0] + 1, found.pair[1] + 1), time=found.time or None)
    return checked(code, bound >= limit, bound, limit, "m", where=where, notes=(note,))


def _as_claimed(
    nearest: Mapping[str, Encounter],
    fleet: FleetLegs,
    show: LoggedShow,
    described: Mapping[str, Any],
    logged: list[Move],
) -> Check:
    """Hold what the manifest predicts against what was found here.

    ``nearest`` are the nearest encounters, by the codes of their checks.
    """
    said: Any = described.get("prediction")
    start, timed = described.get("start"), logged[1:-1]
    try:
        free, legs = KNOWN["prediction"], [*said["legs"], *[{}] * len(timed)]
        # What is free stands here as it is said, if it is figures.
        wanted = {key: _free(said.get(key)) for key in free["keys"]} | {
            "legs": [
                {key: _free(leg.get(key)) for key in free["leg"]}
                | {
                    "leg": move.segment,
                    "name": move.name,
                    "optimal_start": round(move.start, 3),
                    "optimal_duration": round(move.duration, 3),
                }
                for leg, move in zip(legs, timed, strict=False)
            ],
            "firmware": KNOWN["firmware"],
            "clock": "hour" if start is None else "UTC",
            "start": start,
            # Without a start it is what slots count from.
            "start_minute": said.get("start_minute") if start is None else None,
            "delay_spread": CONSTANTS["spread"],
            "clock_lag": CONSTANTS["clock_lag"],
            "required_separation": show.rules.separation.distance,
        }
        wrong = list(unlike(said, wanted, "prediction", rounding=0.0))
        # Until when a mission may start, and reach its first slot for sure.
        starts = fleet.filled(fleet.release, np.inf)[:, 0] - fleet.climbs
        latest = float(starts.min()) - 2.0 * CONSTANTS["spread"]
        last = np.inf if (one := said["latest_mission_start"]) is None else one
        if not (type(last) in {int, float} and last <= latest):
            wrong.append(f"prediction.latest_mission_start: none up to {latest:.3f} s")
        met = [leg["closest"] for leg in said["legs"] if leg["closest"] is not None]
        for key, code, close in (
            ("legs", "VRF411", min(met, key=lambda one: one["distance"], default=None)),
            ("launch", "VRF412", said["launch"]),
            ("land", "VRF413", said["land"]),
        ):
            found = nearest[code].upper
            near = np.inf if close is None else close["distance"] + 0.0
            if near != found and not abs(near - found) <= CONSTANTS["agreement"]:
                wrong.append(f"prediction.{key}: nearest are {near} m, not {found} m")
    except _UNREADABLE:
        wrong = ["the prediction is nothing that can be read"]
    return agreement("VRF414", wrong)


def _free(said: Any) -> Any:  # noqa: ANN401 - JSON
    """Return what is said if it is a figure, a word, some, or an encounter."""
    if isinstance(said, dict):
        return {key: _free(said.get(key)) for key in ("drones", "time", "distance")}
    some = said if isinstance(said, list) else [said]
    return said if all(_WORD.fullmatch(str(one)) for one in some) else _WORD
