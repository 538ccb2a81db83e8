"""Which points of clutter move with the hand."""

import numpy as np

from planning.clearing.taken_points import NEAR_HAND_M, taken_points
from tests.helpers.clutter import box_cloud, grasp_from_above

ONE = box_cloud((0.5, 0.0), (0.04, 0.04, 0.06))
OTHER = box_cloud((0.5, 0.08), (0.04, 0.04, 0.06))
X_WG = grasp_from_above((0.5, 0.0, 0.05))


def test_what_stands_apart_stays() -> None:
    taken = taken_points(X_WG, np.concatenate([ONE, OTHER]))
    assert taken[: len(ONE)].all()
    assert not taken[len(ONE) :].any()


def test_what_touches_comes_along_as_far_as_it_is_near() -> None:
    touching = box_cloud((0.5, 0.10), (0.04, 0.157, 0.06))
    taken = taken_points(X_WG, np.concatenate([ONE, touching]))[len(ONE) :]
    distances = np.linalg.norm(touching - X_WG[:3, 3], axis=1)
    assert taken[distances < 0.9 * NEAR_HAND_M].all()
    assert not taken[distances > NEAR_HAND_M].any()


def test_a_hand_around_nothing_takes_nothing() -> None:
    assert not taken_points(grasp_from_above((0.5, 0.0, 0.2)), ONE).any()
