"""What scores say of samples."""

import numpy as np
import pytest

from split_drake.evaluation.calibration import BINS, area_under_curve, reliability


def test_scores_that_are_chances_are_calibrated() -> None:
    rng = np.random.default_rng(0)
    scores = rng.random(200_000)
    result = reliability(scores, rng.random(len(scores)) < scores)
    assert result.counts.sum() == len(scores)
    assert result.shares == pytest.approx(result.scores, abs=0.03)
    assert result.expected_error < 0.01


def test_the_expected_error_is_weighted_by_samples() -> None:
    scores = np.array([0.8, 0.8, 0.8, 0.2])
    result = reliability(scores, np.array([True, True, True, True]))
    assert result.expected_error == pytest.approx((3 * 0.2 + 0.8) / 4)


def test_every_score_has_a_bin_and_empty_bins_no_share() -> None:
    result = reliability(np.array([0.0, 1.0, 1.0]), np.array([False, True, False]))
    assert (result.counts[0], result.counts[-1]) == (1, 2)
    assert (result.shares[0], result.shares[-1]) == (0.0, 0.5)
    assert np.isnan(result.shares[1 : BINS - 1]).all()
    assert np.isnan(reliability(np.zeros(0), np.zeros(0, dtype=bool)).expected_error)


def test_the_area_is_the_share_of_pairs_in_order() -> None:
    rng = np.random.default_rng(0)
    scores, good = rng.integers(10, size=60) / 10.0, rng.random(60) < 0.4
    pairs = np.sign(scores[good][:, None] - scores[~good][None])
    assert area_under_curve(scores, good) == pytest.approx((1.0 + pairs.mean()) / 2.0)
    assert area_under_curve(good.astype(float), good) == 1.0
    assert area_under_curve(1.0 - good.astype(float), good) == 0.0
    assert area_under_curve(np.full(60, 0.5), good) == 0.5


def test_there_is_no_area_without_both_kinds() -> None:
    scores = np.array([0.1, 0.9])
    assert np.isnan(area_under_curve(scores, np.array([True, True])))
    assert np.isnan(area_under_curve(scores, np.array([False, False])))
