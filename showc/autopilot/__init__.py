"""What ArduCopter makes of a mission: its legs, how it follows them, and its take-off.

:mod:`showc.autopilot.s_curve` is the leg as the autopilot plans it,
:mod:`showc.autopilot.controller` how a vehicle answers to it.
"""
