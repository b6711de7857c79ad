"""What is measured: which peer solves which problem, with which settings."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from benchmarks import quadrotor
from benchmarks.problem import Problem, parse

PROBLEMS = Path(__file__).with_name("problems.yaml")

# One setting a peer for all problems: its defaults, and a common first mesh.
DEFAULTS: dict[str, dict[str, Any]] = {
    "showc": {},
    "maptor": {"mesh": [10, 4], "tolerance": 1e-6},
    "pockit": {"mesh": [10, 6], "tolerance": 1e-6},
    "yapss": {"mesh": [10, 6]},
    "mpopt": {"mesh": [10, 6], "tolerance": 1e-4},
    "rockit": {"mesh": [40, 4]},
}


@dataclass(frozen=True, slots=True)
class Case:
    """One row: a problem, a peer and its settings."""

    problem: Problem
    peer: str
    settings: dict[str, Any] = field(default_factory=dict)
    label: str = ""
    """What the settings are, where a peer has several rows."""

    @property
    def key(self) -> str:
        """Name of the row."""
        return " ".join(filter(None, (self.problem.name, self.peer, self.label)))


def load() -> dict[str, Problem]:
    """Read ``problems.yaml``."""
    data = yaml.safe_load(PROBLEMS.read_text(encoding="utf-8"))
    return {name: parse(name, entry) for name, entry in data.items()}


def classic() -> list[Case]:
    """Every problem of ``problems.yaml`` with every peer."""
    return [
        Case(problem, peer, settings)
        for problem in load().values()
        for peer, settings in DEFAULTS.items()
    ]


def flights() -> list[Case]:
    """The quadrotor with the peers that can state it."""
    one, six = quadrotor.one(), quadrotor.six()
    crossed = quadrotor.six_crossed()
    fine = {"mesh": [160, 3]}
    closer = {"way": "graded", "options": {"tolerance": 5e-5}}
    joint = {"way": "fleet", "gap": 0.001}
    adaptive = {"mesh": [16, 3], "tolerance": 1e-3}
    return [
        Case(one, "showc", {"way": "drone"}, "drone"),
        Case(one, "showc", {"way": "graded"}, "core, graded meshes"),
        Case(one, "showc", closer, "core, graded meshes to 5e-5"),
        Case(one, "showc", {"way": "mesh"}, "core, 53 x 3, linear controls"),
        Case(one, "showc", {"way": "core"}, "core"),
        Case(one, "yapss", {"mesh": [10, 6]}, "10 x 6"),
        Case(one, "yapss", {"mesh": [40, 4]}, "40 x 4"),
        Case(one, "yapss", fine, "160 x 3"),
        Case(one, "maptor", {"mesh": [10, 6]}, "10 x 6, fixed"),
        Case(one, "maptor", adaptive, "16 x 3, refined to 1e-3"),
        Case(one, "pockit", {"mesh": [10, 6], "tolerance": 1e-4}, "refined to 1e-4"),
        Case(one, "mpopt", {"mesh": [10, 6], "tolerance": 1e-4}, "10 x 6, adapted"),
        Case(one, "rockit", {"mesh": [40, 4]}, "40 x 4"),
        Case(six, "showc", joint, "fleet"),
        Case(six, "yapss", {"mesh": [10, 6]}, "10 x 6, all pairs"),
        Case(six, "maptor", {"mesh": [10, 6]}, "10 x 6, fixed, all pairs"),
        Case(six, "rockit", {"mesh": [40, 4]}, "40 x 4, all pairs"),
        Case(crossed, "showc", joint, "fleet"),
        Case(crossed, "yapss", {"mesh": [10, 6]}, "10 x 6, all pairs"),
    ]
