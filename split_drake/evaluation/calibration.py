"""How well scores tell good poses from others: reliability, calibration error and AUC."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from split_drake.poses import Array

BINS = 20


@dataclass(frozen=True)
class Reliability:
    """What scores come to, by bins of equal width over [0, 1].

    Attributes:
        counts: (BINS,) samples in each bin.
        scores: (BINS,) their mean score; NaN in empty bins.
        shares: (BINS,) the share of them that is good; NaN in empty bins.
    """

    counts: NDArray[np.int_]
    scores: Array
    shares: Array

    @property
    def expected_error(self) -> float:
        """The mean distance between score and share good over all samples; NaN without samples."""
        if not self.counts.any():
            return float("nan")
        filled = self.counts > 0
        distances = np.abs(self.scores - self.shares)[filled]
        return float(np.average(distances, weights=self.counts[filled]))


def reliability(scores: Array, good: NDArray[np.bool_]) -> Reliability:
    """Return the reliability of scores (N,) in [0, 1] of samples that are `good` (N,) or not."""
    bins = np.minimum((scores * BINS).astype(int), BINS - 1)
    counts = np.bincount(bins, minlength=BINS)
    with np.errstate(invalid="ignore"):
        means = np.bincount(bins, weights=scores, minlength=BINS) / counts
        shares = np.bincount(bins, weights=good, minlength=BINS) / counts
    return Reliability(counts, means, shares)


def area_under_curve(scores: Array, good: NDArray[np.bool_]) -> float:
    """Return the chance that a good sample has a higher score than another, ties counted half.

    That is the area under the receiver operating characteristic; the Mann-Whitney statistic over
    the number of pairs.  NaN where all samples (N,) are good, or none is.
    """
    positives, negatives = int(good.sum()), int((~good).sum())
    if not positives or not negatives:
        return float("nan")
    rank_sum = float(rankdata(scores)[good].sum())
    return (rank_sum - positives * (positives + 1) / 2.0) / (positives * negatives)
