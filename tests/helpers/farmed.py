"""Items for workers, by functions that other processes find under this module's name."""

import os
import time
from pathlib import Path

from distributed import Worker

from split_drake.experiments.cluster.plugin import RunPlugin

# A test's worker says here that it began.
BEGAN: list[int] = []


def square(item: int) -> int:
    time.sleep(0.04)
    return item * item


def slow_square(item: int) -> int:
    time.sleep(0.5)
    return item * item


def troubled(item: int) -> int:
    """Crash, take for ever, or raise, by the item's number."""
    if item == 1:
        os._exit(1)
    if item == 2:
        time.sleep(600.0)
    if item == 3:
        raise ValueError("three is no item")
    return item


def crashed(item: int, reason: str) -> str:
    return f"{item}: {reason}"


def begin() -> None:
    BEGAN.append(os.getpid())


def began(_item: int) -> tuple[int, int]:
    return os.getpid(), len(BEGAN)


def read_and_write(item: tuple[Path, Path]) -> tuple[str, str]:
    """Write what a file says into the run's folder; return what was read, and the file's path."""
    source, run = item
    text = source.read_text() if source.is_file() else "/".join(_names(source))
    (run / "written").mkdir(exist_ok=True)
    (run / "written" / f"{source.name}.txt").write_text(text)
    (run / "kept").mkdir(exist_ok=True)
    before = "".join(sorted(_names(run / "kept")))
    (run / "kept" / source.name).write_text("kept")
    return before, str(source)


class PluginWithoutRoom(RunPlugin):
    """A run's plugin on a worker whose disk is full."""

    def setup(self, worker: Worker) -> None:
        self._contents = {"a" * 300: b""}  # no file system takes such a name
        super().setup(worker)
        self._fault = self._fault.replace("File name too long", "no room")


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())
