"""What the search for places finds, and what it counts placements as rejected by."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from planning.collision.exemptions import MAX_TABLE_DEPTH_M
from planning.collision.world import CollisionWorld, Situation
from planning.geometry.perceived import PerceivedObject
from planning.geometry.waypoints import APPROACH_M, backed_off, place_grasp, shifted
from planning.motion.ik import solve_ik
from planning.pick_place.fingers import fit_fingers
from planning.pick_place.pick import Q_COMFORT, Pick
from planning.pick_place.place import Place, PlaceSearch
from planning.subgoal import AllowedContact, Placement
from split_drake.poses import Array, make_pose, transform_points
from split_drake.robot.gripper import PALM
from split_drake.robot.kinematics import gripper_poses
from split_drake.station.layout import Layout
from tests.helpers.planning import STANDING, mug_cloud, rim_grasps

X_WG = STANDING @ rim_grasps()[5]  # from straight above
CLOUD = transform_points(STANDING, mug_cloud())
PLACEMENT = Placement(
    X_WO=STANDING,
    X_WOgoal=make_pose(STANDING[:3, :3], (0.5, 0.12, 0.0)),
    score=1.0,
    p_OEntries_W=np.array([[0.0, 0.0, 0.08]]),
    lower_from_m=0.012,
    lower_to_m=-0.004,
    insert_contacts=frozenset(),
    lower_contacts=frozenset({AllowedContact.HELD_TABLE}),
)


@cache
def world() -> CollisionWorld:
    return CollisionWorld(Layout())


def held() -> Pick:
    """Return a pick of which places need no more than the grasp and the widths."""
    fit = fit_fingers(X_WG, CLOUD)
    widths = (fit.opening_m, fit.release_m, fit.held_width_m)
    nowhere = np.empty((0, 7))
    return Pick(X_WG, *widths, nowhere, nowhere, Situation(fit.held_width_m))


def search(p_WExtra: Array | None = None) -> PlaceSearch:
    """Return a search for places of the mug, and of a point that is taken for part of it."""
    points = CLOUD if p_WExtra is None else np.concatenate([CLOUD, [p_WExtra]])
    return PlaceSearch(world(), PerceivedObject.from_cloud(points, None, 0.0))


def goal_qs(placement: Placement) -> Array:
    X_WGgoal = place_grasp(placement.X_WOgoal, placement.X_WO, X_WG)
    return solve_ik(X_WGgoal[None]).of(0, Q_COMFORT)


def find(places: PlaceSearch, placement: Placement) -> Place | None:
    return places.find(held(), placement, goal_qs(placement))


def test_a_place_leads_from_the_entry_down_and_straight_back() -> None:
    places = search()
    place = find(places, PLACEMENT)
    assert place is not None and not places.rejected
    X_WGgoal = place_grasp(PLACEMENT.X_WOgoal, PLACEMENT.X_WO, X_WG)
    start, lowest = (shifted(X_WGgoal, (0.0, 0.0, z)) for z in (0.012, -0.004))
    np.testing.assert_allclose(place.X_WG, lowest, atol=1e-12)
    expected = {
        "insert": (place.insert_qs, shifted(X_WGgoal, (0.0, 0.0, 0.08)), start),
        "lower": (place.lower_qs, start, lowest),
        "retreat": (place.retreat_qs, lowest, backed_off(lowest, APPROACH_M)),
    }
    for name, (qs, X_WFrom, X_WTo) in expected.items():
        ends = gripper_poses(qs[[0, -1]])
        np.testing.assert_allclose(ends, [X_WFrom, X_WTo], atol=1e-5, err_msg=name)
    np.testing.assert_array_equal(place.insert_qs[-1], place.lower_qs[0])
    np.testing.assert_array_equal(place.lower_qs[-1], place.retreat_qs[0])


def test_the_released_object_is_where_the_hand_has_carried_it() -> None:
    place = find(search(), PLACEMENT)
    assert place is not None
    X_WMoved = shifted(PLACEMENT.X_WOgoal, (0.0, 0.0, -0.004)) @ np.linalg.inv(STANDING)
    before = PerceivedObject.from_cloud(CLOUD, None, 0.0).p_WObstacles
    np.testing.assert_allclose(place.p_WReleased, transform_points(X_WMoved, before), atol=1e-9)


def test_entries_are_tried_in_their_order() -> None:
    entries = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, -0.05], [0.0, 0.0, 0.05], [0.0, 0.0, 0.08]])
    place = find(search(), replace(PLACEMENT, p_OEntries_W=entries))
    assert place is not None
    height_m = gripper_poses(place.insert_qs[:1])[0, 2, 3] - place.X_WG[2, 3]
    assert height_m == pytest.approx(0.05 + 0.004, abs=1e-5), "the first that works"


# In the palm's way at the retreat's end, and in the palm until then.
BEHIND_PALM, IN_PALM = transform_points(
    X_WG, np.array([[0.0, 0.09, PALM.lower[2] - 0.025], [0.0, 0.0, PALM.upper[2] - 0.02]])
)
TOO_DEEP_M = -MAX_TABLE_DEPTH_M - 0.01
NO_CONTACTS: frozenset[AllowedContact] = frozenset()


@pytest.mark.parametrize(
    ("reason", "placement", "p_WExtra"),
    [
        ("IK", replace(PLACEMENT, X_WOgoal=make_pose(p=(1.5, 0.0, 0.0))), None),
        (
            "collision at the goal",
            replace(PLACEMENT, X_WOgoal=shifted(PLACEMENT.X_WOgoal, (0.0, 0.0, TOO_DEEP_M))),
            None,
        ),
        ("collision at the goal", replace(PLACEMENT, lower_contacts=NO_CONTACTS), None),
        ("IK of the lowering", replace(PLACEMENT, lower_from_m=1.0), None),
        ("collision while lowering", replace(PLACEMENT, lower_to_m=TOO_DEEP_M), None),
        ("insertion", replace(PLACEMENT, p_OEntries_W=np.array([[0.0, 0.0, -0.05]])), None),
        ("retreat", PLACEMENT, BEHIND_PALM),
        ("retreat", PLACEMENT, IN_PALM),
    ],
)
def test_a_placement_that_is_rejected_is_counted_once_by_its_reason(
    reason: str, placement: Placement, p_WExtra: Array | None
) -> None:
    places = search(p_WExtra)
    assert find(places, placement) is None
    assert places.rejected == {reason: 1}


def test_of_several_configurations_the_first_that_works_is_taken() -> None:
    places, qs = search(), goal_qs(PLACEMENT)
    folded = np.array([0.0, 1.6, 0.0, -3.0, 0.0, 0.1, 0.0])  # into the table
    place = places.find(held(), PLACEMENT, np.stack([folded, qs[0], qs[1]]))
    assert place is not None and not places.rejected
    assert np.abs(place.lower_qs[0] - qs[0]).max() < np.abs(place.lower_qs[0] - qs[1]).max()
