"""Modes, pairs and placements: each once, best first, where the cloud leaves room."""

from dataclasses import replace

import numpy as np
import pytest

from planning.collision.exemptions import TABLE_ERROR_M
from planning.geometry.modes import away_from, distinct_modes, mode_means
from planning.geometry.perceived import PerceivedObject
from planning.goals.hang import (
    GOOD_AXIS_CLEARANCE_M,
    HANG_THETAS_RAD,
    MAX_AXIS_SHIFT_M,
    freest_axis,
    hang_placements,
)
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.goals.upright import upright_placements
from planning.pick_place.pairs import BestPairs
from planning.subgoal import PlacementQuery
from split_drake.pose_set import PoseSet
from split_drake.pose_task import HANDLE, UPRIGHT, PoseTask, Symmetry
from split_drake.poses import Array, make_pose, rotation_x, rotation_z, transform_points
from tests.helpers.planning import STANDING, mug_problem


def ring(radius_m: float) -> Array:
    """Return points of an opening's edge around y_H."""
    angle, y = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 72), np.linspace(-0.01, 0.01, 5))
    return np.column_stack(
        [radius_m * np.cos(angle).ravel(), y.ravel(), radius_m * np.sin(angle).ravel()]
    )


def test_an_axis_beside_the_middle_is_moved_to_where_the_peg_has_room() -> None:
    X_WH = make_pose(rotation_z(0.4), (0.5, 0.1, 0.05))
    edge = transform_points(X_WH, ring(0.011))
    off = X_WH @ make_pose(p=(0.004, 0.0, -0.005))
    moved, room = freest_axis(off, edge)
    assert room >= GOOD_AXIS_CLEARANCE_M
    assert np.linalg.norm(moved[:3, 3] - X_WH[:3, 3]) < 0.003
    np.testing.assert_array_equal(moved[:3, :3], off[:3, :3])
    untouched, _ = freest_axis(X_WH, edge)
    np.testing.assert_allclose(untouched, X_WH, atol=1e-12)


def test_an_axis_is_moved_within_the_openings_plane_and_not_far() -> None:
    X_WH = make_pose(rotation_z(0.4), (0.5, 0.1, 0.05))
    beyond = transform_points(X_WH, np.add(ring(0.010), (0.02, 0.0, 0.0)))
    moved, room = freest_axis(X_WH, beyond)
    p_HMoved = transform_points(np.linalg.inv(X_WH), moved[None, :3, 3])[0]
    assert np.linalg.norm(p_HMoved) <= MAX_AXIS_SHIFT_M + 1e-9
    assert abs(p_HMoved[1]) < 1e-12
    gaps = np.linalg.norm(transform_points(np.linalg.inv(moved), beyond)[:, [0, 2]], axis=1)
    assert room == pytest.approx(gaps.min())


def test_an_object_that_reaches_below_its_detected_base_is_placed_higher() -> None:
    problem = mug_problem(REORIENT, STANDING)
    target = PerceivedObject.from_cloud(problem.p_WPs, STANDING, 0.0)
    too_high = STANDING @ make_pose(p=(0.0, 0.0, 0.03))
    wrong = PoseSet(UPRIGHT, too_high[None], np.ones(1))
    known = PlacementQuery(problem.pose_sets["upright"], target, problem.layout, in_hand=False)
    true_heights = {g.X_WOgoal[2, 3] for g in upright_placements(known)}
    heights = {g.X_WOgoal[2, 3] for g in upright_placements(replace(known, poses=wrong))}
    assert true_heights == {0.0}
    assert min(heights) == pytest.approx(0.03 - TABLE_ERROR_M, abs=1e-3)


def test_pairs_come_best_first_and_whole_rows_can_be_dropped() -> None:
    pairs = BestPairs([0.5, 1.0], [0.2, 0.9, 0.5])
    everything = list(pairs)
    products = [[0.5, 1.0][row] * [0.2, 0.9, 0.5][column] for row, column in everything]
    assert products == sorted(products, reverse=True)
    assert len(set(everything)) == 6
    pairs = BestPairs([0.5, 1.0], [0.2, 0.9, 0.5])
    kept = []
    for row, column in pairs:
        kept.append((row, column))
        if row == 1:
            pairs.drop_row(1)
    assert [row for row, _ in kept].count(1) == 1
    assert list(BestPairs([1.0], [])) == []


def test_modes_are_apart() -> None:
    near, far = make_pose(p=(0.001, 0.0, 0.0)), make_pose(p=(0.1, 0.0, 0.0))
    assert distinct_modes(np.stack([np.eye(4), near, far]), 3, Symmetry()) == [0, 2]
    assert distinct_modes(np.stack([np.eye(4), near, far]), 1, Symmetry()) == [0]


def test_poses_that_differ_by_their_symmetry_are_one_mode() -> None:
    X_WH = make_pose(rotation_z(0.3), (0.5, 0.0, 0.1))
    flips = np.stack([X_WH, X_WH @ HANDLE.symmetry.X_half_turn])
    assert distinct_modes(flips, 2, Symmetry()) == [0, 1]
    assert distinct_modes(flips, 2, HANDLE.symmetry) == [0]
    near = X_WH @ make_pose(rotation_z(0.1), (0.002, 0.0, 0.0)) @ HANDLE.symmetry.X_half_turn
    both = PoseSet(HANDLE, np.stack([X_WH, near]), np.ones(2))
    [(mean, score)] = mode_means(both, 4)
    expected = X_WH @ make_pose(rotation_z(0.05), (0.001, 0.0, 0.0))
    np.testing.assert_allclose(mean, expected, atol=1e-6)
    assert score == 1.0


def test_poses_that_differ_by_any_turn_are_one_mode() -> None:
    lid = PoseTask("lid", Symmetry.any_turn("z"))
    X_WL = make_pose(rotation_x(0.4), (0.5, 0.0, 0.1))
    turned = X_WL @ np.stack([make_pose(rotation_z(turn)) for turn in (0.0, 1.0, 2.5)])
    assert distinct_modes(turned, 3, Symmetry()) == [0, 1, 2]
    assert distinct_modes(turned, 3, lid.symmetry) == [0]
    [(mean, _)] = mode_means(PoseSet(lid, turned, np.ones(3)), 4)
    np.testing.assert_allclose(mean, X_WL, atol=1e-9)
    assert not away_from(turned, X_WL[None], lid.symmetry).any()
    assert away_from(turned, X_WL[None], Symmetry()).tolist() == [False, True, True]


def test_hang_placements_hold_no_duplicates() -> None:
    problem = mug_problem(HANG, STANDING)
    target = PerceivedObject.from_cloud(problem.p_WPs, STANDING, 0.0)
    query = PlacementQuery(problem.pose_sets["handle"], target, problem.layout, in_hand=False)
    found = hang_placements(query)
    X_GoalOs = np.stack([g.X_WOgoal @ np.linalg.inv(g.X_WO) for g in found])
    assert len(found) == 2 * len(HANG_THETAS_RAD)
    differences = np.abs(X_GoalOs[:, None] - X_GoalOs[None]).max(axis=(2, 3))
    assert differences[~np.eye(len(found), dtype=bool)].min() > 1e-3
