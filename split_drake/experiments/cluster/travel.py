"""Values on their way to another machine: files that they name go with them.

A path that exists here is packed as what it holds, and unpacked as the path of a copy there.  A
path within the run's folder stands for the same place in the folder that the worker has in its
stead, whether it exists or not.  Other paths stay as they are.
"""

import io
import os
import pickle
import sys
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import FunctionType
from typing import Any

from split_drake.bad_input import BadInputError
from split_drake.experiments.provenance import combined_sha256, file_sha256
from split_drake.files import write_atomically

# More than this is no setting of a run but data, which does not travel with it.
MOST_BYTES = 1_000_000_000


@dataclass
class Freight:
    """The files that packed values name.

    Attributes:
        files: {path below a worker's folder of files: file here}.
        known: {path here: the path that stands for it below a worker's folder}.
    """

    files: dict[str, Path] = field(default_factory=dict)
    known: dict[Path, str] = field(default_factory=dict)

    def add(self, path: Path) -> str:
        """Take a file or a folder along, and return where it will be below a worker's folder.

        Raises BadInputError where the files together are too large.
        """
        path = path.resolve()  # "..", too, has a name then
        if path not in self.known:
            self.known[path] = self._added(path)
            require_light(path, self.files.values())
        return self.known[path]

    def _added(self, path: Path) -> str:
        if path.is_file():
            place = f"{file_sha256(path)}/{path.name}"
            self.files[place] = path
            return place
        found = {str(file.relative_to(path)): file for file in files_below(path)}
        sha256 = combined_sha256({name: file_sha256(file) for name, file in found.items()})
        place = f"{sha256}/{path.name}"
        self.files.update({f"{place}/{name}": file for name, file in found.items()})
        return place

    def contents(self) -> dict[str, bytes]:
        """Return what the files hold."""
        return {place: file.read_bytes() for place, file in self.files.items()}


def require_light(path: Path, files: Iterable[Path]) -> None:
    """Raise BadInputError, naming the path that was added last, where files are too large."""
    if (size := sum(file.stat().st_size for file in files)) > MOST_BYTES:
        raise BadInputError(
            f"{path} makes {size / 1e9:.1f} GB to send to each worker; expected at most "
            f"{MOST_BYTES / 1e9:g} GB"
        )


def files_below(folder: Path) -> list[Path]:
    """Return the files below a folder, sorted, those behind links to other folders included."""
    found, seen = [], set()
    for where, folders, names in os.walk(folder, followlinks=True):
        real = os.path.realpath(where)
        if real in seen:  # a link that leads back
            folders.clear()
            continue
        seen.add(real)
        found += [path for name in names if (path := Path(where) / name).is_file()]
    return sorted(found)


def _defined_here(value: FunctionType | type) -> tuple[str, ...] | None:
    """Return where else is found what a command defines: under its module's own name."""
    spec = sys.modules["__main__"].__spec__
    return None if spec is None else ("defined", spec.name, value.__qualname__)


class _Packer(pickle.Pickler):
    def __init__(
        self,
        buffer: io.BytesIO,
        run: Path | None,
        freight: Freight | None,
        kept: Collection[str],
    ) -> None:
        super().__init__(buffer, pickle.HIGHEST_PROTOCOL)
        self._run = None if run is None else run.absolute()
        self._freight, self._kept = freight, kept

    def persistent_id(self, value: Any) -> tuple[str, ...] | None:
        if isinstance(value, Path):
            return self._place(value)
        if isinstance(value, FunctionType | type) and value.__module__ == "__main__":
            return _defined_here(value)
        return None

    def _place(self, path: Path) -> tuple[str, ...] | None:
        if self._run is not None and path.absolute().is_relative_to(self._run):
            place = path.absolute().relative_to(self._run)
            # A file that the user put there is not sent with what the run keeps.
            if self._freight is None or not path.is_file() or place.parts[0] in self._kept:
                return "run", str(place)
        if self._freight is not None and path.exists():
            return "file", self._freight.add(path)
        return None


class _Unpacker(pickle.Unpickler):
    def __init__(self, buffer: io.BytesIO, run: Path | None, files: Path | None) -> None:
        super().__init__(buffer)
        self._run, self._files = run, files

    def persistent_load(self, place: tuple[str, ...]) -> Any:
        kind, where, *rest = place
        if kind == "run" and self._run is not None:
            return self._run / where
        if kind == "file" and self._files is not None:
            return self._files / where
        if kind == "defined":
            return self.find_class(where, rest[0])
        raise pickle.UnpicklingError(f"{place} stands for nothing here")


def pack(
    value: object,
    run: Path | None,
    freight: Freight | None = None,
    kept: Collection[str] = (),
) -> bytes:
    """Return a value as bytes; the files that it names are added to the freight, where given.

    `run` is the run's folder, where there is one, and `kept` its entries that are sent anyhow.
    Raises what pickle does for values that cannot travel.
    """
    buffer = io.BytesIO()
    _Packer(buffer, run, freight, kept).dump(value)
    return buffer.getvalue()


def unpack(content: bytes, run: Path | None, files: Path | None = None) -> Any:
    """Return a packed value; `run` and `files` are the folders that stand here for its places."""
    return _Unpacker(io.BytesIO(content), run, files).load()


def write_files(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write files below a folder; BadInputError where one would lie outside of it."""
    for place, content in contents.items():
        path = folder / place
        if not path.resolve().is_relative_to(folder.resolve()):
            raise BadInputError(f"{place!r} is no place within {folder}")
        write_atomically(path, content)
