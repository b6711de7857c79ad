"""Findings as SARIF 2.1.0, for code scanning."""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from pathlib import PurePath
from typing import TYPE_CHECKING
from urllib.parse import quote

from showc._version import __version__
from showc.codes import Code

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from showc.script.diagnostic import Diagnostic
    from showc.script.mark import Mark

SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"

Plain = dict[str, object]


def render_sarif(
    diagnostics: Iterable[Diagnostic],
    sources: Mapping[str, str],
    rules: Mapping[str, Code],
) -> str:
    """Return findings as one SARIF log with one run.

    Paths of files become relative references with forward slashes, as given; the
    fingerprint of a result depends on its code and its line's text only, so that it
    stays the same when lines move.
    """
    found = list(diagnostics)
    used = sorted({item.code for item in found})
    index = {code: number for number, code in enumerate(used)}
    lines = {path: text.split("\n") for path, text in sources.items()}
    seen: Counter[str] = Counter()
    log: Plain = {
        "$schema": SCHEMA,
        "version": "2.1.0",
        "runs": [
            {
                "tool": {
                    "driver": {
                        "name": "showc",
                        "version": __version__,
                        "rules": [
                            _rule(rules.get(code, Code(code, code, "", "")))
                            for code in used
                        ],
                    }
                },
                "columnKind": "unicodeCodePoints",
                "artifacts": [
                    {"location": {"uri": _uri(path)}, **_language(path)}
                    for path in sorted(sources)
                ],
                "results": [_result(item, index, lines, seen) for item in found],
            }
        ],
    }
    return json.dumps(log, indent=2, ensure_ascii=False) + "\n"


def _language(path: str) -> Plain:
    yaml = PurePath(path).suffix.lower() in {".yaml", ".yml"}
    return {"sourceLanguage": "yaml"} if yaml else {}


def _rule(known: Code) -> Plain:
    text = f"{known.cause} {known.repair}".strip() or known.code
    return {
        "id": known.code,
        "name": "".join(
            word.capitalize() for word in re.findall("[A-Za-z0-9]+", known.title)
        ),
        "shortDescription": {"text": known.title},
        "fullDescription": {"text": known.cause or known.title},
        "help": {"text": text},
        "defaultConfiguration": {"level": known.severity},
    }


def _result(
    item: Diagnostic,
    index: Mapping[str, int],
    lines: Mapping[str, list[str]],
    seen: Counter[str],
) -> Plain:
    text = [item.message + ".", *(f"{note}." for note in item.notes)]
    if item.help:
        text.append(f"Help: {item.help}.")
    result: Plain = {
        "ruleId": item.code,
        "ruleIndex": index[item.code],
        "level": str(item.severity),
        "message": {"text": " ".join(text)},
        "partialFingerprints": {
            "primaryLocationLineHash": _fingerprint(item, lines, seen)
        },
    }
    if item.span is not None:
        result["locations"] = [_location(item.span)]
    if item.secondary:
        result["relatedLocations"] = [
            {**_location(label.span), "id": number, "message": {"text": label.text}}
            for number, label in enumerate(item.secondary, start=1)
        ]
    if item.fix and item.span is not None:
        result["fixes"] = [
            {
                "description": {"text": item.help or item.fix},
                "artifactChanges": [
                    {
                        "artifactLocation": {"uri": _uri(item.span.path)},
                        "replacements": [
                            {
                                "deletedRegion": _region(item.span),
                                "insertedContent": {"text": item.fix},
                            }
                        ],
                    }
                ],
            }
        ]
    return result


def _fingerprint(
    item: Diagnostic, lines: Mapping[str, list[str]], seen: Counter[str]
) -> str:
    line = ""
    if item.span is not None:
        text = lines.get(item.span.path, [])
        if item.span.line <= len(text):
            line = "".join(text[item.span.line - 1].split())
    digest = hashlib.sha256(f"{item.code}\n{line}".encode()).hexdigest()[:16]
    seen[digest] += 1
    return f"{digest}:{seen[digest]}"


def _location(span: Mark) -> Plain:
    return {
        "physicalLocation": {
            "artifactLocation": {"uri": _uri(span.path)},
            "region": _region(span),
        }
    }


def _region(span: Mark) -> Plain:
    return {
        "startLine": span.line,
        "startColumn": span.column,
        "endLine": span.end_line,
        "endColumn": span.end_column,
    }


def _uri(path: str) -> str:
    return quote(PurePath(path).as_posix(), safe="/")
