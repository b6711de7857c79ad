"""``python -m showc`` and the ``showc`` command: faults become messages here.

A fault that the user can fix is one message and an exit code. A fault of our own
says so, leaves a file to report, and ends with 70 (sysexits' EX_SOFTWARE).
"""

from __future__ import annotations

import errno
import gc
import io
import os
import signal
import sys
import traceback
from contextlib import suppress
from pathlib import Path

import click

from showc._version import __version__
from showc.cli import showc
from showc.errors import ShowError, UsageError, printable
from showc.files import write_file

EXIT_INTERRUPTED, EXIT_INTERNAL = 130, 70
"""Exit codes: 128 and the number of SIGINT, as shells have it; EX_SOFTWARE of BSD."""

REPORT = Path("showc-crash.txt")
"""Where a fault of showc's own is written down."""

_EXTRAS = {"pymavlink": "link", "distributed": "cluster"}
"""Packages that are installed on demand, and by which extra."""
_OF_THE_SYSTEM = {
    errno.ENOSPC, errno.EDQUOT, errno.EIO, errno.EROFS, errno.EFBIG, errno.EMFILE,
    errno.ENFILE, errno.ENOMEM, errno.EAGAIN,
}  # fmt: skip
"""What only the owner of the system can fix: full disks, too few files or processes."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and end the process with its exit code."""
    _fill_streams()
    # One thread each: processes share the cores, and where a system gives no more
    # threads, OpenBLAS interrupts the whole process.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        # A parent that starts showc with one of them ignored means it.
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)
    code = run(sys.argv[1:] if arguments is None else arguments)
    # The process is over: a last search for cycles would free nothing anyone needs.
    gc.freeze()
    sys.exit(code)


def _fill_streams() -> None:
    """Open what a shell has closed (``>&-``): else a file of ours took its number.

    What libraries print would then go into that file.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            # The lowest number that is free is this one.
            stream = os.fdopen(os.open(os.devnull, os.O_RDWR), "r+b", buffering=0)
            setattr(sys, name, io.TextIOWrapper(stream, write_through=True))


def run(arguments: list[str]) -> int:
    """Run the command line and return its exit code; nothing escapes."""
    try:
        result = showc.main(arguments, prog_name="showc", standalone_mode=False)
    except Exception as error:  # noqa: BLE001 - the last resort for faults of our own
        return _answer(error, arguments)
    return result if isinstance(result, int) else 0


def _answer(error: Exception, arguments: list[str]) -> int:
    """Say what ended a command; return the exit code."""
    code = EXIT_INTERNAL
    match error:
        case click.exceptions.Abort():
            _say("showc: interrupted; former files are whole")
            code = EXIT_INTERRUPTED
        case click.ClickException():
            error.show()
            code = error.exit_code
        case ShowError():
            _say(
                f"{click.style('error', fg='red', bold=True)}: {printable(str(error))}"
            )
            code = error.exit_code
        case BrokenPipeError():
            sys.stderr.close()
            code = 0
        case ModuleNotFoundError() if _package(error) in _EXTRAS:
            extra = _EXTRAS[_package(error)]
            _say(
                f"error: this needs the package {_package(error)!r}, which few need: "
                f"pip install 'showc-compiler[{extra}]', or '.[{extra}]' from a clone"
            )
            code = UsageError.exit_code
        case RuntimeError() if "can't start new thread" in str(error):
            _say(
                "error: the system lets this user start no more threads; former files "
                "are whole"
            )
            code = UsageError.exit_code
        case MemoryError():
            _say("error: the memory is full; former files are whole")
            code = UsageError.exit_code
        case OSError() if error.errno in _OF_THE_SYSTEM:
            _say(f"error: {error.strerror}; former files are whole")
            code = UsageError.exit_code
        case _:
            _own_fault(arguments)
    return code


def _package(error: ModuleNotFoundError) -> str:
    """Return the package that is missing, or whose part is."""
    return (error.name or "").partition(".")[0]


def _say(text: str) -> None:
    """Say a sentence, if the system has enough left for that."""
    with suppress(OSError):
        click.echo(text, err=True)
    # What still waits to be printed cannot be, and must not end in another fault.
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()


def _own_fault(arguments: list[str]) -> None:
    report = (
        f"showc {__version__}, Python {sys.version.split()[0]}, {sys.platform}\n"
        f"arguments: {arguments}\n\n{traceback.format_exc()}"
    )
    try:
        write_file(REPORT, report.encode(errors="replace"))
        where = f"please report it with the file {str(REPORT)!r}"
    except UsageError:
        where = f"please report it:\n{report}"
    _say(f"showc: internal error, not a fault of your show; {where}")


if __name__ == "__main__":
    main()
