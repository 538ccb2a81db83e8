"""Two methods on the same rounds: by how much one is better, and whether that is chance."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from scenarios.clutter.records import BOOTSTRAP_DRAWS, RoundRecord
from scenarios.tables.cells import Cell

Figure = Literal["gsr", "dr"]
FIGURES: tuple[Figure, ...] = ("gsr", "dr")
_WHOLES: dict[Figure, Callable[[RoundRecord], int]] = {
    "gsr": lambda record: len(record.grasps),
    "dr": lambda record: len(record.objects),
}


@dataclass(frozen=True)
class Comparison:
    """A method less another one, on the rounds that both have.

    Attributes:
        method, other: names of the rows.
        scene: kind of scene.
        figure: grasp success rate or declutter rate.
        rounds: that both have.
        difference: of the pooled shares.
        interval: 95% of it, by drawing rounds with replacement, the same for both.
        p: two-sided, that there is no difference: twice the share of draws on the other side.
    """

    method: str
    other: str
    scene: str
    figure: Figure
    rounds: int
    difference: float
    interval: tuple[float, float]
    p: float

    def to_json(self) -> dict[str, Any]:
        """Return the comparison as JSON holds it."""
        return asdict(self)


@dataclass(frozen=True)
class Difference:
    """A pooled share less another one, on the same rounds.

    Attributes:
        share, other_share: both.
        difference: of them.
        interval, p: as of `Comparison`.
    """

    share: float
    other_share: float
    difference: float
    interval: tuple[float, float]
    p: float


def compare(cell: Cell, other: Cell, figure: Figure) -> Comparison | None:
    """Return the paired bootstrap over rounds; None where they have no round in common."""
    ours = {(each.seed, each.index): each for each in cell.records}
    theirs = {(each.seed, each.index): each for each in other.records}
    both = sorted(ours.keys() & theirs.keys())
    if not both:
        return None
    found = compare_rounds([ours[key] for key in both], [theirs[key] for key in both], figure)
    return Comparison(
        method=cell.row.name,
        other=other.row.name,
        scene=cell.scene,
        figure=figure,
        rounds=len(both),
        difference=found.difference,
        interval=found.interval,
        p=found.p,
    )


def compare_rounds(
    records: Sequence[RoundRecord], others: Sequence[RoundRecord], figure: Figure
) -> Difference:
    """Return the paired bootstrap over rounds, of which one at least is in both."""
    first, second = _counts(records, figure), _counts(others, figure)
    shape = (BOOTSTRAP_DRAWS, len(records))
    drawn = np.random.default_rng(0).integers(len(records), size=shape)
    draws = _share(first[drawn].sum(axis=1)) - _share(second[drawn].sum(axis=1))
    low, high = np.percentile(draws, (2.5, 97.5))
    # One more draw on either side, so that no p is 0.
    sides = (1 + (draws <= 0.0).sum(), 1 + (draws >= 0.0).sum())
    shares = [float(_share(counts.sum(axis=0))) for counts in (first, second)]
    return Difference(
        share=shares[0],
        other_share=shares[1],
        difference=shares[0] - shares[1],
        interval=(float(low), float(high)),
        p=min(1.0, 2.0 * min(sides) / (BOOTSTRAP_DRAWS + 1)),
    )


def _counts(records: Sequence[RoundRecord], figure: Figure) -> NDArray[np.int_]:
    """Return (N, 2): grasps that succeeded, and what they are a share of."""
    whole = _WHOLES[figure]
    return np.array([(record.successes, whole(record)) for record in records])


def _share(counts: NDArray[np.int_]) -> NDArray[np.float64]:
    """Return shares of counts (..., 2); a method that tries nothing has a share of 0."""
    return np.asarray(counts[..., 0] / np.maximum(counts[..., 1], 1))
