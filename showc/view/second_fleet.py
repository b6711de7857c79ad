"""A second fleet beside the solved one: as missions are predicted, or as was flown."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from showc.view.digest import every, stride_within
from showc.view.scene import SecondFleet

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.log.reader import LoggedShow

BUDGET = 875_000
"""Greatest number of its positions in a page (frames x drones): a quarter of those of
the solved fleet, for what was flown is noisy and hardly shrinks."""


def frame_times(logged: LoggedShow) -> FloatArray:
    """Return the show times at which a page has its second fleet, shape (T,) [s]."""
    return np.asarray(logged.times[every(logged, stride_within(logged, BUDGET))])


def mission_times(logged: LoggedShow, times: FloatArray) -> FloatArray:
    """Return the missions' own time at show ``times`` (T,), shape (T,) [s].

    Missions wait between legs: each leg of theirs is shown from the moment on at which
    the solved one begins, and waits for the next.
    """
    prediction = _prediction(logged)
    begins, slots = _slots(logged, prediction)
    which = np.searchsorted(begins, times, side="right") - 1
    ends = np.append(slots[1:], logged.predicted_times[-1])
    return np.asarray(np.minimum(slots[which] + times - begins[which], ends[which]))


def predicted_fleet(logged: LoggedShow) -> SecondFleet | None:
    """Return where the missions' flights most likely are; None: no prediction."""
    if not logged.predicted_times.size or "legs" not in _prediction(logged):
        return None
    times = frame_times(logged)
    clock = mission_times(logged, times)
    known = logged.predicted_times
    rows = np.clip(np.searchsorted(known, clock, side="right"), 1, known.size - 1)
    share = (clock - known[rows - 1]) / (known[rows] - known[rows - 1])
    before, after = (
        np.stack([logged.predicted[row][name] for name in "xyz"], axis=-1).astype(float)
        for row in (rows - 1, rows)
    )
    places = before + np.clip(share, 0.0, 1.0)[:, None, None] * (after - before)
    return SecondFleet("Missions, as predicted", times, places)


def _prediction(logged: LoggedShow) -> dict[str, Any]:
    return (logged.manifest.get("missions") or {}).get("prediction") or {}


def _slots(
    logged: LoggedShow, prediction: dict[str, Any]
) -> tuple[FloatArray, FloatArray]:
    """Show times at which legs begin, and those of the missions, both from 0 [s]."""
    pairs = [(0.0, 0.0)]
    pairs += [(leg["optimal_start"], leg["slot"]) for leg in prediction["legs"]]
    if "land_start" in prediction:
        pairs.append((logged.segments[-1].start, prediction["land_start"]))
    pairs.sort()
    begins, slots = np.array(pairs).T
    # Missions of groups may be flown in another order than the solved flights.
    return begins, np.maximum.accumulate(slots)
