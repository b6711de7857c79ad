"""Every number says where it comes from, and functions take few things at once."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "showc"

MOST_PARAMETERS = 7

MANY = {
    # Fields of what they make, all but three by keyword and all optional.
    "ocp/phase.py": {"control"},
    "script/reader.py": {"say"},
    # Parts of one worker's task, and of one mesh's audit.
    "fleet/single_drone/avoiding.py": {"avoid"},
    "fleet/single_drone/staying.py": {"stay_apart"},
    "ocp/refinement/judgement.py": {"judge"},
}
"""Functions with more parameters than that, by module."""

ARRAYS = {"array", "arange", "linspace", "geomspace", "concatenate", "tuple", "float"}
"""Functions whose results are numbers, too."""


def modules():
    return sorted(PACKAGE.rglob("*.py"))


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
        case ast.Call(func=ast.Attribute(attr=name) | ast.Name(id=name)):
            return name in ARRAYS
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
    """Whether a text follows its block of lines, or a comment is above or beside it."""
    statement = body[place]
    if "#" in lines[statement.end_lineno - 1] or lines[
        statement.lineno - 2
    ].lstrip().startswith("#"):
        return True
    for here, after in zip(body[place:], body[place + 1 :], strict=False):
        if is_text(after):
            return True
        if after.lineno != here.end_lineno + 1:
            return False
    return False


def test_every_number_with_a_name_says_what_it_is():
    silent = []
    for path in modules():
        text = path.read_text(encoding="utf-8")
        body, lines = ast.parse(text).body, text.splitlines()
        silent += [
            f"{path.relative_to(PACKAGE)}:{statement.lineno}"
            for place, statement in enumerate(body)
            if is_constant(statement) and not is_explained(body, place, lines)
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
    for path in modules():
        found = {
            node.name
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.FunctionDef)
            and len(parameters(node)) > MOST_PARAMETERS
            and not is_command(node)
        }
        if found:
            many[path.relative_to(PACKAGE).as_posix()] = found
    assert many == MANY
