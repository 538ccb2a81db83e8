"""Which grasps are true in a scene of clutter."""

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from split_drake.data.clutter.labels import clears_table, hand_hits, label_scene, visible
from split_drake.data.clutter.library import ClutterObject
from split_drake.poses import Array, make_pose, rotation_x, transform_points

DOWN = rotation_x(np.pi)


def at(*p: float) -> Array:
    """Return one grasp (1, 4, 4) from straight above."""
    return make_pose(DOWN, p)[None]


def surface(each: ClutterObject, X_WO: Array) -> Array:
    points, _ = trimesh.sample.sample_surface(each.body.mesh, 3000, seed=1)
    return transform_points(X_WO, np.asarray(points))


def test_points_between_the_pads_are_no_obstacle_and_points_where_fingers_go_are() -> None:
    X_WG = at(0.0, 0.0, 0.1)
    between, at_finger = np.array([[0.0, 0.02, 0.1]]), np.array([[0.0, 0.047, 0.1]])
    on_the_way = np.array([[0.0, -0.047, 0.15]])
    below, beside_palm = np.array([[0.0, 0.0, 0.05]]), np.array([[0.06, 0.0, 0.2]])
    hits = [hand_hits(X_WG, p)[0] for p in (between, at_finger, on_the_way, below, beside_palm)]
    assert hits == [False, True, True, False, False]


def test_hands_in_the_table_or_from_below_are_refused() -> None:
    X_WGs = np.concatenate(
        [at(0.0, 0.0, 0.02), at(0.0, 0.0, 0.005), make_pose(p=(0, 0, 0.3))[None]]
    )
    assert clears_table(X_WGs, 0.0).tolist() == [True, False, False]


def test_a_grasp_is_visible_where_the_cloud_shows_what_it_pinches() -> None:
    low, high = (-0.01, -0.01, 0.09), (0.01, 0.01, 0.11)
    cloud = np.random.default_rng(0).uniform(low, high, (20, 3))
    X_WGs = np.concatenate([at(0.0, 0.0, 0.1), at(0.0, 0.0, 0.2)])
    assert visible(X_WGs, cloud, cKDTree(cloud)).tolist() == [True, False]
    few = cloud[:3]
    assert visible(X_WGs, few, cKDTree(few)).tolist() == [False, False]
    assert visible(np.empty((0, 4, 4)), few, cKDTree(few)).tolist() == []


def test_a_neighbour_takes_away_the_grasps_that_it_stands_in_the_way_of(bar: ClutterObject) -> None:
    X_WO = make_pose(p=(0.5, 0.0, 0.025))
    beside = make_pose(p=(0.5 + 0.045, 0.0, 0.025))
    alone = label_scene([bar], X_WO[None], surface(bar, X_WO), 0.0, np.random.default_rng(0))
    both_X_WOs = np.stack([X_WO, beside])
    cloud = np.concatenate([surface(bar, each) for each in both_X_WOs])
    both = label_scene([bar, bar], both_X_WOs, cloud, 0.0, np.random.default_rng(0))

    def across_x(X_WGs: Array) -> int:
        return int((np.abs(X_WGs[:, 0, 1]) > 0.9).sum())

    assert across_x(alone.X_WGs) > 10
    assert across_x(both.X_WGs) == 0, "the gap is 5 mm, a finger is 14 mm thick"
    assert len(both.X_WFs) > len(alone.X_WFs)


def test_true_grasps_hit_no_other_object(bar: ClutterObject, can: ClutterObject) -> None:
    X_WOs = np.stack([make_pose(p=(0.46, 0.0, 0.025)), make_pose(p=(0.54, 0.02, 0.0))])
    clouds = [surface(each, X_WO) for each, X_WO in zip((bar, can), X_WOs, strict=True)]
    rng = np.random.default_rng(0)
    grasps = label_scene([bar, can], X_WOs, np.concatenate(clouds), 0.0, rng)
    nearer_bar = np.linalg.norm(grasps.X_WGs[:, :2, 3] - X_WOs[0, :2, 3], axis=1) < 0.04
    assert 0 < nearer_bar.sum() < len(nearer_bar)
    surfaces = [transform_points(X, e.p_OSurface) for e, X in zip((bar, can), X_WOs, strict=True)]
    assert not hand_hits(grasps.X_WGs[nearer_bar], surfaces[1]).any()
    assert clears_table(grasps.X_WGs, 0.0).all()
    assert len(grasps.weights) == len(grasps.X_WGs)


def test_what_is_not_seen_is_not_true(bar: ClutterObject) -> None:
    X_WO = make_pose(p=(0.5, 0.0, 0.025))
    elsewhere = surface(bar, make_pose(p=(0.6, 0.1, 0.025)))
    grasps = label_scene([bar], X_WO[None], elsewhere, 0.0, np.random.default_rng(0))
    assert len(grasps.X_WGs) == 0
    assert len(grasps.X_WFs) > 0
