"""The field table of the site: where the show flies, and what lies around it."""

from __future__ import annotations

from showc.script.kinds import Choice, Field, Items, Quantity, Section, Text

_PLACE = Quantity("m", minimum=-10_000.0, maximum=10_000.0)
_CORNER = Items(_PLACE, 3, 3)
_ERROR = Quantity("m", minimum=0.0, maximum=100.0)

VOLUME = Section(
    "volume",
    "The box that no drone may leave, show frame.",
    (
        Field("min", _CORNER, "Its lower corner.", default=[-100, -100, 0]),
        Field("max", _CORNER, "Its upper corner.", default=[100, 100, 120]),
    ),
)

ORIGIN = Section(
    "origin",
    "Where the show frame's origin lies on the Earth.",
    (
        Field(
            "latitude",
            Quantity("deg", minimum=-89.0, maximum=89.0, store="deg"),
            "Latitude of the show frame's origin, WGS 84. The default place is the "
            "home of PX4's simulators.",
            default=47.397742,
        ),
        Field(
            "longitude",
            Quantity("deg", minimum=-180.0, maximum=180.0, store="deg"),
            "Longitude of the show frame's origin, WGS 84.",
            default=8.545594,
        ),
        Field(
            "altitude",
            Quantity("m", minimum=-500.0, maximum=6000.0),
            "Altitude of the show frame's origin above mean sea level.",
            default=488.0,
        ),
    ),
)

_POINTS = Items(Items(_PLACE, 2, 2), 2, 200)
_AREA = Items(Items(_PLACE, 2, 2), 3, 200)

AUDIENCE = Section(
    "audience",
    "Where people stand: a line in front of them, or the area they fill.",
    (
        Field("name", Text(60), "What it is called.", default="audience"),
        Field("line", _POINTS, "Points `[x, y]` of a line, show frame."),
        Field("area", _AREA, "Corners `[x, y]` of an area, show frame."),
    ),
    one_of=("line", "area"),
)

BUILDING = Section(
    "building",
    "Something that stands where drones may fall or stray.",
    (
        Field("name", Text(60), "What it is called.", default="building"),
        Field(
            "area",
            _AREA,
            "Corners `[x, y]` of its ground plan, show frame.",
            required=True,
        ),
        Field(
            "height",
            Quantity("m", minimum=0.0, maximum=1000.0),
            "Its height above the origin.",
            required=True,
        ),
    ),
)

RISK = Section(
    "risk",
    "What the safety case reckons with.",
    (
        Field(
            "method",
            Choice(("footprint", "ballistic", "one-to-one")),
            "The ground risk buffer that must be clear of the audience. `footprint`: "
            "where a drone may fall from what it flies, with drag and wind. "
            "`ballistic` and `one-to-one`: the LBA's formulas.",
            default="footprint",
        ),
        Field(
            "wind",
            Quantity("m/s", minimum=0.0, maximum=30.0),
            "Greatest steady wind in which a drone may fall, from any direction.",
            default_text="`wind` of the site",
        ),
        Field(
            "reaction_time",
            Quantity("s", minimum=0.0, maximum=60.0),
            "Time until a drone that strays is acted upon.",
            default=1.0,
        ),
        Field("gnss_error", _ERROR, "Error of the position that it has.", default=3.0),
        Field(
            "position_error",
            _ERROR,
            "How far from its place it is held.",
            default=3.0,
        ),
        Field("map_error", _ERROR, "Error of the map of the site.", default=1.0),
        Field("height_error", _ERROR, "Error of the height.", default=1.0),
        Field(
            "rotation",
            Quantity("deg", minimum=0.0, maximum=180.0),
            "By how much the whole show may be turned about its origin.",
            default=0.5,
        ),
        Field(
            "shift",
            _ERROR,
            "By how much the whole show may be moved, in any direction.",
            default=1.0,
        ),
        Field(
            "ground",
            Quantity("m", minimum=-500.0, maximum=0.0),
            "Height of the lowest ground around, seen from the origin.",
            default=0.0,
        ),
    ),
)


SITE = Section(
    "site",
    "Where the show flies.",
    (
        Field("origin", ORIGIN, ORIGIN.description, default={}),
        Field(
            "heading",
            Quantity("deg", minimum=-360.0, maximum=360.0, store="deg"),
            "Compass bearing of the show frame's +y axis, clockwise from north.",
            default=0.0,
        ),
        Field("volume", VOLUME, VOLUME.description, default={}),
        Field(
            "fence",
            Items(Items(_PLACE, 2, 2), 3, 200),
            "Corners `[x, y]` of a geofence on the ground, show frame.",
            default_text="the volume's walls",
        ),
        Field(
            "fence_margin",
            Quantity("m", minimum=0.0, maximum=100.0),
            "Distance from the fence that every drone keeps at every instant.",
            default=0.0,
        ),
        Field(
            "wind",
            Quantity("m/s", minimum=0.0, maximum=8.0),
            "Wind in which missions are to keep time: their slots wait for drones that "
            "it delays. How missions are flown in more was not measured.",
            default=0.0,
        ),
        Field(
            "audience",
            Items(AUDIENCE, 1, 50),
            "Where people stand.",
            default_text="not stated",
            examples=([{"name": "stands", "line": [[-60, -80], [60, -80]]}],),
        ),
        Field(
            "buildings",
            Items(BUILDING, 1, 200),
            "What stands around.",
            default_text="none",
            examples=(
                [
                    {
                        "name": "hall",
                        "area": [[90, 0], [120, 0], [120, 40], [90, 40]],
                        "height": 12,
                    }
                ],
            ),
        ),
        Field(
            "ceiling",
            Quantity("m", minimum=1.0, maximum=10_000.0),
            "Greatest height above the origin that is allowed, for strayed drones too.",
            default_text="not stated",
        ),
        Field("risk", RISK, RISK.description, default={}),
    ),
)
