"""Whether the script in a log asks for exports: most shows ask for none."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mcap.reader import make_reader

from showc.files import open_file
from showc.log.schema import METADATA_NAME
from showc.script import read_show
from showc.script.language.document import Mapping, parse_document

if TYPE_CHECKING:
    from pathlib import Path

    from showc.script.show import Show


def show_with_exports(log: Path) -> Show | None:
    """Return the show whose exports lie beside a log that is proved itself.

    None if its script asks for none. The index of the log leads to the script, and the
    rest of it stays unread.
    """
    with open_file(log) as stream:
        reader = make_reader(stream)
        metadata = {one.name: one.metadata for one in reader.iter_metadata()}
        attached = {one.name: one.data for one in reader.iter_attachments()}
    name = metadata.get(METADATA_NAME, {}).get("script", "")
    script = attached.pop(name, b"")
    # Its places take longer to work out than the question whether it names any.
    root, *_ = parse_document(script, name)
    if not isinstance(root, Mapping) or root.get("exports") is None:
        return None
    show = read_show(script, path=name, attached=attached).show
    return show if show is not None and show.exports else None
