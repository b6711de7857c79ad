"""What must hold: derived from the script, and compared with what the log claims.

This is the one part of verify that imports the reader of scripts. Nothing of the
planner is imported: places, legs and lights are laid out anew.
"""
