"""The rows of the paper's Table I: methods, whose weights they have, and the paper's figures."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from scenarios.clutter.spec import SceneKind
from split_drake.bad_input import BadInputError
from split_drake.models_folder import MODELS_FOLDER

SCENES: tuple[SceneKind, ...] = ("packed", "pile")
_WEIGHTS = MODELS_FOLDER / "weights"
SPLIT = "split"
# In place of a folder of weights that is not given.
_NOWHERE = Path("--authors")


class PaperFigure(NamedTuple):
    """A cell of the paper: mean and standard deviation over five seeds, percent."""

    gsr: float
    gsr_deviation: float
    dr: float
    dr_deviation: float


@dataclass(frozen=True)
class TableRow:
    """A row.

    Attributes:
        name: of its folders.
        title: how it is shown.
        detector: the method, see `scenarios.clutter.detection`.
        weights: its file for each kind of scene; none for methods without parameters.
        trained_here: whether it learnt from the scenes that SPLIT learns from, so that both can be
            compared.
        paper: what the paper has of it.
    """

    name: str
    title: str
    detector: str
    weights: Mapping[SceneKind, Path] = field(default_factory=dict)
    trained_here: bool = False
    paper: Mapping[SceneKind, PaperFigure] = field(default_factory=dict)

    def missing(self) -> list[Path]:
        """Return the files of weights that are not there."""
        return sorted({path for path in self.weights.values() if not path.is_file()})


_PAPER: Mapping[str, Mapping[SceneKind, PaperFigure]] = {
    "vgn": {
        "packed": PaperFigure(76.37, 3.3, 79.26, 3.7),
        "pile": PaperFigure(47.60, 3.7, 31.06, 3.57),
    },
    "giga": {
        "packed": PaperFigure(84.04, 3.5, 83.48, 2.8),
        "pile": PaperFigure(56.83, 5.7, 39.42, 5.52),
    },
    "se3dif": {
        "packed": PaperFigure(35.34, 2.8, 28.35, 3.6),
        "pile": PaperFigure(10.62, 2.2, 4.94, 1.1),
    },
    SPLIT: {
        "packed": PaperFigure(89.01, 2.3, 86.63, 4.6),
        "pile": PaperFigure(69.00, 6.3, 47.59, 4.9),
    },
}


def _trained_here(name: str, title: str, weights: str, of_paper: str = "") -> TableRow:
    path = _WEIGHTS / weights
    return TableRow(
        name, title, name, dict.fromkeys(SCENES, path), True, _PAPER.get(of_paper or name, {})
    )


def _authors(method: str, title: str, folder: Path) -> TableRow:
    weights = {scene: folder / f"{method}_{scene}.pt" for scene in SCENES}
    return TableRow(f"{method}_authors", title, method, weights, paper=_PAPER[method])


def table_rows(authors: Path | None = None, there: Collection[str] = ()) -> tuple[TableRow, ...]:
    """Return all rows; those with the authors' weights where their folder is given, or they ran.

    Args:
        authors: folder of vgn_packed.pt, vgn_pile.pt, giga_packed.pt and giga_pile.pt.
        there: names of rows that have cells already.
    """
    titles = {"vgn": "VGN, weights of GIGA's authors", "giga": "GIGA, its authors' weights"}
    published = tuple(
        _authors(method, title, authors or _NOWHERE)
        for method, title in titles.items()
        if authors is not None or f"{method}_authors" in there
    )
    return (
        _trained_here("vgn", "VGN, trained here", "vgn.safetensors"),
        _trained_here("giga", "GIGA, trained here", "giga.safetensors"),
        *published,
        _trained_here("se3dif", "SE(3)-Dif, whole scene", "se3dif.safetensors"),
        _trained_here(
            "se3dif_segments", "SE(3)-Dif, each segment", "se3dif_segments.safetensors", "none"
        ),
        _trained_here("split_once", "SPLIT, one look", "split_clutter.safetensors", SPLIT),
        _trained_here(SPLIT, "SPLIT", "split_clutter.safetensors"),
        TableRow("oracle", "true grasps", "oracle"),
    )


def chosen_rows(
    names: tuple[str, ...], authors: Path | None, there: Collection[str] = ()
) -> tuple[TableRow, ...]:
    """Return the rows of those names, all where none is named; `there` have cells already.

    Raises BadInputError naming one that is unknown, or the weights that one which was named and has
    no cells lacks.
    """
    rows = table_rows(authors, there)
    known = {row.name: row for row in rows}
    for name in names:
        if name not in known:
            raise BadInputError(f"--rows has {name!r}; expected some of {', '.join(known)}")
        if name not in there and (missing := known[name].missing()):
            raise BadInputError(f"--rows has {name!r}, but there is no file {missing[0]}")
    return tuple(row for row in rows if not names or row.name in names)
