"""Imports run one way: scenarios, planning, split_drake; and torch stays inside the model."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TORCH_PACKAGES = ("split_drake.split", "split_drake.training", "split_drake.baselines")


def modules(package: str) -> list[Path]:
    found = sorted((ROOT / package).rglob("*.py"))
    assert found
    return found


def imported_names(path: Path) -> set[str]:
    """All modules that a file imports, wherever in the file the import stands."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def offenders(package: str, *forbidden: str) -> list[str]:
    return [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in modules(package)
        for name in sorted(imported_names(path))
        if any(name == item or name.startswith(item + ".") for item in forbidden)
    ]


def test_split_drake_imports_nothing_above_it() -> None:
    assert offenders("split_drake", "planning", "scenarios", "tests") == []


def test_planning_sees_neither_the_model_nor_the_truth() -> None:
    forbidden = ("scenarios", "tests", "torch", "split_drake.oracle", "split_drake.data")
    assert offenders("planning", *forbidden, *TORCH_PACKAGES) == []


def test_torch_stays_inside_the_model() -> None:
    outside = [
        line
        for line in offenders("split_drake", "torch")
        if not line.startswith(tuple(name.replace(".", "/") for name in TORCH_PACKAGES))
    ]
    assert outside == []


@pytest.mark.parametrize(
    ("package", "absent"), [("planning", ("torch",)), ("split_drake", ("torch", "pydrake"))]
)
def test_importing_loads_nothing_heavy(package: str, absent: tuple[str, ...]) -> None:
    names = [package]
    if package == "planning":
        names += [f"planning.{path.stem}" for path in modules(package) if path.stem != "__init__"]
    program = (
        f"import sys, importlib; [importlib.import_module(n) for n in {names}];"
        f"print([n for n in {absent} if n in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "[]"
