"""showc: a compiler for drone light shows."""

from showc._version import __version__

__all__ = ["__version__"]
