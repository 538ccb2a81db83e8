"""Detected poses compared with true ones."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from split_drake.data.rests import Rests
from split_drake.evaluation import scenes
from split_drake.evaluation.judgement import (
    direction_error_rad,
    judge_grasps,
    judge_poses,
    line_error_rad,
    yaw_error_rad,
)
from split_drake.evaluation.scenes import EvalSubject
from split_drake.grasps.judge import GraspJudge
from split_drake.grasps.sampling import sample_grasps
from split_drake.objects.mug_shape import MugShape
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_task import HANDLE, Symmetry
from split_drake.poses import Array, make_pose, rotation_x, rotation_y, rotation_z
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout

HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])


def test_poses_are_good_within_a_centimetre_and_fifteen_degrees_of_any_true_one() -> None:
    X_WH = make_pose(rotation_z(0.4), (0.5, 0.1, 0.05))
    offsets = [
        make_pose(rotation_x(np.radians(14.0)), (0.009, 0.0, 0.0)),
        make_pose(rotation_x(np.radians(16.0)), (0.0, 0.0, 0.0)),
        make_pose(p=(0.0, 0.011, 0.0)),
        HALF_TURN @ make_pose(rotation_y(np.radians(5.0)), (0.0, 0.0, 0.002)),
        make_pose(rotation_z(np.pi)),
    ]
    judgement = judge_poses(X_WH @ np.stack(offsets), X_WH[None], HANDLE.symmetry)
    assert judgement.good.tolist() == [True, False, False, True, False]
    assert judgement.position_m == pytest.approx([0.009, 0.0, 0.011, 0.002, 0.0], abs=1e-9)
    degrees = np.degrees(judgement.rotation_rad)
    assert degrees == pytest.approx([14.0, 16.0, 0.0, 5.0, 180.0], abs=1e-4)


def test_poses_are_compared_with_the_nearest_true_one_up_to_their_symmetry() -> None:
    X_WTruths = np.stack([np.eye(4), make_pose(rotation_x(1.0), (0.1, 0.0, 0.0))])
    X_WPs = X_WTruths @ make_pose(rotation_z(2.0), (0.001, 0.0, 0.0))
    as_they_are = judge_poses(X_WPs, X_WTruths, Symmetry())
    assert not as_they_are.good.any()
    assert as_they_are.rotation_rad == pytest.approx([2.0, 2.0])
    round_ones = judge_poses(X_WPs, X_WTruths, Symmetry.any_turn("z"))
    assert round_ones.good.all()
    assert round_ones.nearest.tolist() == [0, 1]
    assert round_ones.position_m == pytest.approx([0.001, 0.001])
    assert round_ones.rotation_rad == pytest.approx([0.0, 0.0], abs=1e-6)
    assert not judge_poses(X_WPs, X_WTruths, Symmetry.any_turn("x")).good.any()


@pytest.fixture(scope="module")
def mug() -> MugShape:
    return load_mug("test_000")


@pytest.fixture(scope="module")
def X_OGs(mug: MugShape) -> Array:
    """True grasps of the mug."""
    return sample_grasps(mug.body, np.random.default_rng(0), positives=60, negatives=3).X_OGs


def test_true_grasps_are_good_but_for_those_from_below(mug: MugShape, X_OGs: Array) -> None:
    X_WO = make_pose(rotation_z(1.0), (0.5, 0.0, 0.0))
    judgement = judge_grasps(X_WO @ X_OGs, GraspJudge(mug.body.mesh), X_WO, 0.0)
    from_above = X_OGs[:, 2, 2] < 0.0
    assert judgement.good[from_above].mean() > 0.6
    assert not judgement.good[~from_above].any()
    assert np.all(judgement.reachable[judgement.good])
    assert judgement.openings_m.shape == (60,)


def test_half_a_turn_of_the_hand_changes_no_verdict(mug: MugShape, X_OGs: Array) -> None:
    judge = GraspJudge(mug.body.mesh)
    one = judge_grasps(X_OGs, judge, np.eye(4), 0.0)
    other = judge_grasps(X_OGs @ make_pose(rotation_z(np.pi)), judge, np.eye(4), 0.0)
    assert (one.good == other.good).mean() > 0.95  # some lines meet an edge within rounding


def test_directions_differ_by_up_to_half_a_turn_and_lines_by_a_quarter() -> None:
    x, y = np.eye(3)[:2]
    assert direction_error_rad(np.stack([x, -x, y]), x) == pytest.approx([0.0, np.pi, np.pi / 2])
    assert line_error_rad(np.stack([x, -x, y]), x) == pytest.approx([0.0, 0.0, np.pi / 2])


@pytest.mark.parametrize("yaw_deg", [0.0, 20.0, -70.0, 179.0])
@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 90.0])
def test_yaw_is_told_apart_from_the_tilt_of_the_axis(yaw_deg: float, tilt_deg: float) -> None:
    R_WA = Rotation.from_euler("xyz", [0.3, -0.2, 1.1]).as_matrix()
    level = np.array([np.cos(0.7), np.sin(0.7), 0.0])
    tilt = Rotation.from_rotvec(np.radians(tilt_deg) * level).as_matrix()
    yaw = rotation_z(np.radians(yaw_deg))
    for R_AB in (tilt @ yaw, yaw @ tilt):
        assert np.degrees(yaw_error_rad(R_WA, R_WA @ R_AB)) == pytest.approx(abs(yaw_deg))
        axis = direction_error_rad(R_WA[:, 2], (R_WA @ R_AB)[:, 2])
        assert np.degrees(axis) == pytest.approx(tilt_deg, abs=1e-5)


def test_grasps_are_tried_on_the_table_of_the_subjects_layout(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[StationConfig] = []
    monkeypatch.setattr(scenes, "FreeHand", lambda body, config: asked.append(config))
    layout = Layout(p_WTable=(0.55, 0.9))
    shape = load_mug("test_000")
    _ = EvalSubject(shape, Rests(np.eye(4)[None], 1), layout, true_grasps=None).hand
    assert [config.layout for config in asked] == [layout]
