"""The lights of missions: the colours that moves end in, each at its time."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.verify.missions.language import Mission


class Lit(NamedTuple):
    """A colour of a drone's lights, and when it comes on."""

    pulses: list[int]
    """Pulse width of each output [us]."""
    step: int
    """Of a move: how many legs there are up to its end, -1 if that is not known. Of a
    mission: how many legs and slots are behind it."""


def unlit(
    mission: Mission, asked: Sequence[Lit], servos: Sequence[int]
) -> Iterator[str]:
    """Say how a mission's lights differ from those that its moves ask for, in order.

    A colour comes on the legs of its own move, from the slot of the first up to the
    slot that follows the last; if a drone has none, on a slot in between.
    """
    new = [n for n, one in enumerate(asked) if not n or one[0] != asked[n - 1][0]]
    try:
        shown, steps = _shown(mission, asked[0], servos)
    except ValueError as error:
        yield str(error)
        return
    wanted = [asked[n].pulses for n in (new if servos else new[:1])]
    if [one.pulses for one in shown] != wanted:
        found = [one.pulses for one in shown]
        yield f"shows {found}, the moves end in {wanted} us"
    for one, at in zip(shown[1:], new[1:], strict=False):
        before, last = asked[at - 1].step, asked[at].step
        if min(before, last) < 0:
            continue
        low, high = steps[before] + 1, steps[min(last + 1, len(steps) - 1)] - 2
        if before < last:
            low, high = steps[before + 1] - 1, steps[last]
        if not low <= one.step <= high:
            yield f"shows {one.pulses} us on the legs of another move"


def _shown(
    mission: Mission, dark: Lit, servos: Sequence[int]
) -> tuple[list[Lit], list[int]]:
    """Return what a mission shows one after the other, dark at first.

    Also returns how many legs and slots there are up to the end of each leg. ValueError
    if it sets an output that is not one of them, or twice at once, or to no avail; or
    not all of them before it flies.
    """
    found, steps, step = [dark], [0], 0
    now: dict[int, int] = {}
    for word, some in groupby(mission.items, key=lambda item: item.word):
        items = list(some)
        if word != "V":
            for _ in items if word in "TWLCGP" else ():
                step += 1
                steps += [step] * (word in "TWL")
            continue
        own = {int(item.parameters[0]): int(item.parameters[1]) for item in items}
        if not now and (step > 1 or own.keys() != {*servos}):
            raise ValueError("does not set its outputs, and those alone, at first")
        if len(own) < len(items) or own.items() & now.items() or own.keys() - {*servos}:
            raise ValueError("sets an output that the script does not name, or again")
        now |= own
        pulses = [now.get(pin, was) for pin, was in zip(servos, dark[0], strict=True)]
        found += [Lit(pulses, step)] * (pulses != found[-1].pulses)
    if now.keys() != {*servos}:
        raise ValueError("does not set its outputs")
    return found, steps
