"""What a Dask worker keeps of a run: its files, its function, and a process for each thread."""

import shutil
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from distributed import Worker, WorkerPlugin, get_worker

from split_drake.experiments.cluster.lane import Lane, LaneClosedError
from split_drake.experiments.cluster.lane_program import Answer, Assignment
from split_drake.experiments.cluster.travel import write_files
from split_drake.experiments.provenance import (
    code_sha256,
    combined_sha256,
    file_sha256,
    package_versions,
)
from split_drake.models_folder import MODELS_FOLDER


class OtherWorkerError(Exception):
    """A worker has other code or other packages than the run."""


class UnpreparedWorkerError(Exception):
    """A worker knows nothing of the run: its scheduler forgot it."""


class BrokenWorkerError(Exception):
    """A worker's machine lacks memory, room or processes for an item."""


@dataclass(frozen=True)
class Code:
    """What outcomes depend on.

    Attributes:
        sha256: of the project's code.
        weights: of those that ship with it.
        versions: of the packages.
    """

    sha256: str
    weights: str
    versions: dict[str, str]

    @classmethod
    def here(cls) -> "Code":
        """Return that of this process."""
        weights = sorted((MODELS_FOLDER / "weights").glob("*.safetensors"))
        sha256 = combined_sha256({path.name: file_sha256(path) for path in weights})
        return cls(code_sha256(), sha256, package_versions())

    def difference(self, other: "Code") -> str:
        """Return what is different, in words; nothing where nothing is."""
        if self.sha256 != other.sha256:
            return f"code {other.sha256[:12]}, expected {self.sha256[:12]}"
        if self.weights != other.weights:
            return f"weights {other.weights[:12]}, expected {self.weights[:12]}"
        found = [
            f"{name} {other.versions.get(name)}, expected {version}"
            for name, version in self.versions.items()
            if other.versions.get(name) != version
        ]
        return "; ".join(found)


class RunPlugin(WorkerPlugin):
    """Prepares each worker of a cluster for a run, also those that join later.

    Args:
        name: of the run among those of the scheduler.
        function: packed, see `Assignment`.
        contents: {place: content} of the files that items name.
        kept: see `Assignment`.
        before: {place in the run's folder: content} of what was there before.
        limit_s, died, late: see `Lane`.
        code: that the run has.
    """

    def __init__(
        self,
        name: str,
        function: bytes,
        contents: dict[str, bytes],
        kept: tuple[str, ...],
        before: dict[str, bytes],
        limit_s: float | None,
        died: str,
        late: str,
        code: Code,
    ) -> None:
        self.name = name
        self._function, self._contents = function, contents
        self._kept, self._before = kept, before
        self._limit_s, self._died, self._late = limit_s, died, late
        self._code = code

    def setup(self, worker: Worker) -> None:
        self._address = worker.address
        self._folder: Path | None = None
        self._lanes: dict[int, Lane] = {}
        self._guard = threading.Lock()
        self._ended = False
        # Dask keeps a plugin whose setup fails: what went wrong is told to whoever asks for work.
        try:
            self._fault = self._code.difference(Code.here())
            self._folder = Path(tempfile.mkdtemp(prefix="split-", dir=worker.local_directory))
            write_files(self._folder / "files", self._contents)
        except Exception as error:
            self._fault = f"no place for the run: {type(error).__name__}: {error}"
        self._contents = {}

    def teardown(self, worker: Worker) -> None:
        with self._guard:
            self._ended = True
            for lane in self._lanes.values():
                lane.close()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def apply(self, item: bytes) -> Answer:
        """Return what becomes of a packed item in the process of this thread.

        Raises OtherWorkerError where this worker cannot be used, UnpreparedWorkerError where the
        run was ended here, and BrokenWorkerError where the machine lacks something.
        """
        if self._fault or self._folder is None:
            raise OtherWorkerError(f"the worker {self._address} has {self._fault}")
        try:
            return self._lane(self._folder).apply(item)
        except LaneClosedError:
            raise UnpreparedWorkerError(self.name) from None
        except OSError as error:  # no memory, no process, no room
            raise BrokenWorkerError(f"the worker {self._address}: {error}") from error

    def _lane(self, folder: Path) -> Lane:
        number = threading.get_ident()
        with self._guard:
            if self._ended:
                raise LaneClosedError
            if number not in self._lanes:
                run = folder / f"lane-{len(self._lanes)}" / "run"
                run.mkdir(parents=True, exist_ok=True)
                write_files(run, self._before)
                files = folder / "files"
                assignment = Assignment(self._function, run, files, self._kept)
                self._lanes[number] = Lane(assignment, self._limit_s, self._died, self._late)
            return self._lanes[number]


def apply_on_worker(name: str, item: bytes) -> Answer:
    """Return what becomes of an item of the run `name`, on the worker that this is called on."""
    plugin: Any = get_worker().plugins.get(name)
    if plugin is None:
        raise UnpreparedWorkerError(name)
    answer: Answer = plugin.apply(item)
    return answer
