"""Grasp labels: the judge on plain shapes, and the labels of mugs against independent checks."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from split_drake.grasps.judge import (
    CONE_RAD,
    MIN_QUALITY,
    TABLE_CLEARANCE_M,
    GraspJudge,
    feasible,
    opening_for,
)
from split_drake.grasps.sampling import (
    CLEARLY_WEAK,
    GraspLabels,
    check_grasps,
    false_grasps,
    sample_grasps,
)
from split_drake.objects.mug_shape import MugShape
from split_drake.objects.mugs.split import load_mug
from split_drake.poses import (
    Array,
    invert_pose,
    make_pose,
    rotation_x,
    rotation_z,
    transform_points,
)
from split_drake.robot.gripper import MAX_OPENING_M, PAD_SIZE_M, gripper_boxes

DOWN = rotation_x(np.pi)


@pytest.fixture(scope="module")
def block() -> GraspJudge:
    """A judge of a block of 3 cm, 10 cm tall, about the origin."""
    return GraspJudge(trimesh.creation.box((0.03, 0.03, 0.10)))


def from_above(depth_m: float, turn_rad: float = 0.0) -> Array:
    """Return (1, 4, 4) a grasp of the block whose pads' tips are `depth_m` below its top."""
    z = 0.05 + PAD_SIZE_M[1] / 2 - depth_m
    return make_pose(rotation_z(turn_rad) @ DOWN, (0.0, 0.0, z))[None]


def quality(judge: GraspJudge, X_OGs: Array, opening_m: float = 0.054) -> float:
    """Return the quality of the one grasp in `X_OGs`."""
    return float(judge.qualities(X_OGs, np.full(len(X_OGs), opening_m))[0])


def test_full_pads_are_as_good_as_it_gets(block: GraspJudge) -> None:
    assert quality(block, from_above(0.03)) == pytest.approx(1.0, abs=0.06)


def test_quality_falls_with_the_depth_of_the_pinch(block: GraspJudge) -> None:
    qualities = [quality(block, from_above(depth)) for depth in (0.022, 0.012, 0.008, 0.003)]
    assert qualities == sorted(qualities, reverse=True)
    assert qualities[1] > MIN_QUALITY > qualities[3]
    assert quality(block, from_above(-0.002)) == 0.0


def test_thin_rods_count_only_in_the_middle_of_the_pads() -> None:
    rod = GraspJudge(trimesh.creation.box((0.2, 0.006, 0.006)))
    centered, at_the_tip = make_pose(DOWN)[None], make_pose(DOWN, (0.0, 0.0, 0.009))[None]
    assert quality(rod, centered, 0.03) > MIN_QUALITY > quality(rod, at_the_tip, 0.03)


def test_contacts_outside_the_friction_cone_do_not_count(block: GraspJudge) -> None:
    wedge = trimesh.creation.cone(radius=0.03, height=0.06)  # Flanks of 27 degrees, beyond 17.
    assert np.arctan(0.5) > CONE_RAD
    assert quality(GraspJudge(wedge), make_pose(DOWN, (0.0, 0.0, 0.02))[None], 0.08) == 0.0
    assert quality(block, from_above(0.03, np.radians(10))) > MIN_QUALITY
    assert quality(block, from_above(0.03, np.radians(30))) == 0.0


def test_half_turn_is_the_same_grasp(block: GraspJudge) -> None:
    X_OG = from_above(0.012, 0.1)
    turned = X_OG @ make_pose(rotation_z(np.pi))
    assert quality(block, turned) == pytest.approx(quality(block, X_OG))


def test_hands_that_hit_the_object_collide(block: GraspJudge) -> None:
    def collides(X_OGs: Array, opening_m: float) -> bool:
        return bool(block.collides(X_OGs, np.array([opening_m]))[0])

    assert not collides(from_above(0.03), 0.054)
    assert collides(from_above(0.03), 0.020)  # Too little opened: pads inside the block.
    assert collides(from_above(0.09), 0.054)  # Too deep: the palm is.
    from_below_through = make_pose(np.eye(3), (0.0, 0.0, 0.12))[None]
    assert collides(from_below_through, 0.054)  # Free at the end, but not on the way.


def test_check_finds_an_opening_that_works(block: GraspJudge) -> None:
    check = block.check(np.concatenate([from_above(0.02), from_above(-0.05), from_above(0.09)]))
    assert check.good.tolist() == [True, False, False]
    assert 0.03 < check.openings_m[0] <= MAX_OPENING_M
    assert check.qualities[1] == 0.0
    assert check.collides[2]


def test_openings_leave_room_within_what_the_hand_can_do() -> None:
    assert opening_for(np.array([0.004, 0.07])).tolist() == pytest.approx([0.028, MAX_OPENING_M])


def test_feasible_grasps_clear_the_table_from_above() -> None:
    half = PAD_SIZE_M[1] / 2
    heights = [half + TABLE_CLEARANCE_M + 1e-4, half + TABLE_CLEARANCE_M - 1e-4]
    X_OGs = np.stack([*(make_pose(DOWN, (0, 0, z)) for z in heights), make_pose(p=(0, 0, 1.0))])
    assert feasible(np.eye(4), X_OGs, np.full(3, 0.04), 0.0).tolist() == [True, False, False]
    raised = make_pose(p=(0.5, 0.0, 0.01))
    assert feasible(raised, X_OGs, np.full(3, 0.04), 0.0).tolist() == [True, True, False]


def test_feasible_counts_the_whole_hand() -> None:
    """A level hand, its fingers closing upwards, has half a palm below it."""
    level = make_pose(np.column_stack([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]), (0, 0, 0.08))
    slightly_down = level @ make_pose(rotation_x(0.05))
    X_OGs = np.stack([slightly_down, make_pose(p=(0.0, 0.0, 0.08)) @ slightly_down])
    assert (X_OGs[:, 2, 2] < 0.0).all()
    assert feasible(np.eye(4), X_OGs, np.full(2, 0.04), 0.0).tolist() == [False, True]


@pytest.fixture(scope="module", params=["train_006", "test_001"])
def mug(request: pytest.FixtureRequest) -> MugShape:
    return load_mug(request.param)


@pytest.fixture(scope="module")
def labels(mug: MugShape) -> GraspLabels:
    return sample_grasps(mug.body, np.random.default_rng(0), positives=800, negatives=200)


def test_labels_are_enough_and_in_range(labels: GraspLabels) -> None:
    assert 300 < len(labels.X_OGs) <= 800
    assert len(labels.X_OGnegatives) > 150
    assert (labels.qualities >= MIN_QUALITY).all()
    assert (labels.qualities <= 1.0).all()
    assert (labels.openings_m <= MAX_OPENING_M).all()
    R = labels.X_OGs[:, :3, :3]
    assert np.allclose(R @ R.swapaxes(1, 2), np.eye(3), atol=1e-9)
    assert np.allclose(np.linalg.det(R), 1.0)


def test_positives_pinch_material_between_free_fingers(mug: MugShape, labels: GraspLabels) -> None:
    """Points inside the mesh lie between the pads; none of its surface lies in the hand."""
    mesh = mug.body.mesh
    p_OPs = np.random.default_rng(1).permutation(mesh.vertices)[:1500]
    for X_OG, opening_m in zip(labels.X_OGs[::20], labels.openings_m[::20], strict=True):
        across = np.linspace(-opening_m / 2, opening_m / 2, 81)[:, None] * (0.0, 1.0, 0.0)
        inside = mesh.contains(transform_points(X_OG, across))
        assert inside.any()
        assert not inside[[0, -1]].any()
        p_GPs = transform_points(invert_pose(X_OG), p_OPs)
        for box in gripper_boxes(float(opening_m)):
            deep = (p_GPs > np.add(box.lower, 0.002)) & (p_GPs < np.subtract(box.upper, 0.002))
            assert deep.all(axis=1).mean() < 0.002


def test_positives_stay_good_and_negatives_bad_when_checked(
    mug: MugShape, labels: GraspLabels
) -> None:
    assert check_grasps(mug.body, labels.X_OGs).good.mean() > 0.97
    assert check_grasps(mug.body, labels.X_OGnegatives).good.mean() < 0.03


def test_false_grasps_fail_by_far(mug: MugShape, labels: GraspLabels) -> None:
    false = false_grasps(mug.body, labels.X_OGs, 120, np.random.default_rng(0))
    assert 100 < len(false.X_OGs) <= 120
    check = GraspJudge(mug.body.mesh).check_opened(false.X_OGs, false.openings_m)
    assert (check.collides | (check.qualities < CLEARLY_WEAK)).all()
    assert check.collides.any()
    assert (check.qualities[~check.collides] < CLEARLY_WEAK).any()
    nearest_m = np.linalg.norm(
        false.X_OGs[:, None, :3, 3] - labels.X_OGs[None, :, :3, 3], axis=-1
    ).min(axis=1)
    assert np.median(nearest_m) < 0.03


def test_narrow_mugs_are_grasped_by_rim_body_and_handle() -> None:
    mug = load_mug("train_006")
    labels = sample_grasps(mug.body, np.random.default_rng(0))
    widths = labels.openings_m - opening_for(np.zeros(1))
    radius = np.hypot(labels.X_OGs[:, 0, 3], labels.X_OGs[:, 1, 3])
    on_handle = radius > mug.outer_diameter_m / 2
    assert on_handle.sum() > 30
    assert (widths > 0.03).sum() > 100
    assert ((widths < 0.008) & ~on_handle).sum() > 100


def test_labels_follow_the_seed(mug: MugShape, labels: GraspLabels) -> None:
    again = sample_grasps(mug.body, np.random.default_rng(0), positives=800, negatives=200)
    assert np.array_equal(labels.X_OGs, again.X_OGs)
    assert np.array_equal(labels.X_OGnegatives, again.X_OGnegatives)


def test_objects_too_wide_to_grasp_are_named(mug: MugShape) -> None:
    ball = trimesh.creation.icosphere(radius=0.1)
    big = replace(mug.body, name="big_ball", mesh=ball)
    with pytest.raises(ValueError, match="big_ball has no grasp among 0 candidates"):
        sample_grasps(big, np.random.default_rng(0))
