"""What is believed of grasps of a thing that one has just failed to take."""

import numpy as np
import pytest

from scenarios.clutter.detection import clutter_detectors, ranked
from scenarios.clutter.doubt import Doubt
from split_drake.poses import Array, make_pose

DOUBT = Doubt(within_m=0.06, thing_m=0.18, least=0.7)
NOTHING = np.empty((0, 3))


def box_points(center: tuple[float, float, float], size_m: tuple[float, float, float]) -> Array:
    """Return points (N, 3) all over a box, 4 mm apart."""
    axes = [np.arange(-half, half + 1e-9, 0.004) for half in np.asarray(size_m) / 2.0]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3) + center


def test_grasps_near_a_failed_one_need_a_higher_score() -> None:
    X_WFailed = make_pose(p=(0.5, 0.0, 0.1))
    places = ((0.5, 0.0, 0.1), (0.55, 0.0, 0.1), (0.5, 0.0, 0.15), (0.57, 0.0, 0.1))
    found = ranked(np.stack([make_pose(p=p) for p in places]), [0.8, 0.7, 0.6, 0.5])
    assert DOUBT.believed(found, [X_WFailed], NOTHING).scores.tolist() == [0.8, 0.7, 0.5]
    another = make_pose(p=(0.6, 0.0, 0.1))
    believed = DOUBT.believed(found, [another, X_WFailed], NOTHING)
    assert believed.scores.tolist() == [0.8, 0.7]


@pytest.mark.parametrize(("length_m", "expected"), [(0.16, [0.4]), (0.24, [0.5, 0.4])])
def test_grasps_of_the_same_thing_need_one_too_unless_it_is_a_heap(
    length_m: float, expected: list[float]
) -> None:
    seen = np.concatenate(
        [
            box_points((0.5, 0.0, 0.02), (0.04, length_m, 0.04)),
            box_points((0.6, 0.0, 0.02), (0.04, 0.04, 0.04)),
        ]
    )
    failed, same, other = (
        make_pose(p=p) for p in ((0.5, -0.06, 0.02), (0.5, 0.06, 0.02), (0.6, 0.0, 0.02))
    )
    found = ranked(np.stack([same, other]), [0.5, 0.4])
    assert DOUBT.believed(found, [failed], seen).scores.tolist() == expected


def test_without_a_failure_all_are_believed() -> None:
    found = ranked(make_pose(p=(0.5, 0.0, 0.1))[None], [0.3])
    assert len(DOUBT.believed(found, (), NOTHING)) == 1
    assert len(DOUBT.believed(ranked(np.empty((0, 4, 4)), ()), [np.eye(4)], NOTHING)) == 0


@pytest.mark.parametrize("name", ["vgn", "giga", "se3dif", "oracle"])
def test_methods_of_others_keep_no_memory(name: str) -> None:
    assert clutter_detectors()[name].doubt is None
    assert clutter_detectors()["split"].doubt is not None
