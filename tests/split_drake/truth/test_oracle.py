"""The oracle's pose sets against the simulator's state."""

import numpy as np
import pytest

from split_drake.grasps.sampling import GraspLabels
from split_drake.objects.mug_shape import MugShape
from split_drake.objects.mugs.split import load_mug
from split_drake.objects.task_object import TaskObject
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, HANDLE, MUG_TASKS, PoseTask, Symmetry, UnknownTaskError
from split_drake.poses import Array, make_pose, rotation_x, rotation_z, transform_points
from split_drake.scene import Scene
from split_drake.station.station import Station
from split_drake.truth.oracle import OracleDetector
from split_drake.truth.state import Truth
from tests.helpers.stations import STATION

X_WO_STANDING = make_pose(rotation_z(0.7), (0.5, 0.03, 0.0))


@pytest.fixture(scope="module")
def mug() -> MugShape:
    return load_mug("train_001")


@pytest.fixture(scope="module")
def station(mug: MugShape) -> Station:
    station = Station(STATION, [mug.body])
    station.place_object(0, X_WO_STANDING)
    return station


def _rim_labels(mug: MugShape) -> GraspLabels:
    """Return grasps of the rim from above, and as many of the base from below the table."""
    height, radius = mug.body.mesh.bounds[1][2], mug.outer_diameter_m / 2.0
    angles = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    around = make_pose(np.stack([rotation_z(angle) for angle in angles]))
    from_above = around @ make_pose(rotation_x(np.pi), (radius, 0.0, height))
    from_below = around @ make_pose(p=(radius, 0.0, 0.0))
    X_OGs = np.concatenate([from_above, from_below])
    qualities = np.linspace(0.3, 0.9, len(X_OGs))
    return GraspLabels(X_OGs, np.full(len(X_OGs), 0.03), qualities, X_OGs[:0])


def _scene(station: Station) -> Scene:
    return Scene.from_views(station.capture(), station.config.layout.workspace)


def _detect(
    station: Station, mug: MugShape, max_grasps: int = 512
) -> tuple[Array, Array, dict[str, PoseSet]]:
    detector = OracleDetector(Truth(station), mug, _rim_labels(mug), max_grasps=max_grasps)
    sets = detector.detect(_scene(station), MUG_TASKS, np.random.default_rng(0))
    return sets["grasp"].X_WPs, sets["grasp"].scores, sets


def test_truth_is_what_was_placed(station: Station, mug: MugShape) -> None:
    truth = Truth(station)
    np.testing.assert_allclose(truth.X_WO(), X_WO_STANDING, atol=1e-12)
    expected = transform_points(X_WO_STANDING, mug.body.p_OCom[None])[0]
    np.testing.assert_allclose(truth.p_WCom(), expected, atol=1e-12)
    v, w = truth.velocity()
    assert not v.any()
    assert not w.any()


def test_free_fall_has_gravitys_velocity_and_no_contact(mug: MugShape) -> None:
    station = Station(STATION, [mug.body])
    station.place_object(0, make_pose(p=(0.5, 0.0, 0.5)))
    station.advance(0.1)
    truth = Truth(station)
    np.testing.assert_allclose(truth.velocity()[0], [0.0, 0.0, -0.981], atol=1e-6)
    assert truth.touching() == frozenset()


def test_handle_and_upright_sets_are_the_true_poses(station: Station, mug: MugShape) -> None:
    _, _, sets = _detect(station, mug)
    handle, upright = sets["handle"], sets["upright"]
    np.testing.assert_allclose(handle.X_WPs, mug.true_poses(HANDLE, X_WO_STANDING), atol=1e-12)
    np.testing.assert_allclose(upright.X_WPs, X_WO_STANDING[None], atol=1e-12)
    assert handle.scores.tolist() == [1.0, 1.0]
    assert upright.scores.tolist() == [1.0]


def test_grasps_through_the_table_are_left_out(station: Station, mug: MugShape) -> None:
    X_WGs, scores, _ = _detect(station, mug)
    labels = _rim_labels(mug)
    assert len(X_WGs) == 12
    assert X_WGs[:, 2, 2].max() < -0.99, "they approach from above"
    np.testing.assert_allclose(scores, np.sort(labels.qualities[:12])[::-1])
    np.testing.assert_allclose(X_WGs[0], X_WO_STANDING @ labels.X_OGs[11], atol=1e-12)


def test_no_more_grasps_than_asked_for(station: Station, mug: MugShape) -> None:
    X_WGs, scores, _ = _detect(station, mug, max_grasps=5)
    assert len(X_WGs) == 5
    assert len(np.unique(scores)) == 5


def test_what_an_object_has_of_its_own_tasks_is_found_where_it_is(
    station: Station, mug: MugShape
) -> None:
    rim = PoseTask("rim", Symmetry.any_turn("z"), "z up, in the middle of the rim")
    X_ORims = make_pose(p=(0.0, 0.0, mug.body.mesh.bounds[1][2]))[None]
    cup = TaskObject(body=mug.body, X_OPs={rim: X_ORims})
    detector = OracleDetector(Truth(station), cup, _rim_labels(mug))
    assert detector.tasks == (GRASP, rim)
    rng, scene = np.random.default_rng(0), _scene(station)
    found = detector.detect(scene, ("rim",), rng)["rim"]
    assert found.task == rim
    np.testing.assert_allclose(found.X_WPs, X_WO_STANDING @ X_ORims, atol=1e-12)
    assert found.scores.tolist() == [1.0]
    with pytest.raises(UnknownTaskError, match="train_001 has no task 'handle'; it has grasp, rim"):
        detector.detect(scene, (HANDLE,), rng)
