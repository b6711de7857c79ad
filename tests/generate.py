"""Writes what is made from the program's own tables: schema and references."""

import sys
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import gallery  # noqa: E402
import ocp_reference  # noqa: E402
import tutorial  # noqa: E402

from showc.codes import entries  # noqa: E402
from showc.safety.codes import codes_reference as safety_reference  # noqa: E402
from showc.script.codes import codes_reference  # noqa: E402
from showc.script.reference import script_reference  # noqa: E402
from showc.script.schema import schema_text  # noqa: E402
from showc.verify.codes import ROOMS, codes  # noqa: E402


def checks_reference():
    """The chapter of all codes of checks, Markdown."""
    lines = [
        "# Checks of verify",
        "",
        "Every check of `showc verify` has a code that never changes its meaning.",
    ]
    for hundred, heading in enumerate(ROOMS.values(), 1):
        own = [one for one in codes().values() if one.code[3] == str(hundred)]
        lines += ["", f"## {heading}", *entries(own, 3)]
    return "\n".join(lines) + "\n"


GENERATED = {
    ROOT / "schemas" / "show.schema.json": schema_text,
    ROOT / "showc" / "docs" / "script.md": script_reference,
    ROOT / "showc" / "docs" / "codes.md": lambda: (
        f"{codes_reference()}\n{checks_reference()}\n{safety_reference()}"
    ),
    ROOT / "showc" / "docs" / "gallery.md": gallery.page,
    **{
        ROOT / "showc" / "docs" / ocp_reference.FOLDER / f"{name}.md": (
            lambda text=text: text
        )
        for name, text in ocp_reference.pages().items()
    },
    **{
        ROOT / "showc" / "docs" / gallery.file_of(group, piece): partial(
            gallery.picture, piece
        )
        for group, pieces in gallery.GROUPS.items()
        for piece in pieces
    },
}

if __name__ == "__main__":
    for path, text in GENERATED.items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text(), encoding="utf-8")
    tutorial.draw()
