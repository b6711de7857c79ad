"""Foreign shows, and exports of showc's own, on the command line."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from functools import wraps
from math import radians
from typing import TYPE_CHECKING, Any

import click

from showc.cli.options import Real

if TYPE_CHECKING:
    from collections.abc import Callable, Container
    from pathlib import Path

    from showc.foreign.facts import Asked
    from showc.foreign.verdict import Questions
    from showc.verify.report import Verification
    from showc.view.foreign import Judged

    Command = Callable[..., int]


@dataclass(frozen=True, slots=True)
class Rules:
    """What a user asks of a foreign show; None: nothing."""

    separation: float | None
    """Least distance between two drones [m]."""
    max_height: float | None
    """Greatest height [m]."""
    max_speed: float | None
    """Greatest horizontal speed [m/s]."""
    max_climb: float | None
    """Greatest speed up and down [m/s]."""
    tilt: float | None
    """Greatest tilt of the aircraft [deg]."""

    def asked(self) -> Asked | None:
        """Return those that every drone and pair must keep."""
        from showc.foreign.facts import Asked
        from showc.log.showc_pb2 import Separation

        distance, climb = self.separation, self.max_climb
        if distance is self.max_height is self.max_speed is climb is None:
            return None
        kept = None
        if distance is not None:
            kept = Separation(distance=distance, vertical_stretch=1.0)
        return Asked("asked", kept, self.max_height, self.max_speed, climb, climb)

    def questions(self) -> Questions:
        """Return them as the judgement takes them."""
        from showc.foreign.smoothing import Agility
        from showc.foreign.verdict import THRUST_MAX, THRUST_MIN, Questions

        tilt = TILT if self.tilt is None else self.tilt
        agility = Agility(radians(tilt), THRUST_MIN, THRUST_MAX)
        return Questions(self.asked(), agility)

    def refuse(self, path: Path, reason: str, keys: Container[str]) -> None:
        """Refuse those rules among ``keys`` that cannot be applied to a show.

        Raises
        ------
        UsageError
            If one of them is given; it names the option and says why.
        """
        from showc.errors import UsageError

        for key, value in asdict(self).items():
            if key in keys and value is not None:
                option = f"--{key.replace('_', '-')}"
                raise UsageError(f"{path}: {option} {value:g}: {reason}")


SUFFIXES = {".skyc", ".skyb", ".zip", ".csv", ".traj", ".vviz", ".gltf", ".glb"}
"""Endings of files that are no logs of showc's."""

_POSITIVE = Real(0.0, 1e6, min_open=True)

TILT = 30.0
"""Greatest tilt of an aircraft where none is given [deg]: common for shows."""

_OPTIONS = (
    ("--separation", "METRES", _POSITIVE, "least distance between two drones"),
    ("--max-height", "METRES", _POSITIVE, "greatest height"),
    ("--max-speed", "M/S", _POSITIVE, "greatest horizontal speed"),
    ("--max-climb", "M/S", _POSITIVE, "greatest speed up and down"),
    (
        "--tilt",
        "DEGREES",
        Real(1.0, 80.0),
        f"greatest tilt of the aircraft, by default {TILT:g}",
    ),
)


def foreign_options(command: Command) -> Command:
    """Add the options that concern foreign shows; the command gets them as rules."""
    names = [field.name for field in fields(Rules)]

    @wraps(command)
    def gathered(log: Path, **options: Any) -> int:
        rules = Rules(**{name: options.pop(name) for name in names})
        if not is_foreign(log):
            reason = "a log is proved against its script; change the script instead"
            rules.refuse(log, reason, names)
        return command(log=log, rules=rules, **options)

    wrapped: Command = gathered
    for name, unit, kind, text in reversed(_OPTIONS):
        said = f"For another tool's show: {text}."
        wrapped = click.option(name, metavar=unit, type=kind, help=said)(wrapped)
    return wrapped


def is_foreign(path: Path) -> bool:
    """Whether ``path`` is a show of another format than showc's own log."""
    return path.is_dir() or path.suffix.lower() in SUFFIXES


def _verify_export(path: Path, rules: Rules) -> Verification:
    """Prove an export of showc's by its own rules, and by those asked for."""
    from showc.foreign.folder import verify_export

    reason = "an export of showc's is flown as it stands, without smoothing; leave it"
    rules.refuse(path, f"{reason} out", {"tilt"})
    return verify_export(path, rules.asked())


def verify_foreign(path: Path, rules: Rules) -> Verification:
    """Judge a show of another format."""
    from showc.foreign.folder import is_export
    from showc.foreign.verdict import verify_foreign as judged

    if is_export(path):
        return _verify_export(path, rules)
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
    from showc.foreign.folder import is_export, read_manifest
    from showc.foreign.reading import read_show
    from showc.foreign.verdict import judge, rules_for
    from showc.view.foreign import Judged

    show = read_show(path)
    if is_export(path):
        beside = rules.asked()
        asked = [*([] if beside is None else [beside]), read_manifest(path).asked]
        return Judged(show, _verify_export(path, rules).to_json(), asked)
    questions = rules.questions()
    verification = judge(show, questions).to_json()
    return Judged(show, verification, rules_for(show, questions))
