"""Grasps to try: fitted when their turn comes, both half-turns of each alike."""

import numpy as np

from planning.geometry.perceived import PerceivedObject
from planning.geometry.waypoints import with_half_turns
from planning.pick_place.candidates import REPEATED_MODE, Candidates
from planning.pick_place.fingers import fit_fingers, settled
from planning.pick_place.pick import balance, firmness
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.poses import make_pose, rotation_x

RNG = np.random.default_rng(0)
POINTS = RNG.uniform((0.48, -0.02, 0.0), (0.52, 0.02, 0.08), (3000, 3))
TARGET = PerceivedObject.from_cloud(POINTS, None, 0.0)
PLACES = np.array([(0.5, 0.0, 0.06), (0.501, 0.0, 0.06), (0.5, 0.0, 0.03), (0.5, 0.015, 0.07)])
GRASPS = PoseSet.ranked(GRASP, make_pose(rotation_x(np.pi), PLACES), np.array([0.9, 0.8, 0.7, 0.6]))


def test_scores_are_those_of_the_settled_grasps_and_within_their_bounds() -> None:
    candidates = Candidates(GRASPS, TARGET, TARGET.p_WDetails)
    count = len(GRASPS)
    assert len(candidates.bounds) == 2 * count
    X_WGs = np.stack([settled(X_WG, TARGET.p_WDetails) for X_WG in GRASPS.X_WPs])
    fits = [fit_fingers(X_WG, TARGET.p_WDetails) for X_WG in X_WGs]
    alone = GRASPS.scores * balance(GRASPS.X_WPs, TARGET) * firmness(fits)
    turned = with_half_turns(X_WGs)
    for row in range(2 * count):
        X_WG, fit = candidates.at(row)
        index = next(i for i in range(2 * count) if np.allclose(turned[i], X_WG))
        assert index // count == row // count
        assert fit == fits[index % count]
        share = candidates.score(row) / alone[index % count]
        assert np.isclose(share, REPEATED_MODE) or np.isclose(share, 1.0)
        assert candidates.score(row) <= candidates.bounds[row]
        assert candidates.score(row) == candidates.score((row + count) % (2 * count))


def test_of_one_mode_all_but_the_best_count_for_less() -> None:
    near = GRASPS.subset(np.array([True, True, False, False]))
    bounds = Candidates(near, TARGET, TARGET.p_WDetails).bounds
    weight = near.scores * balance(near.X_WPs, TARGET)
    np.testing.assert_allclose(bounds, np.tile(weight * (1.0, REPEATED_MODE), 2))
