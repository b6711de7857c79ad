"""The kernel can be read in an afternoon: its size, and what it leans on."""

import ast
from pathlib import Path

KERNEL = Path(__file__).parents[2] / "showc" / "verify" / "kernel"
FILES = sorted(KERNEL.rglob("*.py"))
STANDARD = {
    *("__future__", "collections", "dataclasses", "functools", "itertools", "math"),
    "typing",
}


def modules(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from names if node.module == "showc.log" else [node.module]


def test_the_kernel_has_at_most_2500_lines():
    lines = {
        path.name: len(path.read_text(encoding="utf-8").splitlines()) for path in FILES
    }
    assert 0 < sum(lines.values()) <= 2500, lines


def test_all_of_verify_has_at_most_6500_lines():
    files = KERNEL.parent.rglob("*.py")
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)
    assert lines <= 6500


def test_the_kernel_imports_numpy_and_the_logs_messages_only():
    allowed = ("numpy", "showc.arrays", "showc.log.showc_pb2", "showc.verify.kernel")
    foreign = {
        f"{path.name}: {name}"
        for path in FILES
        for name in modules(path)
        if name.split(".")[0] not in STANDARD
        and not any(name == one or name.startswith(f"{one}.") for one in allowed)
    }
    assert foreign == set()


def test_every_proof_states_its_theorem_its_rounding_and_its_source():
    for name in ("dynamics", "limits", "fence", "separation", "slices", "certificates"):
        text = ast.get_docstring(
            ast.parse((KERNEL / f"{name}.py").read_text(encoding="utf-8"))
        )
        assert "Rounding" in text, name
        assert any(word in text for word in ("Theorem", "Lemma")), name
        assert any(f"{year}" in text for year in range(1950, 2027)), name
