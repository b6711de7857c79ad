"""Every number says where it comes from, and functions take few things at once."""

import ast
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "showc"

MOST_PARAMETERS = 7

MANY = {
    # Fields of what they make, all but three by keyword and all optional.
    "ocp/phase.py": {"control"},
    "script/language/reader.py": {"say"},
}
"""Functions with more parameters than that, by module."""

ARRAYS = {"array", "arange", "linspace", "geomspace", "concatenate", "tuple", "float"}
"""Functions whose results are numbers, too."""


@cache
def modules():
    """Path, lines and tree of each."""
    paths = sorted(PACKAGE.rglob("*.py"))
    texts = [path.read_text(encoding="utf-8") for path in paths]
    return [
        (path.relative_to(PACKAGE).as_posix(), text.splitlines(), ast.parse(text))
        for path, text in zip(paths, texts, strict=True)
    ]


def is_numeric(value):
    match value:
        case ast.Constant():
            return isinstance(value.value, int | float) and value.value is not True
        case ast.UnaryOp():
            return is_numeric(value.operand)
        case ast.BinOp():
            return is_numeric(value.left) or is_numeric(value.right)
        case ast.Tuple() | ast.List():
            return any(is_numeric(one) for one in value.elts)
        case ast.Call(func=ast.Attribute(attr=name) | ast.Name(id=name), args=given):
            return name in ARRAYS and not isinstance(given[0], ast.GeneratorExp)
    return False


def is_constant(statement):
    if not isinstance(statement, ast.Assign | ast.AnnAssign) or not statement.value:
        return False
    whole = getattr(statement, "targets", None) or [statement.target]
    names = [
        one.id for part in whole for one in ast.walk(part) if isinstance(one, ast.Name)
    ]
    return all(name.isupper() for name in names) and is_numeric(statement.value)


def is_text(statement):
    return isinstance(statement, ast.Expr) and isinstance(
        getattr(statement.value, "value", None), str
    )


def is_explained(body, place, lines):
    """Whether a text follows it, or a comment is above or beside it."""
    statement = body[place]
    beside, above = lines[statement.end_lineno - 1], lines[statement.lineno - 2]
    commented = "#" in beside or above.lstrip().startswith("#")
    return commented or any(is_text(after) for after in body[place + 1 : place + 2])


def test_every_number_with_a_name_says_what_it_is():
    silent = []
    for path, lines, tree in modules():
        silent += [
            f"{path}:{statement.lineno}"
            for place, statement in enumerate(tree.body)
            if is_constant(statement) and not is_explained(tree.body, place, lines)
        ]
    assert not silent


def is_command(function):
    # Each option of a command is a parameter of the function behind it.
    return any(
        isinstance(part, ast.Attribute | ast.Name)
        and getattr(part, "attr", getattr(part, "id", "")) in {"command", "option"}
        for decorator in function.decorator_list
        for part in ast.walk(decorator)
    )


def parameters(function):
    given = function.args
    names = [one.arg for one in given.posonlyargs + given.args + given.kwonlyargs]
    return [name for name in names if name not in {"self", "cls"}]


def test_functions_take_few_things_at_once():
    many = {}
    for path, _, tree in modules():
        found = {
            node.name
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef)
            and len(parameters(node)) > MOST_PARAMETERS
            and not is_command(node)
        }
        if found:
            many[path] = found
    assert many == MANY
