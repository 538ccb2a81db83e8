"""A process that works on one item after another, beside a worker that must outlive it.

Dask's workers may have no children by `multiprocessing`, so this one is a program of its own, that
answers through a pipe and ends with its parent.
"""

import os
import subprocess
import sys
import threading
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from pickle import loads

from split_drake.experiments.allocator import allocator_environment
from split_drake.experiments.cluster.lane_program import Answer, Assignment, Connected

# A crash may be another program's doing, such as one that took all memory: an item gets so many
# processes before it is given up.
_TRIES = 2
# A pipe waits no longer than C's int of milliseconds.
_LONGEST_S = 2e6
_END_S = 10.0
# What is run in the process; the pipe's handle follows.
_PROGRAM = "import sys; from {} import serve; serve(int(sys.argv[1]))"
_ROOT = Path(__file__).parents[3]


class LaneClosedError(Exception):
    """A lane was closed before it could answer."""


class Lane:
    """Works on items in a process of its own, which is started anew where one kills it.

    Args:
        assignment: what it does.
        limit_s: how long an item may take, with the start of its process; None for ever.
        died, late: what stands for the result of an item that killed its process, or took longer.
    """

    def __init__(self, assignment: Assignment, limit_s: float | None, died: str, late: str) -> None:
        self._assignment = assignment
        self._limit_s = None if limit_s is None else min(limit_s, _LONGEST_S)
        self._died, self._late = died, late
        self._guard = threading.Lock()
        self._closed = False
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None

    def apply(self, item: bytes) -> Answer:
        """Return what becomes of a packed item.

        Raises LaneClosedError where the lane is closed, before or meanwhile.
        """
        for _ in range(_TRIES):
            pipe = self._ready()
            try:
                pipe.send_bytes(item)
                if not pipe.poll(self._limit_s):
                    self._end()
                    return self._unless_closed(Answer(lost=self._late))
                answer: Answer = loads(pipe.recv_bytes())
                return answer
            except (EOFError, OSError):
                self._end()
        return self._unless_closed(Answer(lost=self._died))

    def _unless_closed(self, answer: Answer) -> Answer:
        if self._closed:
            raise LaneClosedError
        return answer

    def _ready(self) -> Connection:
        """Return the pipe to a process that lives; one may have ended because it had no work."""
        with self._guard:
            if self._closed:
                raise LaneClosedError
            if self._process is not None and self._process.poll() is not None:
                self._forget()
            return self._pipe or self._started()

    def _started(self) -> Connection:
        ours, theirs = Pipe()
        handle, here = theirs.fileno(), self._assignment.run.parent
        paths = [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        self._process = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM.format(Connected.__module__), str(handle)],
            pass_fds=(handle,),
            # What is kept relative to the current folder goes with the worker's own.
            cwd=here,
            env={
                **os.environ,
                **allocator_environment(),
                "PYTHONPATH": os.pathsep.join(paths),
            },
        )
        theirs.close()
        self._pipe = ours
        ours.send(Connected(self._assignment, os.getpid()))
        return ours

    def close(self) -> None:
        """End the process for good, whatever it is at."""
        with self._guard:
            self._closed = True
            if self._process is not None:
                self._process.kill()
                self._process.wait(_END_S)

    def _end(self) -> None:
        with self._guard:
            if self._process is not None:
                self._process.kill()
                self._process.wait(_END_S)
            self._forget()

    def _forget(self) -> None:
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None
