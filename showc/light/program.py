"""The light program: which drone shows which colour when.

A drone takes the colour of its place. Over a move the colour fades from the one it
has to the one of the place it flies to (evenly in linear light, or at the start or
the end of the move, as the script says). Over a hold it stays, or an effect plays.
From the launch until the first picture, and from above the pads down, all is dark.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import tau
from typing import TYPE_CHECKING, Self

import numpy as np

from showc.light.colour import drive_bytes, full_hue, srgb_bytes
from showc.light.keyframes import Lit, keyframes_of, placed
from showc.script.lanes import chapters

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import ArrayLike

    from showc.arrays import ByteArray, FloatArray, IntArray
    from showc.flight import Flight
    from showc.light.keyframes import Keyframes
    from showc.plan.itinerary import Leg
    from showc.script.show import Effect, Formation, Show, Transition

    Share = tuple[Transition | None, IntArray]  # what is flown, None: waiting; drones


_FLASH = 0.25
"""Share of a period that a strobe shines: mostly dark, so that flashes are seen."""
_GOLDEN = 0.6180339887498949
"""Fraction of the golden ratio: its multiples fill an interval most evenly."""
EASE = 0.5
"""Greatest time over which an effect sets in [s]; a quarter of the hold if shorter."""


@dataclass(frozen=True, slots=True, eq=False)
class LightSpan:
    """The light of some drones over one leg."""

    start: float
    """Show time at which it begins [s]."""
    duration: float
    """How long it lasts [s]."""
    drones: IntArray
    """Which drones, counting from 0, shape (n,)."""
    begin: FloatArray
    """Their linear colours at the start, shape (n, 3)."""
    end: FloatArray
    """Their linear colours at the end, effects aside, shape (n, 3)."""
    fade: str
    """``linear``, ``start`` or ``end``: when the colour changes."""
    effect: Effect | None
    """Effect that plays over it."""
    places: FloatArray
    """Where the drones hover at the end, shape (n, 3), show frame [m]."""
    keys: Keyframes | None = None
    """Colours at moments, instead of those at start and end."""

    def linear(self, elapsed: FloatArray) -> FloatArray:
        """Linear colours at times (T,) since the start [s], shape (T, n, 3)."""
        elapsed = np.clip(elapsed, 0.0, self.duration)
        if self.fade == "start":
            share = (elapsed > 0.0).astype(np.float64)
        elif self.fade == "end":
            share = (elapsed >= self.duration).astype(np.float64)
        else:
            share = elapsed / self.duration
        if self.keys is not None:
            colours = self.keys.linear(elapsed)
        else:
            weight = share[:, None, None]
            colours = (1.0 - weight) * self.begin + weight * self.end
        if self.effect is None:
            return np.asarray(colours)
        ease = min(EASE, 0.25 * self.duration)
        strength = np.clip(elapsed / ease, 0.0, 1.0)[:, None, None]
        since = 0.0 if self.effect.beat is None else self.start - self.effect.beat
        played = _play(self.effect, elapsed + since, self.places, colours)
        return np.asarray((1.0 - strength) * colours + strength * played)


def _play(
    effect: Effect, elapsed: FloatArray, places: FloatArray, colours: FloatArray
) -> FloatArray:
    """Colours (T, n, 3) under ``effect`` at times (T,) since its start [s].

    A strobe shows the colours for the first quarter of each period, and 1 - depth of
    them for the rest. A twinkle is a pulse that begins, for the i-th drone, at the
    fraction of i times the golden ratio of its period. What runs goes through its
    colours, and from the last back to the first, evenly in light and once a turn. It
    has the brightness of the colour that it replaces. With turns w = t / period -
    (place . direction) / wavelength (pulses without the second term), pulse and sweep
    dim to 1 - depth (1 - cos 2 pi w) / 2, and a rainbow shows the hue w in the
    brightness of the colour it replaces.
    """
    turns = np.broadcast_to(
        (elapsed / effect.period)[:, None], (elapsed.size, places.shape[0])
    )
    if effect.kind == "strobe":
        dark = np.mod(turns, 1.0) >= _FLASH
        return np.asarray(colours * (1.0 - effect.depth * dark)[..., None])
    if effect.kind == "twinkle":
        turns = turns + np.mod(np.arange(places.shape[0]) * _GOLDEN, 1.0)
    if effect.kind in {"sweep", "rainbow", "run"}:
        axis = np.asarray(effect.direction)
        turns = turns - places @ axis / effect.wavelength
    if effect.kind == "rainbow":
        brightness = colours.max(axis=-1, keepdims=True)
        return np.asarray(full_hue(turns) * brightness)
    if effect.kind == "run":
        ring = np.array([*effect.colours, effect.colours[0]])
        way = np.mod(-turns, 1.0) * len(effect.colours)
        steps = np.arange(len(ring))
        shown = [np.interp(way, steps, ring[:, channel]) for channel in range(3)]
        brightness = colours.max(axis=-1, keepdims=True)
        return np.asarray(np.stack(shown, axis=-1) * brightness)
    dimming = 1.0 - effect.depth * (0.5 - 0.5 * np.cos(tau * turns))
    return np.asarray(colours * dimming[..., None])


@dataclass(frozen=True, slots=True, eq=False)
class LaneMove:
    """The move of a group that has times of its own."""

    transition: Transition
    """What the script says of it."""
    drones: IntArray
    """Which drones, counting from 0, shape (n,)."""
    places: IntArray
    """Place of each in the formation reached, shape (n,); -1: parked and dark."""
    start: float
    """Show time of the departure [s]."""
    end: float
    """Show time of the arrival [s]."""


def lane_spans(
    show: Show,
    moves: Sequence[LaneMove],
    begin: FloatArray,
    window: tuple[float, float],
) -> list[LightSpan]:
    """Lay out the light of the fleet while groups move at times of their own.

    Parameters
    ----------
    show
        With the formations.
    moves
        In order, those of each group.
    begin
        Linear colours of the fleet at the beginning, shape (drones, 3).
    window
        Show times of beginning and end [s].

    Returns
    -------
    list[LightSpan]
        Those of each drone follow each other without a gap, in order of their start.
    """
    first, last = window
    found: list[LightSpan] = []
    still = np.ones(show.drones, dtype=bool)

    def lit(
        move: LaneMove, start: float, end: float, now: FloatArray, *, there: bool
    ) -> FloatArray:
        """Light a group until it moves, while it does or, ``there``, after it."""
        one = move.transition
        formation = show.formations[one.to]
        moving = start == move.start
        everyone = np.arange(move.drones.size)
        keys = keyframes_of(now, start, [Lit(one.lights, everyone, move.places)])
        span = LightSpan(
            start,
            end - start,
            move.drones,
            now,
            shown(one, formation, move.places) if moving else now,
            one.fade if moving else "linear",
            (one.effect or formation.effect) if there else None,
            formation.points[np.maximum(move.places, 0)],
            keys if there else None,
        )
        found.append(span)
        return np.asarray(span.linear(np.array([span.duration]))[0])

    for group in dict.fromkeys(move.transition.group for move in moves):
        mine = [move for move in moves if move.transition.group == group]
        still[mine[0].drones] = False
        now = begin[mine[0].drones]
        if mine[0].start > first:
            now = lit(mine[0], first, mine[0].start, now, there=False)
        for move, until in zip(mine, [*(m.start for m in mine[1:]), last], strict=True):
            now = lit(move, move.start, move.end, now, there=False)
            if until > move.end:
                now = lit(move, move.end, until, now, there=True)
    if still.any():
        rows = np.flatnonzero(still)
        colours, nowhere = begin[rows], np.zeros((rows.size, 3))
        found.append(
            LightSpan(
                first, last - first, rows, colours, colours, "linear", None, nowhere
            )
        )
    return sorted(found, key=lambda span: span.start)


@dataclass(frozen=True, slots=True, eq=False)
class LightProgram:
    """Colours of a whole fleet over a whole show."""

    drones: int
    """Size of the fleet."""
    duration: float
    """Length of the show [s]; dark before and after."""
    spans: tuple[LightSpan, ...]
    """In order of their start; those of one drone follow each other."""

    @classmethod
    def of(cls, flight: Flight) -> Self:
        """Lay out the light of ``flight`` as its show describes it."""
        legs = [flown.leg for flown in flight.legs]
        durations = [flown.duration for flown in flight.legs]
        return cls.over(flight.itinerary.show, legs, flight.starts, durations)

    @classmethod
    def over(
        cls,
        show: Show,
        legs: Sequence[Leg],
        starts: Sequence[float] | FloatArray,
        durations: Sequence[float],
    ) -> Self:
        """Lay out the light of legs that start and last as said, by the show [s]."""
        present = np.zeros((show.drones, 3))
        together = {index: flown for flown in chapters(show) for index in flown}
        spans: list[LightSpan] = []
        ends = [float(s) + d for s, d in zip(starts, durations, strict=True)]
        done = -1
        for number, leg in enumerate(legs):
            start, duration = float(starts[number]), durations[number]
            if leg.parts:
                # The hold after it belongs to what each group does last.
                after = legs[number + 1 : number + 2]
                held = any(one.kind == "hold" for one in after)
                done = number + held
                moves = [
                    LaneMove(
                        show.transitions[part.transition or 0],
                        part.drones,
                        part.places,
                        part.depart or 0.0,
                        (part.depart or 0.0) + (part.duration or 0.0),
                    )
                    for part in leg.parts
                    if not part.motion
                ]
                window = start, ends[done]
                for span in lane_spans(show, moves, present.copy(), window):
                    spans.append(span)
                    present[span.drones] = span.linear(np.array([span.duration]))[0]
            if number <= done:
                continue
            flown = () if leg.transition is None else together[leg.transition]
            for share in _shares(show, [show.transitions[k] for k in flown]):
                span = _span(show, leg, share, (start, duration), present)
                spans.append(span)
                # A fade starts from what an effect leaves, so that nothing jumps.
                present[span.drones] = span.linear(np.array([duration]))[0]
        return cls(show.drones, max(ends), tuple(spans))

    def linear(self, times: ArrayLike) -> FloatArray:
        """Linear light, 0 to 1, at show times (T,) [s]; shape (T, drones, 3).

        Where one span ends and the next begins, the later one counts.
        """
        moment = np.atleast_1d(np.asarray(times, dtype=np.float64))
        colours = np.zeros((moment.size, self.drones, 3))
        for span in self.spans:
            inside = (moment >= span.start) & (moment <= span.start + span.duration)
            if inside.any():
                rows = np.flatnonzero(inside)
                colours[np.ix_(rows, span.drones)] = span.linear(
                    moment[rows] - span.start
                )
        return colours

    def sample(self, times: ArrayLike) -> ByteArray:
        """Linear LED drive values, 0 to 255, at ``times`` (T,) [s]: (T, drones, 3)."""
        return drive_bytes(self.linear(times))

    def srgb(self, times: ArrayLike) -> ByteArray:
        """Screen (sRGB) bytes of the same light at ``times`` (T,) [s]."""
        return srgb_bytes(self.linear(times))


def shown(one: Transition, formation: Formation, places: IntArray) -> FloatArray:
    """Linear colours that a transition gives to places (n,); those parked are dark."""
    colours = formation.colours if one.colours is None else one.colours
    parked = places < 0
    return np.where(parked[:, None], 0.0, colours[np.where(parked, 0, places)])


def _place_colours(show: Show, leg: Leg) -> FloatArray:
    """Colours of the places that ``leg`` reaches, (n, 3); dark where parked."""
    formation = show.formations[leg.to_formation]
    colours = formation.colours
    if leg.kind in ("launch", "approach", "land"):
        return np.zeros((leg.drones.size, 3))
    if leg.transition is not None:
        transition = show.transitions[leg.transition]
        if transition.colours is not None and transition.to == formation.name:
            colours = transition.colours
    parked = leg.places < 0
    return np.where(parked[:, None], 0.0, colours[np.where(parked, 0, leg.places)])


def _shares(show: Show, flown: Sequence[Transition]) -> Iterator[Share]:
    """Yield what is flown in one time, each with its drones; last, those that wait."""
    waits = np.ones(show.drones, dtype=bool)
    for one in flown:
        group = range(show.drones) if one.group is None else show.groups[one.group]
        drones = np.array(group)
        waits[drones] = False
        yield one, drones
    if waits.any():
        yield None, np.flatnonzero(waits)


def _span(
    show: Show,
    leg: Leg,
    share: Share,
    window: tuple[float, float],
    present: FloatArray,
) -> LightSpan:
    """Return the light of a share of a leg; ``window`` is its start, and how long.

    It begins with the colours that are ``present`` (drones, 3). Drones that wait while
    groups fly have no fade of theirs, and no effect.
    """
    (one, drones), (start, duration) = share, window
    begin, fade, effect, keys = present[drones], "linear", None, None
    end = begin if leg.kind in {"hold", "motion"} else _place_colours(show, leg)[drones]
    if end is not begin:
        fade = fade if one is None else one.fade
    elif one is not None:
        effect = one.effect or show.formations[one.to].effect
        lit = placed(show, one, leg.start[drones], leg.places[drones])
        keys = keyframes_of(begin, start, lit)
    goals = leg.goal[drones]
    return LightSpan(start, duration, drones, begin, end, fade, effect, goals, keys)
