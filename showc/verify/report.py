"""What verification found: checks, the verdict, and JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from showc.documents.values import figures, plain
from showc.verify.codes import GROUPS, codes

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from showc.verify.kernel.show import Statement

Verdict = Literal["pass", "fail", "unproved", "accepted", "warning", "skipped"]
"""``unproved``: looked at, and only estimated or not known; ``accepted``: the same, and
the script accepts it; ``skipped``: there is nothing to prove."""

FORMAT_VERSION = 2  # of the JSON result

Standing = Literal["proved", "not proved", "accepted", "none"]
"""Of the trajectories, or of the missions, as a whole; ``accepted``: not proved, and
the script says that this will do; ``none``: there are no missions."""

NAMED = 5  # findings of a kind, of all that there are

_NEAREST = {"VRF321", "VRF411", "VRF412", "VRF413", "VRF504"}
"""Checks whose value is a distance that drones keep: their figure stands for all."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where in the show, or in the file, something was found; unknown parts None."""

    drone: int | None = None
    """Drone, counting from 1."""
    pair: tuple[int, int] | None = None
    """Pair of drones, counting from 1."""
    segment: str | None = None
    """Name of the segment."""
    time: float | None = None
    """Show time [s]."""
    file: str | None = None
    """Name of another file than the log."""

    def __str__(self) -> str:
        pair, time = self.pair, self.time
        parts = (
            self.file,
            pair and f"drones {pair[0]} and {pair[1]}",
            self.drone and f"drone {self.drone}",
            self.segment and f"“{self.segment}”",
            None if time is None else f"at {time:.3f} s",
        )
        return ", ".join(part for part in parts if part)


@dataclass(frozen=True, slots=True)
class Check:
    """One statement about the show, and whether it holds."""

    code: str
    """``VRF`` and three digits; what it means is in ``codes``."""
    group: str
    """Heading it stands under: integrity, physics, limits, ..."""
    name: str
    """What is proved, in words."""
    verdict: Verdict
    """Whether it holds; ``skipped``: not looked at, the notes say why."""
    value: float | None = None
    """What was found, in ``unit``."""
    limit: float | None = None
    """What was allowed, in ``unit``."""
    unit: str = ""
    """Unit of value and limit."""
    where: Place = field(default_factory=Place)
    """Where the value was found."""
    notes: tuple[str, ...] = ()
    """What else there is to say: tolerances, further findings."""

    def figures(self) -> tuple[str, str]:
        """Value and limit as text; more digits where they decide."""
        if self.value is None:
            return "", ""
        digits = 9 if self.verdict == "fail" else 4
        value = f"{figures(self.value, digits)} {self.unit}".rstrip()
        if self.limit is None:
            return value, ""
        return value, f"limit {figures(self.limit, digits)}"

    def to_json(self) -> dict[str, Any]:
        """Return a dictionary that JSON can hold."""
        where = {key: one for key, one in asdict(self.where).items() if one is not None}
        return dict(plain(asdict(self) | {"where": where}))


def checked(
    code: str,
    verdict: Verdict | bool | None,  # noqa: FBT001 - a verdict too
    value: float | None = None,
    limit: float | None = None,
    unit: str = "",
    *,
    where: Place | None = None,
    notes: tuple[str, ...] = (),
) -> Check:
    """Return a check whose heading and name are those of its code.

    Of a verdict that is none of the words, true is ``pass``, false is ``fail``, and
    None is ``skipped``.
    """
    if not isinstance(verdict, str):
        verdict = "skipped" if verdict is None else "pass" if verdict else "fail"
    group = next(one for start, one in GROUPS.items() if code.startswith(start))
    facts = verdict, value, limit, unit, where or Place(), notes
    return Check(code, group, codes()[code].title, *facts)


def check_of(statement: Statement) -> Check:
    """Return what the kernel proves as a check."""
    drones = [drone + 1 for drone in statement.drones]
    drone = drones[0] if len(drones) == 1 else None
    pair = (drones[0], drones[1]) if len(drones) == 2 else None
    where = Place(drone, pair, statement.segment, statement.time)
    facts = statement.holds, statement.value, statement.limit, statement.unit
    return checked(statement.code, *facts, where=where, notes=statement.notes)


def agreement(code: str, wrong: Iterable[str]) -> Check:
    """Return a check that holds if nothing is wrong, and else names what is."""
    bad = tuple(dict.fromkeys(wrong))
    more = (f"and {len(bad) - NAMED} more",) if len(bad) > NAMED else ()
    return checked(code, not bad, notes=(*bad[:NAMED], *more))


@dataclass(frozen=True, slots=True)
class Verification:
    """The whole result."""

    path: str
    """The log, as it was named."""
    title: str
    """Name of the show."""
    drones: int
    """Size of the fleet."""
    duration: float
    """Time of the show [s]."""
    anchor: str
    """What is trusted: the script with its hash, and where it came from."""
    checks: tuple[Check, ...]
    """In the order in which they were made."""

    @property
    def trajectories(self) -> Standing:
        """Whether all is proved of what the log holds."""
        return _standing(self._of(missions=False))

    @property
    def missions(self) -> Standing:
        """Whether all is proved of the missions beside the log."""
        return _standing(self._of(missions=True))

    @property
    def proved(self) -> bool:
        """Whether all that lies there to be flown is proved; then badges are green."""
        return self.trajectories == "proved" and self.missions in {"proved", "none"}

    @property
    def passed(self) -> bool:
        """Whether all is proved, but for what the script accepts unproved."""
        return self.trajectories == "proved" and self.missions != "not proved"

    @property
    def verdict(self) -> str:
        """One line: what is proved, and what is not, with the worst figures."""
        head = "PROVED" if self.proved else "NOT PROVED"
        if self.passed and not self.proved:
            head = "PROVED BUT FOR MISSIONS"
        flown = _outcome(self.trajectories, self._of(missions=False))
        sent = _outcome(self.missions, self._of(missions=True))
        return f"{head}: trajectories {flown}; missions {sent}."

    def _of(self, *, missions: bool) -> list[Check]:
        return [c for c in self.checks if c.code.startswith("VRF4") == missions]

    def check(self, code: str) -> Check:
        """Return the first check of that code; KeyError if there is none."""
        return {check.code: check for check in reversed(self.checks)}[code]

    def to_json(self) -> dict[str, Any]:
        """Return the whole result as a dictionary that JSON can hold."""
        said = {"format_version": FORMAT_VERSION, "log": self.path, "show": self.title}
        same = ("drones", "duration", "anchor", "verdict", "trajectories", "missions")
        for name in (*same, "proved", "passed"):
            said[name] = getattr(self, name)
        said["exit_code"] = int(not self.passed)
        return {**plain(said), "checks": [check.to_json() for check in self.checks]}


def _standing(checks: Sequence[Check]) -> Standing:
    """Return what the checks of one side come to; the least of them decides."""
    verdicts = {check.verdict for check in checks}
    if verdicts & {"fail", "unproved"}:
        return "not proved"
    if "accepted" in verdicts:
        return "accepted"
    none = any(c.code == "VRF400" and c.verdict == "skipped" for c in checks)
    return "proved" if "pass" in verdicts and not none else "none"


def _outcome(standing: Standing, checks: Sequence[Check]) -> str:
    """Return a standing in words, with the figure that is worst."""
    if standing == "none":
        return next((f"none: {c.notes[0]}" for c in checks if c.notes), "none")
    bad = [check for check in checks if check.verdict in {"fail", "unproved"}]
    if bad:
        count = f"{len(bad)} of {len(checks)} checks"
        return f"NOT PROVED ({count}; {bad[0].code}: {bad[0].name}{figure(bad[0])})"
    if standing == "accepted":
        open_ = next(check for check in checks if check.verdict == "accepted")
        return f"NOT PROVED, as the script accepts ({open_.code}: {open_.notes[0]})"
    parts = []
    near = [c for c in checks if c.code in _NEAREST and c.limit is not None]
    if near:
        worst = min(near, key=lambda check: (check.value or 0.0) - (check.limit or 0.0))
        parts.append(f"closest pair{figure(worst)}")
    free = [c.name for c in checks if c.verdict == "skipped" and c.value is not None]
    if free:
        parts.append(f"no limit known for {', '.join(dict.fromkeys(free))}")
    return f"proved ({'; '.join(parts)})" if parts else "proved"


def figure(check: Check) -> str:
    """Return the worst figure with its limit; what a check has noted if it has none."""
    value, limit = check.figures()
    if not value:
        return f": {check.notes[0]}" if check.notes else ""
    return f" {value}" + (f", {limit}" if limit else "")
