"""What the search for picks finds, and what it counts grasps as rejected by."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from planning.collision.exemptions import TABLE_LIFT_M
from planning.collision.world import CollisionWorld, Situation
from planning.geometry.perceived import PerceivedObject
from planning.geometry.waypoints import backed_off, shifted
from planning.motion.ik import DrakeIk
from planning.pick_place.fingers import MIN_CLEARANCE_M, FingerFit, fit_fingers
from planning.pick_place.pick import (
    APPROACHES_M,
    LIFTS_M,
    Pick,
    PickSearch,
    balance,
    firmness,
)
from split_drake.poses import Array, make_pose, rotation_x, rotation_y, transform_points
from split_drake.robot.gripper import PALM
from split_drake.robot.kinematics import gripper_poses
from split_drake.station.layout import Layout
from tests.helpers.planning import STANDING, mug_cloud, rim_grasps

X_WG = STANDING @ rim_grasps()[5]  # from straight above
CLOUD = transform_points(STANDING, mug_cloud())
FIT = fit_fingers(X_WG, CLOUD)


@cache
def world() -> CollisionWorld:
    return CollisionWorld(Layout())


def search(p_WExtra: Array | None = None) -> PickSearch:
    """Return a search for picks of the mug, and of a point that is taken for part of it."""
    points = CLOUD if p_WExtra is None else np.concatenate([CLOUD, [p_WExtra]])
    return PickSearch(world(), PerceivedObject.from_cloud(points, None, 0.0), DrakeIk())


def find(picks: PickSearch, X_WG: Array = X_WG, fit: FingerFit = FIT) -> Pick | None:
    return picks.find(X_WG, fit)


def in_hand(p_G: tuple[float, float, float]) -> Array:
    return transform_points(X_WG, np.array([p_G]))[0]


def test_a_pick_leads_from_the_pregrasp_to_the_grasp_and_straight_up() -> None:
    picks = search()
    pick = find(picks)
    assert pick is not None and not picks.rejected
    approach, lift = gripper_poses(pick.approach_qs), gripper_poses(pick.lift_qs)
    np.testing.assert_allclose(approach[0], backed_off(X_WG, APPROACHES_M[0]), atol=1e-5)
    for X_WGrasp in (approach[-1], lift[0]):
        np.testing.assert_allclose(X_WGrasp, X_WG, atol=1e-5)
    np.testing.assert_allclose(lift[-1], shifted(X_WG, (0.0, 0.0, LIFTS_M[0])), atol=1e-5)
    np.testing.assert_array_equal(pick.approach_qs[-1], pick.lift_qs[0])
    assert (pick.opening_m, pick.held_width_m) == (FIT.opening_m, FIT.held_width_m)


def test_the_table_may_be_touched_only_at_the_beginning_of_a_lift() -> None:
    pick = find(search())
    assert pick is not None
    assert pick.lifting.table_below_m == pytest.approx(X_WG[2, 3] + TABLE_LIFT_M)
    held = pick.held(PerceivedObject.from_cloud(CLOUD, None, 0.0).p_WObstacles)
    free = world().free(pick.lift_qs, Situation(pick.held_width_m, p_GHeld=held))
    assert not free[0] and free[-1], "it stands on the table, and hangs in the air"


def above_palm(height_m: float) -> Array:
    """Return a point that the palm passes through on its way, above it once at the grasp."""
    return in_hand((0.0, PALM.upper[1] - 0.005, PALM.lower[2] - height_m))


def beside(distance_m: float) -> tuple[PickSearch, Array, FingerFit]:
    """Return a search at a grasp that is so far above the wall that it should pinch."""
    X_WBeside = shifted(X_WG, (0.0, 0.0, distance_m))
    return search(), X_WBeside, fit_fingers(X_WBeside, CLOUD)


@pytest.mark.parametrize(
    ("reason", "spoilt"),
    [
        (
            "no opening clears the object",
            lambda: (search(), X_WG, replace(FIT, clearance_m=0.9 * MIN_CLEARANCE_M)),
        ),
        ("nothing between the pads", lambda: beside(0.05)),
        ("IK", lambda: (search(), make_pose(p=(1.0, 0.0, 0.0)) @ X_WG, FIT)),
        ("collision at the grasp", lambda: (search(in_hand((0.0, 0.0, -0.06))), X_WG, FIT)),
        ("collision on the approach", lambda: (search(above_palm(0.025)), X_WG, FIT)),
        # Straight below the peg is what is taken for a part of the mug.
        ("lift", lambda: (search(Layout().X_WK[:3, 3] - (0.0, 0.0, 0.04)), X_WG, FIT)),
    ],
)
def test_a_grasp_that_is_rejected_is_counted_once_by_its_reason(
    reason: str, spoilt: Callable[[], tuple[PickSearch, Array, FingerFit]]
) -> None:
    picks, X_WGrasp, fit = spoilt()
    assert find(picks, X_WGrasp, fit) is None
    assert picks.rejected == {reason: 1}
    assert find(picks, X_WGrasp, fit) is None
    assert picks.rejected == {reason: 2}


def test_a_shorter_approach_is_taken_where_the_longer_meets_something() -> None:
    """A point above the palm's way of 6 cm lies within that of 8 cm."""
    pick = find(search(above_palm(APPROACHES_M[0] - 0.008)))
    assert pick is not None
    start = gripper_poses(pick.approach_qs[:1])[0]
    np.testing.assert_allclose(start, backed_off(X_WG, APPROACHES_M[1]), atol=1e-5)


def test_grasps_from_above_with_a_short_lever_balance_best() -> None:
    target = PerceivedObject.from_cloud(CLOUD, None, 0.0)
    above = make_pose(rotation_x(np.pi), target.p_WCom)
    aside = above @ make_pose(p=(0.03, 0.0, 0.0))
    along_axis = above @ make_pose(p=(0.0, 0.03, 0.0))
    level = make_pose(rotation_y(np.pi / 2.0), target.p_WCom)
    from_below = make_pose(p=target.p_WCom)
    factors = balance(np.stack([above, along_axis, aside, level, from_below]), target)
    assert factors[:2] == pytest.approx([1.0, 1.0]), "the closing direction has no lever"
    assert factors[2] < 0.8
    assert factors[3:] == pytest.approx([0.6, 0.6]), "nothing below level is worse than level"


@pytest.mark.parametrize("name", ["pinch_depth_m", "clearance_m", "stem_room_m"])
def test_firmness_grows_with_each_of_what_it_is_made_of(name: str) -> None:
    fits = [replace(FIT, **{name: value}) for value in np.linspace(-0.002, 0.03, 40)]
    factors = firmness(fits)
    assert (np.diff(factors) >= 0.0).all()
    assert 0.0 < factors[0] < factors[-1] <= 1.0


@pytest.mark.parametrize(
    ("reason", "p_WExtra"),
    [
        ("collision at the grasp", in_hand((0.0, 0.0, -0.06))),
        ("collision on the approach", above_palm(0.025)),
        ("lift", Layout().X_WK[:3, 3] - (0.0, 0.0, 0.04)),
    ],
)
def test_what_the_hand_alone_cannot_do_is_never_asked_of_the_arm(
    reason: str, p_WExtra: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    def follow(q: Array, X_WGs: Array) -> None:
        raise AssertionError("the arm was asked")

    monkeypatch.setattr("planning.pick_place.pick.follow", follow)
    picks = search(p_WExtra)
    assert find(picks) is None
    assert picks.rejected == {reason: 1}


def test_what_the_arm_alone_collides_with_is_found_after_the_hand() -> None:
    p_WInWrist = in_hand((0.04, 0.0, -0.19))
    picks = search(p_WInWrist)
    obstacles = PerceivedObject.from_cloud(
        np.concatenate([CLOUD, [p_WInWrist]]), None, 0.0
    ).p_WObstacles
    assert world().poses_free(X_WG[None], Situation(0.08, p_WStanding=obstacles[-1:]))
    assert find(picks) is None
    assert picks.rejected == {"collision at the grasp": 1}
