"""Files added to a room for one test."""

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from planning import planner, subgoal
from planning.checking import goal_checks


@contextmanager
def added_files(folder: Path, room: str, files: dict[str, str]) -> Iterator[None]:
    """Have files {name: code} lie in a room, such as "planning.goals", as if they were saved there.

    They are written to `folder`, which is listed after the room's own.
    """
    package = importlib.import_module(room)
    planner.planner_names()  # so that the room's own stay registered
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(package, "__path__", [*package.__path__, str(folder)])
        patch.setattr(planner, "_FACTORIES", dict(planner._FACTORIES))
        for name, code in files.items():
            (folder / f"{name}.py").write_text(code)
            patch.setattr(package, name, None, raising=False)
            # Noted as not there before, so that it is taken out again.
            patch.setitem(sys.modules, f"{room}.{name}", sys)
            del sys.modules[f"{room}.{name}"]
        importlib.invalidate_caches()
        _forget()
        try:
            yield
        finally:
            _forget()


def _forget() -> None:
    """Have the rooms listed again."""
    subgoal._in_room.cache_clear()
    goal_checks.checks_in_files.cache_clear()
