"""Codes 0xx: the file and its YAML."""

from showc.script.codes.code import Code

CODES = (
    Code(
        "SHW001",
        "not valid YAML",
        "The text cannot be read as YAML from the marked place on.",
        "Look at the marked line and the one before: a missing colon or space after "
        "it, an open bracket or quote, an indentation that fits nothing.",
        "formations:\n  ring: {type: circle, radius: 5",
        instead="formations:\n  ring: {type: circle, radius: 10}",
    ),
    Code(
        "SHW002",
        "tab in the indentation",
        "YAML forbids tabs in indentation, because editors draw them differently.",
        "Indent with spaces.",
        "site:\n\theading: 30",
        instead="site:\n  heading: 30",
    ),
    Code(
        "SHW003",
        "not UTF-8",
        "The file has a byte that cannot stand in UTF-8 text at that place.",
        "Save the script as UTF-8 in the editor.",
        "name: M\\xfcnchen    (saved as Latin-1)",
    ),
    Code(
        "SHW004",
        "key twice",
        "The same key stands twice in one mapping; readers of YAML disagree about "
        "which one holds.",
        "Keep one of them.",
        "separation: 1.5\nseparation: 2",
        instead="separation: 2",
    ),
    Code(
        "SHW005",
        "not a finite number",
        "A number is infinite, not a number, or too large to be stored.",
        "Write an ordinary number; leave the key out if there is to be no limit.",
        "separation: .inf",
        instead="separation: 1.5",
    ),
    Code(
        "SHW006",
        "word that YAML may read as a truth value",
        "Plain `yes`, `no`, `on` and `off` are truth values in YAML 1.1 and words in "
        "YAML 1.2.",
        "Write `true` or `false` if a truth value is meant, else put the word in "
        "quotes.",
        "name: no",
        instead='name: "no"',
    ),
    Code(
        "SHW007",
        "number that YAML readers read differently",
        "Leading zeros are octal to some readers, colons are base 60, underscores are "
        "dropped.",
        "Write an ordinary decimal number.",
        "transitions:\n  - {to: ring, hold: 1:30}",
        instead="transitions:\n  - {to: ring, hold: 90}",
    ),
    Code(
        "SHW008",
        "too large",
        "The script has more bytes, values or levels than are read: 16 MB, a million "
        "values with aliases written out, 40 levels.",
        "Put long lists of points into CSV files.",
        "a: &a [x, x, x]\nb: &b [*a, *a, *a]\nc: &c [*b, *b, *b]    (and so on)",
    ),
    Code(
        "SHW009",
        "YAML feature that scripts do not use",
        "Tags, merge keys, several documents and keys that are not plain words have "
        "no meaning in a show script.",
        "Write the values out. A formation can be `like:` another.",
        "epoch: !!timestamp 2025-01-01",
    ),
    Code(
        "SHW010",
        "script cannot be read",
        "There is no such file, or it may not be read.",
        "Check the path and the file's permissions.",
        "showc check shows/grid.yml    (the file is called grid.yaml)",
    ),
    Code(
        "SHW011",
        "no script",
        "The file is empty, or holds a list or a single value instead of keys.",
        "Start from the script that `showc init` writes.",
        "- circle\n- line",
    ),
)
