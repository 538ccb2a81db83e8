"""What is installed is whole: a built wheel holds every module, and the data that they read."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("models", "split_drake", "planning", "scenarios")
IMPORT_ALL = """
import importlib, pkgutil, sys
sys.path.insert(0, sys.argv[1])
for name in sys.argv[2:]:
    package = importlib.import_module(name)
    for module in pkgutil.walk_packages(package.__path__, name + "."):
        found = importlib.import_module(module.name)
        assert found.__spec__.origin is None or found.__spec__.origin.startswith(sys.argv[1]), found
from planning.planner import planner_names
from planning.subgoal import subgoals
from split_drake.split.checkpoint import default_weights, load_checkpoint
from split_drake.objects.mugs.split import load_mug
load_checkpoint(default_weights())
load_mug("test_000")
from planning.checking.goal_checks import checks_in_files
print(*planner_names())
print(*subgoals())
print(*checks_in_files())
"""


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    # Built of a copy of what git would ship, so that nothing is left in the checkout.
    source = folder / "source"
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    files = subprocess.run(listed, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    for name in filter(None, files.split("\0")):
        if name.startswith("tests/") or not (ROOT / name).is_file():
            continue
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_bytes((ROOT / name).read_bytes())
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "-q"]
    built = subprocess.run(
        [*command, "-w", str(folder), str(source)], capture_output=True, text=True, check=True
    )
    assert "is absent from" not in built.stderr, "setuptools found a folder that is not shipped"
    (wheel,) = folder.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(folder / "unpacked")
    return folder / "unpacked"


def test_everything_is_imported_from_the_wheel(unpacked: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-P", "-c", IMPORT_ALL, str(unpacked), *PACKAGES]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    planners, goals, checks = (set(line.split()) for line in run.stdout.splitlines())
    assert {"default", "gcs", "rrt"} <= planners
    assert {"hang", "reorient"} <= goals
    assert {"hang", "reorient"} <= checks
