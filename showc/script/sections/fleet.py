"""The fleet: how many drones fly, in which groups, and how many to each formation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from showc.script.diagnostic import Label
from showc.script.language.scalars import no_such
from showc.script.language.settings import Setting, Settings
from showc.script.sections.gallery import MAX_PLACES
from showc.script.sections.motions import formations_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.script.language.reader import Reader
    from showc.script.mark import Mark
    from showc.script.sections.gallery import Gallery


def fleet_size(settings: Settings, gallery: Gallery, reader: Reader) -> int | None:
    """Return the number of drones, or None if nothing says it.

    It is ``drones``, else the largest number of places that a formation fixes by
    itself, or the highest drone of a group.
    """
    if "drones" in settings:
        return settings.integer("drones")
    names = list(settings.section("formations").values) if _has(settings) else []
    counts = _counts(settings, gallery, names)
    if counts and max(counts) > MAX_PLACES:
        reader.say(
            "SHW119",
            f"a formation or a group asks for {max(counts)} drones, at most "
            f"{MAX_PLACES} fly",
            settings.mark,
            help_text="use fewer places, or fewer drones in the groups",
        )
        return None
    if counts:
        return max(counts)
    if gallery.report_uncounted():
        return None
    if not settings.broken and all(gallery.settings(name) for name in names):
        reader.say(
            "SHW115",
            "the number of drones is missing",
            settings.mark,
            help_text="add `drones: 16`, or a `count` to a formation",
        )
    return None


def _counts(settings: Settings, gallery: Gallery, names: list[str]) -> list[int]:
    """Return the drones that formations, pads and groups speak of by themselves."""
    owned = [gallery.own_count(name) for name in names]
    pads = settings.values.get("pads")
    if pads is not None and isinstance(pads.value, Settings) and not pads.value.broken:
        owned.append(gallery.own_count_inside(pads.value))
    counts = [own for own in owned if own is not None]
    for members, _mark in _members(settings).values():
        counts += members
    return counts


def _has(settings: Settings) -> bool:
    return "formations" in settings


def _members(settings: Settings) -> dict[str, tuple[list[int], Mark]]:
    """Return the drones of each group as written, counting from 1."""
    groups: dict[str, tuple[list[int], Mark]] = {}
    if "groups" not in settings:
        return groups
    # A drone belongs to one group: more members than drones are a fault by what has
    # been read up to there.
    left = MAX_PLACES + 1
    for name, setting in settings.section("groups").values.items():
        value = setting.value
        entries = value if isinstance(value, list) else [setting]
        members = []
        for entry in entries:
            if isinstance(entry, Setting) and isinstance(entry.value, str):
                named = _range(entry.value, left)
                members += named
                left = max(left - len(named), 1)
        groups[name] = (members, setting.mark)
    return groups


def _range(text: str, most: int) -> list[int]:
    low, _, high = text.partition("-")
    first = int(low)
    last = int(high) if high else first
    # A range backwards is empty, and reported as a group without drones.
    return list(range(first, min(last, first + most - 1) + 1))


def groups_of(
    settings: Settings, drones: int | None, reader: Reader
) -> dict[str, tuple[int, ...]]:
    """Return the drones of each group, counting from 0, and check the groups."""
    groups: dict[str, tuple[int, ...]] = {}
    owner: dict[int, str] = {}
    written = _members(settings)
    for name, (members, mark) in written.items():
        if not members:
            if settings.section("groups").values[name].value is not None:
                reader.say(
                    "SHW116",
                    f"the group `{name}` has no drones",
                    mark,
                    help_text="a range goes from the lower number to the higher: `1-8`",
                )
            continue
        beyond = [drone for drone in members if drones is not None and drone > drones]
        if beyond:
            reader.say(
                "SHW116",
                f"the group `{name}` names drone {beyond[0]}; the fleet has {drones}",
                mark,
                help_text="drones are numbered from 1",
            )
            continue
        for drone in members:
            if drone in owner:
                other = owner[drone]
                reader.say(
                    "SHW116",
                    f"drone {drone} is in the group `{name}` a second time"
                    if other == name
                    else f"drone {drone} is in the groups `{other}` and `{name}`",
                    mark,
                    secondary=(Label(written[other][1], "here too"),)
                    if other != name
                    else (),
                    help_text="a drone can be in one group only",
                )
                break
            owner[drone] = name
        groups[name] = tuple(sorted(drone - 1 for drone in set(members)))
    for item in settings.sound("transitions"):
        named = item.word("group")
        if named is not None and named not in written:
            reader.refuse(no_such("group", named, written), item.mark_of("group"))
    return groups


def needed_counts(
    settings: Settings,
    gallery: Gallery,
    drones: int,
    groups: Mapping[str, tuple[int, ...]],
    parking: str | None,
) -> dict[str, int]:
    """Return how many drones fly to each formation that leaves its size open.

    The largest number that flies there at one time. For a parking where none flies by
    a transition it is the largest number that waits; for others, the whole fleet.
    """
    needed: dict[str, int] = {}
    waiting = 1
    for item in settings.sound("transitions"):
        group = item.word("group")
        size = len(groups.get(group, ())) if group is not None else drones
        name = item.text("to")
        for flown in (name, *formations_of(item)):
            needed[flown] = max(needed.get(flown, 0), size)
        waiting = max(waiting, size - (gallery.own_count(name) or size))
    if parking is not None and gallery.own_count(parking) is None:
        needed.setdefault(parking, waiting)
    for name in settings.section("formations").values if _has(settings) else ():
        if gallery.own_count(name) is None:
            needed.setdefault(name, drones)
    return needed
