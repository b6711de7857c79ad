"""The trajectory log: MCAP with Foxglove's schemas and showc's own.

``showc.log.writer`` makes it, ``showc.log.reader`` gives it back to the planner's side
(pictures, reports, comparisons). The verifier has a reader of its own and takes only
``showc.log.showc_pb2`` from here; so this module imports nothing.
"""
