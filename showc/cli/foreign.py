"""Shows of others, and exports of showc's own, on the command line."""

from __future__ import annotations

from dataclasses import dataclass
from functools import wraps
from math import radians
from typing import TYPE_CHECKING, Any

import click

from showc.cli.options import Real, given

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from showc.foreign.verdict import Questions
    from showc.verify.report import Verification
    from showc.view.foreign import Judged

    Command = Callable[..., int]


@dataclass(frozen=True, slots=True)
class Rules:
    """What a user asks of a show of others; None: nothing."""

    separation: float | None
    """Least distance between two drones [m]."""
    max_height: float | None
    """Greatest height [m]."""
    max_speed: float | None
    """Greatest horizontal speed [m/s]."""
    max_climb: float | None
    """Greatest speed up and down [m/s]."""
    tilt: float
    """Greatest tilt of the aircraft [deg]."""

    def questions(self) -> Questions:
        """Return them as the judgement takes them."""
        from showc.foreign.facts import Asked
        from showc.foreign.smoothing import Agility
        from showc.foreign.verdict import THRUST_MAX, THRUST_MIN, Questions
        from showc.log.showc_pb2 import Separation

        agility = Agility(radians(self.tilt), THRUST_MIN, THRUST_MAX)
        distance, climb = self.separation, self.max_climb
        if distance is self.max_height is self.max_speed is climb is None:
            return Questions(None, agility)
        kept = None
        if distance is not None:
            kept = Separation(distance=distance, vertical_stretch=1.0)
        asked = Asked("asked", kept, self.max_height, self.max_speed, climb, climb)
        return Questions(asked, agility)


SUFFIXES = {".skyc", ".skyb", ".zip", ".csv", ".traj", ".vviz", ".gltf", ".glb"}
"""Endings of files that are no logs of showc's."""

_POSITIVE = Real(0.0, 1e6, min_open=True)

_OPTIONS = (
    ("--separation", "METRES", "least distance between two drones"),
    ("--max-height", "METRES", "greatest height"),
    ("--max-speed", "M/S", "greatest horizontal speed"),
    ("--max-climb", "M/S", "greatest speed up and down"),
)


def foreign_options(command: Command) -> Command:
    """Add the options that concern shows of others; the command gets them as rules."""

    @wraps(command)
    def gathered(
        *,
        separation: float | None,
        max_height: float | None,
        max_speed: float | None,
        max_climb: float | None,
        tilt: float,
        **others: Any,
    ) -> int:
        rules = Rules(separation, max_height, max_speed, max_climb, tilt)
        return command(rules=rules, **others)

    wrapped = given(
        "--tilt",
        type=Real(1.0, 80.0),
        metavar="DEGREES",
        default=30.0,
        help="Show of others: greatest tilt of the aircraft.",
    )(gathered)
    for name, unit, text in reversed(_OPTIONS):
        said = f"Show of others: {text}."
        wrapped = click.option(name, metavar=unit, type=_POSITIVE, help=said)(wrapped)
    return wrapped


def is_foreign(path: Path) -> bool:
    """Whether ``path`` is a show of another format than showc's own log."""
    return path.is_dir() or path.suffix.lower() in SUFFIXES


def verify_foreign(path: Path, rules: Rules) -> Verification:
    """Judge a show of another format."""
    from showc.foreign.folder import is_export, verify_export
    from showc.foreign.verdict import verify_foreign as judged

    if is_export(path):
        return verify_export(path)
    return judged(path, rules.questions())


def judge_foreign(path: Path, rules: Rules) -> Judged:
    """Read and judge a show of another format, to draw it.

    Raises
    ------
    UsageError
        If there is no such show.
    DamagedFileError
        If it cannot be read, so there is nothing to draw.
    """
    from showc.foreign.folder import is_export, read_manifest, verify_export
    from showc.foreign.reading import read_show
    from showc.foreign.verdict import judge, rules_for
    from showc.view.foreign import Judged

    show = read_show(path)
    if is_export(path):
        asked = [read_manifest(path).asked]
        return Judged(show, verify_export(path).to_json(), asked)
    questions = rules.questions()
    verification = judge(show, questions).to_json()
    return Judged(show, verification, rules_for(show, questions))
