"""Codes 1xx: keys, values, units and names."""

from showc.script.codes.code import Code
from showc.script.diagnostic import Severity

CODES = (
    Code(
        "SHW101",
        "unknown key",
        "The key has no meaning at this place.",
        "Take the suggestion, or look the keys up in the reference of show scripts.",
        "seperation: 1.5",
        instead="separation: 1.5",
    ),
    Code(
        "SHW102",
        "missing key",
        "Something that has no default is missing.",
        "Add the key that the message names.",
        "transitions:\n  - {hold: 5}",
        instead="transitions:\n  - {to: ring, hold: 5}",
    ),
    Code(
        "SHW103",
        "value of the wrong form",
        "A value is a text, number, list or mapping where another form is wanted.",
        "Write what the message wants. A value that begins with # needs quotes.",
        "separation: wide",
        instead="separation: 1.5 m",
    ),
    Code(
        "SHW104",
        "out of range",
        "The number, or the length of the text, is beyond what makes sense here.",
        "Check the unit: plain numbers are in the unit the message names.",
        "limits: {tilt: 200}",
        instead="limits: {tilt: 30}",
    ),
    Code(
        "SHW105",
        "wrong unit",
        "The unit is unknown, or measures something else than what is wanted.",
        "Use one of the units the message lists, or a plain number.",
        "limits: {speed: 20 deg}",
        instead="limits: {speed: 5 m/s}",
    ),
    Code(
        "SHW106",
        "unknown word",
        "The value must be one of a few words.",
        "Take the suggestion, or one of the words listed.",
        "separation: {distance: 1.5, shape: ball}",
        instead="separation: {distance: 1.5, shape: sphere}",
    ),
    Code(
        "SHW107",
        "name of nothing",
        "A formation or group is named that the script does not define.",
        "Take the suggestion, or define it.",
        "transitions:\n  - {to: rnig}  # the formation is called ring",
        instead="transitions:\n  - {to: ring}",
    ),
    Code(
        "SHW108",
        "format version of another showc",
        "The key `showc` gives the version of the script format, and this program "
        "reads another one.",
        "Use the showc the script was written for, or adapt the script and its "
        "version.",
        "showc: 7",
        instead="showc: 1",
    ),
    Code(
        "SHW109",
        "file cannot be read",
        "A file that a formation names does not exist, may not be read, is too large, "
        "is no regular file, or lies outside the script's folder.",
        "Names of files are relative to the script's folder. A file elsewhere, links "
        "followed, is read with the option `--allow-outside` only.",
        "dragon: {type: csv, file: dargon.csv}",
    ),
    Code(
        "SHW110",
        "file of the wrong form",
        "A file that a formation names is not what its kind should be.",
        "The message says what was found, in which line where there are lines.",
        "dragon: {type: csv, file: dragon.csv}    (a line has a word for a number)",
    ),
    Code(
        "SHW111",
        "keys that exclude each other",
        "Two keys are given of which only one can hold.",
        "Keep one of them.",
        "ring: {type: circle, like: star}",
        instead="ring: {type: circle, radius: 10}",
    ),
    Code(
        "SHW112",
        "wrong number of elements",
        "A list is longer or shorter than it must be.",
        "Positions have three numbers: x, y, z.",
        "ring: {type: circle, centre: [0, 20]}",
        instead="ring: {type: circle, radius: 10, centre: [0, 0, 20]}",
    ),
    Code(
        "SHW113",
        "formations like each other in a ring",
        "Each is defined by the other, so that none is defined.",
        "Give one of them a shape.",
        "a: {like: b}\nb: {like: a}",
        instead="a: {type: circle, radius: 10}\nb: {like: a, centre: [0, 0, 30]}",
    ),
    Code(
        "SHW114",
        "no colour",
        "The text is neither a CSS colour name nor hexadecimal.",
        'Write a name, or hexadecimal in quotes: "#ff8800".',
        "ring: {type: circle, colour: golden}",
        instead="ring: {type: circle, radius: 10, colour: gold}",
    ),
    Code(
        "SHW115",
        "size of the fleet unknown",
        "No formation has a number of places of its own, and `drones` is missing.",
        "Add `drones: 16`, or a `count` to a formation.",
        "formations: {ring: {type: circle, radius: 10}}",
    ),
    Code(
        "SHW116",
        "faulty group",
        "A group is empty, names a drone the fleet does not have, or shares a drone "
        "with another group.",
        "Drones are numbered from 1; each belongs to one group at most.",
        "groups: {left: 1-8, right: 8-16}",
        instead="groups: {left: 1-8, right: 9-16}",
    ),
    Code(
        "SHW117",
        "comment that passes over nothing",
        "A `# showc: ignore[...]` names no code, an unknown one, or one that is not "
        "found there, or gives no reason.",
        "Remove it, or write `# showc: ignore[SHW303] why it is right here`.",
        "separation: 3  # showc: ignore[SHW303] we have RTK",
        Severity.WARNING,
        instead="separation: 1.5",
    ),
    Code(
        "SHW118",
        "formation never flown",
        "A formation is defined, and no transition, pads, parking or other formation "
        "uses it.",
        "Remove it, or fly to it.",
        "formations:\n"
        "  ring: {type: circle, radius: 10}\n"
        "  spare: {type: line, length: 45}",
        Severity.WARNING,
        instead="formations:\n"
        "  ring: {type: circle, radius: 10}\n"
        "  spare: {type: line, length: 45}\n"
        "transitions: [ring, spare]",
    ),
    Code(
        "SHW119",
        "more than is read",
        "The script asks for more than any show needs: places, formations, links of "
        "formations that are each like the next, bytes of its files, processor time; "
        "or it has more findings than are shown.",
        "The message says what is too much, and the limit.",
        "formations: {swarm: {type: grid, rows: 1000, columns: 1000}}",
        instead="formations: {swarm: {type: grid, rows: 4, columns: 4}}\n"
        "transitions: [swarm]",
    ),
    Code(
        "SHW120",
        "volume inside out",
        "The flight volume's lower corner is not below its upper corner.",
        "Swap the numbers.",
        "site: {volume: {min: [50, -50, 0], max: [-50, 50, 100]}}",
        instead="site: {volume: {min: [-50, -50, 0], max: [50, 50, 100]}}",
    ),
    Code(
        "SHW121",
        "beats without a tempo",
        "A time counts bars or beats, and nothing says how long they are.",
        "Add `music: {bpm: 120}`, or give the time in seconds.",
        "transitions:\n  - {to: ring, at: bar 12}",
    ),
    Code(
        "SHW122",
        "no sure tube",
        "`tracking: measured` takes how far drones stray from a file that `showc "
        "simulate` writes; this one holds no such tube, or flew too seldom to be sure.",
        "Simulate the show with more `--runs`, or give `tracking` in metres.",
        "separation: {distance: 1.5, tracking: measured, results: show.yaml}",
        instead="separation: {distance: 1.5, tracking: 0.3}",
    ),
)
