"""Writes what is made from the program's own tables: schema and references."""

import sys
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import findings_reference  # noqa: E402
import gallery  # noqa: E402
import ocp_reference  # noqa: E402
import script_reference  # noqa: E402
import tutorial  # noqa: E402

from showc.script.language.schema import schema_text  # noqa: E402

GENERATED = {
    ROOT / "schemas" / "show.schema.json": schema_text,
    ROOT / "showc" / "docs" / "script.md": script_reference.page,
    ROOT / "showc" / "docs" / "codes.md": findings_reference.page,
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
