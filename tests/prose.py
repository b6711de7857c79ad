"""Sentences that a reader may have to read twice: run by ``make lint``.

Looks at comments, docstrings and messages of the package and at the documents. A noun
is to be the subject of a sentence, so these pronouns and phrases are findings.
"""

import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]

PATTERN = re.compile(
    r"\b(who|whom|whoever|nobody|everybody|anybody|so many|lest"
    r"|(?:is|are|was|were) told)\b",
    re.IGNORECASE,
)
CODE_BLOCK = re.compile(r"```.*?```", re.DOTALL)
TEXT = {
    tokenize.COMMENT,
    tokenize.STRING,
    getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING),
}


def prose_of(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of prose with their numbers: of code, text tokens alone."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".toml":
        yield from enumerate(text.splitlines(), 1)
        return
    if path.suffix == ".md":
        blank = CODE_BLOCK.sub(lambda block: "\n" * block[0].count("\n"), text)
        yield from enumerate(blank.splitlines(), 1)
        return
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in TEXT:
            yield from enumerate(token.string.splitlines(), token.start[0])


def main() -> int:
    """Print the findings as file:line; return 1 if there are any."""
    documents = [*ROOT.glob("*.md"), *(ROOT / "showc" / "docs").glob("*.md")]
    tables = (ROOT / "showc").rglob("*.toml")
    code = [
        path
        for path in (ROOT / "showc").rglob("*.py")
        if not path.name.endswith("_pb2.py")
    ]
    found = [
        f"{path.relative_to(ROOT)}:{number}: “{match[0]}” in: {line.strip()}"
        for path in sorted([*documents, *tables, *code])
        for number, line in prose_of(path)
        if (match := PATTERN.search(line))
    ]
    sys.stdout.writelines(f"{line}\n" for line in found)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
