"""The safety case: where drones may fall, how they stop, whether they last.

It reads the trajectories of a log and the script that the log carries. Nothing of the
planner is used.
"""
