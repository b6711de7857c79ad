"""Marks: places in a script, as findings name them."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class Mark:
    """Where in a script something stands; lines and columns count from 1."""

    path: str
    line: int
    column: int
    end_line: int
    end_column: int

    def __str__(self) -> str:
        return f"{self.path}:{self.line}:{self.column}"

    @property
    def on_one_line(self) -> bool:
        """Whether it ends on the line that it begins on."""
        return self.end_line == self.line

    @property
    def first_line(self) -> Mark:
        """The part of it on its first line, one column if it goes on."""
        if self.on_one_line:
            return self
        return replace(self, end_line=self.line, end_column=self.column + 1)

    def near(self, key: Mark) -> Mark:
        """Return it if it stands on one line, else the place of its key."""
        return self if self.on_one_line else key
