"""Where a run's mugs come from: a fixed split, or a folder of mesh files."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import cast, get_args

from split_drake.bad_input import BadInputError
from split_drake.experiments.provenance import combined_sha256, file_sha256
from split_drake.models_folder import MODELS_FOLDER
from split_drake.objects.mug_shape import MugShape
from split_drake.objects.mugs.split import Split, load_mug, mug_names, mugs_sha256
from split_drake.objects.scanned.files import ReadMug, read_mug_file
from split_drake.objects.scanned.folder import MugFiles, find_mug_files

SPLITS: tuple[Split, ...] = get_args(Split)
DERIVED = Path("datasets/mugs")


@dataclass(frozen=True)
class MugSource:
    """Mugs by name.

    Attributes:
        where: "train", "test" or "thin", the fixed splits, or a folder of mesh files, see
            `find_mug_files`.
        left_out: names of the folder's mugs that are of no use.

    Raises BadInputError where it is neither.
    """

    where: str
    left_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.where not in SPLITS and not Path(self.where).is_dir():
            raise BadInputError(
                f"mugs are {self.where!r}; expected {', '.join(SPLITS)}, or a folder of mesh files"
            )

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        """Pickle a folder as a path, so that it is sent along to workers that share no disk."""
        return _source_at, (self.folder or self.where, self.left_out)

    @property
    def folder(self) -> Path | None:
        """The folder of mesh files; None for a fixed split."""
        return None if self.where in SPLITS else Path(self.where)

    @property
    def split(self) -> Split | None:
        """The fixed split; None for a folder."""
        return cast(Split, self.where) if self.where in SPLITS else None

    def names(self) -> tuple[str, ...]:
        """Return the names of all mugs but those left out, in a fixed order.

        Raises NoMugsError where a folder holds no mesh file.
        """
        if self.split is not None:
            return mug_names(self.split)
        return tuple(name for name in _files(Path(self.where)).meshes if name not in self.left_out)

    def load(self, name: str) -> MugShape:
        """Return the mug `name`; raise InvalidMugError where its mesh is no mug."""
        return self.read(name).shape

    def read(self, name: str) -> ReadMug:
        """Return the mug `name` and what was assumed of its file; errors are those of `load`."""
        if self.folder is None:
            return ReadMug(load_mug(name), ())
        meshes = _files(self.folder).meshes
        if name not in meshes:
            raise BadInputError(f"{self.where} holds no mug {name!r}; expected one of its meshes")
        return _from_file(meshes[name], name)

    def unclear(self) -> dict[str, str]:
        """Return {mesh file: why it has no name of its own} of a folder; none of a fixed split."""
        return {} if self.folder is None else dict(_files(self.folder).refused)

    def mesh_sha256(self, name: str) -> str | None:
        """Return the SHA-256 of a mug's mesh file; None for the mugs of a fixed split."""
        return None if self.folder is None else file_sha256(_files(self.folder).meshes[name])

    def derived_path(self, kind: str) -> Path:
        """Return the .npz file in which what is made of all mugs is kept, "rests" or "grasps".

        That of a fixed split ships; a folder's is told by its content, below where a command runs.
        """
        if self.folder is None:
            return MODELS_FOLDER / "mugs" / f"{kind}_{self.where}.npz"
        called = f"{self.folder.resolve().name}-{self.mugs_sha256()[:12]}"
        return DERIVED / called / f"{kind}.npz"

    def mugs_sha256(self) -> str:
        """Return a hash of the mugs alone, which what is made of them records."""
        return self.sha256() if self.split is None else mugs_sha256(self.split)

    def sha256(self) -> str:
        """Return a hash of the files that mugs, and the rests and grasps of a split, come from."""
        folder, pattern = self.folder, "*"
        if folder is None:
            folder, pattern = MODELS_FOLDER / "mugs", f"*{self.where}.*"
        files = sorted(path for path in folder.rglob(pattern) if path.is_file())
        return combined_sha256({str(path.relative_to(folder)): file_sha256(path) for path in files})


def _source_at(where: str | Path, left_out: tuple[str, ...]) -> MugSource:
    return MugSource(str(where), left_out)


@lru_cache(maxsize=1)
def _files(folder: Path) -> MugFiles:
    return find_mug_files(folder)


@lru_cache(maxsize=64)
def _from_file(path: Path, name: str) -> ReadMug:
    return read_mug_file(path, name)
