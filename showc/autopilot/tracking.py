"""The flights that the autopilot's loops make of legs: late, and a little too far.

:mod:`showc.autopilot.controller` says how a drone follows its leg. What it is off its
end is followed for 10 s after the law's own end, and fades out over the last of them.
A drone whose next leg is released before begins it as it is then.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from mmap import mmap
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.autopilot.controller import (
    PLACE,
    RATE,
    STEP,
    TIME,
    Loops,
    states_at_rest,
)
from showc.processes import side_by_side

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.autopilot.parameters import Parameters
    from showc.autopilot.stage import Stage


TAIL = 10.0
"""How long after the law's end a drone is followed on [s]."""

FADE = 1.0
"""Time at the end of that in which it comes to rest at its goal [s]."""

INSTANT = 1e-9
"""Times that are nearer are the same [s]."""

TOGETHER = 512
"""Drones that are integrated at once: their numbers fit the processor's cache."""

CHUNK = 32
"""Steps after which places are worked out from states."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Where the drones of n legs are, in steps of 20 ms from their own releases."""

    along: FloatArray
    """Ways from begin to end, show frame, shape (n, 3) [m]."""
    ways: NDArray[np.float32]
    """Ways covered since the legs' begins, shape (steps, n, 3) [m]."""
    until: FloatArray
    """Time since its release at which each drone's next leg is released, shape (n,)
    [s]; inf: it has none."""
    half_way: FloatArray
    """When each drone is half way, shape (n,) [s]."""
    ended: FloatArray
    """When the law's own time has ended, shape (n,) [s]: the next item begins."""

    @property
    def over(self) -> FloatArray:
        """Time from its release after which nothing of a leg moves, shape (n,) [s].

        The last step's, or when the next leg tells where the drone is.
        """
        return np.asarray(np.minimum(self.until, STEP * (self.ways.shape[0] - 1)))

    def places(self, since: FloatArray) -> FloatArray:
        """Ways (..., n, 3) [m] covered at ``since`` (..., n) the releases [s].

        0 before them; the whole way after the last step, and from the release of the
        next leg on, which tells where the drone is then.
        """
        last, count = self.ways.shape[0] - 1, self.until.size
        own = np.broadcast_to(since, np.broadcast_shapes(np.shape(since), (count,)))
        place = np.minimum(np.maximum(own, 0.0) / STEP, float(last))
        before = np.minimum(place.astype(np.int64), last - 1)
        share = (place - before)[..., None]
        at = before * count + np.arange(count)
        ways = self.ways.reshape(-1, 3)
        covered = ways[at] * (1.0 - share)
        covered += ways[at + count] * share
        # A leg and the one after it must not both leave out the instant between them.
        covered[own < -INSTANT] = 0.0
        done = own >= self.over - INSTANT
        np.copyto(covered, self.along, where=done[..., None])
        return np.asarray(covered)

    def near(self, distance: float) -> FloatArray:
        """Return when each drone is first within ``distance`` [m] of its end, (n,) [s].

        The time of the last step for one that never is.
        """
        steps, count = self.ways.shape[:2]
        moment = np.full(count, STEP * (steps - 1))
        some, high = np.arange(count), np.linalg.norm(self.along - self.ways[0], axis=1)
        moment[high <= distance] = 0.0
        for begin in range(1, steps, CHUNK):
            # Only drones that have not been so near yet matter.
            far = high > distance
            some, high = some[far], high[far]
            rows = self.ways[begin : begin + CHUNK, some]
            left = np.vstack([high, np.linalg.norm(self.along[some] - rows, axis=2)])
            inside = left <= distance
            some_inside = np.flatnonzero(inside.any(axis=0))
            first = inside[:, some_inside].argmax(axis=0)
            one, other = left[first - 1, some_inside], left[first, some_inside]
            share = (one - distance) / (one - other)
            moment[some[some_inside]] = STEP * (begin + first - 2 + share)
            high = np.where(inside.any(axis=0), 0.0, left[-1])
        return moment


@dataclass(frozen=True, slots=True, eq=False)
class _Flown:
    """A stage that was flown."""

    stage: Stage
    tracks: Tracks
    after: FloatArray
    """States of the fleet (STATES, drones) as each drone's next leg begins, seen from
    where that begins; of a drone that has not flown yet at rest."""


class Tracker:
    """Flies the stages of a fleet, one after the other.

    A stage that was flown before is not flown again as long as it, all before it and
    the releases after it are the same.

    Parameters
    ----------
    drones
        Number of all drones of the fleet; they rest at first.
    jobs
        Processes that share them (None: one for each core), which changes nothing.
    """

    def __init__(
        self, drones: int, parameters: Parameters, jobs: int | None = 1
    ) -> None:
        self._drones, self._parameters, self._jobs = drones, parameters, jobs
        self._flown: list[_Flown] = []

    def fly(self, flown: Sequence[tuple[float, Stage]]) -> Iterator[Tracks]:
        """Yield the flights along stages, released at mission times [s], in order.

        Each is flown when it is asked for.
        """
        soonest = np.full(self._drones, np.inf)
        untils = []
        for release, stage in reversed(flown):
            own = release + stage.wait
            untils.append(soonest[stage.drones] - own)
            soonest[stage.drones] = own
        untils.reverse()
        for number, ((_, stage), until) in enumerate(zip(flown, untils, strict=True)):
            known = number < len(self._flown)
            if not known or not _alike(self._flown[number], stage, until):
                before = self._flown[number - 1].after if number else None
                self._flown[number:] = [self._flight(stage, until, before)]
            yield self._flown[number].tracks

    def _flight(
        self, stage: Stage, until: FloatArray, before: FloatArray | None
    ) -> _Flown:
        """Fly a stage from the states ``before`` it; None: all rest."""
        blocks = np.unique(stage.drones // TOGETHER).tolist()
        shared = len(blocks) > 1
        track = _blank(stage, until, shared=shared)
        after = states_at_rest(self._drones) if before is None else before
        if shared:
            room = np.frombuffer(mmap(-1, after.nbytes), np.float64)
            room.reshape(after.shape)[:] = after
            after = room.reshape(after.shape)
        else:
            after = after.copy()

        def fly(block: int) -> None:
            some = np.flatnonzero(stage.drones // TOGETHER == block)
            own = stage.drones[some]
            flight = _Flight(stage, some, self._parameters, after[:, own])
            after[:, own] = flight.draw(track)

        # Drones do not know of each other, and what they fly is put where all see it.
        side_by_side([partial(fly, block) for block in blocks], self._jobs)
        return _Flown(stage, track, after)


def _alike(known: _Flown, stage: Stage, until: FloatArray) -> bool:
    """Whether a stage was flown before, until the same releases."""
    return known.stage is stage and np.array_equal(known.tracks.until, until)


def _steps(stage: Stage, until: FloatArray) -> int:
    """How many steps drones of ``stage`` fly, the next leg's first one included."""
    lasting = np.minimum(until + STEP, stage.profile.duration + TAIL)
    return max(int(np.ceil(lasting.max(initial=0.0) / STEP)), 1)


def _blank(stage: Stage, until: FloatArray, *, shared: bool) -> Tracks:
    """Return room for the flights of ``stage``; if ``shared``, for copies of us too."""
    count, steps = stage.drones.size, _steps(stage, until) + 1
    places = steps * count * 3
    room = mmap(-1, max(4 * places + 16 * count, 1)) if shared else None

    def array(size: int, offset: int, kind: type) -> Any:  # noqa: ANN401 - of any kind
        if room is None:
            return np.empty(size, kind)
        return np.frombuffer(room, kind, size, offset)

    return Tracks(
        stage.end - stage.begin,
        array(places, 16 * count, np.float32).reshape(steps, count, 3),
        until,
        array(count, 0, np.float64),
        array(count, 8 * count, np.float64),
    )


class _Flight:
    """The flights of n drones along legs of one stage.

    Parameters
    ----------
    some
        Their positions in the stage, shape (n,).
    state
        Their states (STATES, n) at their releases, seen from where the legs begin.
    """

    def __init__(
        self,
        stage: Stage,
        some: IntArray,
        parameters: Parameters,
        state: FloatArray,
    ) -> None:
        self.some = some
        profile = stage.profile.select(some)
        self.due, self.moves = profile.duration, profile.length > 0.0
        self.along = (stage.end[some] - stage.begin[some]).T
        flat = np.hypot(self.along[0], self.along[1])
        direction = self.along[:2] / np.where(flat > 0.0, flat, 1.0)
        self.aim = np.vstack([stage.level[some] * direction, stage.climb[some]])
        self.goal = profile.length * self.aim
        self.half = 0.5 * profile.length
        self.loops = Loops(profile, self.aim, parameters)
        self.loops.state[:] = state
        self.loops.state[TIME] = 0.0
        self.step = 0
        self.half_way, self.ended = np.full((2, some.size), np.inf)
        self.places = np.empty((CHUNK + 1, TIME + 1, some.size))
        self.places[0] = self.loops.state[: TIME + 1]

    def draw(self, track: Tracks) -> FloatArray:
        """Fly till the next legs, and put where the drones are into ``track``.

        Returns
        -------
        ndarray
            States (STATES, n) at their next legs' releases, seen from where these
            begin; at rest for drones without one.
        """
        some, most = self.some, len(track.ways) - 1
        until = track.until[some]
        lasting = np.minimum(until + STEP, self.due + TAIL)
        steps = max(int(np.ceil(lasting.max() / STEP)), 1)
        handover = np.round(np.minimum(until, 1e9) / STEP).astype(np.int64)
        events = set(handover.tolist())
        carried = states_at_rest(some.size)
        track.ways[0, some] = self._ways(0)[0]
        if 0 in events:
            self._hand_over(handover == 0, carried)
        while self.step < steps:
            count = self._next(steps)
            for _ in range(count):
                self._advance()
                if self.step in events:
                    self._hand_over(handover == self.step, carried)
            rows = slice(self.step - count + 1, self.step + 1)
            track.ways[rows, some] = self._ways(count)[1:]
            self._note()
        # From here on all are on their next legs, or rest.
        track.ways[steps + 1 :, some] = track.ways[steps, some]
        ended = np.where(np.isinf(self.ended), most * STEP, self.ended)
        # On a leg of a centimetre a drone may be past its middle before it begins.
        middle = np.where(self.half_way < ended, self.half_way, 0.5 * ended)
        for found, moment in ((track.half_way, middle), (track.ended, ended)):
            found[some] = np.where(self.moves, moment, 0.0)
        return carried

    def _next(self, steps: int) -> int:
        """Begin to keep places anew; return for how many steps."""
        count = min(CHUNK, steps - self.step)
        self.row = 0
        self.places[0] = self.loops.state[: TIME + 1]
        self.loops.look_ahead()
        return count

    def _advance(self) -> None:
        self.loops.advance()
        self.step += 1
        self.row += 1
        self.places[self.row] = self.loops.state[: TIME + 1]

    def _left(self, steps: IntArray | int) -> FloatArray:
        """Return how much of what drones are off their ends counts at ``steps``."""
        return np.clip((self.due + TAIL - STEP * steps) / FADE, 0.0, 1.0)

    def _ways(self, count: int) -> FloatArray:
        """Ways (count + 1, n, 3) [m] covered at the last steps, show frame."""
        off = self.places[: count + 1, PLACE] - self.goal
        if STEP * self.step > self.due.min() + TAIL - FADE:
            steps = np.arange(self.step - count, self.step + 1)
            off *= self._left(steps[:, None])[:, None]
        off *= self._scale
        off += self.along
        return off.transpose(0, 2, 1)

    @cached_property
    def _scale(self) -> FloatArray:
        """From the autopilot's metric to the show's, which agree to a few per mille."""
        scale = self.along / np.where(self.goal != 0.0, self.goal, np.inf)
        level = np.where(np.any(scale[:2] != 0.0, axis=0), scale[:2].max(axis=0), 1.0)
        return np.vstack([level, level, np.where(scale[2] != 0.0, scale[2], 1.0)])

    def _hand_over(self, ends: BoolArray, carried: FloatArray) -> None:
        """Put the states of those whose next legs begin now into ``carried``."""
        state = self.loops.state[:, ends]
        rest = self._left(self.step)[ends] * state
        rest[PLACE] = self._left(self.step)[ends] * (state[PLACE] - self.goal[:, ends])
        rest[RATE] = state[RATE]
        carried[:, ends] = rest

    def _note(self) -> None:
        """Note drones half way, and those whose law has ended, in the last steps."""
        first, rows = self.step - self.row, slice(0, self.row + 1)
        if np.isinf(self.ended).any():
            _passed(self.ended, first, self.places[rows, TIME], self.due / STEP)
        if np.isinf(self.half_way).any():
            covered = np.add.reduce(self.aim * self.places[rows, PLACE], axis=1)
            _passed(self.half_way, first, covered, self.half)


def _passed(
    moment: FloatArray, first: int, values: FloatArray, mark: FloatArray
) -> None:
    """Put into ``moment`` (n,) [s] when values first pass ``mark`` (n,), if they do.

    The ``values`` (m, n) are those at step ``first`` and after it; moments that are
    known stay.
    """
    passes = (values[:-1] < mark) & (values[1:] >= mark)
    some = np.flatnonzero(passes.any(axis=0) & np.isinf(moment))
    step = passes[:, some].argmax(axis=0)
    before, after = values[step, some], values[step + 1, some]
    moment[some] = STEP * (first + step + (mark[some] - before) / (after - before))
