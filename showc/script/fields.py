"""The field table: every key of a script, its unit, range, default and meaning.

The reader, ``schemas/show.schema.json`` and the reference in the documents are all
made from this table.
"""

from __future__ import annotations

from showc.script.formation_fields import COLOUR, EFFECT, FORMATION
from showc.script.kinds import (
    NAME,
    Choice,
    Either,
    Field,
    File,
    Flag,
    Integer,
    Items,
    Moment,
    Quantity,
    Reference,
    Section,
    Table,
    Text,
    Time,
)
from showc.script.lights import LIGHTS
from showc.script.motions import MOTION
from showc.script.site_fields import SITE
from showc.script.vehicle_fields import LIMITS, VEHICLE

FORMAT_VERSION = 1
"""Version of the script format that this reader understands."""

_HOLD = Quantity("s", minimum=0.0, maximum=3600.0)
_ALTITUDE = Quantity("m", minimum=0.5, maximum=1000.0)
_SPEED = Quantity("m/s", minimum=0.1, maximum=50.0)
_ASSIGNMENT = Choice(("optimal", "fixed"))

SEPARATION = Section(
    "separation",
    "How far two drones stay apart, at every instant.",
    (
        Field(
            "distance",
            Quantity("m", minimum=0.05, maximum=100.0),
            "The separation d.",
            default=1.5,
        ),
        Field(
            "shape",
            Choice(("sphere", "ellipsoid", "any-axis", "all-axes")),
            "`sphere`: distance at least d. `ellipsoid`: the same after dividing the "
            "height difference by `vertical_stretch` (downwash). `any-axis`: at least "
            "d along one axis. `all-axes`: at least d along every axis.",
            default="sphere",
        ),
        Field(
            "vertical_stretch",
            Quantity(minimum=1.0, maximum=10.0),
            "Stretch of the ellipsoid along z.",
            default=1.0,
        ),
        Field(
            "tracking",
            Either(
                (Choice(("measured",)), Quantity("m", minimum=0.0, maximum=20.0)),
            ),
            "How far each drone may stray from its path. Paths keep twice that more "
            "than `distance`, so that drones that stray still keep `distance`. "
            "`measured`: the tube that `results` has for the whole show.",
            default=0,
            examples=(0.3, "measured"),
        ),
        Field(
            "results",
            File((".json",)),
            "What `showc simulate` wrote, for `tracking: measured`.",
            default="wind.json",
        ),
    ),
    short="distance",
)

YAW = Section(
    "yaw",
    "Which way the drones point.",
    (
        Field(
            "mode",
            Choice(("held", "free")),
            "`held` keeps the heading all the time, `free` lets it move in between.",
            default="held",
        ),
        Field(
            "heading",
            Quantity("deg", minimum=-360.0, maximum=360.0),
            "Yaw at hover, show frame, counter-clockwise from +x.",
            default=0.0,
        ),
    ),
    short="mode",
)

LAUNCH = Section(
    "launch",
    "From the pads straight up to the first hover.",
    (
        Field("altitude", _ALTITUDE, "Height of the hover above the pads.", default=10),
        Field("climb_speed", _SPEED, "Greatest climb speed.", default=2.0),
        Field("hold", _HOLD, "Time to hover afterwards.", default=2.0),
    ),
)

LANDING = Section(
    "landing",
    "From the last formation to above the pads and straight down.",
    (
        Field("altitude", _ALTITUDE, "Height of the hover above the pads.", default=10),
        Field("descent_speed", _SPEED, "Greatest descent speed.", default=1.0),
        Field("hold", _HOLD, "Time to hover before the descent.", default=2.0),
        Field(
            "assignment",
            _ASSIGNMENT,
            "`optimal` lets drones land on each other's pads, `fixed` sends each to "
            "its own.",
            default="optimal",
        ),
    ),
)

_JOINT = Choice(("at rest", "moving"))
PREFER = Either((Choice(("time", "energy")), Quantity(minimum=1.0, maximum=10.0)))

TRANSITION = Section(
    "transition",
    "One move of the fleet, or of a group, and the hold after it.",
    (
        Field("to", Reference("formation"), "Formation to reach.", required=True),
        Field(
            "hold",
            _HOLD,
            "Time to hover in it afterwards. Where the next transition has a time of "
            "its own, this is the least time, and none if it is not written.",
            default=5.0,
        ),
        Field(
            "at",
            Time(),
            "When the formation stands. The hold before grows so that it does.",
            examples=(24.5, "bar 12", "@chorus"),
        ),
        Field("start", Time(), "When the move begins."),
        Field(
            "assignment",
            Choice(("optimal", "fixed", "keep")),
            "`optimal` gives the places out so that the move is short, `fixed` sends "
            "drone i to place i, `keep` leaves every drone the place number that it "
            "has, for another version of the same formation.",
            default="optimal",
        ),
        Field(
            "duration",
            Quantity("s", minimum=0.1, maximum=600.0),
            "Time the move takes.",
            default_text="as short as can be, or by `at`, `start` and `prefer`",
        ),
        Field(
            "prefer",
            PREFER,
            "What the move does with time that it does not need, where `at` or "
            "`duration` leave some.",
            default_text="the show's",
        ),
        Field(
            "group",
            Reference("group"),
            "The drones that move. Groups that follow each other in the list move at "
            "once; with different times each keeps its own, and may move again while "
            "others do.",
            default_text="the whole fleet",
        ),
        Field("colour", COLOUR, "Colours on arrival, instead of the formation's."),
        Field(
            "fade",
            Choice(("linear", "start", "end")),
            "How colours change over the move: evenly, at its start, at its end.",
            default="linear",
        ),
        Field("effect", EFFECT, "Effect over the hold, instead of the formation's."),
        Field(
            "lights",
            LIGHTS,
            "Colours at moments of the hold, or a table of them: columns time [s], "
            "place (from 1), red, green, blue (0 to 255). Effects play on them.",
            examples=(
                [
                    {"after": 2, "colour": "red"},
                    {"at": "bar 13", "colour": "white", "fade": "end"},
                ],
                "lights.csv",
            ),
        ),
        Field(
            "motion",
            Items(MOTION, 1, 20),
            "What the formation does while it is held, each on top of those before it. "
            "It begins and ends at rest, unless `arrive` or `leave` say otherwise.",
            examples=(
                [
                    {"rotate": {"angle": "360 deg"}},
                    {"wave": {"amplitude": 2, "period": 6}},
                ],
            ),
        ),
        Field(
            "arrive",
            _JOINT,
            "`moving`: the drones arrive in motion, with position, velocity and "
            "acceleration of a formation that moves already.",
            default="at rest",
        ),
        Field(
            "leave",
            _JOINT,
            "`moving`: they leave out of the motion, which does not come to rest.",
            default="at rest",
        ),
        Field("name", Text(80), "Name for people.", default_text="`from -> to`"),
    ),
    short="to",
)

MUSIC = Section(
    "music",
    "What the times of the script count in. They count from the beginning of the "
    "music; without music, from take-off.",
    (
        Field(
            "file",
            File((".mp3", ".wav", ".ogg", ".flac", ".m4a")),
            "The recording, for viewers; nothing is heard in it.",
        ),
        Field(
            "offset",
            Quantity("s", minimum=-3600.0, maximum=3600.0),
            "Time from take-off to the beginning of the music.",
            default=0.0,
        ),
        Field(
            "bpm",
            Quantity(minimum=10.0, maximum=1000.0),
            "Tempo in beats per minute.",
            default_text="none: bars and beats cannot be used",
        ),
        Field("beats_per_bar", Integer(1, 64), "Beats in a bar.", default=4),
        Field(
            "first_beat",
            Quantity("s", minimum=0.0, maximum=3600.0),
            "Time of beat 1, which begins bar 1, from the beginning of the music.",
            default=0.0,
        ),
        Field(
            "cues",
            Either((File((".txt", ".csv", ".tsv")), Table(Time(), "cue"))),
            "Names for times: a mapping, or a file with Audacity's labels, Reaper's "
            "markers, or a name and a time in each line.",
            default={},
            default_text="none",
            examples=({"chorus": 24.5, "drop": "bar 33"},),
        ),
    ),
)

BOARDS = {
    "4k": 161,
    "8k": 303,
    "15k": 303,
    "16k": 650,
    "32k": 1306,
    "f4": 303,
    "f405": 303,
    "pixhawk": 650,
    "cube": 650,
    "fmuv3": 650,
    "sitl": 650,
    "h743": 1306,
}
"""Autopilot boards, and the items with home that fit: ArduPilot keeps 15 bytes of each,
less 4 bytes."""

MISSION = Section(
    "mission",
    "For the mission files.",
    (
        Field(
            "wanted",
            Flag(),
            "Whether mission files are made. Without them the log is flown with "
            "`showc stream`.",
            default=True,
        ),
        Field(
            "light_servos",
            Items(Integer(1, 16), 3, 3),
            "Servo outputs that carry red, green and blue.",
            default_text="no light items",
            examples=([9, 10, 11],),
        ),
        Field(
            "light_pwm",
            Items(Quantity("us", minimum=500.0, maximum=2500.0, store="us"), 2, 2),
            "Pulse widths of dark and of full light.",
            default=[1000, 2000],
        ),
        Field(
            "slack",
            Quantity("s", minimum=0.0, maximum=60.0),
            "Time between the predicted end of a leg and the next clock slot.",
            default=3.0,
        ),
        Field(
            "autopilot",
            Choice(("ardupilot", "px4")),
            "Whose missions to write. How PX4 flies a mission is not known: naming it "
            "here accepts missions about which nothing is proved.",
            default="ardupilot",
        ),
        Field(
            "start_minute",
            Integer(0, 59),
            "Minute of any hour at which the missions begin, where no start time is "
            "given.",
            default=0,
        ),
        Field(
            "board",
            Choice(tuple(BOARDS)),
            "Autopilot board, for the number of items it can hold.",
            default="pixhawk",
        ),
    ),
)

_DRONE_RANGE = Text(
    20, r"[1-9][0-9]*(\s*-\s*[1-9][0-9]*)?", "a drone's number, or a range like `1-8`"
)

EXPORT = Section(
    "export",
    "One other format, written from the log and proved as it was written.",
    (
        Field(
            "to",
            Choice(
                (
                    "skyc",
                    "skyb",
                    "skybrush-csv",
                    "poly7",
                    "crazyflie",
                    "vviz",
                    "gltf",
                    "kml",
                )
            ),
            "Which format.",
            required=True,
        ),
        Field(
            "separation",
            Quantity("m", minimum=0.0, maximum=100.0),
            "Distance that must be left in the air when Skybrush's show mode flies it.",
            default_text="the script's",
        ),
        Field(
            "lead",
            Quantity("s", minimum=0.0, maximum=600.0),
            "Time that the fleet stands before the show begins.",
            default_text="10 s for skyc and skyb, else none",
        ),
        Field(
            "tolerance",
            Quantity("m", minimum=0.001, maximum=1.0),
            "Greatest distance of the written flight from the solved one.",
            default=0.01,
        ),
    ),
    short="to",
)

SHOW = Section(
    "show",
    "A drone show, complete from ground to ground.",
    (
        Field(
            "showc",
            Integer(1, 1000),
            "Version of the script format; this is version 1.",
            required=True,
            examples=(1,),
        ),
        Field("name", Text(120), "Title.", default_text="the file's name"),
        Field(
            "epoch",
            Moment(),
            "Time stamp of show time zero in the log; it has no effect on the flight.",
            default="2025-01-01T00:00:00Z",
        ),
        Field("site", SITE, SITE.description, default={}),
        Field("vehicle", VEHICLE, VEHICLE.description, default={}),
        Field("limits", LIMITS, LIMITS.description, default={}),
        Field("separation", SEPARATION, SEPARATION.description, default={}),
        Field("yaw", YAW, YAW.description, default={}),
        Field(
            "drones",
            Integer(1, 10_000),
            "Size of the fleet.",
            default_text="the largest number of places that pads or a formation fix",
        ),
        Field(
            "pads",
            Either((Reference("formation"), FORMATION)),
            "Places on the ground from which the drones start: a formation, or the "
            "name of one.",
            default_text="a grid with 2 m between neighbours, or more where the "
            "separation asks for it, about the site's origin",
        ),
        Field("launch", LAUNCH, LAUNCH.description, default={}),
        Field(
            "formations",
            Table(FORMATION, "formation"),
            "The pictures, by name.",
            required=True,
        ),
        Field(
            "groups",
            Table(
                Either((_DRONE_RANGE, Items(_DRONE_RANGE, 1, 10_000))),
                "group of drones",
            ),
            "Groups of drones that move by themselves: numbers from 1 and ranges.",
            examples=({"left": "1-8", "right": ["9-15", 16]},),
        ),
        Field(
            "transitions",
            Items(TRANSITION, 1, 1000),
            "What happens, in order: where to, how long to stay.",
            required=True,
        ),
        Field("music", MUSIC, MUSIC.description),
        Field(
            "prefer",
            PREFER,
            "What moves do with time that they do not need. With `at` alone: `time` "
            "flies as fast as can be, and late; a number, 2 say, takes twice the time "
            "of the quickest straight flight, if there is as much, and more is calmer; "
            "`energy` takes the time that costs the fleet the least. With `duration` "
            "too, `energy` takes the profile that costs the least.",
            default=1.5,
            examples=("time", "energy", 3),
        ),
        Field("landing", LANDING, LANDING.description, default={}),
        Field(
            "parking",
            Either((Reference("formation"), FORMATION)),
            "Where drones wait that have no place in a picture.",
            default_text="every drone has a place in every picture",
        ),
        Field("mission", MISSION, MISSION.description, default={}),
        Field(
            "exports",
            Items(EXPORT, 0, 8),
            "Other formats that compile writes too, beside the log.",
            default=[],
            default_text="none",
            examples=(["skyc", {"to": "skyb", "separation": 1.5}],),
        ),
        Field(
            "log_rate",
            Quantity("Hz", minimum=1.0, maximum=200.0),
            "Samples of the fleet per second in the log.",
            default=20.0,
        ),
        Field(
            "seed",
            Integer(0, 2_147_483_647),
            "Seed of everything random in formations and planning.",
            default=0,
        ),
    ),
)
"""The whole script."""

__all__ = ["FORMAT_VERSION", "NAME", "SHOW"]
