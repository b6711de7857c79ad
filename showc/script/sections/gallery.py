"""The gallery: all formations of a script, each drawn once, when it is needed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from showc.script.diagnostic import Label, ScriptError
from showc.script.formations import SHAPES, Request
from showc.script.formations.spacing import closest, crowded, spread_apart
from showc.script.language.scalars import no_such
from showc.script.language.settings import Setting, Settings
from showc.script.language.wording import counted, number_text
from showc.script.sections.placing import colours_in, paint, transform
from showc.script.show import Effect, EffectKind, Music

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from showc.arrays import FloatArray
    from showc.script.language.reader import Reader
    from showc.script.mark import Mark
    from showc.vehicle import Separation


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A formation as drawn."""

    points: FloatArray
    """Shape (places, 3), show frame [m]."""
    colours: FloatArray
    """sRGB, 0 to 1, shape (places, 3)."""
    origin: FloatArray
    """Where its own origin stands, show frame [m]."""
    effect: Effect | None


@dataclass(frozen=True, slots=True)
class Bench:
    """What formations are drawn with."""

    separation: Separation
    """What pairs keep; gives the default spacing and the metric."""
    floor: float
    """Height of the lowest place of formations that say nothing of their place [m]."""
    seed: int
    read: Callable[[str, str], bytes]
    """Reads a file that the script names."""
    music: Music | None = None
    """What effects in beats count in."""


_TEMPO = 120.0
"""Beats per minute of music whose tempo could not be read: another finding says so."""


def effect_of(settings: Settings, music: Music | None) -> Effect:
    """Return the effect a section asks for.

    Raises
    ------
    ScriptError
        If its direction has no length, its beats have no tempo, or what runs has no
        colours.
    """
    x, y, z = settings.unit_vector("direction")
    kind = cast("EffectKind", settings.text("kind"))
    if kind == "run" and "colours" not in settings:
        raise ScriptError(
            "SHW102",
            "the effect `run` needs `colours`",
            key="effect",
            help_text="add `colours: [deepskyblue, magenta]`",
        )
    period, beat = settings.number("period"), None
    if "beats" in settings:
        if music is None or (music.sound and music.bpm is None):
            raise ScriptError(
                "SHW121",
                "the effect counts beats, but the music has no tempo",
                key="effect",
                help_text="add `music: {bpm: 120}`",
            )
        period = settings.number("beats") * 60.0 / (music.bpm or _TEMPO)
        beat = music.offset + music.first_beat
    stops = colours_in(settings, "colours") if kind == "run" else np.zeros((0, 3))
    return Effect(
        kind=kind,
        period=period,
        colours=tuple((float(r), float(g), float(b)) for r, g, b in stops),
        beat=beat,
        direction=(x, y, z),
        depth=settings.number("depth"),
        wavelength=settings.number("wavelength"),
    )


MAX_PLACES = 10_000
"""Places of one formation: the largest fleet."""
MAX_DRAWN = 200_000
"""Places of all formations and their parts together: twenty of the largest fleet."""
MAX_FLOWN = 1_000_000
"""Drones times transitions: a hundred of the largest fleet."""
MAX_CHAIN = 50
"""How many times a formation may be like one that is like another."""
FARTHEST = 1e6
"""Farthest a place may be from the origin along an axis, while it is drawn [m]."""


class Gallery:
    """Draws formations; each at most once, faults reported once."""

    def __init__(self, table: dict[str, Setting], bench: Bench, reader: Reader) -> None:
        self._table = table
        self._bench = bench
        self._reader = reader
        self._drawn: dict[str, Picture | None] = {}
        self._open: list[str] = []
        self._deep = _deep(table)
        self._own: dict[int, int | None] = {}
        self._failed: dict[int, ScriptError] = {}
        self._uncounted: list[tuple[Settings, ScriptError]] = []
        self._spent = 0
        self.counts: dict[str, int] = {}
        """Number of places wanted of formations that do not fix one themselves."""

    def settings(self, name: str) -> Settings | None:
        """Return a formation's settings, or None if they are broken or missing."""
        setting = self._table.get(name)
        value = setting.value if setting is not None else None
        if not isinstance(value, Settings) or value.broken:
            return None
        return value

    def mark(self, name: str) -> Mark:
        """Return where a formation is defined."""
        return self._table[name].key_mark

    def own_count(self, name: str) -> int | None:
        """Return the number of places a formation fixes by itself, if it does."""
        settings = self.settings(name)
        if settings is None or name in self._open:
            return None
        if name in self._deep:
            return None  # said when it is drawn
        self._open.append(name)
        try:
            return self.own_count_inside(settings)
        finally:
            self._open.pop()

    def _count(self, settings: Settings) -> int | None:
        # Counting looks into files and at all that a formation is like: once.
        if id(settings) in self._failed:
            raise self._failed[id(settings)]
        if id(settings) not in self._own:
            try:
                self._own[id(settings)] = self._counted(settings)
            except ScriptError as fault:
                # Raised through others, it stands where it was raised first.
                if fault not in self._failed.values():
                    self._uncounted.append((settings, fault))
                self._failed[id(settings)] = fault
                raise
        return self._own[id(settings)]

    def report_uncounted(self) -> bool:
        """Report the formations whose places could not be counted, if there are any."""
        for settings, fault in self._uncounted:
            self._report(settings, fault)
        return bool(self._uncounted)

    def _counted(self, settings: Settings) -> int | None:
        if "count" in settings:
            return settings.integer("count")
        if "like" in settings:
            return self.own_count(settings.text("like"))
        if "parts" in settings:
            counts = [self._count(part) for part in settings.sections("parts")]
            known = [count for count in counts if count is not None]
            return sum(known) if len(known) == len(counts) else None
        shape = SHAPES[settings.text("type")]
        return shape.own_count(settings, self._bench.read)

    def excess(self, drones: int, moves: int) -> str:
        """Return what the script asks for beyond what is drawn; empty if nothing.

        Parameters
        ----------
        drones
            Size of the fleet.
        moves
            Number of transitions.
        """
        wanted = [self.own_count(name) for name in self._table]
        places = sum(
            min(self.counts.get(name, 0) if own is None else own, MAX_PLACES)
            for name, own in zip(self._table, wanted, strict=True)
        )
        if places > MAX_DRAWN:
            return (
                f"{len(self._table)} formations with {places} places together, at most "
                f"{MAX_DRAWN} are drawn"
            )
        if drones * moves > MAX_FLOWN:
            return (
                f"{drones} drones in {moves} transitions are {drones * moves} moves, "
                f"at most {MAX_FLOWN} are planned"
            )
        return ""

    def picture(self, name: str) -> Picture | None:
        """Draw a formation; None if that is impossible, which is then reported."""
        if name in self._drawn:
            return self._drawn[name]
        settings = self.settings(name)
        if settings is None or name in self._open:
            return None
        if name in self._deep:
            self._reader.say(
                "SHW119",
                f"`{name}` ends a chain of formations that are each `like` the next, "
                f"at most {MAX_CHAIN} links are followed",
                self.mark(name),
                help_text="make it `like` the first formation of the chain",
            )
            self._drawn[name] = None
            return None
        self._open.append(name)
        own = self.own_count_inside(settings)
        count = own if own is not None else self.counts.get(name, 0)
        picture = self._draw(settings, count, self._bench.floor) if count else None
        self._open.pop()
        self._drawn[name] = picture
        return picture

    def redrawn(self, settings: Settings, count: int) -> FloatArray | None:
        """Places of a formation if it had ``count``, (count, 3) [m]; None: impossible.

        What is wrong with them is not reported.
        """
        try:
            picture = self._drawing(settings, count, self._bench.floor)
        except ScriptError:
            return None
        return None if picture is None else picture.points

    def own_count_inside(self, settings: Settings) -> int | None:
        """Return the count of settings at hand; None also when a file is unreadable."""
        try:
            return self._count(settings)
        except ScriptError:
            return None

    def pads(self, name: str, settings: Settings, count: int) -> Picture | None:
        """Draw a formation that stands on the ground unless it says otherwise."""
        own = self.own_count_inside(settings)
        picture = self._draw(settings, own or count, 0.0)
        self._drawn[name] = picture
        return picture

    def _draw(
        self, settings: Settings, count: int, floor: float | None
    ) -> Picture | None:
        try:
            return self._drawing(settings, count, floor)
        except ScriptError as fault:
            self._report(settings, fault)
            return None

    def _report(self, settings: Settings, fault: ScriptError) -> None:
        self._reader.refuse(
            fault, settings.mark_within(fault.key) if fault.key else settings.mark
        )

    def _drawing(
        self, settings: Settings, count: int, floor: float | None
    ) -> Picture | None:
        """Draw, change, place, spread and colour."""
        self._spend(count)
        if "like" in settings:
            base = self._like(settings)
        elif "parts" in settings:
            base = self._composed(settings, count, floor)
        else:
            base = self._shape(settings, count)
        if base is None:
            return None
        if len(base.points) > count:
            base = Picture(
                base.points[:count], base.colours[:count], base.origin, base.effect
            )
        changes = settings.sections("transform")
        points, unshifted = transform(base.points - base.origin, changes)
        shift, _ = transform(np.zeros((1, 3)), changes)
        _demand_near(points, "transform")
        _demand_near(unshifted, "transform")
        spread = self._spaced(settings, points)
        # Spreading may reach lower than the shape as drawn.
        deeper = float(spread[:, 2].min() - points[:, 2].min())
        origin = base.origin
        if "centre" in settings:
            origin = np.array(settings.vector("centre"))
        elif floor is not None and self._lifts(settings):
            lowest = float(unshifted[:, 2].min()) + deeper
            origin = np.array([0.0, 0.0, floor - lowest])
        points = spread + origin
        _demand_near(points, "")
        colours = base.colours
        if "colour" in settings:
            colours = paint(settings.section("colour"), points)
        effect = (
            effect_of(settings.section("effect"), self._bench.music)
            if "effect" in settings
            else base.effect
        )
        return Picture(points, colours, origin + shift[0], effect)

    def _spend(self, count: int) -> None:
        """Take places from what the script may ask for."""
        if count > MAX_PLACES:
            raise ScriptError(
                "SHW119",
                f"a formation of {count} places; at most {MAX_PLACES} are drawn",
            )
        self._spent += count
        if self._spent > MAX_DRAWN:
            raise ScriptError(
                "SHW119",
                f"the formations up to here, parts included, have {self._spent} "
                f"places; at most {MAX_DRAWN} are drawn",
            )

    def _lifts(self, settings: Settings) -> bool:
        """Tell whether a formation is put above the floor when it names no place."""
        return "type" in settings and not SHAPES[settings.text("type")].absolute

    def _spacing(self, settings: Settings) -> float:
        given = settings.optional("spacing")
        return self._bench.separation.distance if given is None else given

    def _shape(self, settings: Settings, count: int) -> Picture:
        shape = SHAPES[settings.text("type")]
        # Shapes that choose their own size leave room for straight moves.
        roomy = settings.optional("spacing") or 1.5 * self._bench.separation.distance
        request = Request(count, roomy, self._bench.seed, self._bench.read)
        drawing = shape.draw(settings, request)
        _demand_near(drawing.points, "")
        colours = drawing.colours
        if colours is None:
            colours = np.ones((len(drawing.points), 3))
        return Picture(drawing.points, colours, np.zeros(3), None)

    def _like(self, settings: Settings) -> Picture | None:
        name = settings.text("like")
        mark = settings.mark_of("like")
        if name not in self._table:
            self._reader.refuse(no_such("formation", name, self._table), mark)
            return None
        if name in self._open:
            ring = " -> ".join([*self._open[self._open.index(name) :], name])
            self._reader.say(
                "SHW113",
                f"formations are `like` each other in a circle: {ring}",
                mark,
                secondary=(Label(self.mark(name), "this one"),),
                help_text="give one of them a shape",
            )
            return None
        if name not in self.counts and self.own_count(name) is None:
            self.counts[name] = self.counts.get(self._open[-1], 0)
        return self.picture(name)

    def _composed(
        self, settings: Settings, count: int, floor: float | None
    ) -> Picture | None:
        parts = settings.sections("parts")
        own = [self._count(part) for part in parts]
        missing = sum(1 for number in own if number is None)
        rest = count - sum(number or 0 for number in own)
        if missing and rest < missing:
            raise ScriptError(
                "SHW205",
                f"{count} places are needed, and the parts with a number of places "
                f"of their own leave {max(rest, 0)} for {counted(missing, 'other')}",
                key="parts",
            )
        inside = None if "centre" in settings else floor
        pictures, given = [], 0
        for part, number in zip(parts, own, strict=True):
            if number is None:
                share = rest // missing + (given < rest % missing)
                given += 1
            else:
                share = number
            pictures.append(self._draw(part, share, inside))
        drawn = [picture for picture in pictures if picture is not None]
        if len(drawn) < len(pictures):
            return None
        effects = [picture.effect for picture in drawn if picture.effect is not None]
        return Picture(
            np.concatenate([picture.points for picture in drawn]),
            np.concatenate([picture.colours for picture in drawn]),
            np.zeros(3),
            effects[0] if effects else None,
        )

    def _spaced(self, settings: Settings, points: FloatArray) -> FloatArray:
        """Spread where asked; refuse what is closer than an explicit spacing."""
        spacing = self._spacing(settings)
        separation = self._bench.separation
        if settings.flag("spread"):
            return spread_apart(points, spacing, separation)
        if settings.written("spacing"):
            pair = closest(points, spacing, separation)
            if pair is not None:
                tight = crowded(points, spacing, separation)
                message = (
                    f"places {pair.first + 1} and {pair.second + 1} are "
                    f"{number_text(pair.distance)} m apart, the formation's spacing "
                    f"is {number_text(spacing)} m"
                )
                self._reader.say(
                    "SHW201",
                    message,
                    settings.mark_of("spacing"),
                    label="asked for here",
                    notes=(f"{tight} places are closer to another than that",)
                    * (tight > 2),
                    help_text="make the shape larger, or add `spread: true`",
                )
        return points


def bases_of(settings: Settings) -> Iterator[str]:
    """Yield the formations that a formation is like, parts included."""
    if "like" in settings:
        yield settings.text("like")
    for part in settings.sections("parts"):
        yield from bases_of(part)


def _deep(table: dict[str, Setting]) -> set[str]:
    """Return the formations at the end of too long a chain, without recursion.

    Where more formations than a chain may have hang on rings, all of those count too.
    """
    bases = {
        name: set(bases_of(setting.value)) & table.keys()
        for name, setting in table.items()
        if isinstance(setting.value, Settings)
    }
    users: dict[str, list[str]] = {}
    for name, those in bases.items():
        for base in those:
            users.setdefault(base, []).append(name)
    depth = dict.fromkeys(table, 0)
    waiting = {name: len(those) for name, those in bases.items()}
    ready = [name for name in table if not waiting.get(name)]
    while ready:
        base = ready.pop()
        for name in users.get(base, ()):
            depth[name] = max(depth[name], depth[base] + 1)
            waiting[name] -= 1
            if not waiting[name]:
                ready.append(name)
    ringed = {name for name, left in waiting.items() if left}
    long = len(ringed) > MAX_CHAIN
    return {
        name for name in table if depth[name] > MAX_CHAIN or (long and name in ringed)
    }


def _demand_near(points: FloatArray, key: str) -> None:
    """Refuse places that are no numbers, or farther away than any show.

    Raises
    ------
    ScriptError
        Naming the first such place.
    """
    # A comparison with what is no number is false.
    near = np.all(np.abs(points) <= FARTHEST, axis=1)
    if not near.all():
        place = int(np.argmin(near))
        raise ScriptError(
            "SHW104",
            f"place {place + 1} lies at {points[place].tolist()} m, at most "
            f"{number_text(FARTHEST)} m along each axis are allowed",
            key=key,
        )
