"""Codes 4xx to 9xx: what later stages find."""

from showc.script.codes.code import Code

CODES: tuple[Code, ...] = (
    Code(
        "SHW401",
        "transition without a solution",
        "No flight was found that keeps every limit and the separation.",
        "The message names the transition, the drones and the limit. Give the move "
        "more time, the formation more space, or drones other places.",
        "transitions: [{to: ring, assignment: fixed, duration: 3}]",
    ),
)
