"""The files beside the log: those of this compile, every line of them known.

The log carries the manifest as an attachment; beside ``output.mcap`` lies the folder
``output`` with the same manifest and the files whose hashes it names. Which files these
are, and what stands in them, follows from the script and from the missions' own
language; whatever else lies there is a finding.
"""

from __future__ import annotations

import json
from collections import defaultdict
from functools import lru_cache
from itertools import groupby
from math import degrees
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from showc.documents.values import read_json, unlike
from showc.files import read_files, strangers
from showc.log import showc_pb2 as pb
from showc.log.facts import fleet_token, sha256
from showc.log.schema import MANIFEST_NAME as MANIFEST
from showc.log.showc_pb2 import Site
from showc.script.rules.missions import item_budget
from showc.verify.decode import CAPS
from showc.verify.missions import language
from showc.verify.missions.flight import boundaries, check_flight, visits
from showc.verify.missions.language import read_mission
from showc.verify.missions.law import KNOWN, fastest_level, parameter_file
from showc.verify.missions.legs import Clock, fleet_legs, standing, to_show_frame
from showc.verify.missions.separation import Tubes
from showc.verify.report import Check, Verdict, agreement, checked
from showc.verify.specification.cover import object_in, read_manifest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from showc.log.container import LogFile
    from showc.script.show import Show
    from showc.verify.kernel.show import LoggedShow
    from showc.verify.missions.legs import FleetLegs
    from showc.verify.specification.demands import Demands

PARAMETERS = str(KNOWN["file"])
ARDUPILOT, PX4 = 3, 12  # MAV_AUTOPILOT

NEIGHBOURS = np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])[:, None]
"""A corner of whole 1e-7 degrees, and those about it [1e-7 deg]."""


class Lit(NamedTuple):
    """A colour of a drone's lights, and when it comes on."""

    pulses: list[int]
    """Pulse width of each output [us]."""
    step: int
    """Of a move: how many legs there are up to its end, -1 if that is not known. Of a
    mission: how many legs and slots are behind it."""


class Folder:
    """The files of one compile, read once; nothing of the log is kept beside them."""

    def __init__(self, log: LogFile, script: Show) -> None:
        self.path, self.script = log.path.with_suffix(""), script
        self.manifest = read_manifest(log)
        self.described = object_in(self.manifest, "missions")
        said = self.described.get("autopilot", "")
        self.none = said is None and self.described.get("files") == {}
        """Whether this is a compile without missions."""
        # A dialect that the script does not name is read as such, and stays unproved.
        self.spoken = "px4" if said == "px4" else script.mission.autopilot
        self.known = self.spoken == "ardupilot"
        """Whether it is known how the autopilot flies."""
        stems = [f"missions/drone_{n:04d}" for n in range(1, script.drones + 1)]
        files = [f"{stem}{kind}" for stem in stems for kind in (".waypoints", ".plan")]
        files += [PARAMETERS] * (self.spoken != "px4")
        self.names = [] if self.none else files
        """All files that must be there beside the manifest, and no others."""
        copy, unread = read_files(self.path, [MANIFEST], *[CAPS["document"]] * 2)
        differs = [f"{MANIFEST} differs: files of two compiles are mixed"]
        self.mixed = unread or differs * (copy[MANIFEST] != log.attachment(MANIFEST))
        """What is wrong with the copy of the manifest."""
        self.there = self.path.is_dir()
        self.contents: dict[str, bytes] = {}
        self.missions: dict[str, language.Mission] = {}
        self.bad, self.unread = list[str](), list[str]()
        """What is wrong with the files as a whole, and with what are no missions."""
        if self.there:
            self._read()

    def _read(self) -> None:
        """Read all files; list no folders but those in which some must be."""
        inner, known = ["missions"] * (not self.none), [MANIFEST, *self.names]
        try:
            odd = strangers(self.path, inner, known)
            self.bad += [f"{one}: is of no compile" for one in odd]
        except OSError as error:
            self.bad.append(f"the folder cannot be listed: {error.strerror}")
        sizes = language.RULES["largest_file"], CAPS["folder"]
        self.contents, bad = read_files(self.path, self.names, *sizes)
        listed, self.bad = object_in(self.described, "files"), self.bad + bad
        most = item_budget(self.spoken, self.script.mission.board)
        for name, content in self.contents.items():
            if sha256(content) != listed.get(name):
                self.bad.append(f"{name}: the hash is not the manifest's")
            if name.endswith(".waypoints"):
                try:
                    self.missions[name] = read_mission(content, self.spoken, most)
                except language.MissionFormatError as error:
                    self.unread.append(f"{name}: {error}")


class Missions:
    """What the files of a compile say and fly.

    ``asked`` is what follows from the script: the light and the moves of the fleet.
    """

    def __init__(
        self, folder: Folder, log: LogFile, show: LoggedShow, asked: Demands
    ) -> None:
        self.folder, self.missions, self.script = folder, folder.missions, folder.script
        self.log, self.show, self.asked = log, show, asked
        self.fleet: FleetLegs | None = None
        """What the drones fly; None if that cannot be said: see ``grounded``."""
        self.grounded = "how they are flown is not known"
        if folder.there and not folder.none:
            self._fly()

    @property
    def tubes(self) -> Tubes | None:
        """Where the drones may be at any time; None if that cannot be said."""
        known, speed = self.fleet if self.folder.known else None, self.script.landing
        return None if known is None else Tubes(known, speed.descent_speed)

    def parts(self) -> list[Callable[[], list[Check]]]:
        """Return the checks of the folder, in parts for side by side."""
        return [self.files, *[self.flight] * (not self.folder.none)]

    def files(self) -> list[Check]:
        """Check names, hashes and every line of the files."""
        skipped = checked("VRF400", "skipped", notes=("the manifest says why",))
        folder = self.folder
        if not folder.there:
            note = f"there is no folder {folder.path.name!r} beside the log; copy it "
            note += "there, or leave missions out of the verification"
            return [skipped if folder.none else agreement("VRF401", [note])]
        checks = [agreement("VRF402", folder.mixed), agreement("VRF401", folder.bad)]
        if folder.none:
            return [*checks, skipped]
        listed, asked = object_in(folder.described, "files"), folder.names
        odd = unlike(dict.fromkeys(listed), dict.fromkeys(asked), "missions.files")
        return [*checks, agreement("VRF403", odd), *self._lines(), self._autopilot()]

    def _fly(self) -> None:
        """Work out what all drones fly, if that can be said."""
        site, legs = self.show.rules.site, [one.message for one in self.show.segments]
        held = [bool(one.motion) for one in self.script.transitions]
        if any([*held, *(one.kind == pb.Segment.MOTION for one in legs)]):
            self.grounded = "a mission carries no formation that moves"
            return
        if len(self.missions) != self.show.drones:
            self.grounded = next(iter(self.folder.unread), "missions are missing")
            return
        known = self.folder.known
        if not known:
            pads = self.show.segments[0].ends()[0][:, 2].tolist()
            for name, height in zip(self.missions, pads, strict=True):
                self.missions[name] = standing(self.missions[name], site, height)
        try:
            # Without a start, missions that wait for no clock count from nothing.
            free = not known and self.folder.described.get("start") is None
            clock = None if free else Clock.of(self.folder.described)
            missions = list(self.missions.values())
            self.fleet = fleet_legs(missions, site, self.script, clock)
        except language.MissionFormatError as error:
            self.grounded = str(error)

    def _lines(self) -> list[Check]:
        """Check every row of the missions, and every key of the plans."""
        folder, script, site = self.folder, self.script, self.show.rules.site
        rows, plans = list(folder.unread), list[str]()
        if (token := fleet_token(folder.contents)) != folder.manifest.get("fleet"):
            rows.append(f"{MANIFEST}: the fleet token is not that of these missions")
        for name, mission in self.missions.items():
            turned = _wrong_rows(mission, self.show, folder.spoken)
            rows += [f"{name}: {wrong}" for wrong in turned]
            plan = name.replace(".waypoints", ".plan")
            whose = self.log.library, token, folder.spoken
            content = folder.contents.get(plan, b"")
            wrong = next(check_plan(content, mission, site, script, whose), None)
            plans += [f"{plan}: {wrong}"] * (wrong is not None)
        found = {"VRF405": rows, "VRF406": plans, "VRF409": self._wrong_lights()}
        return [agreement(*one) for one in found.items()]

    def _wrong_lights(self) -> Iterator[str]:
        """Say which missions show other colours than the moves end in."""
        options, moves = self.script.mission, self.asked.moves
        (dark, full), servos = options.light_pwm, options.light_servos or ()
        lit = [[Lit([dark] * len(servos), 0)] for _ in range(self.show.drones)]
        spans = () if self.asked.lights is None else self.asked.lights.spans
        ends = np.full((self.show.drones, len(moves)), -1)
        if self.fleet is not None and servos and spans:  # else all stay dark
            ends = visits(self.fleet, self.show, moves)[0]
            ends = np.where(ends < 0, -1, ends + 1 - self.fleet.first[:-1, None])
        begun: defaultdict[float, Any] = defaultdict(lambda: np.zeros((len(lit), 3)))
        for one in spans:
            begun[round(one.start, 6)][one.drones] = one.end
        for number, move in enumerate(moves if spans else ()):
            end = begun[round(move.start, 6)][move.drones]
            pulses = np.rint(dark + np.clip(end, 0.0, 1.0) * (full - dark)).astype(int)
            for drone, own in zip(move.drones, pulses.tolist(), strict=False):
                lit[drone].append(Lit(own, int(ends[drone, number])))
        for asked, (name, mission) in zip(lit, self.missions.items(), strict=False):
            yield from (f"{name}: {one}" for one in unlit(mission, asked, servos))

    def _autopilot(self) -> Check:
        """Hold the autopilot against the script's, and the parameters of a known one.

        Of one whose flight is not known say whether the script accepts it.
        """
        folder, asked = self.folder, self.script.mission.autopilot
        said = folder.described.get("autopilot")
        for wrong in unlike(said, folder.spoken, "missions.autopilot"):
            return checked("VRF410", "fail", notes=(wrong,))
        if said == "ardupilot":
            found = folder.contents.get(PARAMETERS, b"")
            return check_parameters(found, parameter_file(self.script))
        note = f"mission.autopilot of the script is {asked}"
        verdict: Verdict = "accepted" if said == asked else "unproved"
        return checked("VRF410", verdict, notes=(note,))

    def flight(self) -> list[Check]:
        """Check what the missions fly."""
        if self.fleet is None:
            return [checked("VRF410", "fail", notes=(self.grounded,))]
        show, script, moves = self.show, self.script, self.asked.moves
        if not self.folder.known:
            said = self.folder.described.get("prediction")
            foretold = unlike(said, {"clock": "relative"}, "prediction")
            ends = visits(self.fleet, show, moves)[1]
            walls = boundaries(self.fleet, show.rules.site)
            return [ends, *walls, agreement("VRF414", foretold)]
        return check_flight(self.fleet, show, self.folder.described, script, moves)


def check_parameters(found: bytes, wanted: bytes) -> Check:
    """Hold the lines of a parameter file against those wanted."""
    lines, right = (x.decode("ascii", "replace").split("\n") for x in (found, wanted))
    return agreement("VRF407", unlike(lines, right, "line"))


def _wrong_rows(
    mission: language.Mission, show: LoggedShow, autopilot: str
) -> Iterator[str]:
    """Say if a drone turns to another yaw, or hovers otherwise before its landing."""
    # Only PX4 turns to a yaw: the bearing of the show's heading.
    bearing = show.rules.site.heading + 90.0 - degrees(show.rules.heading)
    yaw = round(bearing % 360.0, 4) % 360.0 if autopilot == "px4" else 0.0
    turned = [one for one in mission.items if one.frame != language.MISSION]
    if any(one.parameters[3] != yaw for one in turned):
        yield f"turns to another yaw than {yaw:g} degrees"
    (pause,) = (item.parameters[0] for item in mission.items if item.word == "P")
    last = max(one.end for one in show.segments[:-1] if not one.holds)
    wanted = round(max(show.segments[-1].start - last, 1.0), 2)
    if pause != wanted:
        yield f"hovers {pause:g} s before its landing, by the log {wanted:g} s"


def check_plan(
    content: bytes,
    mission: language.Mission,
    site: Site,
    script: Show,
    whose: tuple[str, str, str],
) -> Iterator[str]:
    """Yield where a plan differs from its mission, the script and its site's fence.

    ``whose`` are the release that wrote the log, the token of the compile, and the
    autopilot.
    """
    try:
        plan = read_json(content, CAPS["document"])
        fence = plan["geoFence"]["polygons"][0]["polygon"]
    except (ValueError, LookupError, TypeError) as error:
        yield f"is no plan with a fence ({str(error)[:80]})"
        return
    pad, same = mission.home or mission.items[0], language.RULES["plan"]
    home = [pad.latitude / 1e7, pad.longitude / 1e7, pad.height]
    own = _is_fence(json.dumps(fence), site.SerializeToString())
    polygon = fence if own else "the fence of the script"
    wanted = same | {"groundStation": whose[0], "fleetToken": whose[1]}
    wanted["mission"] = same["mission"] | {
        "firmwareType": PX4 if whose[2] == "px4" else ARDUPILOT,
        **dict.fromkeys(("cruiseSpeed", "hoverSpeed"), fastest_level(script)),
        "plannedHomePosition": home,
        "items": [_entry(n, item) for n, item in enumerate(mission.items, 1)],
    }
    polygons = [{"version": 1, "inclusion": True, "polygon": polygon}]
    wanted["geoFence"] = same["geoFence"] | {"polygons": polygons}
    rally = [[*home[:2], round(script.landing.altitude, 2)]]
    wanted["rallyPoints"] = same["rallyPoints"] | {"points": rally}
    yield from unlike(plan, wanted, "plan", rounding=0.0)


def _entry(number: int, item: language.Item) -> dict[str, Any]:
    """Return QGroundControl's form of an item."""
    height = round(item.height, 3)
    place = item.latitude / 1e7, item.longitude / 1e7, height
    numbers = {"doJumpId": number, "command": item.command, "frame": item.frame}
    entry: dict[str, Any] = numbers | {"params": [*item.parameters, *place]}
    entry |= language.RULES["entry"]
    if item.frame != language.MISSION:
        entry |= {"AMSLAltAboveTerrain": None, "Altitude": height, "AltitudeMode": 1}
    return entry


@lru_cache(maxsize=8)  # all plans of a show have the same
def _is_fence(json_text: str, encoded_site: bytes) -> bool:
    """Whether corners [deg] are those of the site's fence, clockwise from above.

    The volume's walls stand for it where the site has none.
    """
    found, site = json.loads(json_text), Site.FromString(encoded_site)
    low, high = site.volume_min, site.volume_max
    walls = [(low.x, low.y), (low.x, high.y), (high.x, high.y), (high.x, low.y)]
    wanted = np.array(list(site.fence) or walls).reshape(-1, 2)
    x, y = wanted.T
    # Twice the area, positive if they go round to the left.
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) > 0.0:
        wanted = wanted[::-1]
    try:
        kinds = {type(value) for corner in found for value in corner}
        corners = np.array(found, dtype=np.float64)
        grid = np.rint(1e7 * corners)
        alike = kinds <= {int, float} and corners.shape == wanted.shape
        if not (alike and (np.abs(corners) <= (90.0, 180.0)).all()):
            return False
        # A tangent plane has no corner off by its curve within any fence of a show.
        north, east = np.moveaxis(1e-7 * (grid + NEIGHBOURS), 2, 0)
        level = to_show_frame(site, north, east, site.altitude)[..., :2]
    except (TypeError, ValueError, OverflowError):
        return False
    off = np.linalg.norm(level - wanted, axis=2)
    return bool((grid / 1e7 == corners).all() and (off[0] <= off + 1e-9).all())


def unlit(
    mission: language.Mission, asked: Sequence[Lit], servos: Sequence[int]
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
    if (found := [one.pulses for one in shown]) != wanted:
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
    mission: language.Mission, dark: Lit, servos: Sequence[int]
) -> tuple[list[Lit], list[int]]:
    """Return what a mission shows one after the other, dark at first.

    Also returns how many legs and slots there are up to the end of each leg. ValueError
    if it sets an output that is not one of them, or twice at once, or to no avail; or
    not all of them before it flies.
    """
    found, steps, step, now = [dark], [0], 0, dict[int, int]()
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
