"""The arm that clears a table: what it brings into the bin, and how it comes home again."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from planning.clearing.drop_planner import DropPlanner
from planning.handling.recovery import Recovery
from scenarios.clutter.arm_clearing import ArmClearing, LostArmError, arm_layout
from scenarios.clutter.observation import observe, side_camera
from scenarios.clutter.records import EMPTIED, NO_GRASP, NO_PLAN, TWO_FAILURES
from scenarios.clutter.rounds import run_round
from scenarios.clutter.spec import draw_start, drawn_objects
from scenarios.clutter_removal import ClutterOptions, missing_rounds
from split_drake.poses import make_pose
from split_drake.robot.posture import Q_HOME
from split_drake.scene import Scene
from split_drake.station.config import StationConfig
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import Layout
from split_drake.station.station import Station
from tests.helpers.clutter import grasp_from_above, grasps
from tests.split_drake.station.solids import solids

LAYOUT = arm_layout(Layout())
TIN, CUBE = 3, 4
ON_TIN = grasp_from_above((0.47, 0.0, 0.045))
IN_THE_AIR = grasp_from_above((0.5, -0.1, 0.2))


@cache
def planner() -> DropPlanner:
    return DropPlanner()


def clearing() -> tuple[ArmClearing, Station]:
    """Return an arm at a table with a tin and a cube."""
    station = Station(StationConfig(LAYOUT), solids(), bearing=True)
    for index in range(3):
        station.park_object(index)
    station.place_object(TIN, make_pose(p=(0.47, 0.0, 0.0005)))
    station.place_object(CUBE, make_pose(p=(0.56, 0.06, 0.0255)))
    station.advance(0.2)
    return ArmClearing(station, planner(), np.random.default_rng(0)), station


def look(arm: ArmClearing) -> Scene:
    return observe(arm.look(), LAYOUT.workspace, "none", np.random.default_rng(0))


def test_what_is_taken_ends_in_the_bin() -> None:
    arm, station = clearing()
    found = grasps(IN_THE_AIR, ON_TIN)
    chosen = arm.choose(found, look(arm), range(2))
    assert chosen == 1, "a grasp in the air cannot be planned"
    record = arm.take(found, 1)
    assert (record.reason, record.taken, record.lost) == ("", ("tin",), ())
    assert arm.left == (CUBE,)
    assert station.present == (TIN, CUBE), "it stays in the bin"
    np.testing.assert_allclose(station.q, Q_HOME, atol=0.01)
    assert look(arm).p_WPs[:, 0].min() > 0.52, "the camera sees the cube alone"


def test_where_nothing_can_be_planned_it_says_why() -> None:
    arm, _ = clearing()
    reason = arm.choose(grasps(IN_THE_AIR), look(arm), range(1))
    assert isinstance(reason, str)
    assert "nothing between the pads" in reason


def test_an_empty_hand_comes_home_and_tries_again() -> None:
    arm, station = clearing()
    found = grasps(ON_TIN)
    assert arm.choose(found, look(arm), range(1)) == 0
    X_WTin = arm.truth.X_WO(TIN)
    station.place_object(TIN, make_pose(p=(0.47, 0.12, 0.0005)))
    record = arm.take(found, 0)
    assert record.reason.startswith("the hand is empty after close")
    assert record.taken == ()
    np.testing.assert_allclose(station.q, Q_HOME, atol=0.01)
    station.place_object(TIN, X_WTin)
    station.advance(0.2)
    assert arm.choose(found, look(arm), range(1)) == 0
    assert arm.take(found, 0).taken == ("tin",)


def test_a_grasp_that_failed_comes_last_until_one_succeeds() -> None:
    arm, station = clearing()
    on_cube = grasp_from_above((0.56, 0.06, 0.04))
    found = grasps(ON_TIN, on_cube)
    assert arm.choose(found, look(arm), range(2)) == 0
    station.place_object(TIN, make_pose(p=(0.47, 0.12, 0.0005)))
    assert arm.take(found, 0).taken == ()
    station.place_object(TIN, make_pose(p=(0.47, 0.0, 0.0005)))
    station.advance(0.2)
    assert arm.choose(found, look(arm), range(2)) == 1
    assert arm.take(found, 1).taken == ("cube",)
    assert arm.choose(found, look(arm), range(2)) == 0


def test_an_arm_without_a_way_home_has_its_last_grasp_recorded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arm, station = clearing()
    found = grasps(ON_TIN)
    assert arm.choose(found, look(arm), range(1)) == 0
    station.place_object(TIN, make_pose(p=(0.47, 0.12, 0.0005)))
    monkeypatch.setattr(Recovery, "go_home", lambda self, rng: False)
    assert arm.take(found, 0).reason.startswith("the hand is empty after close")
    with pytest.raises(LostArmError, match="no way home was found after: the hand is empty"):
        arm.choose(found, look(arm), range(1))


def test_only_what_was_chosen_is_tried() -> None:
    arm, _ = clearing()
    with pytest.raises(ValueError, match="grasp 0 has no plan"):
        arm.take(grasps(ON_TIN), 0)


def test_the_arm_at_home_hides_nothing_from_the_camera() -> None:
    arm, _ = clearing()
    hand = HandStation(solids(), LAYOUT)
    hand.place_object(TIN, make_pose(p=(0.47, 0.0, 0.0005)))
    hand.place_object(CUBE, make_pose(p=(0.56, 0.06, 0.0255)))
    hand.advance(0.2)
    (view,) = hand.capture([side_camera(LAYOUT.workspace)])
    alone = observe(view, LAYOUT.workspace, "none", np.random.default_rng(0))
    seen = look(arm)
    assert len(seen.p_WPs) == pytest.approx(len(alone.p_WPs), rel=0.01)


def test_a_round_with_the_arm_starts_as_with_the_hand(tmp_path: Path) -> None:
    options = ClutterOptions(
        "packed",
        1,
        1,
        48,
        "oracle",
        objects="procedural-train",
        noise="none",
        robot="arm",
        record="none",
    )
    (spec,) = missing_rounds(options, tmp_path, ())
    rng = spec.streams()[0]
    objects = drawn_objects(spec, rng)
    start = draw_start(spec, HandStation(objects, LAYOUT), rng)
    record = run_round(spec)
    assert record.objects == tuple(objects[index].name for index in start.indices)
    # Which of these ends it is depends on the last bits of a processor's sums.
    assert record.ended in (EMPTIED, NO_GRASP, NO_PLAN, TWO_FAILURES)
    taken = [name for grasp in record.grasps for name in grasp.taken]
    assert len(taken) == record.successes >= 1
