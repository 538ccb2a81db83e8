"""The paper's Table I and its mug figures, ours beside them: ``python -m scenarios.paper_tables``.

``--whole`` runs what is missing of 200 rounds a cell, ``--quick`` of 8 rounds; without either, what
was run before is read.  The folder gets a folder for each cell, as `scenarios.clutter_removal`
writes it, and three for mugs; table.md, table.json, index.html and table.png.  The same --out goes
on where an interrupted run stopped.
"""

import itertools
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from scenarios import clutter_removal, mug_hang
from scenarios.clutter.observation import Noise
from scenarios.clutter.spec import SceneKind
from scenarios.tables.cells import (
    SAME,
    SAME_IN_A_COLUMN,
    Cell,
    cell_folder,
    keep_cells,
    read_cell,
    require_comparable,
)
from scenarios.tables.markdown import clutter_table, comparison_table, mug_table, to_markdown
from scenarios.tables.mugs import MUG_FIGURES
from scenarios.tables.page import PICTURE, to_page
from scenarios.tables.picture import draw_table
from scenarios.tables.rows import SCENES, TableRow, chosen_rows
from scenarios.tables.table import PaperTable, mugs_of
from split_drake.bad_input import BadInputError, require_count, require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.provenance import file_sha256
from split_drake.experiments.run import as_json
from split_drake.files import write_atomically, write_json

# Folders of VGN's layout; those that nothing was trained on come first.
_PARTS = ("test", "train")
QUICK_ROUNDS, QUICK_SEEDS, QUICK_TRIALS = 4, 2, 4


@dataclass(frozen=True)
class TableOptions:
    """What the tables are made of.

    Attributes:
        out: folder of the runs and of the tables.
        whole: run what is missing.
        quick: run what is missing of 4 rounds of 2 seeds a cell, and of 4 trials with mugs.
        rows: names of the rows to run and to show, such as split and vgn; all where none is named.
        rounds: of each seed.
        seeds: how many, from `first_seed` on.
        first_seed: of the rounds.
        objects: as of `scenarios.clutter_removal`; or a folder of VGN's layout, with folders packed
            and pile, and in each the objects, or a folder test or train of them.
        noise, fit_table: as of `scenarios.clutter_removal`.
        authors: folder with weights that GIGA's authors published, of GIGA and of VGN: adds a row
            for each.  Its files are vgn_packed.pt, vgn_pile.pt, giga_packed.pt and giga_pile.pt.
        kept: folder with cells that `keep` wrote, which are read where `out` has none; those that
            are whole are not run again.
        keep: folder to write the table's cells to, so that others can make the table anew.
        mug_trials: of each of the mug experiment's figures; 0 to leave them out.
        mug_seed: of the first of these.
        workers: processes; outcomes do not depend on them.
    """

    out: Path = Path("runs/paper_tables")
    whole: bool = False
    quick: bool = False
    rows: tuple[str, ...] = ()
    rounds: int = 40
    seeds: int = 5
    first_seed: int = 0
    objects: str = "procedural"
    noise: Noise = "gaussian"
    fit_table: bool = False
    authors: Path | None = None
    kept: Path | None = None
    keep: Path | None = None
    mug_trials: int = 40
    mug_seed: int = 0
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        if self.whole and self.quick:
            raise BadInputError("--whole and --quick are both given; expected one at most")
        for name, least in (("rounds", 1), ("seeds", 1), ("workers", 1)):
            require_count(f"--{name}", getattr(self, name), least)
        for name in ("first_seed", "mug_trials", "mug_seed"):
            require_count(f"--{name.replace('_', '-')}", getattr(self, name))

    @property
    def size(self) -> tuple[int, int, int]:
        """Rounds of a seed, seeds, and trials with mugs."""
        if self.quick:
            return QUICK_ROUNDS, QUICK_SEEDS, min(QUICK_TRIALS, self.mug_trials)
        return self.rounds, self.seeds, self.mug_trials

    @property
    def seed_range(self) -> range:
        """Seeds of the rounds."""
        return range(self.first_seed, self.first_seed + self.size[1])

    def clutter(self, row: TableRow, scene: SceneKind) -> clutter_removal.ClutterOptions:
        """Return the options of a cell's run."""
        rounds, seeds, _ = self.size
        return clutter_removal.ClutterOptions(
            scene=scene,
            rounds=rounds,
            seeds=seeds,
            first_seed=self.first_seed,
            detector=row.detector,
            checkpoint=row.weights.get(scene),
            objects=objects_for(self.objects, scene),
            noise=self.noise,
            fit_table=self.fit_table,
            record="none",
            workers=self.workers,
            out=cell_folder(self.out, row, scene),
        )


def objects_for(objects: str, scene: SceneKind) -> str:
    """Return the objects of one kind of scene: of a folder of VGN's layout, those for that kind."""
    if not all((Path(objects) / each).is_dir() for each in SCENES):
        return objects
    folder = Path(objects) / scene
    return str(next((folder / part for part in _PARTS if (folder / part).is_dir()), folder))


def names_there(options: TableOptions) -> set[str]:
    """Return the names of rows that have a cell which was run or kept."""
    folders = [each for each in (options.out, options.kept) if each is not None and each.is_dir()]
    return {
        cell.name.removesuffix(f"-{scene}")
        for folder in folders
        for scene in SCENES
        for cell in folder.glob(f"*-{scene}")
    }


def run_missing(options: TableOptions, rows: Sequence[TableRow], console: Console) -> None:
    """Run what is missing of all cells and of the mugs' figures."""
    _, _, trials = options.size
    for row, scene in itertools.product(rows, SCENES):
        console.rule(f"{row.title}, {scene}")
        if (kept := _kept_whole(options, row, scene)) is None:
            clutter_removal.main(options.clutter(row, scene))
            continue
        weights = options.clutter(row, scene).checkpoint
        console.print(f"kept in {options.kept}", markup=False)
        if weights and file_sha256(weights) != kept.config.get("checkpoint_sha256"):
            console.print(f"of other weights than {weights}", markup=False, style="yellow")
    for figure in MUG_FIGURES if trials else ():
        console.rule(figure.title)
        mug_hang.main(
            mug_hang.MugHangOptions(
                trials=trials,
                seed=options.mug_seed,
                detector=figure.detector,
                task=figure.task,
                record="none",
                workers=options.workers,
                out=options.out / figure.name,
            )
        )


def _kept_whole(options: TableOptions, row: TableRow, scene: SceneKind) -> Cell | None:
    """Return a cell kept whole, run in the same conditions, where `out` has not begun it."""
    asked = options.clutter(row, scene)
    if options.kept is None or cell_folder(options.out, row, scene).is_dir():
        return None
    cell = read_cell(options.kept, row, scene, asked.rounds, options.seed_range)
    if cell is None or len(cell.records) < asked.rounds * asked.seeds:
        return None
    config = as_json(clutter_removal.run_config(asked))
    same = all(cell.config.get(key) == config[key] for key in (*SAME, *SAME_IN_A_COLUMN))
    return cell if same else None


def made_table(options: TableOptions, rows: Sequence[TableRow]) -> PaperTable:
    """Return the table of what was run.

    Raises BadInputError where nothing was, or where cells were run in other conditions.
    """
    rounds, seeds, trials = options.size
    found = [
        cell
        for row in rows
        for scene in SCENES
        if (cell := _found_cell(options, row, scene, rounds, options.seed_range))
    ]
    mug_seeds = range(options.mug_seed, options.mug_seed + trials)
    mugs = mugs_of({figure: figure.read(options.out, mug_seeds) for figure in MUG_FIGURES})
    if not found and not mugs:
        raise BadInputError(f"{options.out} holds no runs; --quick or --whole make them")
    require_comparable(found)
    run = {cell.row.name for cell in found}
    absent = {
        row.title: f"there is no file {missing[0]}"
        for row in rows
        if row.name not in run and (missing := row.missing())
    }
    return PaperTable.of(rows, found, rounds * seeds, mugs, absent)


def _found_cell(
    options: TableOptions, row: TableRow, scene: SceneKind, rounds: int, seeds: range
) -> Cell | None:
    """Return a cell that was run in `out`, or else was kept."""
    for folder in (options.out, options.kept):
        if folder is not None and (cell := read_cell(folder, row, scene, rounds, seeds)):
            return cell
    return None


def write_table(out: Path, table: PaperTable) -> None:
    """Write the table in all its forms."""
    write_json(out / "table.json", table.to_json())
    write_atomically(out / "table.md", to_markdown(table))
    draw_table(table, out / PICTURE)
    write_atomically(out / "index.html", to_page(table))


def main(options: TableOptions) -> None:
    """Run what is missing where asked to, and write the tables."""
    console = Console(soft_wrap=True)
    rows = chosen_rows(options.rows, options.authors, names_there(options))
    if options.whole or options.quick:
        run_missing(options, [row for row in rows if not row.missing()], console)
    table = made_table(options, rows)
    write_table(options.out, table)
    if options.keep is not None:
        keep_cells(list(table.cells.values()), options.keep)
    parts = [clutter_table(table)]
    parts += [comparison_table(table)] if table.comparisons else []
    parts += [mug_table(table)] if table.mugs else []
    for part in parts:
        console.print(part + "\n", highlight=False, markup=False)
    for remark in (*table.unfinished(), *(f"{r}: {w}" for r, w in table.left_out.items())):
        console.print(remark, markup=False)
    console.print(f"tables: {options.out / 'table.md'}, {options.out / 'index.html'}", markup=False)


if __name__ == "__main__":
    run_command(main, TableOptions, __doc__)
