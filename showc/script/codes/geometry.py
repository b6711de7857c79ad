"""Codes 2xx: kinematics and separation."""

from showc.script.codes.code import Code
from showc.script.diagnostic import Severity

CODES = (
    Code(
        "SHW201",
        "formation tighter than the separation",
        "Two places of a formation are closer to each other than two drones may ever "
        "be, or than the formation's own `spacing`. No flight could keep that, so "
        "nothing is solved.",
        "Make the formation larger, use fewer drones, or add `spread: true`, which "
        "pushes places apart as little as possible.",
        "separation: 2\nformations: {ring: {type: circle, radius: 3, count: 16}}",
        instead="separation: 2\n"
        "formations: {ring: {type: circle, radius: 8, count: 16}}",
    ),
    Code(
        "SHW202",
        "formation tighter than √2 times the separation",
        "Straight synchronous moves between formations whose places are s apart keep "
        "drones at least s/√2 apart, and not more. Below √2 times the separation the "
        "planner must bend or delay paths, which takes longer.",
        "Nothing need be done; a wider formation is quicker to reach.",
        "separation: 2\nformations: {row: {type: line, length: 30, count: 16}}  "
        "# 2 m apart",
        Severity.WARNING,
        instead="separation: 2\nformations: {row: {type: line, length: 45, count: 16}}",
    ),
    Code(
        "SHW203",
        "outside the flight volume",
        "A place, or the hover above a pad, is outside the box `site: volume:`.",
        "Move the formation, make it smaller, or enlarge the volume. Without "
        "`site: volume:` the box is 200 m x 200 m and 120 m high.",
        "ring: {type: circle, radius: 20, plane: front, centre: [0, 0, 10]}",
        instead="ring: {type: circle, radius: 20, plane: front, centre: [0, 0, 30]}",
    ),
    Code(
        "SHW204",
        "outside the fence",
        "A place is outside the polygon `site: fence:`, or nearer to it than "
        "`fence_margin` allows.",
        "Move the formation or the fence.",
        "site: {fence: [[-20, -20], [20, -20], [0, 20]]}",
        instead="site: {fence: [[-40, -40], [40, -40], [40, 40], [-40, 40]]}",
    ),
    Code(
        "SHW205",
        "places and drones do not match",
        "A formation has more places than drones fly to it, or fewer and the script "
        "has no `parking` where the others could wait.",
        "Change `count` or `drones`, or add `parking`.",
        "drones: 16\nformations: {ring: {type: circle, count: 12}}",
        instead="drones: 16\nformations: {ring: {type: circle, radius: 10, count: 16}}",
    ),
    Code(
        "SHW206",
        "parking too near a picture",
        "A place of the parking formation is closer to a place of a picture than the "
        "separation, and drones stand in both at one time.",
        "Park further away.",
        "parking: {type: line, centre: [0, 0, 20]}    (and a picture there too)",
    ),
    Code(
        "SHW207",
        "the vehicle cannot hover",
        "The weight is not between the least and the greatest thrust.",
        "Change the thrust limits, the mass, or the rotors' parameters.",
        "limits: {thrust_max: 5 N}  # the aircraft weighs 6.1 N",
        instead="limits: {thrust_max: 12 N}",
    ),
    Code(
        "SHW208",
        "groups too near each other",
        "Two groups stand in formations at the same time that are closer to each "
        "other than the separation, or a group flies to where a drone of no group "
        "stands by.",
        "Move one of the formations away.",
        "transitions: [{to: left_ring, group: left}, {to: same_place, group: right}]",
    ),
    Code(
        "SHW209",
        "duration too short",
        "No drone can make the move in the time given, by its speed and thrust alone, "
        "whatever the planner does.",
        "Give at least the time the message names, or leave `duration` out.",
        "transitions: [{to: ring, duration: 1}]",
        instead="transitions: [{to: ring, duration: 30}]",
    ),
    Code(
        "SHW210",
        "limit beyond the rotors",
        "A limit of thrust or torque is more than the rotors can give at their "
        "greatest speed, so that it never takes effect.",
        "Check the limit, or the vehicle's parameters. The rotors' own limit holds in "
        "any case.",
        "limits: {thrust_max: 30 N}  # the rotors give 21 N",
        Severity.WARNING,
        instead="limits: {thrust_max: 15 N}",
    ),
    Code(
        "SHW211",
        "limit beyond the autopilot",
        "A limit of speed or acceleration is more than the autopilot was seen to "
        "follow, so that it never takes effect.",
        "Lower the limit, or write `envelope: airframe` for a flight that no autopilot "
        "is known to follow.",
        "limits: {acceleration: 9}  # the autopilot follows 4.2 m/s²",
        Severity.WARNING,
        instead="limits: {acceleration: 4}",
    ),
    Code(
        "SHW212",
        "no way within the fence",
        "The fence, less its margin, falls into parts, and a place lies in another "
        "part than the pads.",
        "Widen the passage between them, or ask for less `fence_margin`.",
        "site: {fence: [[0, 0], [9, 0], [9, 9], [5, 1], [0, 9]], fence_margin: 1}",
    ),
    Code(
        "SHW213",
        "time that cannot be met",
        "A transition is to arrive or to start before the drones can: what comes "
        "before it lasts longer, by times the script gives and by what speed and "
        "thrust need at least.",
        "Give the time that the message names, or more; shorten the holds before it; "
        "or begin the music later (`music: {offset: ...}`).",
        "transitions: [{to: ring, at: 20, hold: 9}, {to: star, at: 25}]",
        instead="transitions: [{to: ring, at: 20, hold: 9}, {to: star, at: 50}]",
    ),
    Code(
        "SHW216",
        "text that cannot be read",
        "The letters of a text are less than three and a half times as high as its "
        "places are apart: the coarsest letters of dots that people read are 3 wide "
        "and 5 high, which is four times.",
        "Use as many drones as the message says, or write less.",
        "drones: 16\nformations: {word: {type: text, text: WELCOME}}",
        Severity.WARNING,
    ),
    Code(
        "SHW218",
        "picture that is mirrored",
        "A text, drawing or image reads from one side only, and an audience of `site` "
        "is on the other: people there see it mirrored.",
        "Turn it as the message says. With people on both sides, show it once for "
        "each.",
        "site: {audience: [{line: [[-30, 60], [30, 60]]}]}\n"
        "formations: {row: {type: text, text: LEFT}}",
        Severity.WARNING,
        instead="site: {audience: [{line: [[-30, 60], [30, 60]]}]}\n"
        "formations: {row: {type: text, text: LEFT, transform: [{rotate: 180}]}}",
    ),
    Code(
        "SHW214",
        "above the ceiling",
        "A place, or the hover above a pad, is higher than `site: ceiling:`. Drones "
        "that stray rise further; `showc safety` reckons with that.",
        "Lower the formation, or have a higher ceiling allowed.",
        "site: {ceiling: 20}\nformations: {row: {type: line, length: 9, "
        "centre: [0, 0, 25]}}",
        instead="site: {ceiling: 40}\n"
        "formations: {row: {type: line, length: 45, centre: [0, 0, 25]}}",
    ),
    Code(
        "SHW215",
        "over the audience or in a building",
        "A place is above an area of `site: audience:`, or inside the ground plan of a "
        "building and not above its roof.",
        "Move the formation away. `showc safety` says how far drones may fall.",
        "site: {audience: [{area: [[0, 0], [9, 0], [9, 9]]}]}",
    ),
    Code(
        "SHW217",
        "motion that cannot be flown",
        "A motion asks for more speed, acceleration, jerk, tilt or thrust than the "
        "limits allow, leads out of the flight volume, or brings two drones nearer "
        "than the separation.",
        "Make its times longer or its size smaller, by what the message says.",
        "transitions: [{to: ring, hold: 20, motion: [{wave: {amplitude: 5, period: "
        "4}}]}]",
        instead="transitions: [{to: ring, hold: 40, motion: [{wave: {amplitude: 3, "
        "period: 12}}]}]",
    ),
)
