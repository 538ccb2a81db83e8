"""How samples of one scene are judged, task by task."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from split_drake.data.object_scenes import NO_FEATURE, ObjectScene
from split_drake.evaluation.judges import record_task, require_true_poses
from split_drake.evaluation.scenes import EvalSubject
from split_drake.evaluation.task_records import (
    TRIED_GRASPS,
    UNREACHABLE,
    Question,
    Ranking,
    record_grasps,
    record_handles,
    record_uprights,
)
from split_drake.grasps.free_hand import GraspOutcome
from split_drake.objects.task_object import TaskObject
from split_drake.pose_set import Acceptance, ScoredPoses
from split_drake.pose_task import GRASP, HANDLE, UPRIGHT, PoseTask, Symmetry, UnknownTaskError
from split_drake.poses import Array, make_pose, rotation_x, rotation_y, rotation_z
from tests.helpers.evaluation import standing, standing_mug


@pytest.fixture(scope="module")
def mug() -> EvalSubject:
    return standing_mug()


@pytest.fixture(scope="module")
def scene(mug: EvalSubject) -> ObjectScene:
    return mug.draw(np.random.default_rng(0))


def rank(X_WPs: Array, scores: list[float] | None = None, least: float = 0.3) -> Ranking:
    """Return a ranking of the poses, in their order where no scores are given."""
    ranks = np.linspace(0.9, 0.5, len(X_WPs)) if scores is None else np.array(scores)
    return Ranking(ScoredPoses(X_WPs, ranks), Acceptance(least, least))


@dataclass(frozen=True)
class Asked:
    """A mug in one scene, of which questions are asked."""

    mug: EvalSubject
    scene: ObjectScene

    def of(
        self, task: PoseTask, ranking: Ranking, rng: np.random.Generator | None = None
    ) -> Question:
        """Return the question how a task's samples are judged."""
        return Question(task, ranking, self.mug, self.scene, rng)

    def true(self, task: PoseTask) -> Array:
        """Return the true poses of a task."""
        return self.mug.shape.true_poses(task, self.scene.X_WO)

    def true_grasps(self) -> Array:
        """Return the true grasps."""
        assert self.mug.true_grasps is not None
        return self.mug.true_grasps.in_scene(self.scene)


@pytest.fixture
def asked(mug: EvalSubject, scene: ObjectScene) -> Asked:
    return Asked(mug, scene)


def test_the_top_ranked_handle_and_all_samples_are_judged(asked: Asked) -> None:
    X_WH, X_WHturned = asked.true(HANDLE)
    X_WHs = np.stack([X_WH @ make_pose(p=(0.1, 0.0, 0.0)), X_WHturned, X_WH])
    record = record_handles(asked.of(HANDLE, rank(X_WHs, scores=[0.5, 0.9, 0.1])))
    assert record.checks == {"top_good": True, "peg_clear": True, "peg_clear_axis": True}
    assert record.values["position_mm"] == pytest.approx(0.0, abs=1e-6)
    assert record.values["accepted"] == 2
    assert record.tallies == {"samples_good": (2, 3), "accepted_good": (1, 2)}
    assert (record.samples.good, record.samples.scores) == ("011", (0.5, 0.9, 0.1))


def test_a_peg_may_be_clear_where_the_pose_is_not_good(asked: Asked) -> None:
    X_WH = asked.true(HANDLE)[0]
    about_the_peg = X_WH @ make_pose(rotation_y(np.radians(40.0)))
    record = record_handles(asked.of(HANDLE, rank(about_the_peg[None])))
    assert record.checks == {"top_good": False, "peg_clear": True, "peg_clear_axis": True}
    assert record.values["axis_deg"] == pytest.approx(0.0, abs=1e-4)
    assert record.values["rotation_deg"] == pytest.approx(40.0)


def test_a_rejected_pose_passes_no_check_even_if_right(asked: Asked) -> None:
    X_WHs = asked.true(HANDLE)
    record = record_handles(asked.of(HANDLE, rank(X_WHs, least=0.999)))
    assert not any(record.checks.values())
    assert record.tallies == {"samples_good": (2, 2), "accepted_good": (0, 0)}


def test_the_axis_of_an_upright_pose_is_judged_apart_from_its_yaw(asked: Asked) -> None:
    X_WO = make_pose(rotation_x(1.0), (0.5, 0.0, 0.05))
    lying = Asked(asked.mug, replace(asked.scene, X_WO=X_WO))
    turned = X_WO @ make_pose(rotation_z(np.radians(60.0)), (0.0, 0.0, 0.004))
    record = record_uprights(lying.of(UPRIGHT, rank(turned[None])))
    assert record.checks == {"top_good": False, "axis_good": True, "axis_yaw_good": False}
    assert record.values["yaw_deg"] == pytest.approx(60.0)
    assert record.values["axis_deg"] == pytest.approx(0.0, abs=1e-4)
    tilted = X_WO @ make_pose(rotation_x(np.radians(16.0)))
    assert not any(record_uprights(lying.of(UPRIGHT, rank(tilted[None]))).checks.values())
    far = X_WO @ make_pose(p=(0.0, 0.011, 0.0))
    assert not any(record_uprights(lying.of(UPRIGHT, rank(far[None]))).checks.values())


def test_true_grasps_cover_themselves(asked: Asked) -> None:
    X_WGs = asked.true_grasps()
    assert len(X_WGs) >= 3
    record = record_grasps(asked.of(GRASP, rank(X_WGs)))
    assert record.tallies["coverage"] == (len(X_WGs), len(X_WGs))
    assert record.tried is None
    assert set(record.checks) == {"top_good", "enough_accepted"}
    above = X_WGs @ make_pose(p=(0.0, 0.0, -0.5))
    missed = record_grasps(asked.of(GRASP, rank(above)))
    assert missed.tallies["coverage"] == (0, len(X_WGs))


def test_enough_grasps_must_be_accepted(asked: Asked) -> None:
    X_WGs = np.repeat(asked.true_grasps()[:1], 30, axis=0)
    assert record_grasps(asked.of(GRASP, rank(X_WGs))).checks["enough_accepted"]
    assert not record_grasps(asked.of(GRASP, rank(X_WGs[1:]))).checks["enough_accepted"]


@dataclass
class CountingHand:
    """Says of each grasp that it slips, or holds where it lies at a place that was named."""

    p_WHeld: Array
    tried: list[Array] = field(default_factory=list)

    def try_in_scene(self, X_WO: Array, X_WG: Array, opening_m: float) -> GraspOutcome:
        assert 0.0 < opening_m <= 0.08
        self.tried.append(X_WG)
        holds = np.allclose(X_WG[:3, 3], self.p_WHeld)
        return GraspOutcome("" if holds else "slipped", 0.0, 0.0)


def test_some_accepted_grasps_are_tried_in_physics(
    asked: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = record_grasps(asked.of(GRASP, rank(asked.true_grasps()))).samples.flags
    held, slips = asked.true_grasps()[good][:2]
    X_WGs = np.stack([held] + [slips] * 3 + [held @ make_pose(rotation_x(np.pi))] * 12)
    hand = CountingHand(held[:3, 3])
    monkeypatch.setitem(asked.mug.__dict__, "hand", hand)
    record = record_grasps(asked.of(GRASP, rank(X_WGs), np.random.default_rng(0)))
    assert record.checks["top_holds"]
    hits, tried = record.tallies["tried_holds"]
    assert record.tried is not None
    assert (tried, len(record.tried.good)) == (TRIED_GRASPS, TRIED_GRASPS)
    slipped, unreachable = (record.tallies[f"tried_{f}"][0] for f in ("slipped", UNREACHABLE))
    assert hits + slipped + unreachable == TRIED_GRASPS
    assert unreachable > 0
    assert len(hand.tried) == 1 + hits + slipped  # what the hand cannot reach isn't simulated


def test_nothing_is_tried_where_nothing_is_accepted(
    asked: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    hand = CountingHand(np.zeros(3))
    monkeypatch.setitem(asked.mug.__dict__, "hand", hand)
    ranking = rank(asked.true_grasps(), least=0.999)
    record = record_grasps(asked.of(GRASP, ranking, np.random.default_rng(0)))
    assert record.checks["top_holds"] is False
    assert record.tallies["tried_holds"] == (0, 0)
    assert not hand.tried


def test_a_firm_grasp_holds_in_physics(asked: Asked) -> None:
    X_WGs = asked.true_grasps()
    steep = X_WGs[np.argsort(X_WGs[:, 2, 2])[:3]]
    record = record_grasps(asked.of(GRASP, rank(steep), np.random.default_rng(0)))
    assert record.tallies["tried_holds"][0] >= 1


LID = PoseTask("lid", Symmetry.any_turn("z"), "z along the thread")


@pytest.fixture(scope="module")
def jar(mug: EvalSubject) -> EvalSubject:
    """An object that is no mug, with poses of a task that no mug has."""
    X_OLid = make_pose(rotation_x(0.3), (0.0, 0.0, 0.08))
    X_OPs = {LID: X_OLid[None], HANDLE: mug.shape.poses_of(HANDLE)}
    return standing(TaskObject(body=mug.shape.body, X_OPs=X_OPs))


def test_any_task_is_judged_by_how_near_its_poses_are_to_true_ones(jar: EvalSubject) -> None:
    asked = Asked(jar, jar.draw(np.random.default_rng(0)))
    (X_WLid,) = asked.true(LID)
    turned = X_WLid @ make_pose(rotation_z(2.0), (0.0, 0.0, 0.004))
    tilted = X_WLid @ make_pose(rotation_x(np.radians(16.0)))
    record = record_task(asked.of(LID, rank(np.stack([turned, tilted]))))
    assert record.checks == {"top_good": True}
    assert record.values["position_mm"] == pytest.approx(4.0)
    assert record.values["rotation_deg"] == pytest.approx(0.0, abs=1e-4)
    assert record.tallies["samples_good"] == (1, 2)
    assert asked.scene.feature_points == NO_FEATURE
    with pytest.raises(UnknownTaskError, match=r"has no poses of .*upright"):
        record_task(asked.of(UPRIGHT, rank(turned[None])))


def test_what_has_no_handle_to_hang_by_is_tried_with_no_peg(jar: EvalSubject) -> None:
    asked = Asked(jar, jar.draw(np.random.default_rng(0)))
    assert jar.peg is None
    record = record_task(asked.of(HANDLE, rank(asked.true(HANDLE))))
    assert record.checks == {"top_good": True}
    assert record.tallies["samples_good"] == (2, 2)


def two_ways(mug: EvalSubject, task: PoseTask, X_PQ: Array) -> EvalSubject:
    """Return the body with a second true pose of a task, at X_PQ (4, 4) of the first."""
    (X_OP,) = mug.shape.poses_of(task)
    return standing(replace(mug.shape, X_OPs={task: np.stack([X_OP, X_OP @ X_PQ])}))


def test_an_upright_pose_is_compared_with_the_nearest_true_one(mug: EvalSubject) -> None:
    overturned = two_ways(mug, UPRIGHT, make_pose(rotation_x(np.pi), (0.0, 0.0, 0.1)))
    asked = Asked(overturned, overturned.draw(np.random.default_rng(0)))
    record = record_task(asked.of(UPRIGHT, rank(asked.true(UPRIGHT)[1:])))
    assert record.checks == {"top_good": True, "axis_good": True, "axis_yaw_good": True}
    assert record.values["axis_deg"] == pytest.approx(0.0, abs=1e-4)
    assert record.values["yaw_deg"] == pytest.approx(0.0, abs=1e-4)


def test_a_handle_pose_is_compared_with_the_nearest_true_one(mug: EvalSubject) -> None:
    askew = two_ways(mug, HANDLE, make_pose(rotation_z(1.0), (0.05, 0.0, 0.0)))
    asked = Asked(askew, askew.draw(np.random.default_rng(0)))
    record = record_task(asked.of(HANDLE, rank(asked.true(HANDLE)[1:2])))
    assert record.checks["top_good"]
    assert record.values["axis_deg"] == pytest.approx(0.0, abs=1e-4)


def test_true_poses_are_required_of_what_is_judged_by_them(jar: EvalSubject) -> None:
    require_true_poses((GRASP, LID, HANDLE), jar.shape)
    with pytest.raises(UnknownTaskError, match="has no poses of 'upright'; it has those of lid, h"):
        require_true_poses((LID, UPRIGHT), jar.shape)


def test_without_known_true_grasps_there_is_no_coverage(asked: Asked, jar: EvalSubject) -> None:
    record = record_task(Asked(jar, asked.scene).of(GRASP, rank(asked.true_grasps())))
    assert "coverage" not in record.tallies
    assert record.checks.keys() == {"top_good", "enough_accepted"}
