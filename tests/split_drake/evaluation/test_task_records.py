"""How samples of one scene are judged, task by task."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from split_drake.data.mug_scenes import MugScene
from split_drake.evaluation.scenes import EvalMug
from split_drake.evaluation.task_records import (
    TRIED_GRASPS,
    UNREACHABLE,
    Ranking,
    record_grasps,
    record_handles,
    record_uprights,
)
from split_drake.grasps.free_hand import Hold
from split_drake.poses import Array, make_pose, rotation_x, rotation_y, rotation_z
from split_drake.split.detector import ScoredSamples
from tests.helpers.evaluation import standing_mug


@pytest.fixture(scope="module")
def mug() -> EvalMug:
    return standing_mug()


@pytest.fixture(scope="module")
def scene(mug: EvalMug) -> MugScene:
    return mug.draw(np.random.default_rng(0))


def true_grasps(mug: EvalMug, scene: MugScene) -> Array:
    assert mug.true_grasps is not None
    return mug.true_grasps.in_scene(scene)


def rank(X_WPs: Array, scores: list[float] | None = None, threshold: float = 0.3) -> Ranking:
    """Return a ranking of the poses, in their order where no scores are given."""
    ranks = np.linspace(1.0, 0.5, len(X_WPs)) if scores is None else np.array(scores)
    return Ranking(ScoredSamples(X_WPs, ranks), threshold)


def test_the_top_ranked_handle_and_all_samples_are_judged(mug: EvalMug, scene: MugScene) -> None:
    X_WH, X_WHturned = mug.shape.handle_poses(scene.X_WO)
    X_WHs = np.stack([X_WH @ make_pose(p=(0.1, 0.0, 0.0)), X_WHturned, X_WH])
    record = record_handles(rank(X_WHs, scores=[0.5, 0.9, 0.1]), mug, scene.X_WO)
    assert record.checks == {"top_good": True, "peg_clear": True, "peg_clear_axis": True}
    assert record.values["position_mm"] == pytest.approx(0.0, abs=1e-6)
    assert record.values["accepted"] == 2
    assert record.tallies == {"samples_good": (2, 3), "accepted_good": (1, 2)}
    assert (record.samples.good, record.samples.scores) == ("011", (0.5, 0.9, 0.1))


def test_a_peg_may_be_clear_where_the_pose_is_not_good(mug: EvalMug, scene: MugScene) -> None:
    X_WH = mug.shape.handle_poses(scene.X_WO)[0]
    about_the_peg = X_WH @ make_pose(rotation_y(np.radians(40.0)))
    record = record_handles(rank(about_the_peg[None]), mug, scene.X_WO)
    assert record.checks == {"top_good": False, "peg_clear": True, "peg_clear_axis": True}
    assert record.values["axis_deg"] == pytest.approx(0.0, abs=1e-4)
    assert record.values["rotation_deg"] == pytest.approx(40.0)


def test_a_rejected_pose_passes_no_check_even_if_right(mug: EvalMug, scene: MugScene) -> None:
    X_WHs = mug.shape.handle_poses(scene.X_WO)
    record = record_handles(rank(X_WHs, threshold=1.1), mug, scene.X_WO)
    assert not any(record.checks.values())
    assert record.tallies == {"samples_good": (2, 2), "accepted_good": (0, 0)}


def test_the_axis_of_an_upright_pose_is_judged_apart_from_its_yaw() -> None:
    X_WO = make_pose(rotation_x(1.0), (0.5, 0.0, 0.05))
    turned = X_WO @ make_pose(rotation_z(np.radians(60.0)), (0.0, 0.0, 0.004))
    record = record_uprights(rank(turned[None]), X_WO)
    assert record.checks == {"top_good": False, "axis_good": True, "axis_yaw_good": False}
    assert record.values["yaw_deg"] == pytest.approx(60.0)
    assert record.values["axis_deg"] == pytest.approx(0.0, abs=1e-4)
    tilted = X_WO @ make_pose(rotation_x(np.radians(16.0)))
    assert not any(record_uprights(rank(tilted[None]), X_WO).checks.values())
    far = X_WO @ make_pose(p=(0.0, 0.011, 0.0))
    assert not any(record_uprights(rank(far[None]), X_WO).checks.values())


def test_true_grasps_cover_themselves(mug: EvalMug, scene: MugScene) -> None:
    X_WGs = true_grasps(mug, scene)
    assert len(X_WGs) >= 3
    record = record_grasps(rank(X_WGs), mug, scene, rng=None)
    assert record.tallies["coverage"] == (len(X_WGs), len(X_WGs))
    assert record.tried is None
    assert set(record.checks) == {"top_good", "enough_accepted"}
    above = X_WGs @ make_pose(p=(0.0, 0.0, -0.5))
    missed = record_grasps(rank(above), mug, scene, rng=None)
    assert missed.tallies["coverage"] == (0, len(X_WGs))


def test_enough_grasps_must_be_accepted(mug: EvalMug, scene: MugScene) -> None:
    X_WGs = np.repeat(true_grasps(mug, scene)[:1], 30, axis=0)
    assert record_grasps(rank(X_WGs), mug, scene, None).checks["enough_accepted"]
    assert not record_grasps(rank(X_WGs[1:]), mug, scene, None).checks["enough_accepted"]


@dataclass
class CountingHand:
    """Says of each grasp that it slips, or holds where it lies at a place that was named."""

    p_WHeld: Array
    tried: list[Array] = field(default_factory=list)

    def hold_in_scene(self, X_WO: Array, X_WG: Array, opening_m: float) -> Hold:
        assert 0.0 < opening_m <= 0.08
        self.tried.append(X_WG)
        holds = np.allclose(X_WG[:3, 3], self.p_WHeld)
        return Hold("" if holds else "slipped", 0.0, 0.0)


def test_some_accepted_grasps_are_tried_in_physics(
    mug: EvalMug, scene: MugScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = record_grasps(rank(true_grasps(mug, scene)), mug, scene, None).samples.flags
    held, slips = true_grasps(mug, scene)[good][:2]
    X_WGs = np.stack([held] + [slips] * 3 + [held @ make_pose(rotation_x(np.pi))] * 12)
    hand = CountingHand(held[:3, 3])
    monkeypatch.setitem(mug.__dict__, "hand", hand)
    record = record_grasps(rank(X_WGs), mug, scene, np.random.default_rng(0))
    assert record.checks["top_holds"]
    hits, tried = record.tallies["tried_holds"]
    assert (tried, len(record.tried.good)) == (TRIED_GRASPS, TRIED_GRASPS)  # type: ignore[union-attr]
    slipped, unreachable = (record.tallies[f"tried_{f}"][0] for f in ("slipped", UNREACHABLE))
    assert hits + slipped + unreachable == TRIED_GRASPS
    assert unreachable > 0
    assert len(hand.tried) == 1 + hits + slipped  # what the hand cannot reach isn't simulated


def test_nothing_is_tried_where_nothing_is_accepted(
    mug: EvalMug, scene: MugScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    hand = CountingHand(np.zeros(3))
    monkeypatch.setitem(mug.__dict__, "hand", hand)
    ranking = rank(true_grasps(mug, scene), threshold=1.1)
    record = record_grasps(ranking, mug, scene, np.random.default_rng(0))
    assert record.checks["top_holds"] is False
    assert record.tallies["tried_holds"] == (0, 0)
    assert not hand.tried


def test_a_firm_grasp_holds_in_physics(mug: EvalMug, scene: MugScene) -> None:
    X_WGs = true_grasps(mug, scene)
    steep = X_WGs[np.argsort(X_WGs[:, 2, 2])[:3]]
    record = record_grasps(rank(steep), mug, scene, np.random.default_rng(0))
    assert record.tallies["tried_holds"][0] >= 1
