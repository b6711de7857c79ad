"""showc: a compiler for drone light shows.

The command line's verbs as functions; each name imports what it needs when it is
first used.

>>> import showc
>>> from pathlib import Path
>>> result = showc.load_show("shows/grid.yaml")  # showc check
>>> showc.compile_script("shows/grid.yaml", Path("output.mcap"))  # showc compile
>>> showc.verify_log(Path("output.mcap")).passed  # showc verify
>>> logged = showc.read_log(Path("output.mcap"))
>>> Path("output.html").write_text(showc.render_page(logged))  # showc view
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from showc._version import __version__

if TYPE_CHECKING:
    from showc.errors import ShowError
    from showc.fleet.options import SolveOptions
    from showc.log.reader import read_log
    from showc.pipeline.compile import CompileOptions, compile_script
    from showc.script import load_show
    from showc.verify import verify_log
    from showc.view import render_page, render_report

__all__ = [
    "CompileOptions",
    "ShowError",
    "SolveOptions",
    "__version__",
    "compile_script",
    "load_show",
    "read_log",
    "render_page",
    "render_report",
    "verify_log",
]

_HOMES = {
    "CompileOptions": "showc.pipeline.compile",
    "ShowError": "showc.errors",
    "SolveOptions": "showc.fleet.options",
    "compile_script": "showc.pipeline.compile",
    "load_show": "showc.script",
    "read_log": "showc.log.reader",
    "render_page": "showc.view",
    "render_report": "showc.view",
    "verify_log": "showc.verify",
}


def __getattr__(name: str) -> object:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'showc' has no attribute {name!r}")
