"""Which files of a folder are mugs: one mesh each, however the folder is laid out."""

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from split_drake.bad_input import BadInputError
from split_drake.objects.meshes.mesh_file import SUFFIXES

# Words in the names of files and folders, as data sets use them.
_SEEN = {"visual", "vis", "textured"}
_TOUCHED = {"collision", "coll", "col", "convex", "vhacd", "coacd", "decomposed", "nontextured"}
# Folders of these names say nothing of what lies in them.
_PLAIN = {"mesh", "meshes"}
# Archives of macOS hold a folder of this name, of files that are none.
_RESOURCES = "__MACOSX"


class NoMugsError(BadInputError, FileNotFoundError):
    """A folder of no use; one sentence: which one, what is wrong, what was expected."""


@dataclass(frozen=True)
class MugFiles:
    """What a folder of mugs holds; nothing has been read yet.

    Attributes:
        meshes: {name of a mug: its mesh file}, sorted by name.
        refused: {name: one sentence that says why it cannot be told which file is the mug}.
    """

    meshes: dict[str, Path]
    refused: dict[str, str]


@dataclass(frozen=True)
class _Found:
    """A mesh file: the folders that it belongs to, its name without words of its role."""

    path: Path
    home: tuple[str, ...]
    base: str
    is_touched: bool


def find_mug_files(folder: Path) -> MugFiles:
    """Return the mugs of a folder of mesh files, or of folders of such, at any depth.

    A mug is called as its file, or as the folders that hold it where they hold no other.  Of a
    visual and a collision mesh the visual one is the mug, of copies in several formats the one
    whose suffix is named first in `SUFFIXES`.  Hidden files, and what macOS adds to archives, are
    no mugs.

    Raises NoMugsError where there is no folder, or no mesh file in it.
    """
    if not folder.is_dir():
        raise NoMugsError(f"there is no folder {folder}; expected one of mesh files")
    paths = sorted(path for path in folder.rglob("*") if _is_mesh(path, folder))
    if not paths:
        raise NoMugsError(f"{folder} holds no mesh file; expected {', '.join(SUFFIXES)}")
    homes = defaultdict(list)
    for found in (_describe(path, folder) for path in paths):
        # In the folder itself every name is another mug.
        homes[found.home, "" if found.home else found.base].append(found)
    named = [entry for (home, _), group in homes.items() for entry in _mugs_of(home, group)]
    return _by_name(named)


def mug_files(folder: Path) -> dict[str, Path]:
    """Return the meshes that `find_mug_files` does, without those whose names cannot be told."""
    return find_mug_files(folder).meshes


def _is_mesh(path: Path, folder: Path) -> bool:
    parts = path.relative_to(folder).parts
    shown = not any(part.startswith(".") or part == _RESOURCES for part in parts)
    return shown and path.suffix.lower() in SUFFIXES and path.is_file()


def _words(name: str) -> list[str]:
    return re.split(r"[^a-z0-9]+", name.lower())


def _describe(path: Path, folder: Path) -> _Found:
    *folders, _ = path.relative_to(folder).parts
    words = {word for part in (*folders, path.stem) for word in _words(part)}
    silent = _SEEN | _TOUCHED | _PLAIN
    home = tuple(part for part in folders if part.lower() not in silent)
    kept = re.split(r"([^A-Za-z0-9]+)", path.stem)
    roles = _SEEN | _TOUCHED
    base = "".join("" if part.lower() in roles else part for part in kept).strip("_-. ")
    return _Found(path, home, base or path.stem, bool(words & _TOUCHED))


def _mugs_of(home: tuple[str, ...], found: Sequence[_Found]) -> list[tuple[str, Path]]:
    """Return (name, file) of the mugs that share a home: folders, or a name in the top folder."""
    seen = [entry for entry in found if not entry.is_touched] or list(found)
    by_base: dict[str, list[Path]] = defaultdict(list)
    for entry in seen:
        by_base[entry.base].append(entry.path)
    several = len(by_base) > 1
    return [
        ("_".join((*home, base) if several or not home else home), min(paths, key=_rank))
        for base, paths in by_base.items()
    ]


def _rank(path: Path) -> tuple[int, str]:
    return SUFFIXES.index(path.suffix.lower()), str(path)


def _by_name(named: Sequence[tuple[str, Path]]) -> MugFiles:
    meshes: dict[str, Path] = {}
    refused: dict[str, str] = {}
    for name, path in sorted(named, key=lambda entry: (entry[0], len(entry[1].parts), entry[1])):
        if name in meshes:
            refused[str(path)] = (
                f"{path} would be called {name!r}, as {meshes[name]} is; expected different names"
            )
        else:
            meshes[name] = path
    return MugFiles(meshes, refused)
