"""The folder of a training run: who may write into it, and what is left of an interrupted run."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from split_drake.experiments.lock import locked
from split_drake.experiments.run import (
    CONFIG,
    AnotherRunError,
    read_json_lines,
    require_no_files,
    require_same,
)
from split_drake.files import read_json_object, write_atomically, write_json

# A resumed run may be longer or shorter; the state tells whether the device fits.
_MAY_CHANGE = {"minutes", "steps", "epochs", "device", "workers"}


class TrainingFolder:
    """Options, state, curves and weights of one run.

    Attributes:
        path: of the folder.
        config: the options that the run was started with.
        state: from which it goes on.
        curves: a JSON object a line, with its "step".
        weights: as of the last save.

    Args:
        path: of the folder.
        weights: name of the weights' file.
    """

    def __init__(self, path: Path, weights: str = "split.safetensors") -> None:
        self.path = path
        self.config = path / CONFIG
        self.state = path / "state.pt"
        self.curves = path / "curves.jsonl"
        self.weights = path / weights

    @contextmanager
    def locked(self, resume: bool) -> Iterator[None]:
        """Make the folder where it is missing, and keep other processes out of it.

        SystemExit says that there is no run to `resume`.  Raises AnotherRunError where the folder
        holds files of something else, and FolderInUseError where another process runs there.
        """
        if not self.config.exists():
            if resume or self.state.exists():
                raise SystemExit(f"{self.config} does not exist: there is no run to resume")
            require_no_files(self.path)
        with locked(self.path):
            yield

    def take_up(self, options: dict[str, Any], resume: bool) -> bool:
        """Return whether there is a state to go on from; otherwise write the options of a new run.

        A run of the same options that was killed before its first save starts anew.  SystemExit
        says why the folder cannot be used: another run is never overwritten.  Call it while the
        folder is `locked`.
        """
        if self.config.exists():
            if self.state.exists() and not resume:
                raise SystemExit(f"{self.path} holds a run; --resume it, or choose another folder")
            self._require_same(options)
        if self.state.exists():
            return True
        write_json(self.config, options)
        self.curves.unlink(missing_ok=True)
        return False

    def append_curves(self, line: dict[str, Any]) -> None:
        """Add a line to the curves."""
        with self.curves.open("a") as file:
            file.write(json.dumps(line) + "\n")

    def read_curves(self) -> list[dict[str, Any]]:
        """Return the lines of the curves, without one that is not, or never will be, finished."""
        return read_json_lines(self.curves)

    def cut_curves(self, step: int) -> None:
        """Drop what was reported beyond `step`, which the resumed run will report again."""
        kept = [json.dumps(line) + "\n" for line in self.read_curves() if line["step"] <= step]
        write_atomically(self.curves, "".join(kept))

    def options(self) -> dict[str, Any]:
        """Return the options of the run that was begun here; none where none was."""
        return read_json_object(self.config, "the options of a run") if self.config.exists() else {}

    def _require_same(self, options: dict[str, Any]) -> None:
        """Exit where a resumed run would not be the same."""
        try:
            require_same(self.path, self.options(), options, _MAY_CHANGE)
        except AnotherRunError as error:
            raise SystemExit(str(error)) from error
