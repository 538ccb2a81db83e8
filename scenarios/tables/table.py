"""Table I with everything that is shown of it: cells, comparisons, the mugs, and what to mind."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from scenarios.clutter.records import Share
from scenarios.clutter.spec import SceneKind
from scenarios.tables.cells import Cell
from scenarios.tables.comparison import FIGURES, Comparison, Figure, compare
from scenarios.tables.mugs import MUG_FIGURES, MugFigure
from scenarios.tables.rows import SCENES, SPLIT, PaperFigure, TableRow
from split_drake.experiments.statistics import Rate

NAMES: Mapping[Figure, str] = {"gsr": "grasps that succeed (GSR)", "dr": "objects taken (DR)"}
# What keeps the paper's figures and ours apart.
NOTES = (
    "The paper's figures come from another physics engine, and from objects of its own.",
    "The camera stands where GIGA's weights had theirs; the paper does not say where its own was.",
    "All methods try the best of their grasps; the hand comes in wide open, whatever width is "
    "predicted.",
    "Methods trained here learn from the scenes and labels that SPLIT learns from; the authors' "
    "weights come from other objects, another engine and more scenes.",
    "VGN, GIGA and SE(3)-Dif were trained for 90 minutes each on two cores, SPLIT for longer.",
    "SPLIT, one look, is the paper's method; SPLIT takes a second look at 24 of the best grasps.",
    "SE(3)-Dif has no evaluator: its grasps are ranked by their energy.",
)


@dataclass(frozen=True)
class PaperTable:
    """What the paper's experiments come to here.

    Attributes:
        rows: of Table I, in their order.
        cells: {(name of a row, kind of scene): cell} of those that were run.
        asked: rounds of each cell that the table is of.
        comparisons: of SPLIT with every other row.
        mugs: {figure: rate} of those that were run.
        left_out: why rows are missing, by their titles.
    """

    rows: tuple[TableRow, ...]
    cells: Mapping[tuple[str, SceneKind], Cell]
    asked: int
    comparisons: tuple[Comparison, ...]
    mugs: Mapping[MugFigure, Rate]
    left_out: Mapping[str, str]

    @classmethod
    def of(
        cls,
        rows: Sequence[TableRow],
        cells: Sequence[Cell],
        asked: int,
        mugs: Mapping[MugFigure, Rate],
        left_out: Mapping[str, str],
    ) -> "PaperTable":
        """Return the table of cells, compared where SPLIT has been run."""
        by_place = {(cell.row.name, cell.scene): cell for cell in cells}
        comparisons = []
        for scene in SCENES:
            ours = by_place.get((SPLIT, scene))
            for row in rows:
                other = by_place.get((row.name, scene))
                if ours is None or other is None or row.name == SPLIT:
                    continue
                found = [compare(ours, other, figure) for figure in FIGURES]
                comparisons += [each for each in found if each is not None]
        return cls(tuple(rows), by_place, asked, tuple(comparisons), mugs, left_out)

    def share(self, row: TableRow, scene: SceneKind, figure: Figure) -> Share | None:
        """Return a figure of a cell; None where it was not run."""
        cell = self.cells.get((row.name, scene))
        return None if cell is None else getattr(cell.removal, figure)

    def comparison(self, row: TableRow, scene: SceneKind, figure: Figure) -> Comparison | None:
        """Return SPLIT less a row, where both were run."""
        wanted = (row.name, scene, figure)
        for each in self.comparisons:
            if (each.other, each.scene, each.figure) == wanted:
                return each
        return None

    def unfinished(self) -> list[str]:
        """Return a sentence for each cell that lacks rounds."""
        return [
            f"{row.title}, {scene}: {len(cell.records)} of {self.asked} rounds"
            for row in self.rows
            for scene in SCENES
            if (cell := self.cells.get((row.name, scene))) and len(cell.records) < self.asked
        ]

    def to_json(self) -> dict[str, Any]:
        """Return all figures as JSON holds them."""
        return {
            "rounds": self.asked,
            "rows": [self._row_to_json(row) for row in self.rows],
            "comparisons": [each.to_json() for each in self.comparisons],
            "mugs": [
                {
                    "name": figure.name,
                    "successes": rate.successes,
                    "trials": rate.trials,
                    "interval": rate.wilson95,
                    "paper": [figure.paper.successes, figure.paper.trials],
                }
                for figure, rate in self.mugs.items()
            ],
            "left_out": dict(self.left_out),
            "notes": list(NOTES),
        }

    def _row_to_json(self, row: TableRow) -> dict[str, Any]:
        scenes: dict[str, Any] = {}
        for scene in SCENES:
            cell = self.cells.get((row.name, scene))
            paper = row.paper.get(scene)
            scenes[scene] = {
                "ours": None if cell is None else cell.removal.to_json(),
                "commit": None if cell is None else cell.config.get("commit"),
                "processor": None if cell is None else cell.config.get("processor"),
                "paper": None if paper is None else paper._asdict(),
            }
        return {"name": row.name, "title": row.title, "trained_here": row.trained_here, **scenes}


def paper_text(paper: PaperFigure | None, figure: Figure) -> str:
    """Return a figure of the paper as it has it; empty where it has none."""
    if paper is None:
        return ""
    value, deviation = (
        (paper.gsr, paper.gsr_deviation) if figure == "gsr" else (paper.dr, paper.dr_deviation)
    )
    return f"{value:.1f} ± {deviation:.1f}"


def share_text(share: Share | None) -> str:
    """Return a share in percent with its interval; a dash where it was not run."""
    if share is None:
        return "-"
    low, high = share.interval
    return f"{100.0 * share.value:.1f} [{100.0 * low:.0f}, {100.0 * high:.0f}]"


def mugs_of(rates: Mapping[MugFigure, Rate | None]) -> dict[MugFigure, Rate]:
    """Return those figures that were run."""
    return {figure: rate for figure in MUG_FIGURES if (rate := rates.get(figure)) is not None}
