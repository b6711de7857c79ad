"""The page of all codes: of scripts, of checks, of the safety case."""

from showc.safety import codes as safety
from showc.script import codes as script
from showc.verify import codes as verify

_HEAD = """# Findings

<!-- Made from the program's own table; `make docs` writes it anew. -->

Every finding has a code that never changes its meaning. `showc explain SHW201` prints \
what stands here.

Warnings can be passed over, with a reason, by a comment on their line or alone on the \
line before:

```yaml
separation: 1  # showc: ignore[SHW303] all drones fly with RTK
```"""
_CHAPTERS = {
    "0": "The file and its YAML",
    "1": "Keys, values, units and names",
    "2": "Kinematics and separation",
    "3": "Operation",
    "4": "Planning and solving",
}


def page():
    """Markdown of the page."""
    return f"{_script()}\n{_checks()}\n{_safety()}"


def _script():
    lines = [_HEAD]
    for hundred, heading in _CHAPTERS.items():
        lines += ["", f"## {heading} (SHW{hundred}xx)"]
        for one in script.codes().values():
            if one.code[3] == hundred:
                lines += _entry(one, 3, f"*{one.severity.capitalize()}.* ")
    return "\n".join(lines) + "\n"


def _checks():
    lines = [
        "# Checks of verify",
        "",
        "Every check of `showc verify` has a code that never changes its meaning.",
    ]
    for hundred, heading in enumerate(verify.ROOMS.values(), 1):
        lines += ["", f"## {heading}"]
        for one in verify.codes().values():
            if one.code[3] == str(hundred):
                lines += _entry(one, 3)
    return "\n".join(lines) + "\n"


def _safety():
    lines = ["# Findings of the safety case"]
    for one in safety.codes().values():
        lines += _entry(one, 2)
    return "\n".join(lines) + "\n"


def _entry(one, level, severity=""):
    """Lines of one code below a heading of that level."""
    lines = ["", f"{'#' * level} {one.code}: {one.title}", "", severity + one.cause]
    if one.example:
        lines += ["", "```text", one.example, "```"]
    lines += ["", one.repair]
    if one.instead:
        lines += ["", "*Use instead:*", "", "```text", one.instead, "```"]
    return lines
