"""Where a wide-open hand stops in a scene, and what it closes on there."""

import numpy as np
import pytest
import trimesh

from split_drake.grasps.clutter_judge import PREGRASP_M, ClutterJudge
from split_drake.grasps.judge import GraspJudge
from split_drake.poses import Array, make_pose, rotation_x, rotation_z
from split_drake.robot.gripper import MAX_OPENING_M

DOWN = rotation_x(np.pi)
TABLE_Z_M = 0.0


def bar(x: float = 0.0, width_m: float = 0.04, height_m: float = 0.06) -> trimesh.Trimesh:
    """Return a bar along x that stands on the table; the hand closes across y."""
    box = trimesh.creation.box((0.1, width_m, height_m))
    return box.apply_transform(make_pose(p=(x, 0.0, height_m / 2.0)))


def down_at(*p: float) -> Array:
    return make_pose(DOWN, p)[None]


def test_a_free_hand_goes_all_the_way_and_holds() -> None:
    check = ClutterJudge(bar(), TABLE_Z_M).check(down_at(0.0, 0.0, 0.04))
    assert check.short_m[0] == 0.0
    assert check.widths_m[0] == pytest.approx(0.04, abs=1e-4)
    assert check.good[0]


def test_the_table_stops_a_hand_that_reaches_below_it() -> None:
    judge = ClutterJudge(bar(height_m=0.03), TABLE_Z_M)
    check = judge.check(np.concatenate([down_at(0.0, 0.0, 0.02), down_at(0.0, 0.0, 0.0)]))
    assert check.short_m[1] == pytest.approx(0.011, abs=1.5e-3), "pads reach 11 mm beyond G"
    assert check.good.tolist() == [True, True]


def test_what_stands_under_a_finger_stops_the_hand_above_it() -> None:
    low = trimesh.creation.box((0.02, 0.02, 0.05))
    low.apply_transform(make_pose(p=(0.0, 0.048, 0.025)))
    judge = ClutterJudge(trimesh.util.concatenate([bar(), low]), TABLE_Z_M)
    check = judge.check(down_at(0.0, 0.0, 0.045))
    assert check.short_m[0] == pytest.approx(0.05 - (0.045 - 0.011), abs=2.5e-3)
    assert check.good[0], "its pads still close on the bar's top"
    taller = ClutterJudge(trimesh.util.concatenate([bar(height_m=0.04), low]), TABLE_Z_M)
    assert not taller.check(down_at(0.0, 0.0, 0.035)).good[0], "it stops above the bar"


def test_nothing_between_the_pads_and_walls_too_thin_are_no_grasps() -> None:
    away = down_at(0.0, 0.2, 0.04)
    check = ClutterJudge(bar(), TABLE_Z_M).check(away)
    assert (check.widths_m[0], check.good[0]) == (0.0, False)
    thin = ClutterJudge(bar(width_m=0.006), TABLE_Z_M).check(down_at(0.0, 0.0, 0.04))
    assert thin.widths_m[0] == pytest.approx(0.006, abs=1e-4)
    assert not thin.good[0]


def test_a_hand_that_cannot_start_is_no_grasp() -> None:
    tall = bar(width_m=0.1, height_m=0.2)
    check = ClutterJudge(tall, TABLE_Z_M).check(down_at(0.0, 0.0, 0.1))
    assert check.short_m[0] == pytest.approx(PREGRASP_M)
    assert not check.good[0]


def test_no_grasps_make_an_empty_check() -> None:
    check = ClutterJudge(bar(), TABLE_Z_M).check(np.empty((0, 4, 4)))
    assert (len(check.short_m), len(check.good)) == (0, 0)


def test_each_pad_stops_at_what_it_meets() -> None:
    judge = GraspJudge(bar())
    X_WGs = np.concatenate([down_at(0.0, 0.01, 0.04), down_at(0.0, 0.3, 0.04)])
    widths = judge.closed_widths(X_WGs, np.full(2, MAX_OPENING_M))
    np.testing.assert_allclose(widths, [0.04, 0.0], atol=1e-4)


def test_what_is_pinched_askew_is_as_thin_as_it_is_flat() -> None:
    wall = bar(width_m=0.008)
    askew = make_pose(DOWN @ rotation_z(np.radians(20.0)), (0.0, 0.0, 0.04))[None]
    judge, wide = GraspJudge(wall), np.full(1, MAX_OPENING_M)
    assert judge.closed_widths(askew, wide)[0] > 0.0085
    assert judge.settled_widths(askew, wide)[0] == pytest.approx(0.008, abs=7e-4)
    thick = GraspJudge(bar())
    np.testing.assert_array_equal(
        thick.settled_widths(askew, wide), thick.closed_widths(askew, wide)
    )
