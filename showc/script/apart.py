"""The separation of a script: what pairs keep, and how far drones may stray."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from showc.script.diagnostic import ScriptError
from showc.vehicle import Separation

if TYPE_CHECKING:
    from showc.script.files import InputFiles
    from showc.script.reader import Reader
    from showc.script.settings import Settings

MOST_TRACKING = 20.0
"""Greatest way that a drone may stray [m]: beyond it nothing is tracked."""
SURE = 0.999
"""Share of flights that a measured tube must hold to be planned with."""


def separation_of(settings: Settings, tracking: float) -> Separation:
    """Return the separation that paths keep.

    Parameters
    ----------
    settings
        What the script asks for.
    tracking
        How far each drone may stray from its path [m]: two of them, towards each other.
    """
    return settings.made(
        Separation, distance=settings.number("distance") + 2.0 * tracking
    )


def tracking_of(settings: Settings, files: InputFiles, reader: Reader) -> float:
    """Return how far each drone may stray from its path [m].

    A number, or the tube of the whole show in a file that ``showc simulate`` wrote;
    ``reader`` hears what is wrong with that file.
    """
    if settings.values["tracking"].value != "measured":
        return settings.number("tracking")
    name = settings.text("results")
    mark = settings.mark_of("results" if settings.written("results") else "tracking")
    try:
        whole = json.loads(files.read(name, "results"))["legs"][-1]
        radius, share = float(whole["radius"]), float(whole["share"])
        sound = 0.0 <= radius <= MOST_TRACKING and 0.0 <= share <= 1.0
    except ScriptError as fault:
        reader.refuse(fault, mark)
        return 0.0
    except (ValueError, KeyError, IndexError, TypeError, RecursionError):
        sound = False
    if not sound:
        reader.say(
            "SHW122",
            f"`{name}` holds no tube of at most {MOST_TRACKING:g} m",
            mark,
            help_text="`showc simulate` writes such a file, beside the log of the show",
        )
        return 0.0
    if share < SURE:
        reader.say(
            "SHW122",
            f"the tube in `{name}` holds {100.0 * share:.2f} % of flights surely, "
            f"{100.0 * SURE:g} % are wanted",
            mark,
            help_text="raise `--runs` of `showc simulate`: 2995 flights of single "
            "drones are enough",
        )
        return 0.0
    return radius
