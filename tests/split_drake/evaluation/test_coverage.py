"""How many true grasps were found."""

import numpy as np
from scipy.spatial.transform import Rotation

from split_drake.evaluation.judgement import covered
from split_drake.poses import Array, make_pose, rotation_x, rotation_z

NONE = np.zeros((0, 4, 4))


def grasps(count: int, seed: int = 0) -> Array:
    """Return random grasps spread over a cube of 20 cm."""
    rng = np.random.default_rng(seed)
    R_WGs = Rotation.random(count, rng=rng).as_matrix()
    return make_pose(R_WGs, rng.uniform(-0.1, 0.1, (count, 3)))


def test_a_set_covers_itself_and_its_half_turns() -> None:
    X_WGs = grasps(50)
    assert covered(X_WGs, X_WGs).all()
    assert covered(X_WGs, X_WGs[::-1] @ make_pose(rotation_z(np.pi))).all()


def test_only_grasps_within_two_centimetres_and_twenty_degrees_count() -> None:
    X_WGs = grasps(20)
    lone = np.eye(4)[None]
    near = make_pose(rotation_x(np.radians(19.0)), (0.0, 0.0, 0.019))
    assert covered(X_WGs, X_WGs @ near).all()
    assert not covered(lone, lone @ make_pose(p=(0.0, 0.0, 0.021))).any()
    assert not covered(lone, lone @ make_pose(rotation_x(np.radians(21.0)))).any()
    assert not covered(lone, lone @ make_pose(rotation_z(np.pi / 2.0))).any()


def test_place_and_direction_must_fit_the_same_grasp() -> None:
    there, elsewhere = np.eye(4), make_pose(rotation_x(1.0), (0.1, 0.0, 0.0))
    mixed = [make_pose(rotation_x(1.0)), make_pose(p=(0.1, 0.0, 0.0))]
    assert not covered(np.stack([there, elsewhere]), np.stack(mixed)).any()


def test_more_grasps_cover_no_less_and_none_cover_nothing() -> None:
    X_WTruths, X_WGs = grasps(200), grasps(20_000, seed=1)
    few, many = covered(X_WTruths, X_WGs[:5000]), covered(X_WTruths, X_WGs)
    assert many[few].all()
    assert many.sum() > few.sum() > 0
    assert not covered(X_WTruths, NONE).any()
    assert covered(NONE, X_WGs).shape == (0,)
