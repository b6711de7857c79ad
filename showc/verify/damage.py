"""How damage is reported: with the byte where it shows, and what is still whole."""

from __future__ import annotations

from showc.errors import DamagedFileError
from showc.verify.report import printable


class DamagedLogError(DamagedFileError):
    """The log is cut, altered, or not one of showc's.

    Attributes
    ----------
    offset
        Byte of the file at which the damage shows.
    good_until
        Show time up to which all data before that byte are whole [s]; None if there
        are none.
    """

    def __init__(
        self, path: str, text: str, offset: int, good_until: float | None = None
    ) -> None:
        self.offset = offset
        self.good_until = good_until
        whole = (
            "nothing before that can be used"
            if good_until is None
            else f"the data before that are whole up to {good_until:.3f} s of the show"
        )
        super().__init__(
            printable(
                f"{path}: {text}, at byte {offset:,}; {whole}. "
                "Compile the show again, or fetch the file again."
            )
        )


class Damage(Exception):  # noqa: N818 - it becomes a DamagedLogError at the border
    """Raised inside the reader, which adds path and last good time."""

    def __init__(self, offset: int, text: str) -> None:
        super().__init__(text)
        self.offset = offset
        self.text = text

    def __reduce__(self) -> tuple[type[Damage], tuple[int, str]]:
        """Make a copy from the arguments; found elsewhere, it is raised here."""
        return Damage, (self.offset, self.text)
