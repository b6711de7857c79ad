"""A virtual environment for each peer, made on demand: their pins clash."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HOME = ROOT / ".venv" / "bench"


class InstallationError(Exception):
    """A peer cannot be installed here; the text is the reason."""


@dataclass(frozen=True, slots=True)
class Peer:
    """A Python package for optimal control that is measured beside showc."""

    name: str
    package: str
    version: str
    licence: str
    steps: tuple[tuple[str, ...], ...]
    """Arguments of ``pip install``, one call each."""
    method: str
    """What it does, in a line."""
    ipopt_from_casadi: bool = False
    """Whether its last step compiles against the IPOPT in the CasADi wheel."""


PEERS = (
    Peer(
        "maptor", "maptor", "0.2.1", "LGPL-3.0",
        (("maptor==0.2.1",),),
        "Radau, refined by itself (Haman, Rao 2024) to 1e-6 from 10 x 4",
    ),
    Peer(
        "pockit", "pockit-optimal-control", "0.1.1", "MIT",
        (
            ("pockit-optimal-control==0.1.1", "casadi==3.7.2", "setuptools", "wheel"),
            ("cyipopt==1.7.0",),
        ),
        "Radau, refined to 1e-6 from 10 x 6 in a loop of the user's; knows which "
        "controls are bang-bang; compiles each problem",
        ipopt_from_casadi=True,
    ),
    Peer(
        "yapss", "yapss", "0.2.3", "MIT",
        (("yapss==0.2.3",),),
        "Radau, fixed mesh 10 x 6, no refinement",
    ),
    Peer(
        "mpopt", "mpopt", "0.2.2", "LGPL-3.0",
        (
            ("numpy==1.26.4", "casadi==3.6.5", "scipy<1.14", "matplotlib<3.9"),
            ("--no-deps", "mpopt==0.2.2"),
        ),
        "Radau, widths of 10 x 6 adapted to a residual of 1e-4",
    ),
    Peer(
        "rockit", "rockit-meco", "0.6.7", "LGPL-3.0",
        (("rockit-meco==0.6.7",),),
        "Radau, fixed mesh 40 x 4, controls constant on each interval",
    ),
)  # fmt: skip


def python_of(peer: Peer) -> Path:
    """Interpreter of the peer's environment."""
    return HOME / peer.name / "bin" / "python"


def prepare(peer: Peer) -> Path:
    """Make the peer's environment unless it is there; return its interpreter.

    Raises
    ------
    InstallationError
        If pip cannot install it; with pip's own reason.
    """
    folder = HOME / peer.name
    mark = folder / ".installed"
    wanted = hashlib.sha256(repr(peer.steps).encode()).hexdigest()
    python = python_of(peer)
    if mark.exists() and mark.read_text() == wanted and python.exists():
        return python
    if not python.exists():
        venv.create(folder, with_pip=True)
    environment = dict(os.environ)
    for step in peer.steps:
        if peer.ipopt_from_casadi and step is peer.steps[-1]:
            environment["PKG_CONFIG_PATH"] = str(_describe_ipopt(folder))
        command = [
            str(python), "-m", "pip", "install", "--quiet",
            "--disable-pip-version-check", *step,
        ]  # fmt: skip
        run = subprocess.run(
            command, capture_output=True, text=True, env=environment, check=False
        )
        if run.returncode != 0:
            reasons = [line for line in run.stderr.splitlines() if "ERROR" in line]
            reason = reasons[-1] if reasons else "pip failed without a reason"
            raise InstallationError(f"pip install {' '.join(step)}: {reason}")
    mark.write_text(wanted)
    return python


def _describe_ipopt(folder: Path) -> Path:
    """Write the pkg-config file that leads to the IPOPT of the CasADi wheel."""
    found = sorted(folder.glob("lib/python*/site-packages/casadi/libipopt.so"))
    if not found:
        raise InstallationError("no libipopt.so in the CasADi wheel of this platform")
    library = found[0].parent
    target = folder / "pkgconfig"
    target.mkdir(exist_ok=True)
    (target / "ipopt.pc").write_text(
        "Name: ipopt\nDescription: IPOPT of the CasADi wheel\nVersion: 3.14.11\n"
        f"Libs: -L{library} -lipopt\nCflags: -I{library}/include/coin-or\n"
    )
    return target


def showc_python() -> Path:
    """Interpreter that runs showc: this one."""
    return Path(sys.executable)
