"""The trajectory log: MCAP with Foxglove's schemas and showc's own.

``showc.log.container`` reads every byte of it, ``showc.log.writer`` makes it, and
``showc.log.reader`` gives it back to the planner's side (pictures, reports,
comparisons). This module imports nothing.
"""
