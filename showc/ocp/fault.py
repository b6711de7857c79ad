"""Faults in the statement of a problem, with the user's own line."""

from __future__ import annotations

import sys
from math import isfinite, isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi

if TYPE_CHECKING:
    from collections.abc import Iterable

_HOME = str(Path(__file__).parent)


class StatementError(ValueError):
    """A problem, guess or option that is not stated right.

    The message begins with the file and line of the call that is at fault.
    """

    def __init__(self, words: str, line: str = "") -> None:
        super().__init__(f"{line or users_line()}: {words}")


def users_line() -> str:
    """File and line of the innermost call from outside the core."""
    frame = sys._getframe()  # noqa: SLF001 - the one way to the caller's line
    own = _HOME, "<string>"
    # What dataclasses generate has no file.
    while frame.f_back is not None and frame.f_code.co_filename.startswith(own):
        frame = frame.f_back
    return f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"


def scalar(value: object, what: str) -> Any:  # noqa: ANN401 - a CasADi expression
    """Return ``value`` as a scalar CasADi ``SX``.

    Raises
    ------
    StatementError
        If it is no number and no scalar expression of ``SX`` symbols.
    """
    if isinstance(value, casadi.MX):
        raise StatementError(
            f"{what} is a CasADi MX; write it with the SX symbols that state(), "
            "control() and parameter() return"
        )
    try:
        expression = casadi.SX(value)  # type: ignore[call-overload]
    except (NotImplementedError, TypeError, ValueError, RuntimeError):
        kind = type(value).__name__
        raise StatementError(
            f"{what} is of type {kind}; wanted a number or a scalar expression"
        ) from None
    if expression.shape != (1, 1):
        rows, columns = expression.shape
        raise StatementError(
            f"{what} has the shape {rows} x {columns}; wanted a scalar, so state it "
            "element by element"
        )
    if expression.is_constant() and isnan(float(expression)):
        raise StatementError(
            f"{what} is not a number (of a symbol, Python's own functions give none: "
            "casadi.sin, not math.sin)"
        )
    return expression


_COMPARISONS = frozenset(
    {casadi.OP_LT, casadi.OP_LE, casadi.OP_EQ, casadi.OP_NE, casadi.OP_AND}
)


def limited(value: object, what: str) -> Any:  # noqa: ANN401 - a CasADi expression
    """Return what is to be kept within bounds, as :func:`scalar` does.

    Raises
    ------
    StatementError
        If it is no scalar, or a comparison: that is 1 or 0, whatever its bounds.
    """
    expression = scalar(value, what)
    if expression.op() in _COMPARISONS:
        raise StatementError(
            f"{what} is a comparison ({expression}); give what is compared, and its "
            "lower or upper bound"
        )
    return expression


def check_name(name: object, what: str, taken: Iterable[str] = ()) -> None:
    """Raise where ``name`` is no new name; ``what``: whose, with an article."""
    if not isinstance(name, str) or not name or "." in name:
        raise StatementError(
            f"the name of {what} is {name!r}; wanted a text without a dot"
        )
    if name in taken:
        raise StatementError(
            f"{name!r} is the name of two quantities; {what} needs one"
        )


def check_scale(scale: object, what: str) -> None:
    """Raise where a typical magnitude is none."""
    if scale is None:
        return
    if not isinstance(scale, (int, float)) or not isfinite(scale) or scale <= 0.0:
        raise StatementError(f"the scale of {what} is {scale!r}; wanted above 0")


def check_type(value: object, wanted: type, what: str) -> None:
    """Raise where ``value`` is given and not of the type ``wanted``."""
    if value is not None and not isinstance(value, wanted):
        raise StatementError(
            f"{what} is of type {type(value).__name__}; wanted ocp.{wanted.__name__}"
        )


def check_number(value: object, what: str) -> float:
    """Return ``value`` as a finite number.

    Raises
    ------
    StatementError
        If it is none.
    """
    expression = scalar(value, what)
    if not expression.is_constant() or not isfinite(float(expression)):
        raise StatementError(f"{what} is {value}; wanted a finite number")
    return float(expression)


def check_known(given: Iterable[str], known: Iterable[str], what: str) -> None:
    """Raise where a name of ``given`` is not among the ``known`` ones."""
    names = list(dict.fromkeys(known))
    unknown = sorted(set(given) - set(names))
    if unknown:
        raise StatementError(
            f"{what} names {', '.join(map(repr, unknown))}; there is "
            f"{', '.join(names) or 'nothing of the kind'}"
        )
