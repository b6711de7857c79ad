"""The session: follows a script, draws each version, and lets it be solved beside."""

from __future__ import annotations

import json
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
import traceback
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from threading import Condition
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.errors import ShowError
from showc.files import UnreadableFileError, open_file
from showc.fleet.execution.cache import Cache, leg_key
from showc.light.program import shown
from showc.preview.draft import Draft, Memory, held_formation, lay_out, scene_of
from showc.script import load_show
from showc.script.files import MOST_BYTES
from showc.view.findings import Finding

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.options import SolveOptions
    from showc.flight import LegFlight
    from showc.plan.itinerary import Leg
    from showc.script import LoadResult
    from showc.script.diagnostic import Diagnostic
    from showc.script.show import Show

WATCHED = {*MOST_BYTES, ".yaml", ".yml", ".obj", ".stl", ".ply", ".glb", ".gltf"}
"""Endings of files whose change may change the show."""
_MOST_FILES = 2000
"""Files of the folder that are looked at."""
_PAUSE = 0.05
"""Time between two looks at the files [s]."""
_LOOKS = 16
"""Of these, how many pass before the cache is looked at again while solving."""
_THUMB_DRONES = 1000
"""Places of a formation that its small picture shows."""


class Session:
    """What the server shows: always the latest version that could be drawn.

    Parameters
    ----------
    script
        Path of the script.
    options
        How to solve; its cache is read, and written by the solving process.
    solve
        Whether to solve in the background.
    allow_outside
        Whether the script's files may lie elsewhere.
    """

    def __init__(
        self,
        script: Path,
        options: SolveOptions,
        *,
        solve: bool = False,
        allow_outside: bool = False,
    ) -> None:
        self.script = script
        self.changed = Condition()
        self.version = 0
        self.body = b""
        """What the page fetches: length of the header, header, numbers."""
        self._options, self._solve, self._outside = options, solve, allow_outside
        self._memory = Memory()
        self._stamps: object = None
        self._result: LoadResult | None = None
        self._shown: tuple[bytes, list[dict[str, Any]], dict[str, Any] | None] = (
            b"",
            [],
            None,
        )
        self._solved: dict[str, LegFlight] = {}
        self._solver: Solver | None = None
        self._trouble: tuple[Finding, ...] = ()

    def follow(self) -> None:
        """Draw the script now and after every change, until interrupted."""
        looks = 0
        try:
            while True:
                stamps = self._look()
                saved, self._stamps = stamps != self._stamps, stamps
                looks = 0 if saved else looks + 1
                try:
                    if saved:
                        self._read()
                    elif looks % _LOOKS == 0:
                        self._watch_solver()
                except Exception as fault:  # noqa: BLE001 - the next save may be sound
                    self._fail(fault)
                time.sleep(_PAUSE)
        finally:
            self._stop()

    def wait(self, version: int, timeout: float) -> int:
        """Return the version that is shown, another than ``version`` if one comes."""
        with self.changed:
            self.changed.wait_for(lambda: self.version != version, timeout)
            return self.version

    def _look(self) -> object:
        """Return what changes when the script or a file beside it does."""
        inputs = []
        draft = None if self._result is None else self._result.draft
        if draft is not None:
            inputs = [self.script.parent / name for name in draft.source.inputs]
        found = {str(path): _stamp(path) for path in (self.script, *inputs)}
        with suppress(OSError), os.scandir(self.script.parent) as entries:
            for _, entry in zip(range(_MOST_FILES), entries, strict=False):
                if Path(entry.name).suffix.lower() in WATCHED:
                    found[entry.path] = _stamp(Path(entry.path))
        return found

    def _read(self) -> None:
        self._stop()
        self._trouble = ()
        self._result = load_show(self.script, allow_outside=self._outside)
        # First what is quick, then what was solved some other day.
        self._draw(look=False)
        if self._result.show is None:
            return
        if self._solve:
            self._solver = Solver(self.script, self._options, outside=self._outside)
        self._draw(look=True, anyway=self._solve)

    def _watch_solver(self) -> None:
        """Show what has been solved meanwhile."""
        if self._solver is None:
            return
        ended = self._solver.ended()
        if ended is not None:
            self._stop()
            if ended:
                self._trouble = (Finding("", "error", ended, "", 0, None, ()),)
        self._draw(look=True, anyway=ended is not None)

    def _stop(self) -> None:
        if self._solver is not None:
            self._solver.stop()
            self._solver = None

    def _fail(self, fault: Exception) -> None:
        """Say that showc itself failed at what was saved; the picture stays."""
        traceback.print_exception(fault)
        self._stop()
        text = (
            f"internal error, not a fault of your show: {type(fault).__name__}: "
            f"{fault}; please report it with what the terminal shows"
        )
        said = Finding("", "error", text, "", 0, None, ())
        self._publish([said], {"stale": True, "solving": False})

    def _draw(self, *, look: bool, anyway: bool = True) -> None:
        """Lay out, draw and publish what was read; the former picture if it cannot be.

        ``look``: in the cache for solved legs; nothing is drawn without new ones unless
        ``anyway``.
        """
        result = self._result
        assert result is not None  # noqa: S101 - read before it is drawn
        findings = [_plain(item) for item in result.diagnostics]
        status: dict[str, Any] = {"stale": True, "solving": self._solver is not None}
        if result.draft is not None:
            try:
                before = len(self._solved)
                find = partial(self._find, show=result.draft, look=look)
                draft = lay_out(result.draft, self._memory, find)
                if len(self._solved) == before and not anyway:
                    return
                scene = scene_of(draft, self._memory)
            except ShowError as fault:
                findings.append(Finding("", "error", str(fault), "", 0, None, ()))
            else:
                findings = [_placed(item, draft) for item in result.diagnostics]
                self._shown = (scene.payload(), _pictures(draft), scene.header())
                status["stale"] = False
                status["solved"] = len(draft.solved)
                status["legs"] = len(draft.itinerary.legs)
        self._publish([*findings, *self._trouble], status)

    def _publish(self, findings: list[Finding], status: dict[str, Any]) -> None:
        """Give the page what is shown, with findings."""
        payload, pictures, header = self._shown
        about = {
            "scene": header,
            "pictures": pictures,
            "findings": [asdict(item) for item in findings],
            "status": status,
            "script": self.script.name,
        }
        encoded = json.dumps(about, separators=(",", ":")).encode()
        encoded += b" " * (-len(encoded) % 4)
        with self.changed:
            self.body = struct.pack("<I", len(encoded)) + encoded + payload
            self.version += 1
            self.changed.notify_all()

    def _find(self, leg: Leg, *, show: Show, look: bool) -> LegFlight | None:
        """Return the flight of a leg if it was solved, now or some other day."""
        key = leg_key(leg, show, self._options)
        flight = self._solved.get(key)
        if flight is None and look:
            flight = Cache.of(self._options).find(key, leg)
            if flight is not None:
                self._solved[key] = flight
        return None if flight is None else replace(flight, leg=leg)


class Solver:
    """A compile in a process of its own, whose results go into the cache."""

    def __init__(self, script: Path, options: SolveOptions, *, outside: bool) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="showc-preview-")
        self._said = Path(self._folder.name) / "said"
        command = [sys.executable, "-m", "showc", "compile", str(script)]
        command += ["--no-missions", "-o", str(Path(self._folder.name) / "show.mcap")]
        command += ["--allow-outside"] * outside
        if options.cache is not None:
            command += ["--cache-dir", str(options.cache)]
        if options.jobs is not None:
            command += ["--jobs", str(options.jobs)]
        with self._said.open("wb") as said:
            # A group of its own, which is ended whole.
            self._process = subprocess.Popen(  # noqa: S603 - our own command
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=said,
                start_new_session=True,
            )

    def ended(self) -> str | None:
        """Return what went wrong once it has ended, empty if nothing; else None."""
        code = self._process.poll()
        if code is None:
            return None
        if code == 0:
            return ""
        try:
            with open_file(self._said) as stream:
                said = stream.read(20_000).decode(errors="replace")
        except UnreadableFileError:
            said = ""
        faults = [line for line in said.splitlines() if line.startswith("error: ")]
        return faults[-1].removeprefix("error: ") if faults else f"ended with {code}"

    def stop(self) -> None:
        """End it, and all that it started."""
        if self._process.poll() is None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGTERM)
            try:
                self._process.wait(timeout=5.0)
            except subprocess.TimeoutExpired:
                os.killpg(self._process.pid, signal.SIGKILL)
                self._process.wait()
        self._folder.cleanup()


def _stamp(path: Path) -> tuple[int, int, int]:
    try:
        found = path.stat()
    except OSError:
        return 0, 0, 0
    return found.st_mtime_ns, found.st_size, found.st_ino


def _plain(item: Diagnostic) -> Finding:
    line = 0 if item.span is None else item.span.line
    return Finding(
        item.code, str(item.severity), item.message, item.help, line, None, ()
    )


def _placed(item: Diagnostic, draft: Draft) -> Finding:
    """Return a finding with the time and the drones at which it can be seen."""
    plain = _plain(item)
    spot, show = item.spot, draft.show
    legs = draft.itinerary.legs
    if spot is not None and spot.formation in show.formations:
        points = show.formations[spot.formation].points[list(spot.places)]
        for leg, start, length in zip(legs, draft.starts, draft.durations, strict=True):
            ends = [(start, leg.start), (start + length, leg.goal)]
            for moment, places in ends:
                apart = np.linalg.norm(places[:, None] - points[None], axis=-1)
                rows = np.flatnonzero((apart < 1e-6).any(axis=1))
                shown = len(spot.places) == 0 and leg.to_formation == spot.formation
                if shown or (rows.size and rows.size >= len(spot.places)):
                    return replace(
                        plain, time=moment, drones=tuple(int(row) for row in rows)
                    )
    for leg, start, length in zip(legs, draft.starts, draft.durations, strict=True):
        if leg.mark is not None and leg.mark.line == plain.line:
            return replace(plain, time=start + length)
    return plain


def _pictures(draft: Draft) -> list[dict[str, Any]]:
    """Return the formations that are flown, for their small pictures."""
    found: dict[str, dict[str, Any]] = {}
    for leg, start in zip(draft.itinerary.legs, draft.starts, strict=True):
        name = held_formation(leg)
        if name and leg.transition is not None and name not in found:
            places, colours = leg.places, draft.show.formations[name].colours
            colours = np.where((places < 0)[:, None], 0.0, colours[places])
            found[name] = _picture(name, start, leg.start, colours)
        for part in leg.parts:
            if not part.motion and part.to_formation not in found:
                one = draft.show.transitions[part.transition or 0]
                formation = draft.show.formations[one.to]
                end = (part.depart or 0.0) + (part.duration or 0.0)
                colours = shown(one, formation, part.places)
                found[one.to] = _picture(one.to, end, part.goal, colours)
    return list(found.values())


def _picture(
    name: str, time: float, points: FloatArray, colours: FloatArray
) -> dict[str, Any]:
    from showc.light.colour import srgb_bytes  # noqa: PLC0415 - beside its only use

    step = max(1, -(-len(points) // _THUMB_DRONES))
    return {
        "name": name,
        "time": time,
        "points": np.round(points[::step], 2).tolist(),
        "colours": srgb_bytes(colours[::step]).tolist(),
    }
