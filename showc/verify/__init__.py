"""Proof of a compiled show from its bytes alone, by code that planned nothing.

Nothing of the compiler is imported: no planner, no solver, no polynomials of theirs.
What is taken from the file is proved against the file's own rules: integrity of every
byte, physics, limits and separation at every instant, choreography, lower bounds on
time, and the mission files beside it. ``showc/docs/proofs.md`` says what is proved and
with which error bounds.
"""

from showc.log.records import DamagedLogError
from showc.verify.proofs import verify_log
from showc.verify.report import Check, Place, Verification

__all__ = ["Check", "DamagedLogError", "Place", "Verification", "verify_log"]
