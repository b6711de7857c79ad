"""Codes 3xx: operation of the show."""

from showc.script.codes.code import Code
from showc.script.diagnostic import Severity

CODES = (
    Code(
        "SHW301",
        "above the usual ceiling",
        "A place is more than 120 m above the ground, the ceiling without a special "
        "authorisation in Europe (122 m in the United States).",
        "Fly lower, or pass over the finding with the authorisation as the reason.",
        "ring: {type: circle, centre: [0, 0, 140]}",
        Severity.WARNING,
        instead="ring: {type: circle, radius: 10, centre: [0, 0, 60]}",
    ),
    Code(
        "SHW302",
        "level flight near the ground",
        "Drones fly level below 2.5 m, where autopilots of shows refuse to and gusts "
        "are dangerous.",
        "Raise the formation, or the launch and landing altitudes.",
        "launch: {altitude: 2}",
        Severity.WARNING,
        instead="launch: {altitude: 10}",
    ),
    Code(
        "SHW303",
        "small separation",
        "The separation is below 1.5 m, less than what satellite positioning without "
        "corrections can promise (2 to 3 m).",
        "Fly with RTK or motion capture and pass over the finding, or keep more "
        "distance.",
        "separation: 1",
        Severity.WARNING,
        instead="separation: 1.5",
    ),
    Code(
        "SHW304",
        "pads close together",
        "Two pads are less than 2 m apart; near the ground drones drift in each "
        "other's airflow.",
        "Leave at least 2 m between pads.",
        "pads: {type: grid, step: 1.5}",
        Severity.WARNING,
        instead="pads: {type: grid, step: 3}",
    ),
    Code(
        "SHW305",
        "fleet larger than a network",
        "One MAVLink network addresses 250 vehicles.",
        "Split the fleet into several networks.",
        "drones: 300",
        Severity.WARNING,
    ),
    Code(
        "SHW306",
        "show longer than the batteries",
        "Holds and least times of the moves together take longer than twelve minutes, "
        "which batteries of show drones surely last.",
        "Shorten the holds, or split the show.",
        "transitions: [{to: ring, hold: 15 min}]",
        Severity.WARNING,
        instead="transitions: [{to: ring, hold: 15 s}]",
    ),
    Code(
        "SHW307",
        "no room to stop before the fence",
        "A drone at full speed, after one second to react and braking at its greatest "
        "tilt, would cross the fence from this place.",
        "Move the formation inwards, fly slower, or widen the fence.",
        "ring: {type: circle, radius: 19}    (with a fence at 20 m)",
        Severity.WARNING,
    ),
    Code(
        "SHW308",
        "what missions cannot carry",
        "Groups move at times of their own, or a formation moves while it is held: in "
        "missions all drones wait for the same slot before each straight leg. Or a "
        "mission has more items than its board holds, or its slots of minute and "
        "second come round again before it lands. Then none are written. Missions for "
        "PX4 are written, but nothing of them is proved.",
        "Want no missions and fly the log (`showc stream`), give groups that are flown "
        "together the same times, leave the motion out, choose a larger board, or name "
        "the hour with --start.",
        "groups: {a: 1, b: 2}\n"
        "formations: {row: {type: points, points: [[0, 0, 20]]}, "
        "top: {type: points, points: [[4, 0, 25]]}}\n"
        "transitions: [{to: row, group: a, at: 30, duration: 9}, "
        "{to: top, group: b, at: 33, duration: 9}]",
        Severity.WARNING,
        instead="mission: {wanted: false}\n"
        "groups: {a: 1, b: 2}\n"
        "formations: {row: {type: points, points: [[0, 0, 20]]}, "
        "top: {type: points, points: [[4, 0, 25]]}}\n"
        "transitions: [{to: row, group: a, at: 30, duration: 9}, "
        "{to: top, group: b, at: 33, duration: 9}]",
    ),
)
