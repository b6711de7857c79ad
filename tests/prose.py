"""Sentences that a reader may have to read twice: run by ``make lint``.

Looks at comments, docstrings and messages of the package, at its tables, pages and
templates, and at the documents. A noun is to be the subject of a sentence, so certain
pronouns and phrases are findings; and so are long sentences of documents and tables.
"""

import io
import re
import sys
import tokenize
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]

PATTERN = re.compile(
    r"\b(who|whom|whoever|nobody|everybody|anybody|so\s+many|lest|told)\b",
    re.IGNORECASE,
)
LONGEST = {".toml": 25, ".md": 36}
"""Words of a sentence at most: of a table, and of a page that may hold a formula."""
CODE_BLOCK = re.compile(r"```.*?```", re.DOTALL)
QUOTES = re.compile(r"""^[a-zA-Z]*("{3}|'{3}|"|')|("{3}|'{3}|"|')$""")
PARAGRAPH = re.compile(r"\n\s*\n|\n(?=\s*(?:[-*|#>]|\d+\.) )")
END = re.compile(r"[.!?;:]\s")
ASIDE = re.compile(r"\([^)]*\)|`[^`]*`")
TEXT = {
    tokenize.STRING,
    getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING),
}
AROUND = {
    tokenize.NL,
    getattr(tokenize, "FSTRING_START", tokenize.NL),
    getattr(tokenize, "FSTRING_END", tokenize.NL),
}


def strings_of(text: str) -> Iterator[tuple[int, str]]:
    """Yield the strings of code, those that follow each other as one, and comments."""
    line, parts = 0, []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string
        elif token.type in TEXT:
            line = line if parts else token.start[0]
            parts.append(QUOTES.sub("", token.string))
        elif token.type not in AROUND and parts:
            yield line, "".join(parts)
            parts = []


def values_of(table: object) -> Iterator[str]:
    """Yield all texts of a table."""
    if isinstance(table, str):
        yield table
    elif isinstance(table, dict | list):
        inner = table.values() if isinstance(table, dict) else table
        for value in inner:
            yield from values_of(value)


def prose_of(path: Path) -> Iterator[tuple[int, str]]:
    """Pieces of prose with their lines: of code, strings and comments alone."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        yield from strings_of(text)
    elif path.suffix == ".toml":
        tomllib.loads(text)
        yield from ((0, value) for value in values_of(tomllib.loads(text)))
    else:
        if path.suffix == ".md":
            text = CODE_BLOCK.sub(lambda block: "\n" * block[0].count("\n"), text)
        line = 1
        for piece in PARAGRAPH.split(text):
            yield line, piece
            line = text.count("\n", 0, text.find(piece)) + 1


def long_sentences(text: str, most: int) -> Iterator[str]:
    """Yield the sentences of a text that have more than ``most`` words."""
    for piece in PARAGRAPH.split(text):
        if piece.count("|") > 2:
            continue  # a row of a table
        for sentence in END.split(" ".join(piece.split())):
            words = [w for w in ASIDE.sub("x", sentence).split() if w[0].isalnum()]
            if len(words) > most:
                yield f"{len(words)} words: {sentence}"


def files() -> Iterator[Path]:
    """Yield everything that is read by people."""
    yield from ROOT.glob("*.md")
    for folder, pattern in (
        ("showc", "**/*.md"), ("showc", "**/*.toml"), ("showc", "**/*.py"),
        ("showc", "**/*.html"), ("showc", "**/*.js"), ("showc", "**/*.yaml"),
        ("schemas", "*.proto"), ("shows", "*.yaml"),
    ):  # fmt: skip
        yield from (ROOT / folder).glob(pattern)


def main() -> int:
    """Print the findings as file:line; return 1 if there are any."""
    found = []
    for path in sorted(set(files())):
        if path.name.endswith("_pb2.py"):
            continue
        where = path.relative_to(ROOT)
        most = LONGEST.get(path.suffix, 0) * (path.name != "CHANGELOG.md")
        for number, text in prose_of(path):
            if match := PATTERN.search(text):
                at = number + text.count("\n", 0, match.start())
                line = text.splitlines()[at - number].strip()
                found.append(f"{where}:{at}: “{match[0]}” in: {line}")
            if most:
                found += [f"{where}:{number}: {s}" for s in long_sentences(text, most)]
    sys.stdout.writelines(f"{line}\n" for line in found)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
