"""Building: the settings of a script become a show, its rules checked on the way."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import Label, ScriptError
from showc.script.lanes import arrival, departure
from showc.script.language.colours import linear_light
from showc.script.language.scalars import no_such
from showc.script.language.settings import Settings
from showc.script.sections.aircraft import (
    battery_of,
    body_of,
    envelope_of,
    limits_of,
    separation_of,
    tracking_of,
    vehicle_of,
)
from showc.script.sections.fleet import fleet_size, groups_of, needed_counts
from showc.script.sections.gallery import Bench, Gallery, Picture, effect_of
from showc.script.sections.lights import lights_of
from showc.script.sections.motions import morphs_of, motion_of
from showc.script.sections.music import asked_time, music_of
from showc.script.sections.placing import paint
from showc.script.sections.site import site_of
from showc.script.show import (
    Export,
    Follow,
    Formation,
    Landing,
    Launch,
    MissionOptions,
    Motion,
    Music,
    Show,
    Source,
    Transition,
)
from showc.vehicle import Separation

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from showc.arrays import FloatArray
    from showc.script.files import InputFiles
    from showc.script.language.reader import Reader
    from showc.script.language.settings import Setting
    from showc.script.mark import Mark
    from showc.script.show import Preference, Site


@dataclass(frozen=True, slots=True)
class Sketch:
    """A show as far as it could be built, for the rules to look at."""

    settings: Settings
    """The whole script."""
    show: Show | None
    """The show, if nothing is missing."""
    separation: Separation | None
    """What pairs keep, if that could be read."""
    formations: Mapping[str, Formation]
    """Those formations that could be drawn, pads included."""
    site: Site | None
    drones: int | None
    groups: Mapping[str, tuple[int, ...]]
    pads: str
    parking: str | None
    redrawn: Callable[[Settings, int], FloatArray | None]
    """Places of a formation if it had another number of them; None: impossible."""

    def written(self, *marks: Mark) -> bool:
        """Tell whether the script has a text at each of these places of its own."""
        return all(mark != self.settings.mark for mark in marks)

    def place(self, mark: Mark, other: Mark) -> Mark:
        """Return where to point: at what is not written nothing can be shown."""
        return mark if self.written(mark) else other

    def ordered(self) -> list[Settings]:
        """Return what the script says of each transition, in the order of the show.

        Groups may be written one after the other, and fly side by side.
        """
        items = self.settings.sound("transitions")
        if self.show is None:
            return items
        written = {item.mark_of("to"): item for item in items}
        return [written[one.mark] for one in self.show.transitions]


class Builder:
    """Builds the show of one script."""

    def __init__(self, settings: Settings, files: InputFiles, reader: Reader) -> None:
        self.settings = settings
        self.files = files
        self.reader = reader
        self.table: dict[str, Setting] = {}
        if "formations" in settings:
            self.table = dict(settings.section("formations").values)
        self.music: Music | None = None
        self.tracking = 0.0
        self.pads = self._ground("pads", "pads")
        self.parking = self._ground("parking", "parking")

    def _ground(self, key: str, name: str) -> str | None:
        """Return the name of the formation a key gives, defining it where inline."""
        if key not in self.settings.values:
            return None
        setting = self.settings.values[key]
        if isinstance(setting.value, Settings):
            if name in self.table:
                self.reader.say(
                    "SHW111",
                    f"`{key}` is defined here, and a formation is called `{name}`",
                    self.table[name].key_mark,
                    help_text=f"write `{key}: {name}` to use that one, or rename it",
                )
            self.table[name] = setting
            return name
        named = str(setting.value)
        return named if self._known(named, setting.mark) else None

    def _known(self, name: str, mark: Mark) -> bool:
        if name in self.table:
            return True
        if "formations" not in self.settings:
            return False  # why there are none is said already
        self.reader.refuse(no_such("formation", name, self.table), mark)
        return False

    def sketch(self, source: Source) -> Sketch:
        """Build as much as can be built."""
        settings = self.settings
        separation = None
        if not _broken(settings, "separation"):
            section = settings.section("separation")
            exports = settings.sound("exports")
            self.tracking = tracking_of(section, exports, self.files, self.reader)
            separation = separation_of(section, self.tracking)
        site = None
        if not _broken(settings, "site"):
            site = site_of(settings.section("site"), self.reader)
        self.music = music_of(settings, self.files, self.reader)
        floor = 10.0
        if not _broken(settings, "launch"):
            floor = settings.section("launch").number("altitude")
        bench = Bench(
            separation or Separation(1e-3),
            floor,
            settings.integer("seed") if "seed" in settings else 0,
            self.files.read,
            self.music,
        )
        gallery = Gallery(self.table, bench, self.reader)
        self._references()
        drones = fleet_size(settings, gallery, self.reader)
        groups = groups_of(settings, drones, self.reader)
        formations: dict[str, Formation] = {}
        if drones is not None:
            gallery.counts |= needed_counts(
                settings, gallery, drones, groups, self.parking
            )
            excess = gallery.excess(drones, len(self.settings.sections("transitions")))
            if excess:
                advice = "split it into two shows"
                self.reader.say("SHW119", excess, settings.mark, help_text=advice)
            else:
                formations = self._formations(gallery, drones, separation)
        pads = self.pads or "pads"
        sketch = Sketch(
            settings, None, separation, formations, site, drones, groups, pads,
            self.parking, gallery.redrawn,
        )  # fmt: skip
        show = self._show(sketch, source)
        return replace(sketch, show=show)

    def _references(self) -> None:
        """Check the formations that transitions name."""
        for item in self.settings.sections("transitions"):
            if "to" in item:
                self._known(item.text("to"), item.mark_of("to"))
            for name in morphs_of(item):
                self._known(str(name.value), name.mark)

    def _formations(
        self, gallery: Gallery, drones: int, separation: Separation | None
    ) -> dict[str, Formation]:
        formations = {}
        pads = self._pads(gallery, drones, separation)
        if pads is not None:
            formations[self.pads or "pads"] = pads
        for name in self.table:
            if name in formations or name == self.pads:
                continue
            picture = gallery.picture(name)
            if picture is not None:
                formations[name] = self._formation(name, picture, gallery.mark(name))
        return formations

    def _pads(
        self, gallery: Gallery, drones: int, separation: Separation | None
    ) -> Formation | None:
        if self.pads is not None:
            settings = gallery.settings(self.pads)
            if settings is None:
                return None
            picture = gallery.pads(self.pads, settings, drones)
            if picture is None:
                return None
            return self._formation(self.pads, picture, gallery.mark(self.pads))
        if "pads" in self.settings or (self.settings.broken and separation is None):
            return None
        distance = 1.5 * separation.distance if separation is not None else 0.0
        step = max(2.0, math.ceil(distance * 4.0) / 4.0)
        columns = math.ceil(math.sqrt(drones))
        index = np.arange(drones)
        square = index % columns, index // columns, np.zeros(drones)
        places = np.column_stack(square)
        middle = (places.min(axis=0) + places.max(axis=0)) / 2.0
        points = (places - middle) * step
        picture = Picture(points, np.ones((drones, 3)), np.zeros(3), None)
        return self._formation("pads", picture, self.settings.mark)

    def _formation(self, name: str, picture: Picture, mark: Mark) -> Formation:
        # A nanometre: the same places whatever rounds a sine; no negative zeros.
        points = np.round(picture.points, 9) + 0.0
        colours = linear_light(np.clip(picture.colours, 0.0, 1.0))
        points.setflags(write=False)
        colours.setflags(write=False)
        return Formation(name, points, colours, mark, picture.effect)

    def _transition(
        self, settings: Settings, before: str, sketch: Sketch
    ) -> Transition | None:
        to = settings.text("to")
        formation = sketch.formations.get(to)
        if formation is None:
            return None
        colours = effect = None
        key = "colour"
        try:
            if key in settings:
                srgb = paint(settings.section(key), formation.points)
                colours = linear_light(srgb)
                colours.setflags(write=False)
            key = "effect"
            if key in settings:
                effect = effect_of(settings.section(key), self.music)
        except ScriptError as fault:
            mark = settings.section(key).mark_of(fault.key)
            self.reader.refuse(fault, mark if fault.key else settings.mark_of(key))
            return None
        at, start, duration = self._times(settings)
        name = settings.text("name") if "name" in settings else f"{before} -> {to}"
        motion = self._motion(settings, formation, sketch)
        # Whole milliseconds, as all times of a show: a beat may be any part of one.
        hold = round(settings.number("hold"), 3)
        played = [one.length + one.ramp for one in motion if isinstance(one, Follow)]
        if played and not settings.written("hold"):
            hold = round(max(played), 3)
        return settings.made(
            Transition,
            name=name,
            hold=hold,
            mark=settings.mark_of("to"),
            duration=duration,
            colours=colours,
            effect=effect,
            at=at,
            start=start,
            prefer=_preference(settings if "prefer" in settings else self.settings),
            motion=motion,
            under_way=self._under_way(settings),
            lights=lights_of(settings, formation, self.music, self.files, self.reader),
        )

    def _motion(
        self, settings: Settings, formation: Formation, sketch: Sketch
    ) -> tuple[Motion, ...]:
        """Return what a formation does over its hold, if that can be done."""
        motion: list[Motion] = []
        for item in settings.sound("motion"):
            try:
                motion.append(motion_of(item, self.files))
            except ScriptError as fault:
                self.reader.refuse(fault, item.mark_within(fault.key))
                return ()
        for written in morphs_of(settings):
            name = str(written.value)
            other = sketch.formations.get(name)
            if other is not None and len(other.points) != len(formation.points):
                self.reader.say(
                    "SHW205",
                    f"`{formation.name}` has {len(formation.points)} places, but "
                    f"becomes `{name}` with {len(other.points)}",
                    written.mark,
                    help_text="give both the same number of places",
                )
        for one in motion:
            if isinstance(one, Follow) and one.frames.shape[1] != len(formation.points):
                self.reader.say(
                    "SHW205",
                    f"`{formation.name}` has {len(formation.points)} places, but "
                    f"follows `{one.file}` with {one.frames.shape[1]}",
                    settings.mark_of("motion"),
                    help_text="give both the same number of places: "
                    f"`{{type: frames, file: {one.file}}}` has those of the file",
                )
                return ()
        return tuple(motion)

    def _under_way(self, settings: Settings) -> tuple[bool, bool]:
        """Whether drones join, and leave, a motion that is under way."""
        asked = [key for key in ("arrive", "leave") if settings.text(key) == "moving"]
        if asked and "motion" not in settings:
            self.reader.say(
                "SHW102",
                f"`{asked[0]}: moving` needs a motion",
                settings.mark_of(asked[0]),
                help_text=f"add `motion`, or leave `{asked[0]}` out",
            )
            return False, False
        return "arrive" in asked, "leave" in asked

    def _times(
        self, settings: Settings
    ) -> tuple[float | None, float | None, float | None]:
        """Show times of arrival and departure, and the duration between them [s]."""
        at = asked_time(settings, "at", self.music, self.reader)
        start = asked_time(settings, "start", self.music, self.reader)
        duration = settings.optional("duration")
        duration = None if duration is None else round(duration, 3)
        if at is not None and start is not None and duration is not None:
            self.reader.say(
                "SHW111",
                "`at`, `start` and `duration` cannot stand together",
                settings.values["duration"].key_mark,
                help_text="give two of them; the third follows",
            )
        elif at is not None and start is not None:
            duration = round(at - start, 3)
            if duration <= 0.0:
                self.reader.say(
                    "SHW213",
                    "the move arrives before it starts",
                    settings.mark_of("at"),
                    secondary=(Label(settings.mark_of("start"), "the start"),),
                    help_text="`at` must be later than `start`",
                )
                return at, None, None
        return at, start, duration

    def _show(self, sketch: Sketch, source: Source) -> Show | None:
        settings = self.settings
        vehicle = limits = envelope = None
        if not _broken(settings, "vehicle"):
            vehicle = vehicle_of(settings.section("vehicle"))
            envelope = envelope_of(settings.section("vehicle"))
            if sketch.site is not None and not _broken(settings, "limits"):
                limits = limits_of(
                    settings.section("limits"),
                    settings.section("vehicle"),
                    vehicle,
                    sketch.site,
                    self.reader,
                )
        transitions, loose = [], []
        last: dict[str | None, str] = {}
        for item in settings.sound("transitions"):
            group = item.word("group")
            before = last.get(group, last.get(None, "launch"))
            if group is None and last:
                before = " + ".join(dict.fromkeys(last.values()))
            made = self._transition(item, before, sketch)
            if made is not None:
                transitions.append(made)
                loose.append(not item.written("hold"))
            if group is None:
                last.clear()
            last[group] = item.text("to")
        if (
            self.reader.found
            or sketch.site is None
            or sketch.separation is None
            or sketch.drones is None
            or vehicle is None
            or limits is None
        ):
            return None
        yaw = settings.section("yaw")
        name = PurePath(source.path).stem
        return Show(
            format_version=settings.integer("showc"),
            name=settings.text("name") if "name" in settings else name,
            source=replace(source, inputs=dict(sorted(self.files.contents.items()))),
            epoch=settings.moment("epoch"),
            site=sketch.site,
            vehicle=vehicle,
            body=body_of(settings.section("vehicle")),
            battery=battery_of(settings.section("vehicle"), vehicle),
            limits=limits if envelope is None else envelope.within(limits),
            separation=sketch.separation,
            tracking=self.tracking,
            yaw=yaw.values["mode"].plain,
            heading=yaw.number("heading"),
            drones=sketch.drones,
            formations=sketch.formations,
            pads=sketch.pads,
            groups=sketch.groups,
            launch=settings.section("launch").made(Launch),
            airframe_limits=None if envelope is None else limits,
            transitions=_with_free_holds(*_in_order_of_time(transitions, loose)),
            landing=settings.section("landing").made(Landing),
            mission=_mission(settings.section("mission")),
            exports=tuple(one.made(Export) for one in settings.sections("exports")),
            log_rate=settings.number("log_rate"),
            seed=settings.integer("seed"),
            parking=sketch.parking,
            music=self.music,
        )


def _preference(settings: Settings) -> Preference:
    if "prefer" not in settings:
        return 1.0  # what is wrong with it has been said
    wanted: Preference = settings.values["prefer"].plain
    return wanted


def _in_order_of_time(
    transitions: list[Transition], loose: list[bool]
) -> tuple[list[Transition], list[bool]]:
    """Merge moves of groups that follow each other by their times, where all have any.

    A script may list one group after the other. Each group's own order stays, so that
    times which run backwards are found; moves that begin together stay as written.
    """

    def leaves(one: Transition) -> float:
        """Return when a timed move begins or, where that is open, arrives [s]."""
        begins = departure(one)
        return begins if begins is not None else (arrival(one) or 0.0)

    order: list[int] = []
    for grouped, rows in groupby(
        range(len(transitions)), lambda row: transitions[row].group is not None
    ):
        run = list(rows)
        if not grouped or not all(transitions[row].timed for row in run):
            order += run
            continue
        waiting: dict[str | None, list[int]] = {}
        for row in run:
            waiting.setdefault(transitions[row].group, []).append(row)
        lanes = waiting.values()
        order += heapq.merge(*lanes, key=lambda row: (leaves(transitions[row]), row))
    return [transitions[row] for row in order], [loose[row] for row in order]


def _with_free_holds(
    transitions: list[Transition], loose: list[bool]
) -> tuple[Transition, ...]:
    """Let holds that are not written (``loose``) shrink before timed transitions."""
    result = list(transitions)
    free = False
    for index in range(len(result) - 2, -1, -1):
        after = result[index + 1]
        # Groups side by side share the hold after them.
        both = result[index].group is not None and after.group is not None
        free = after.timed or (both and free)
        if free and loose[index]:
            result[index] = replace(result[index], hold=0.0)
    return tuple(result)


def _mission(settings: Settings) -> MissionOptions:
    dark, full = settings.numbers("light_pwm")
    return settings.made(MissionOptions, light_pwm=(round(dark), round(full)))


def _broken(settings: Settings, key: str) -> bool:
    """Tell whether a section could not be read whole."""
    if key not in settings.values:
        return True
    section = settings.section(key)
    return section.broken or any(
        isinstance(item.value, Settings) and item.value.broken
        for item in section.values.values()
    )
