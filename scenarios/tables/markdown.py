"""The tables in Markdown."""

from collections.abc import Sequence

from scenarios.tables.comparison import FIGURES, Comparison
from scenarios.tables.rows import SCENES
from scenarios.tables.table import NOTES, PaperTable, paper_text, share_text


def to_markdown(table: PaperTable) -> str:
    """Return Table I, the comparisons and the mugs' figures."""
    parts = [
        "# The paper's tables",
        f"## Clutter removal: {table.asked} rounds a cell, percent, 95% intervals over rounds",
        clutter_table(table),
    ]
    if table.comparisons:
        parts += ["## SPLIT less each other row, on the same rounds", comparison_table(table)]
    if table.mugs:
        parts += ["## Mugs, 95% intervals", mug_table(table)]
    remarks = [*table.unfinished(), *(f"{row}: {why}" for row, why in table.left_out.items())]
    parts += ["## To mind", "\n".join(f"- {each}" for each in (*NOTES, *remarks))]
    return "\n\n".join(parts) + "\n"


def clutter_table(table: PaperTable) -> str:
    """Return Table I: of each row ours and, in brackets beside it, the paper's."""
    heads = ["method", *(f"{scene} {figure.upper()}" for scene in SCENES for figure in FIGURES)]
    rows = []
    for row in table.rows:
        cells = [row.title]
        for scene in SCENES:
            for figure in FIGURES:
                ours = share_text(table.share(row, scene, figure))
                paper = paper_text(row.paper.get(scene), figure)
                cells.append(f"{ours}; paper {paper}" if paper else ours)
        rows.append(cells)
    return _table(heads, rows)


def comparison_table(table: PaperTable) -> str:
    """Return by how many points SPLIT is better, with intervals and p."""
    heads = ["SPLIT less", *(f"{scene} {figure.upper()}" for scene in SCENES for figure in FIGURES)]
    rows = []
    for row in table.rows:
        found = [table.comparison(row, scene, figure) for scene in SCENES for figure in FIGURES]
        if any(found):
            rows.append([row.title, *(_points(each) for each in found)])
    return _table(heads, rows)


def _points(comparison: Comparison | None) -> str:
    """Return a difference in points, with its interval and p; a dash where there is none."""
    if comparison is None:
        return "-"
    low, high = (100.0 * each for each in comparison.interval)
    return f"{100.0 * comparison.difference:+.1f} [{low:+.0f}, {high:+.0f}], p {comparison.p:.3g}"


def mug_table(table: PaperTable) -> str:
    """Return the mug experiment's figures, ours and the paper's."""
    rows = [[figure.title, str(rate), str(figure.paper)] for figure, rate in table.mugs.items()]
    return _table(["task, poses from", "here", "the paper"], rows)


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
