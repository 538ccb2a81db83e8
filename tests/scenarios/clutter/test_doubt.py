"""What is believed of grasps beside one that failed."""

import numpy as np
import pytest

from scenarios.clutter.detection import clutter_detectors, ranked
from scenarios.clutter.doubt import Doubt
from split_drake.poses import make_pose

DOUBT = Doubt(within_m=0.06, least=0.7)


def test_grasps_beside_a_failed_one_need_a_higher_score() -> None:
    X_WFailed = make_pose(p=(0.5, 0.0, 0.1))
    places = ((0.5, 0.0, 0.1), (0.55, 0.0, 0.1), (0.5, 0.0, 0.15), (0.57, 0.0, 0.1))
    found = ranked(np.stack([make_pose(p=p) for p in places]), [0.8, 0.7, 0.6, 0.5])
    assert DOUBT.believed(found, [X_WFailed]).scores.tolist() == [0.8, 0.7, 0.5]
    another = make_pose(p=(0.6, 0.0, 0.1))
    assert DOUBT.believed(found, [another, X_WFailed]).scores.tolist() == [0.8, 0.7]


def test_without_a_failure_all_are_believed() -> None:
    found = ranked(make_pose(p=(0.5, 0.0, 0.1))[None], [0.3])
    assert len(DOUBT.believed(found, ())) == 1
    assert len(DOUBT.believed(ranked(np.empty((0, 4, 4)), ()), [np.eye(4)])) == 0


@pytest.mark.parametrize("name", ["vgn", "giga", "se3dif", "oracle"])
def test_methods_of_others_keep_no_memory(name: str) -> None:
    assert clutter_detectors()[name].doubt is None
    assert clutter_detectors()["split"].doubt is not None
