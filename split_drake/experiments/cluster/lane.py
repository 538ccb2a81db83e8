"""A process that works on one item after another, beside a worker that must outlive it.

Dask's workers may have no children by `multiprocessing`, so this one is a program of its own, that
answers through a pipe and ends with its parent.
"""

import os
import pickle
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from split_drake.experiments.cluster.travel import pack, unpack

# A crash may be another program's doing, such as one that took all memory: an item gets so many
# processes before it is given up.
_TRIES = 2
_WATCH_S = 1.0
_PROGRAM = f"import sys, {__name__} as lane; lane.work(lane.Connection(int(sys.argv[1])))"


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
class Answer:
    """What became of an item.

    Attributes:
        result: packed; of what failed nothing.
        error: what it raised.
        lost: why there is neither.
        files: {place in the run's folder: content} of what it wrote.
    """

    result: bytes = b""
    error: Exception | None = None
    lost: str = ""
    files: dict[str, bytes] = field(default_factory=dict)


class Lane:
    """Works on items in a process of its own, which is started anew where one kills it.

    Args:
        assignment: what it does.
        limit_s: how long an item may take, with the start of its process; None for ever.
        died, late: what stands for the result of an item that killed its process, or took longer.
    """

    def __init__(self, assignment: Assignment, limit_s: float | None, died: str, late: str) -> None:
        self._assignment = assignment
        self._limit_s = limit_s
        self._died, self._late = died, late
        self._closed = False
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None

    def apply(self, item: bytes) -> Answer:
        """Return what becomes of a packed item; of one after `close` nothing."""
        for _ in range(_TRIES):
            if self._closed:
                break
            pipe = self._pipe or self._started()
            try:
                pipe.send_bytes(item)
                if not pipe.poll(self._limit_s):
                    self._end()
                    return Answer(lost=self._late)
                return pickle.loads(pipe.recv_bytes())
            except (EOFError, OSError):
                self._end()
        return Answer(lost=self._died)

    def _started(self) -> Connection:
        ours, theirs = Pipe()
        handle = theirs.fileno()
        self._process = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, str(handle)],
            pass_fds=(handle,),
        )
        theirs.close()
        self._pipe = ours
        ours.send((self._assignment, os.getpid()))
        return ours

    def close(self) -> None:
        """End the process for good, whatever it is at."""
        self._closed = True
        if self._process is not None:
            self._process.kill()

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None


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
    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _tried(act: Callable[[], Any]) -> tuple[Any, Exception | None]:
    try:
        return act(), None
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
    """Answer items until the other end is closed."""
    assignment, parent = pipe.recv()
    _end_with_parent(parent)
    folder = _Folder(assignment)
    apply, fault = _tried(partial(_begin, assignment))
    while True:
        try:
            item = pipe.recv_bytes()
        except EOFError:
            return
        result, error = (b"", fault) if fault is not None else _tried(partial(apply, item))
        answer = Answer(result or b"", error, files=folder.take())
        pipe.send_bytes(pickle.dumps(answer))
