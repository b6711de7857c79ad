"""The show as the script describes it: what the reader of YAML hands on.

Every number is SI, every position is in the show frame: origin at the site's
origin, x to the right and y ahead on the ground, z up; +y points along the site's
``heading`` (compass bearing, clockwise from north). With heading 0 the show frame is
east-north-up.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime

    from showc.arrays import FloatArray
    from showc.script.mark import Mark
    from showc.vehicle import Battery, Body, Limits, Quadrotor, Separation, Vector


@dataclass(frozen=True, slots=True)
class Source:
    """The script and every file it reads, as bytes, for hashes and attachments."""

    path: str
    """As the user gave it."""
    content: bytes
    """The script itself."""
    inputs: Mapping[str, bytes] = field(default_factory=dict)
    """Files that the script names (CSV, SVG, meshes, images, fonts), by name."""


@dataclass(frozen=True, slots=True, eq=False)
class Audience:
    """Where people stand."""

    name: str
    """What it is called."""
    points: FloatArray
    """Of the line or the area, shape (n, 2), show frame [m]; read-only."""
    area: bool
    """Whether the points are corners of an area."""


@dataclass(frozen=True, slots=True, eq=False)
class Building:
    """Something that stands around."""

    name: str
    """What it is called."""
    corners: FloatArray
    """Of its ground plan, shape (n, 2), show frame [m]; read-only."""
    height: float
    """Above the origin [m]."""


@dataclass(frozen=True, slots=True)
class Risk:
    """What the safety case reckons with; the meaning of each is the field table's."""

    method: Literal["footprint", "ballistic", "one-to-one"] = "footprint"
    """Ground risk buffer that must be clear of the audience."""
    wind: float = 0.0
    """Greatest steady wind in a fall [m/s]."""
    reaction_time: float = 1.0
    """[s]."""
    gnss_error: float = 3.0
    """[m]."""
    position_error: float = 3.0
    """[m]."""
    map_error: float = 1.0
    """[m]."""
    height_error: float = 1.0
    """[m]."""
    rotation: float = 0.0087266462599716
    """Of the whole show about its origin [rad]; half a degree."""
    shift: float = 1.0
    """Of the whole show [m]."""
    ground: float = 0.0
    """Height of the lowest ground around [m]."""

    @property
    def misplaced(self) -> float:
        """How far from its planned place a drone may be: the errors' sum [m]."""
        return self.gnss_error + self.position_error + self.map_error


@dataclass(frozen=True, slots=True)
class Site:
    """Where the show flies."""

    latitude: float
    """Latitude of the show frame's origin, WGS 84 [deg]."""
    longitude: float
    """Longitude of the show frame's origin, WGS 84 [deg]."""
    altitude: float
    """Altitude of the show frame's origin above mean sea level [m]."""
    heading: float
    """Compass bearing of the show frame's +y axis, clockwise from north [deg]."""
    volume_min: Vector
    """Lower corner of the flight volume, show frame [m]."""
    volume_max: Vector
    """Upper corner of the flight volume, show frame [m]."""
    fence: FloatArray | None = None
    """Geofence, shape (corners, 2), show frame [m]; None: the volume's walls."""
    fence_margin: float = 0.0
    """Distance from the fence that every drone keeps [m]."""
    wind: float = 0.0
    """Wind in which missions are to keep time [m/s]."""
    audience: tuple[Audience, ...] = ()
    """Where people stand; empty: not stated."""
    buildings: tuple[Building, ...] = ()
    """What stands around."""
    ceiling: float | None = None
    """Greatest height above the origin that is allowed [m]; None: not stated."""
    risk: Risk = field(default_factory=Risk)
    """What the safety case reckons with."""

    @property
    def room(self) -> tuple[Vector, Vector]:
        """Corners of the box to fly in [m]: walls, and a ceiling that is lower."""
        low, (x, y, top) = self.walls
        highest = top if self.ceiling is None else min(top, self.ceiling)
        return low, (x, y, max(highest, low[2]))

    @property
    def walls(self) -> tuple[Vector, Vector]:
        """Corners of the flight volume [m], less the margin where it is the fence."""
        inset = 0.0 if self.fence is not None else self.fence_margin
        low, high = self.volume_min, self.volume_max
        return (
            (low[0] + inset, low[1] + inset, low[2]),
            (high[0] - inset, high[1] - inset, high[2]),
        )


Preference = Literal["time", "energy"] | float
"""To be there soon, to take little energy, or a multiple of the time of the quickest
straight flight."""
EffectKind = Literal["pulse", "sweep", "rainbow", "strobe", "twinkle", "run"]
"""What a colour effect does."""


@dataclass(frozen=True, slots=True)
class Effect:
    """A colour effect in time over a formation or a transition."""

    kind: EffectKind
    """What it does."""
    period: float
    """Time of one cycle [s]."""
    direction: Vector = (1.0, 0.0, 0.0)
    """Axis of a sweep or rainbow, show frame, unit length."""
    depth: float = 1.0
    """How far a pulse darkens or a sweep dims, 0 to 1."""
    wavelength: float = 10.0
    """Length of one cycle along the axis [m]."""
    colours: tuple[Vector, ...] = ()
    """Linear red, green, blue that a running gradient goes through, then again."""
    beat: float | None = None
    """Show time at which a cycle begins [s]; None: the beginning of the hold."""


@dataclass(frozen=True, slots=True, eq=False)
class LightKey:
    """Colours at one moment of a hold."""

    time: float
    """Since the beginning of the hold, or of the show [s]."""
    absolute: bool
    """Whether it is a time of the show."""
    colours: FloatArray
    """Linear light of each place, shape (places, 3), read-only; not a number where
    nothing is said."""
    step: bool
    """Whether the colours change there at once, and not on the way there."""


@dataclass(frozen=True, slots=True, eq=False)
class Formation:
    """Places of the drones in one picture."""

    name: str
    """Its key in the script."""
    points: FloatArray
    """Places, shape (places, 3), show frame [m]; read-only."""
    colours: FloatArray
    """Linear red, green, blue of each place, 0 to 1, shape (places, 3); read-only."""
    mark: Mark
    """Where the script defines it."""
    effect: Effect | None = None
    """Colour effect while the formation is held."""


@dataclass(frozen=True, slots=True)
class Rotate:
    """Turn about an axis, once over the whole hold."""

    angle: float
    """By how much, right-handed [rad]."""
    axis: Vector
    """Unit vector, show frame."""
    about: Vector | None
    """Point of the axis [m]; None: the middle of the formation."""
    ramp: float
    """Time to speed up, and to slow down [s]."""


@dataclass(frozen=True, slots=True)
class Breathe:
    """Grow to a size and back, again and again."""

    scale: float
    """Greatest size, as a share of the formation's own."""
    period: float
    """Time of one breath [s]."""
    about: Vector | None
    """Point that stays [m]; None: the middle of the formation."""
    ramp: float
    """Time to reach the full motion, and to leave it [s]."""


@dataclass(frozen=True, slots=True)
class Wave:
    """Swing to and fro along an axis, later the further along a direction."""

    amplitude: float
    """Greatest distance from the place [m]."""
    axis: Vector
    """Along which drones swing, unit vector."""
    period: float
    """Time of one swing [s]."""
    direction: Vector
    """Where the wave runs, unit vector."""
    wavelength: float
    """Distance from crest to crest [m]; infinite: all swing alike."""
    ramp: float
    """Time to reach the full motion, and to leave it [s]."""


@dataclass(frozen=True, slots=True)
class Orbit:
    """Circle about the place, later the further along a direction."""

    radius: float
    """Of the circle [m]."""
    axis: Vector
    """Normal of the circle, unit vector; right-handed."""
    period: float
    """Time of one turn [s]."""
    direction: Vector
    """Along which drones lag behind, unit vector."""
    wavelength: float
    """Distance over which they lag a whole turn [m]; infinite: all circle alike."""
    ramp: float
    """Time to reach the full motion, and to leave it [s]."""


@dataclass(frozen=True, slots=True)
class Travel:
    """Move as a whole from point to point, at rest in each."""

    points: tuple[Vector, ...]
    """Displacements from where it stands [m]; times go by the length of the ways."""


@dataclass(frozen=True, slots=True)
class Morph:
    """Become other formations one after the other, at rest in each."""

    through: tuple[str, ...]
    """Their names; each takes an equal share of the time, place i going to place i."""


@dataclass(frozen=True, slots=True, eq=False)
class Follow:
    """Go where the frames of a file lead, once over the whole hold."""

    file: str
    """As the script names it."""
    frames: FloatArray
    """Where each place is at evenly spaced moments, shape (frames, places, 3), show
    frame [m]; read-only. How far it has come since the first one counts."""
    length: float
    """Time from the first frame to the last, as recorded [s]."""
    ramp: float
    """Time to speed up, and to slow down [s]."""


Motion = Rotate | Breathe | Wave | Orbit | Travel | Morph | Follow
"""What a formation does while it is held."""


@dataclass(frozen=True, slots=True)
class Transition:
    """One move of the fleet, or of a group, and the hold after it."""

    name: str
    """For people: given by the script, or ``from -> to``."""
    to: str
    """Name of the formation to reach."""
    hold: float
    """Time to hover in the formation afterwards [s]; the least one where the next
    transition has a time of its own."""
    assignment: Literal["optimal", "fixed", "keep"]
    """Whether places are assigned optimally, drone i takes place i, or every drone
    keeps its number of place."""
    mark: Mark
    """Where the script says so."""
    duration: float | None = None
    """Time the move takes [s]; None: as short as can be."""
    group: str | None = None
    """Group of drones that moves; None: all."""
    colours: FloatArray | None = None
    """Colours of the places reached, overriding the formation's, (places, 3)."""
    fade: Literal["linear", "start", "end"] = "linear"
    """How the colour changes over the move: evenly, at its start, at its end."""
    effect: Effect | None = None
    """Colour effect over the hold, overriding the formation's."""
    at: float | None = None
    """Show time of the arrival [s]; None: when it comes."""
    start: float | None = None
    """Show time of the departure [s]; None: when it comes."""
    prefer: Preference = 1.5
    """What it does with time that it does not need."""
    motion: tuple[Motion, ...] = ()
    """What the formation does over the hold, each on top of those before it."""
    under_way: tuple[bool, bool] = (False, False)
    """Whether the motion is under way when the drones arrive, and when they leave;
    else it begins, and ends, at rest."""
    lights: tuple[LightKey, ...] = ()
    """Colours at moments of the hold, under the effect."""

    @property
    def timed(self) -> bool:
        """Whether the script says when it flies."""
        return self.at is not None or self.start is not None


@dataclass(frozen=True, slots=True)
class Music:
    """What the times of a script count in."""

    file: str | None
    """Name of the recording among the script's files."""
    offset: float
    """Show time at which the music begins [s]."""
    bpm: float | None
    """Beats per minute."""
    beats_per_bar: int
    first_beat: float
    """Time of beat 1 in the music [s]."""
    cues: Mapping[str, float] = field(default_factory=dict)
    """Times in the music by name [s]."""
    sound: bool = True
    """Whether tempo and cues could be read."""


@dataclass(frozen=True, slots=True)
class Launch:
    """From the pads to the first hover: straight up."""

    altitude: float
    """Height above the pads of the hover after the climb [m]."""
    climb_speed: float
    """Greatest climb speed [m/s]."""
    hold: float
    """Time to hover afterwards [s]."""


@dataclass(frozen=True, slots=True)
class Landing:
    """From the last formation to above the pads, and straight down."""

    altitude: float
    """Height above the pads of the hover before the descent [m]."""
    descent_speed: float
    """Greatest descent speed [m/s]."""
    hold: float
    """Time to hover before the descent [s]."""
    assignment: Literal["optimal", "fixed"]
    """Whether drones may land on each other's pads (optimal) or only on their own."""


@dataclass(frozen=True, slots=True)
class MissionOptions:
    """What the mission files need to know beyond the flight itself."""

    wanted: bool = True
    """Whether there are to be any."""
    light_servos: tuple[int, int, int] | None = None
    """Servo outputs that carry red, green, blue; None: no light items."""
    light_pwm: tuple[int, int] = (1000, 2000)
    """Pulse widths of dark and full light [us]."""
    slack: float = 3.0
    """Time between the predicted end of a leg and the next clock slot [s]."""
    board: str = "pixhawk"
    """Autopilot board, for the item budget."""
    start_minute: int = 0
    """Minute of any hour at which missions without a start time begin, 0 to 59."""
    autopilot: Literal["ardupilot", "px4"] = "ardupilot"
    """Whose dialect they speak; how PX4 flies them is not known, nor proved."""


@dataclass(frozen=True, slots=True)
class Export:
    """Another format that compile writes too."""

    to: str
    """Its name."""
    tolerance: float
    """Greatest distance of the written flight from the solved one [m]."""
    separation: float | None = None
    """Distance to keep in the air [m]; None: the script's."""
    lead: float | None = None
    """How long the fleet stands before the show begins [s]; None: as usual."""


@dataclass(frozen=True, slots=True, eq=False)
class Show:
    """A whole show, checked, complete from ground to ground."""

    format_version: int
    """Version of the script format."""
    name: str
    """Title of the show."""
    source: Source
    """The script's own bytes and those of the files it names."""
    epoch: datetime
    """Time stamp of show time zero in the log (UTC); a fixed date by default."""
    site: Site
    """Where it flies."""
    vehicle: Quadrotor
    """What flies."""
    body: Body
    """How it falls."""
    battery: Battery
    """What it flies on."""
    limits: Limits
    """What each drone keeps."""
    separation: Separation
    """What each pair keeps."""
    yaw: Literal["held", "free"]
    """Whether yaw is held at ``heading`` or free to move."""
    heading: float
    """Yaw of every drone at hover, show frame, counter-clockwise from +x [rad]."""
    drones: int
    """Size of the fleet."""
    formations: Mapping[str, Formation]
    """All formations by name, pads included."""
    pads: str
    """Name of the formation on the ground."""
    groups: Mapping[str, tuple[int, ...]]
    """Drones of each group, counting from 0."""
    launch: Launch
    """Its first part."""
    transitions: tuple[Transition, ...]
    """Its middle, in order."""
    landing: Landing
    """Its last part."""
    mission: MissionOptions
    """For the mission files."""
    tracking: float = 0.0
    """How far each drone may stray from its path; ``separation`` holds it twice [m]."""
    exports: tuple[Export, ...] = ()
    """Other formats."""
    log_rate: float = 20.0
    """Samples of the fleet per second in the log [Hz]."""
    seed: int = 0
    """Seed of everything random in the show's formations and planning."""
    airframe_limits: Limits | None = None
    """Limits of the airframe alone where ``limits`` keep its autopilot's envelope."""
    parking: str | None = None
    """Formation where drones without a place in a picture wait; None: not allowed."""
    music: Music | None = None
    """What it is flown to."""

    @property
    def kept(self) -> float:
        """Distance that drones keep though they stray as far as ``tracking`` [m]."""
        return self.separation.distance - 2.0 * self.tracking
