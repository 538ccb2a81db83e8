"""Trying grasps: candidates, and runs that go on where they were."""

from pathlib import Path

import numpy as np
import pytest

from split_drake.grasps.check_grasps import STEADY, WIDE, CheckConfig, candidates, check_mug
from split_drake.grasps.judge import MIN_QUALITY, GraspJudge
from split_drake.grasps.store import read_store
from split_drake.objects.mugs.split import load_mug, mugs_sha256
from split_drake.objects.scanned.mug_source import MugSource
from tests.helpers.stations import STATION


def test_candidates_are_firm_and_the_first_span_the_mug() -> None:
    X_OGs, openings, qualities = candidates(load_mug("train_003").body, np.random.default_rng(0))
    assert len(X_OGs) == len(openings) == WIDE + STEADY
    assert (qualities >= MIN_QUALITY).all()
    assert np.ptp(X_OGs[:10, :3, 3], axis=0).max() > 0.05


def test_later_candidates_are_not_spoilt_by_small_errors() -> None:
    body = load_mug("train_003").body
    X_OGs, openings, _ = candidates(body, np.random.default_rng(0))
    steadiness = GraspJudge(body.mesh).steadiness(X_OGs, openings, np.random.default_rng(1))
    assert np.median(steadiness[WIDE:]) > np.median(steadiness[:WIDE]) + 0.1
    assert np.median(steadiness[WIDE:]) > 0.65


def test_run_with_more_grasps_adds_to_what_there_is(tmp_path: Path) -> None:
    source = MugSource("train")
    check_mug(source, tmp_path, 2, STATION, "train_003")
    path, sha256 = tmp_path / "train_003.npz", mugs_sha256("train")
    before = read_store(path, sha256)["train_003"]
    check_mug(source, tmp_path, 3, STATION, "train_003")
    after = read_store(path, sha256)["train_003"]
    assert (len(before), len(after)) == (2, 3)
    np.testing.assert_array_equal(after.X_OGs[:2], before.X_OGs)
    np.testing.assert_array_equal(after.slips_m[:2], before.slips_m)
    once = tmp_path / "once"
    once.mkdir()
    check_mug(source, once, 3, STATION, "train_003")
    np.testing.assert_array_equal(
        read_store(once / "train_003.npz", sha256)["train_003"].slips_m, after.slips_m
    )


def test_too_many_grasps_are_refused() -> None:
    with pytest.raises(ValueError, match="per_mug is 151"):
        CheckConfig(per_mug=151)
