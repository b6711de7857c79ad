"""The show script: from YAML to a show, with everything that is wrong with it."""

from showc.script.diagnostic import Diagnostic, Label, Severity, Suppressed
from showc.script.load import LoadResult, load_show, read_show

__all__ = [
    "Diagnostic",
    "Label",
    "LoadResult",
    "Severity",
    "Suppressed",
    "load_show",
    "read_show",
]
