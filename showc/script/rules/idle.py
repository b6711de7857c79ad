"""Idle keys: what a script says that has no effect."""

from __future__ import annotations

from typing import TYPE_CHECKING

from showc.script.diagnostic import Diagnostic, Label, Severity
from showc.script.language.settings import Settings
from showc.script.language.wording import counted, number_text
from showc.script.rules.holds import longest_holds

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.script.sections.build import Sketch

_USED = {
    "pulse": {"depth"},
    "sweep": {"depth", "direction", "wavelength"},
    "rainbow": {"direction", "wavelength"},
    "strobe": {"depth"},
    "twinkle": {"depth"},
    "run": {"colours", "direction", "wavelength"},
}
"""Keys that an effect has beside its period, by its kind."""


def idle_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield keys without effect (SHW124) and lights that are never seen (SHW220)."""
    for section in _sections(sketch.settings):
        match section.name:
            case "effect":
                yield from _effect(section)
            case "colour" if "gradient" not in section:
                yield from _idle(section, "along", "only a `gradient` has a direction")
            case "mission" if "light_servos" not in section:
                yield from _idle(section, "light_pwm", "add `light_servos`")
            case "separation":
                yield from _separation(section)
            case _:
                pass
    yield from _unseen(sketch)


def _sections(settings: Settings) -> Iterator[Settings]:
    """Yield every sound section of a script, those within others included."""
    for setting in settings.values.values():
        values = setting.value if isinstance(setting.value, list) else [setting]
        for one in values:
            if isinstance(one.value, Settings) and not one.value.broken:
                yield one.value
                yield from _sections(one.value)


def _idle(section: Settings, key: str, advice: str) -> Iterator[Diagnostic]:
    if section.written(key):
        yield Diagnostic(
            "SHW124",
            f"`{key}` has no effect here",
            section.values[key].key_mark,
            help=advice,
            severity=Severity.WARNING,
        )


def _effect(section: Settings) -> Iterator[Diagnostic]:
    kind = section.text("kind")
    for key in sorted({"colours", "depth", "direction", "wavelength"} - _USED[kind]):
        users = [f"`{name}`" for name, keys in _USED.items() if key in keys]
        yield from _idle(section, key, f"it belongs to {', '.join(users)}")
    if section.written("beats"):
        yield from _idle(section, "period", "`beats` gives the time of a cycle")


def _separation(section: Settings) -> Iterator[Diagnostic]:
    shape, stretch = section.text("shape"), "vertical_stretch"
    if section.number(stretch) != 1.0 and shape != "ellipsoid":
        yield Diagnostic(
            "SHW102",
            f"`{stretch}` needs `shape: ellipsoid`",
            section.values[stretch].key_mark,
            secondary=(Label(section.mark_of("shape"), "the shape"),)
            if section.written("shape")
            else (),
            help=f"add it; a `{shape}` is not stretched",
        )
    if section.values["tracking"].value != "measured":
        yield from _idle(section, "results", "`tracking: measured` reads them")


def _unseen(sketch: Sketch) -> Iterator[Diagnostic]:
    """Find lights later than the longest time that their formation is held."""
    show = sketch.show
    if show is None:
        return
    asked = sketch.ordered()
    for index, longest, _ in longest_holds(show):
        one = show.transitions[index]
        late = [
            (at, key.time)
            for at, key in enumerate(one.lights)
            if not key.absolute and key.time > longest + _MILLISECOND
        ]
        if not late:
            continue
        at, time = late[0]
        # A table in a file has no places in the script.
        whole = asked[index].values["lights"]
        written = whole.value if isinstance(whole.value, list) else []
        yield Diagnostic(
            "SHW220",
            f"a light comes {number_text(time)} s into the hold of `{one.to}`, which "
            f"lasts {number_text(round(longest, 3))} s at most",
            (written[at] if written else whole).mark,
            notes=(f"{counted(len(late), 'moment')} of `lights` are never seen",)
            if len(late) > 1
            else (),
            help="hold it longer, or let the light come earlier",
            severity=Severity.WARNING,
        )


_MILLISECOND = 1e-3
"""What a time may be off by rounding [s]."""
