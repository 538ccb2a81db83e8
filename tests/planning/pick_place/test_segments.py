"""From paths to segments: their order, and ends and openings that fit together."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from planning.collision.world import CollisionWorld, Situation
from planning.geometry.perceived import PerceivedObject
from planning.motion.segment_builder import FINGER_SPEED_M_S
from planning.pick_place.pick import Pick
from planning.pick_place.place import Place
from planning.pick_place.segments import Route, plan_segments
from planning.problem import Segment, SegmentName
from planning.subgoal import AllowedContact, Placement
from split_drake.poses import make_pose
from split_drake.robot.posture import Q_HOME
from split_drake.station.layout import Layout

# Where the straight lines of pick and place begin and end.
QS = Q_HOME + np.linspace(0.0, 0.3, 8)[:, None] * np.array([1.0, 0.5, -1.0, 0.2, 0.0, 0.3, -0.5])
POINTS = np.array([[0.5, 0.0, 0.02], [0.5, 0.0, 0.05]])
OPEN_M, RELEASE_M, WIDTH_M = 0.06, 0.03, 0.012
TABLE = frozenset({AllowedContact.HELD_TABLE})


@cache
def world() -> CollisionWorld:
    return CollisionWorld(Layout())


def segments(transit: bool, away: bool) -> tuple[Segment, ...]:
    """Return the segments of a pick and place from QS[0] to QS[7], or of the place alone."""
    target = PerceivedObject.from_cloud(POINTS, None, 0.0)
    holding = Situation(WIDTH_M, p_GHeld=POINTS)
    pick = Pick(np.eye(4), OPEN_M, RELEASE_M, WIDTH_M, QS[1:3], QS[2:4], holding)
    entry = np.array([[0.0, 0.0, 0.05]])
    nothing: frozenset[AllowedContact] = frozenset()
    placement = Placement(make_pose(), make_pose(), 1.0, entry, 0.01, 0.0, nothing, TABLE)
    place = Place(placement, make_pose(), QS[4:6], QS[[5, 5]], QS[5:7], POINTS, holding, holding)
    route = Route(QS[:2] if transit else None, QS[3:5], QS[6:] if away else None)
    return plan_segments(world(), target, pick, place, route)


PICKING = ["transit", "approach", "close", "lift"]
PLACING = ["transfer", "insert", "insert", "open", "retreat"]


@pytest.mark.parametrize("transit", [True, False])
@pytest.mark.parametrize("away", [True, False])
def test_segments_are_those_of_the_route_in_their_order(transit: bool, away: bool) -> None:
    found = segments(transit, away)
    expected = PICKING * transit + PLACING + ["transit"] * away
    assert [segment.name for segment in found] == expected
    for before, after in pairwise(found):
        assert before.openings_m[1] == pytest.approx(after.openings_m[0]), after.name
        np.testing.assert_allclose(before.trajectory.qs[-1], after.trajectory.qs[0], atol=1e-6)
    assert [s.holding for s in found if s.holding] == [True] * (3 + transit)


def test_the_hand_lets_go_on_what_the_lowering_may_touch() -> None:
    found = segments(transit=True, away=False)
    (opening,) = (segment for segment in found if segment.name is SegmentName.OPEN)
    assert opening.allowed_contacts == TABLE | {AllowedContact.FINGERS_TARGET}
    assert [segment.stop_on_contact for segment in found].count(True) == 1
    assert found[found.index(opening) - 1].stop_on_contact, "down by feel, then open"


def test_fingers_close_and_open_slowly_while_the_arm_rests() -> None:
    for segment in segments(transit=True, away=True):
        change_m = abs(segment.opening_end_m - segment.opening_start_m)
        assert change_m <= FINGER_SPEED_M_S * segment.trajectory.duration_s
        assert change_m == 0.0 or np.ptp(segment.trajectory.qs, axis=0).max() == 0.0
