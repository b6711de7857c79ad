"""Data flows one way, and what must be light is light."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "showc"

# What each part may import, besides itself and third-party libraries.
FOUNDATION = {"errors", "_version", "files", "processes", "progress", "trajectory"}
MAY_IMPORT = {
    "_version": set(),
    "arrays": set(),
    "codes": set(),
    "errors": set(),
    "files": {"errors"},
    "processes": set(),
    "progress": set(),
    "trajectory": set(),
    "documents": {"errors", "files"},
    "vehicle": FOUNDATION,
    "script": FOUNDATION | {"codes", "vehicle", "documents"},
    "plan": FOUNDATION | {"vehicle", "script"},
    "flight": FOUNDATION | {"vehicle", "script", "plan"},
    "ocp": FOUNDATION,
    "fleet": FOUNDATION | {"vehicle", "script", "plan", "flight", "ocp"},
    "light": FOUNDATION | {"vehicle", "script", "plan", "flight"},
    "log": FOUNDATION | {"vehicle", "script", "plan", "flight", "light", "documents"},
    "geodesy": {"script"},
    "autopilot": FOUNDATION | {"vehicle", "script", "geodesy"},
    "schedule": FOUNDATION
    | {"vehicle", "script", "plan", "flight", "geodesy", "autopilot"},
    "mission": FOUNDATION
    | {"vehicle", "script", "plan", "flight", "light", "geodesy", "autopilot"}
    | {"schedule", "log.facts"},
    # Which rows a mission may have is known to the verification; nothing else of it.
    "vehicle_link": FOUNDATION
    | {"vehicle", "script", "plan", "flight", "light", "log", "mission", "view"}
    | {"geodesy", "autopilot", "safety"}
    | {"verify.missions.language"},
    # Where drones may fall is judged without the planner, and without the verifier.
    "safety": FOUNDATION | {"codes", "vehicle", "script", "log"},
    "abort": FOUNDATION
    | {"vehicle", "script", "plan", "flight", "fleet", "log", "safety"},
    "simulate": FOUNDATION | {"vehicle", "script", "log", "ocp"},
    "view": FOUNDATION
    | {"vehicle", "script.show", "flight", "log", "ocp", "safety", "foreign"}
    | {"simulate.results"},
    "preview": FOUNDATION
    | {"vehicle", "script", "plan", "flight", "fleet", "light", "log.sampling", "view"},
    "pipeline": FOUNDATION
    | {"vehicle", "script", "plan", "flight", "fleet", "light", "log", "mission"},
    # Most of it imports less: see the rooms of verify.
    "verify": {
        "codes",
        "documents",
        "errors",
        "_version",
        "files",
        "processes",
        "progress",
        "script",
        "vehicle",
    }
    | {"light", "log.showc_pb2", "log.scene", "log.facts", "log.sample", "log.schema"}
    | {"log.container", "log.records"},
    "foreign": {"errors", "_version", "files", "processes", "documents"}
    # The parameters beside a show file are those of the preset, and compared.
    | {"log.showc_pb2", "verify", "light", "vehicle.presets"},
    "export": FOUNDATION
    | {"documents", "script", "light", "log", "geodesy", "verify", "foreign"}
    | {"vehicle", "safety"},
}

# What the rooms of verify may import besides its own reports. The room that reads the
# script is the only one that sees the reader of scripts; what a viewer shows is drawn
# again by what drew it, and compared; the layouts of samples are the log's.
ROOMS_OF_VERIFY = {
    "verify/kernel": {"verify.kernel", "log.showc_pb2"},
    "verify/specification": {"verify", "documents", "files", "script", "vehicle"}
    | {"light", "log.showc_pb2", "log.facts", "log.schema", "log.container"},
    # What missions must be follows from the script, and so do their lights.
    "verify/missions": {"verify", "codes", "documents", "errors", "files"}
    | {"script", "light", "log.showc_pb2", "log.container", "log.facts", "log.schema"},
    "verify/samples.py": {"verify", "documents", "script", "light"}
    | {"log.scene", "log.sample", "log.schema", "log.container"},
    "verify": {
        "verify",
        "codes",
        "documents",
        "errors",
        "_version",
        "files",
        "processes",
        "progress",
    }
    | {"script.show", "log.showc_pb2", "log.schema", "log.container", "log.records"}
    | {"log.facts"},
}

# What the folders of a room may import of each other, besides what lies beside them:
# the statement of problems and solutions in the core, the leg's stages in the fleet,
# the show and its findings in the script. The key table holds the formations' keys.
ONE_DRONE = {"single_drone", "shared_profile"}
LAYERS = {
    "ocp": {
        "transcription": set(),
        "audit": {"transcription"},
        "refinement": {"transcription", "audit"},
    },
    "fleet": {
        "execution": set(),
        "single_drone": ONE_DRONE,
        "shared_profile": ONE_DRONE,
        "lower_bound": ONE_DRONE | {"execution"},
        "deconfliction": ONE_DRONE | {"execution"},
    },
    "script": {
        "language": {"formations"},
        "formations": {"language"},
        "sections": {"language", "formations"},
        "rules": {"language", "formations", "sections"},
        "render": set(),
    },
}


@cache
def imports(path):
    """Modules of showc that a file imports, as dotted names without the package."""
    package = path.relative_to(PACKAGE.parent).parts[:-1]
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(
                package[: len(package) - node.level + 1] if node.level else ()
            )
            module = ".".join(part for part in (base, node.module) if part)
            names = [f"{module}.{alias.name}" for alias in node.names]
        else:
            continue
        # Names of arrays are vocabulary, open to every room.
        found += [
            name.removeprefix("showc.")
            for name in names
            if name.startswith("showc.") and not name.startswith("showc.arrays.")
        ]
    return found


def allowed(name, part):
    if name.split(".")[0] == part or name == "__version__":
        return True
    return any(
        name == other or name.startswith(f"{other}.") for other in MAY_IMPORT[part]
    )


@pytest.mark.parametrize("part", MAY_IMPORT)
def test_imports_follow_the_data(part):
    folder = PACKAGE / part
    files = list(folder.rglob("*.py")) if folder.is_dir() else [PACKAGE / f"{part}.py"]
    assert files
    against = [
        f"{path.relative_to(PACKAGE.parent)} imports showc.{name}"
        for path in files
        if not path.name.endswith("_pb2.py")
        for name in imports(path)
        if not allowed(name, part)
    ]
    assert against == []


def test_every_part_has_a_rule():
    parts = {
        path.stem if path.is_file() else path.name
        for path in PACKAGE.iterdir()
        if path.suffix == ".py" or (path.is_dir() and (path / "__init__.py").exists())
    }
    assert parts - set(MAY_IMPORT) <= {"__init__", "__main__", "cli", "api"}


def folders_used(path, room):
    """Folders of a room from which a file imports."""
    names = {name.split(".")[1] for name in imports(path) if name.startswith(room)}
    return names & set(LAYERS[room])


@pytest.mark.parametrize("room", LAYERS)
def test_rooms_are_built_in_layers(room):
    assert [
        path.name
        for part, below in LAYERS[room].items()
        for path in (PACKAGE / room / part).rglob("*.py")
        if folders_used(path, room) - below - {part}
    ] == []


def test_the_statement_of_problems_and_solutions_needs_no_part_of_the_core():
    files = set((PACKAGE / "ocp").glob("*.py")) - {PACKAGE / "ocp" / "__init__.py"}
    assert files
    assert [path.name for path in files if folders_used(path, "ocp")] == []


@pytest.mark.parametrize("room", LAYERS)
def test_every_folder_of_a_room_in_layers_has_a_rule(room):
    folders = {path.parent.name for path in (PACKAGE / room).glob("*/__init__.py")}
    assert folders == set(LAYERS[room])


def loaded(statement):
    """Modules in memory after a statement, in a fresh interpreter."""
    code = f"import sys\n{statement}\nprint('\\n'.join(sys.modules))"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    return set(run.stdout.split())


def test_public_names_of_the_core_are_where_it_says():
    from showc import ocp

    assert all(getattr(ocp, name) is not None for name in ocp.__all__)
    assert set(dir(ocp)) == set(ocp.__all__)


def test_solving_a_few_drones_does_without_all_of_scipy():
    statement = (
        "import showc.fleet.itinerary, showc.ocp.transcription.condensed.transcription,"
        " showc.fleet.lower_bound.relaxed_move, showc.fleet.single_drone.common_time"
    )
    assert "scipy" not in loaded(statement)


@pytest.mark.parametrize(
    "statement",
    [
        "import showc.__main__",
        "from showc.__main__ import run; run(['--help'])",
        "from showc.__main__ import run; run(['check', 'shows/grid.yaml'])",
    ],
)
def test_start_up_is_light(statement):
    heavy = {"casadi", "highspy", "lap", "scipy", "rich.progress", "pymavlink", "mcap"}
    heavy |= {"http.server"}
    assert loaded(statement) & heavy == set()


def test_verify_reads_no_exports_where_a_script_asks_for_none(compiled):
    log = str(compiled("lanes"))
    modules = loaded(f"from showc.__main__ import run; run(['verify', {log!r}, '-q'])")
    assert "showc.verify.proofs" in modules
    assert modules & {"showc.export.beside", "scipy.spatial"} == set()


def room_of(path):
    """The first room of verify that a file belongs to."""
    name = path.relative_to(PACKAGE).as_posix()
    return next(room for room in ROOMS_OF_VERIFY if name.startswith(room))


def test_rooms_of_verify_import_what_they_need_alone():
    against = [
        f"{path.relative_to(PACKAGE)} imports showc.{name}"
        for path in (PACKAGE / "verify").rglob("*.py")
        for name in imports(path)
        if not any(
            name == other or name.startswith(f"{other}.")
            for other in ROOMS_OF_VERIFY[room_of(path)]
        )
    ]
    assert against == []


def test_verify_shares_no_code_with_the_planner():
    ours = loaded("import showc.verify.proofs")
    planner = ("plan", "ocp", "fleet", "flight", "autopilot", "schedule", "mission")
    planner += ("pipeline", "view")
    writers = ("log.writer", "log.reader", "log.chunks", "log.content")
    assert {
        name
        for name in ours
        for part in (*planner, *writers)
        if name == f"showc.{part}" or name.startswith(f"showc.{part}.")
    } == set()


def test_the_map_of_rooms_has_all_of_them():
    guide = (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert {room for room in rooms if f"`showc/{room}`" not in guide} == set()


def test_a_module_is_one_noun_of_500_lines_at_most():
    written = (path for path in PACKAGE.rglob("*.py") if not path.stem.endswith("_pb2"))
    sizes = {
        path.relative_to(PACKAGE): len(path.read_text(encoding="utf-8").splitlines())
        for path in written
    }
    assert {path: size for path, size in sizes.items() if size > 500} == {}
