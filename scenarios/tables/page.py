"""Table I as a page with bars and intervals, which needs no server."""

from collections.abc import Sequence

import numpy as np

from scenarios.clutter.records import Share
from scenarios.tables.comparison import FIGURES, Comparison
from scenarios.tables.rows import SCENES
from scenarios.tables.table import NOTES, PaperTable, paper_text, share_text
from scenarios.viewing.page import lines, picture, table_page, text

PICTURE = "table.png"
# Below this, a difference is held for one.
SIGNIFICANT = 0.05


def to_page(table: PaperTable) -> str:
    """Return the page; the picture of the table lies beside it."""
    heads = [
        "method",
        *(f"{scene} {figure.upper()}, percent" for scene in SCENES for figure in FIGURES),
    ]
    rows = [
        [
            text(row.title),
            *(
                lines(
                    _cell(
                        table.share(row, scene, figure),
                        paper_text(row.paper.get(scene), figure),
                        table.comparison(row, scene, figure),
                    )
                )
                for scene in SCENES
                for figure in FIGURES
            ),
        ]
        for row in table.rows
    ]
    facts = [
        f"{table.asked} rounds a cell; 95% intervals by drawing rounds with replacement",
        "SPLIT less a row: on the same rounds, by a paired bootstrap over rounds",
        *(
            f"{figure.title}: {rate}; the paper {figure.paper}"
            for figure, rate in table.mugs.items()
        ),
        *table.unfinished(),
        *(f"{row}: {why}" for row, why in table.left_out.items()),
        *NOTES,
    ]
    shown = "Bars of all figures with their intervals, the paper's beside them"
    return table_page("The paper's tables", facts, heads, rows, [picture(PICTURE, shown)])


def _cell(share: Share | None, paper: str, comparison: Comparison | None) -> Sequence[str]:
    """Return what a cell says, line by line."""
    if share is None:
        return [text("not run")]
    said = [f"<b>{text(share_text(share))}</b>{_bar(share)}"]
    if len(share.seeds) > 1:
        said.append(text(f"{_over_seeds(share)} over seeds"))
    if paper:
        said.append(text(f"paper {paper}"))
    if comparison is not None:
        points = f"SPLIT {100.0 * comparison.difference:+.1f} points, p {comparison.p:.3g}"
        said.append(text(points + ("" if comparison.p < SIGNIFICANT else ": may be chance")))
    return said


def _over_seeds(share: Share) -> str:
    mean, deviation = np.nanmean(share.seeds), np.nanstd(share.seeds, ddof=1)
    return f"{100.0 * mean:.1f} ± {100.0 * deviation:.1f}"


def _bar(share: Share) -> str:
    """Return a bar as long as the share, and a darker one over its interval."""
    low, high = share.interval
    return (
        '<span style="display:block;position:relative;height:.6rem;min-width:6rem;'
        'background:#eee"><span style="position:absolute;left:0;top:0;bottom:0;'
        f'width:{100.0 * share.value:.1f}%;background:#9db4c0"></span>'
        f'<span style="position:absolute;top:.2rem;height:.2rem;left:{100.0 * low:.1f}%;'
        f'width:{100.0 * (high - low):.1f}%;background:#222"></span></span>'
    )
