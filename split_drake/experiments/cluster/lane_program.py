"""What a lane's process does: it answers items through a pipe until it is told no more."""

import ctypes
import os
import pickle
import signal
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from split_drake.experiments.cluster.travel import pack, unpack
from split_drake.experiments.provenance import processor

_WATCH_S = 1.0
# A process that has had no work for so long ends: a command that was killed told nobody.
IDLE_S = 900.0
_SET_PARENT_DEATH_SIGNAL = 1  # of Linux's prctl


@dataclass(frozen=True)
class Assignment:
    """What a process is to do.

    Attributes:
        function: of an item, packed with what is called before the first one, or None.
        run: folder that stands for the run's.
        files: folder that packed files lie in.
        kept: entries of the run's folder that are read again, and stay there.
    """

    function: bytes
    run: Path
    files: Path
    kept: tuple[str, ...]


@dataclass(frozen=True)
class Connected:
    """The first thing that a process is told: what it is to do, and whose child it is."""

    assignment: Assignment
    parent: int


@dataclass(frozen=True)
class Answer:
    """What became of an item.

    Attributes:
        result: packed; of what failed nothing.
        error: what it raised.
        lost: why there is neither.
        files: {place in the run's folder: content} of what it wrote.
        processor: that it was worked on.
    """

    result: bytes = b""
    error: Exception | None = None
    lost: str = ""
    files: dict[str, bytes] = field(default_factory=dict)
    processor: str = ""


class _Folder:
    """The folder that stands for the run's, and what was written there."""

    def __init__(self, assignment: Assignment) -> None:
        self._run, self._kept = assignment.run, assignment.kept
        self._sent = self._found()

    def _found(self) -> dict[Path, tuple[int, int]]:
        files = (path for path in self._run.rglob("*") if path.is_file())
        return {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in files}

    def take(self) -> dict[str, bytes]:
        """Return what is new, and remove it unless it is to be read again."""
        found, taken = self._found(), {}
        for path, state in found.items():
            place = path.relative_to(self._run)
            if self._sent.get(path) != state:
                taken[str(place)] = path.read_bytes()
                if place.parts[0] not in self._kept:
                    path.unlink()
        self._sent = found
        return taken


def _end_with_parent(parent: int) -> None:
    """End this process once its parent is gone, also where native code holds the interpreter."""
    with suppress(OSError, AttributeError):  # no Linux: the thread below is all there is
        ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _tried(act: Callable[[], Any]) -> tuple[Any, Exception | None]:
    """Return what a function returns, or an error that can travel."""
    try:
        return act(), None
    except SystemExit as end:
        return None, RuntimeError(str(end))
    except Exception as error:
        error.add_note("on a worker:\n" + traceback.format_exc())
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            return None, RuntimeError("".join(traceback.format_exception(error)))
        return None, error


def _begin(assignment: Assignment) -> Callable[[bytes], bytes]:
    """Return what makes a packed result of a packed item."""
    run, files = assignment.run, assignment.files
    function, start_worker = unpack(assignment.function, run, files)
    if start_worker is not None:
        start_worker()
    return lambda item: pack(function(unpack(item, run, files)), run)


def work(pipe: Connection) -> None:
    """Answer items until the other end is closed, or there are none for long."""
    connected: Connected = pipe.recv()
    _end_with_parent(connected.parent)
    folder, name = _Folder(connected.assignment), processor()
    apply, fault = _tried(partial(_begin, connected.assignment))
    while pipe.poll(IDLE_S):
        try:
            item = pipe.recv_bytes()
        except EOFError:
            return
        result, error = (None, fault) if fault is not None else _tried(partial(apply, item))
        files, unread = _tried(folder.take)
        answer = Answer(result or b"", error or unread, files=files or {}, processor=name)
        pipe.send_bytes(pickle.dumps(answer))


def serve(handle: int) -> None:
    """Work at the pipe of that handle."""
    work(Connection(handle))
