"""A whole crowd apart at once: changes of all its flights together.

Where they lead there, the gentlest changes are taken, about the flights as they are.
Which way round each other drones go is then decided by where those begin; where that
leads nowhere, ways are found through a fourth dimension, from several beginnings.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.changes import Untangled
from showc.fleet.deconfliction.elastic import Elastic
from showc.fleet.deconfliction.neighbours import near_pairs
from showc.fleet.deconfliction.programs import Programs

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.fleet.deconfliction.crowd import Crowd
    from showc.fleet.execution.pool import Workers


_AROUND = 2.0
"""Distance within which drones make way for some that come too near, in separations:
those about these stay as they are."""
_MANY = 200
"""Drones from which on there is one beginning."""
_FEW = 12
"""Drones up to which ways are looked for in the crowd's own time first, even where it
may take more: six and eight that exchange places across a ring then take 0.1 % more
than the least time, not 0.3 and 0.4 %, and less than half of the search. For these
few, what was tried begins no search in more time: eight that turn within a cube then
take 9.6 % more than the least time, not 10.0 %."""
_STARTS = 3
"""Beginnings of a way through a fourth dimension."""
_HOPELESS = 0.35
"""Wrong for each drone, from which on no other beginning is tried: the time is too
short."""
_MOST, _BESIDE, _BETTER, _SEARCH = 12, 2, 0.003, 5e10
"""Beginnings at most where the time is free; how many are followed at once; by what
share one of these is to be better than all before; and products of numbers after which
there is no other."""
SOON = 0.003
"""Share of more time than the crowd's that ways may take and are flown in it."""
_SLOWER, _HARDLY_SLOWER = (1.1, 1.3), 1.01
"""Times that random beginnings have at first, over the crowd's, and that of changes
tried in its own time: for a third of the work, these parted three of seven crowds in
1 % less time than two random ones, two in the same, and two in up to 1 % more."""
_WRONG = 1.0
"""How much more time what is wrong with an outcome is thought to take, over its share
of the drones."""
_NEARLY, _HARDLY, OF_MANY = 0.1, 3.0, 0.03
"""Wrong for each drone, at most, and for each drone of a great crowd, at which another
search would not pay: what little is lacking is made good in flight."""


def untangle(
    crowd: Crowd,
    known: FloatArray | None = None,
    *,
    anew: bool = True,
    free: bool = False,
    onward: bool = False,
) -> Untangled:
    """Change flights of a crowd until all pairs keep apart, as gently as can be.

    Parameters
    ----------
    crowd
        What each would fly alone.
    known
        Changes at the crowd's instants to begin with, shape (n, m, 3) [m]: those of
        the same crowd at another pace.
    free
        Whether more time may be taken than the crowd's.
    onward
        Whether :func:`quickest` goes on from what is :func:`hopeless` here.
    """

    def lacking(found: Untangled) -> float:
        # About others that fly already, what asks for too much tangles them anew.
        return found.wrong if anew else found.strain

    tried: list[Untangled] = []
    for search in _searches(crowd, known, anew=anew, free=free):
        found = search.run()
        tried.append(found)
        if lacking(found) == 0.0 or (anew and not hopeless(found)):
            break
    best = min(tried, key=lacking)
    if onward and not _few(crowd) and hopeless(best):
        # Changes that keep limits nearly are parted in less time than others.
        best = min(tried, key=lambda found: found.excess.sum())
    return replace(best, work=sum(found.work for found in tried))


def hopeless(found: Untangled) -> bool:
    """Whether too much is wrong with changes for them to be flown and mended."""
    drones = found.excess.size
    return found.wrong > max(min(_NEARLY * drones, _HARDLY), OF_MANY * drones)


def _few(crowd: Crowd) -> bool:
    return len(crowd.places) <= _FEW


def _searches(
    crowd: Crowd, known: FloatArray | None, *, anew: bool, free: bool
) -> Iterator[Programs | Elastic]:
    """Yield what is run until it parts the crowd."""
    many = crowd.places.shape[0] >= _MANY
    if known is not None:
        yield Elastic(crowd, known=known)
    yield Programs(_staying(crowd), limited=many, gently=not anew)
    if anew and known is None:
        second = Programs(_staying(crowd), limited=True)
        if many:
            second.begin_in_layers()
        yield second
    if crowd.hovers.any():
        yield Programs(crowd, limited=False, gently=not anew)
    if many or known is not None or (free and not _few(crowd)):
        return
    if not anew:
        yield Elastic(crowd, known=np.zeros_like(crowd.places))
        return
    for seed in range(_STARTS):
        ways = Elastic(crowd, seed)
        yield ways
        if ways.lacking > _HOPELESS * crowd.places.shape[0]:
            return


def quickest(
    crowd: Crowd, workers: Workers, tried: Untangled | None = None
) -> Untangled:
    """Change flights of a crowd until all pairs keep apart, in the least time.

    Each beginning leads to other ways round. Unless drones are few, what was tried in
    the crowd's own time is the first one. Then two random ones are followed side by
    side, and two others: until no more time is needed than the crowd's, or all of them
    were in vain.

    Parameters
    ----------
    tried
        Changes in the crowd's own time that do not part it.

    Returns
    -------
    Untangled
        Its duration is at least the crowd's, and what it takes.
    """
    rounds: list[Sequence[int | Untangled]] = []
    if tried is not None and not _few(crowd):
        rounds.append([tried])
    rounds += [range(first, first + _BESIDE) for first in range(0, _MOST, _BESIDE)]
    found: list[Untangled] = []
    for beginnings in rounds:
        least = min(map(_needed, found), default=np.inf)
        tasks = [(crowd, beginning) for beginning in beginnings]
        found += workers.run(_followed, tasks)
        now = min(map(_needed, found))
        better = now < (1.0 - _BETTER) * least
        enough = now <= (1.0 + SOON) * crowd.duration
        if not better or enough or sum(one.work for one in found) >= _SEARCH:
            break
    best = min(found, key=_needed)
    return replace(best, work=sum(one.work for one in found))


def _followed(crowd: Crowd, beginning: int | Untangled) -> Untangled:
    """Follow one beginning, with the time free; fly its ways sooner, near to limits.

    A beginning is a seed, or what was tried.
    """
    if isinstance(beginning, Untangled):
        return _sooner(crowd, beginning, _HARDLY_SLOWER)
    found = Elastic(crowd, beginning).run(_SLOWER[beginning % len(_SLOWER)])
    if found.duration <= crowd.duration or hopeless(found):
        return found
    sooner = _sooner(crowd, found, found.duration / crowd.duration)
    best = min(found, sooner, key=_needed)
    return replace(best, work=found.work + sooner.work)


def _sooner(crowd: Crowd, found: Untangled, slower: float) -> Untangled:
    """Go on from changes, at first so much slower than the crowd, in less time."""
    times = crowd.times * (found.duration / crowd.duration)
    known = found.aside(np.arange(len(crowd.places)), times)
    return Elastic(crowd, known=known).run(slower)


def _needed(found: Untangled) -> float:
    """Time that an outcome is thought to need, with what is wrong with it [s]."""
    return found.duration * (1.0 + _WRONG * found.wrong / found.excess.size)


def untangle_near(crowd: Crowd, rows: IntArray) -> Untangled:
    """Change flights of some drones, and of those about them, around all others.

    Parameters
    ----------
    rows
        Drones that come too near others, all else being well.
    """
    reach = _AROUND * crowd.separation.distance
    scaled = crowd.places * np.asarray(crowd.separation.metric_scale)
    pairs = [near_pairs(scaled[:, k], reach, 2.0) for k in range(scaled.shape[1])]
    drones = scaled.shape[0]
    first = np.concatenate([pair[0] for pair in pairs])
    second = np.concatenate([pair[1] for pair in pairs])

    def about(some: BoolArray) -> BoolArray:
        found = some.copy()
        found[first[some[second]]] = True
        found[second[some[first]]] = True
        return found

    wrong = np.zeros(drones, dtype=bool)
    wrong[rows] = True
    free = about(wrong)
    chosen = np.nonzero(about(free))[0]
    found = untangle(crowd.part(chosen, free[chosen]), anew=False)
    return found.among(chosen, drones)


def _staying(crowd: Crowd) -> Crowd:
    """Return the same crowd, in which those that hover cannot move."""
    still = crowd.hovers[:, None, None]
    return replace(crowd, give=np.where(still, 0.0, crowd.give))
