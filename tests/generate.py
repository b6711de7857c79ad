"""Writes what is made from the program's own tables: schema and references."""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from showc.safety.codes import codes_reference as safety_reference  # noqa: E402
from showc.script.codes import codes_reference  # noqa: E402
from showc.script.reference import script_reference  # noqa: E402
from showc.script.schema import schema_text  # noqa: E402
from showc.verify.codes import codes_reference as checks_reference  # noqa: E402

GENERATED = {
    ROOT / "schemas" / "show.schema.json": schema_text,
    ROOT / "showc" / "docs" / "script.md": script_reference,
    ROOT / "showc" / "docs" / "codes.md": lambda: (
        f"{codes_reference()}\n{checks_reference()}\n{safety_reference()}"
    ),
}

if __name__ == "__main__":
    for path, text in GENERATED.items():
        path.write_text(text(), encoding="utf-8")
