"""The rooms of the house, from the ground up: imports run down, without circles."""

import ast
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAX_FILES = 12
# A room may import itself and every room before it.  A folder that is not listed belongs to the
# room that it lies in.
ROOMS = (
    "models",
    "split_drake",
    "split_drake.robot",
    "split_drake.experiments",
    "split_drake.sensing",
    "split_drake.objects",
    "split_drake.objects.meshes",
    "split_drake.objects.mugs",
    "split_drake.objects.scanned",
    "split_drake.objects.procedural",
    "split_drake.objects.files",
    "split_drake.station",
    "split_drake.station.file",
    "split_drake.split",
    "split_drake.baselines",
    "split_drake.grasps",
    "split_drake.truth",
    "split_drake.data",
    "split_drake.training",
    "split_drake.baselines.learning",
    "split_drake.baselines.learning.methods",
    "split_drake.evaluation",
    "split_drake.tuning",
    "split_drake.studies",
    "planning.geometry",
    "planning",
    "planning.collision",
    "planning.motion",
    "planning.goals",
    "planning.pick_place",
    "planning.planners",
    "planning.clearing",
    "planning.execution",
    "planning.handling",
    "planning.checking",
    "scenarios.viewing",
    "scenarios.trials",
    "scenarios.trials.detectors",
    "scenarios.bench.motions",
    "scenarios.bench",
    "scenarios.study",
    "scenarios.detecting",
    "scenarios.clutter",
    "scenarios.clutter.detectors",
    "scenarios.tables",
    "scenarios.comparing",
    "scenarios.timing",
    "scenarios",
    "scenarios.making",
    "scenarios.measuring",
)
# Walls between rooms that the order alone would let through.
WALLS = {
    "planning": (
        *(
            f"split_drake.{room}"
            for room in ("truth", "grasps", "data", "split", "baselines", "training")
        ),
        *(f"split_drake.{room}" for room in ("evaluation", "tuning", "studies")),
        "split_drake.station.station",
        "split_drake.station.hand",
    ),
    "planning.handling": ("planning.pick_place", "planning.planners"),
    "planning.execution": ("planning.pick_place", "planning.planners", "planning.goals"),
    "planning.checking": (
        "planning.collision.world",
        "planning.motion",
        "planning.goals",
        "planning.pick_place",
        "planning.planners",
        "planning.execution",
        "planning.handling",
    ),
    "split_drake.evaluation": ("split_drake.training",),
}
TORCH_ROOMS = tuple(
    f"split_drake.{room}"
    for room in ("split", "baselines", "training", "evaluation", "tuning", "studies")
)


def module_name(path: Path) -> str:
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    return name.removesuffix(".__init__")


PACKAGES = ("models", "split_drake", "planning", "scenarios")
MODULES = {
    module_name(path): path for package in PACKAGES for path in (ROOT / package).rglob("*.py")
}


def imported_names(path: Path) -> set[str]:
    """All names that a file imports, wherever in the file the import stands."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def imported_modules(module: str) -> set[str]:
    """The project's modules that a module imports."""
    found = set()
    for name in imported_names(MODULES[module]):
        if name in MODULES:
            found.add(name)
        elif (parent := name.rpartition(".")[0]) in MODULES:
            found.add(parent)
    return found - {module}


def lies_in(module: str, room: str) -> bool:
    return module == room or module.startswith(room + ".")


def room_of(module: str) -> str:
    return max((room for room in ROOMS if lies_in(module, room)), key=len)


def test_imports_run_down() -> None:
    floors = {room: number for number, room in enumerate(ROOMS)}
    upward = [
        f"{module} imports {name}"
        for module in sorted(MODULES)
        for name in sorted(imported_modules(module))
        if floors[room_of(name)] > floors[room_of(module)]
    ]
    assert upward == []


def test_no_circle_of_files() -> None:
    try:
        TopologicalSorter({name: imported_modules(name) for name in MODULES}).prepare()
    except CycleError as error:
        pytest.fail(f"files import each other in a circle: {' -> '.join(error.args[1])}")


@pytest.mark.parametrize("room", WALLS)
def test_walls_hold(room: str) -> None:
    through = [
        f"{module} imports {name}"
        for module in sorted(MODULES)
        if lies_in(module, room)
        for name in sorted(imported_modules(module))
        if any(lies_in(name, other) for other in WALLS[room])
    ]
    assert through == []


def test_rooms_are_small_and_say_what_they_are() -> None:
    folders = {path.parent for path in MODULES.values()}
    counts = {str(folder.relative_to(ROOT)): len(list(folder.glob("*.py"))) for folder in folders}
    assert {name: count for name, count in counts.items() if count > MAX_FILES} == {}
    for folder in folders:
        statements = ast.parse((folder / "__init__.py").read_text())
        assert ast.get_docstring(statements), f"{folder}/__init__.py does not say what the room is"


def test_no_room_is_listed_that_is_not_there() -> None:
    assert [room for room in ROOMS if room not in MODULES] == []


def test_torch_stays_inside_the_model() -> None:
    outside = [
        module
        for module, path in MODULES.items()
        if any(lies_in(name, "torch") for name in imported_names(path))
        and not any(lies_in(module, room) for room in TORCH_ROOMS)
    ]
    assert outside == []


@pytest.mark.parametrize(
    ("room", "absent"), [("planning", ("torch",)), ("split_drake", ("torch", "pydrake"))]
)
def test_importing_loads_nothing_heavy(room: str, absent: tuple[str, ...]) -> None:
    names = [name for name in MODULES if lies_in(name, room)] if room == "planning" else [room]
    program = (
        f"import sys, importlib; [importlib.import_module(n) for n in {names}];"
        f"print([n for n in {absent} if n in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "[]"
