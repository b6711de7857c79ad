"""The version, in one place: the package, the manifest and the log read it."""

__version__ = "0.1.0"
