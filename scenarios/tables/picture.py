"""Table I as bars with intervals."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from scenarios.clutter.spec import SceneKind
from scenarios.tables.comparison import FIGURES, Figure
from scenarios.tables.rows import SCENES, SPLIT, TableRow
from scenarios.tables.table import NAMES, PaperTable
from split_drake.files import replacing

_OURS, _OTHERS, _PAPER = "#1f6f8b", "#9db4c0", "#b3261e"


def draw_table(table: PaperTable, path: Path) -> None:
    """Write a picture, its kind by the suffix: a panel for each figure, a bar for each row."""
    canvas = Canvas(figsize=(11.0, 0.42 * len(table.rows) + 1.6), layout="constrained")
    panels = canvas.subplots(1, len(SCENES) * len(FIGURES), sharey=True)
    places = [(scene, figure) for scene in SCENES for figure in FIGURES]
    for panel, (scene, figure) in zip(panels, places, strict=True):
        _draw_panel(panel, table, scene, figure)
    panels[0].set_yticks(range(len(table.rows)), [row.title for row in table.rows])
    panels[0].invert_yaxis()
    canvas.supxlabel(
        "percent; black: 95% intervals over rounds; red: the paper, mean ± standard deviation",
        fontsize=9,
    )
    with replacing(path) as temporary:
        canvas.savefig(temporary, format=path.suffix.lstrip("."), dpi=130)


def _draw_panel(panel: Axes, table: PaperTable, scene: SceneKind, figure: Figure) -> None:
    for place, row in enumerate(table.rows):
        share = table.share(row, scene, figure)
        if share is not None and not np.isnan(share.value):
            value, (low, high) = 100.0 * share.value, (100.0 * each for each in share.interval)
            panel.barh(place, value, color=_OURS if row.name == SPLIT else _OTHERS, height=0.7)
            panel.errorbar(value, place, xerr=[[value - low], [high - value]], color="black")
        _draw_paper(panel, place, row, scene, figure)
    panel.set_xlim(0.0, 100.0)
    panel.set_title(f"{scene}: {NAMES[figure]}", fontsize=9)
    panel.grid(axis="x", alpha=0.3)


def _draw_paper(panel: Axes, place: int, row: TableRow, scene: SceneKind, figure: Figure) -> None:
    paper = row.paper.get(scene)
    if paper is None:
        return
    value = paper.gsr if figure == "gsr" else paper.dr
    deviation = paper.gsr_deviation if figure == "gsr" else paper.dr_deviation
    panel.errorbar(
        value, place + 0.22, xerr=deviation, fmt="D", color=_PAPER, markersize=3.5, linewidth=1.0
    )
