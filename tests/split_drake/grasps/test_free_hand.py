"""The free hand: what holds, what slips, what collides, and what closes on nothing."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from split_drake.grasps.free_hand import MAX_SLIP_M, FreeHand
from split_drake.objects.rigid import Primitive, RigidObject
from split_drake.poses import make_pose, rotation_x, rotation_y
from tests.helpers.stations import STATION

EDGE_M = 0.04
LENGTH_M = 0.16


def bar(mass_kg: float = 0.3) -> RigidObject:
    """Return a bar of 4 x 4 x 16 cm, long along z of O, its origin in its middle."""
    size = (EDGE_M, EDGE_M, LENGTH_M)
    mesh = trimesh.creation.box(size)
    return RigidObject(
        name="bar",
        mesh=mesh,
        mass_kg=mass_kg,
        p_OCom=np.zeros(3),
        inertia_kg_m2=mesh.moment_inertia * mass_kg / mesh.volume,
        collision=(Primitive("box", size, np.eye(4)),),
    )


@pytest.fixture(scope="module")
def hand() -> FreeHand:
    return FreeHand(bar(), STATION)


def across(z_m: float) -> np.ndarray:
    """Return a grasp across the bar at height z, approaching along -x of O."""
    # Columns: x_G along z of O, y_G along -y, z_G along -x... a right-handed frame.
    R_OG = rotation_y(-np.pi / 2.0) @ rotation_x(np.pi)
    return make_pose(R_OG, (0.0, 0.0, z_m))


def test_bar_held_in_its_middle_stays(hand: FreeHand) -> None:
    hold = hand.try_grasp(across(0.0), 0.064)
    assert hold.holds
    assert hold.slip_m < 0.003
    assert hold.turn_rad < np.radians(3.0)


def test_same_grasp_holds_in_the_same_way_twice(hand: FreeHand) -> None:
    first = hand.try_grasp(across(0.01), 0.064)
    hand.try_grasp(across(0.05), 0.064)
    assert hand.try_grasp(across(0.01), 0.064) == first


def test_bar_held_at_its_end_moves_more(hand: FreeHand) -> None:
    middle, end = hand.try_grasp(across(0.0), 0.064), hand.try_grasp(across(0.07), 0.064)
    assert end.turn_rad > 2.0 * middle.turn_rad


def test_heavy_bar_slips() -> None:
    hold = FreeHand(bar(mass_kg=6.0), STATION).try_grasp(across(0.06), 0.064)
    assert not hold.holds
    assert hold.fault in ("slipped", "lost")


def test_hand_beside_the_bar_closes_on_nothing(hand: FreeHand) -> None:
    assert hand.try_grasp(across(0.12), 0.064).fault == "empty"


def test_pads_inside_the_bar_collide(hand: FreeHand) -> None:
    hold = hand.try_grasp(across(0.0), 0.02)
    assert hold.fault == "collides"
    assert hold.slip_m == float("inf")


def on_the_table() -> tuple[np.ndarray, np.ndarray]:
    """Return X_WO of the bar upright on the table, and X_WG across it from the side."""
    X_WO = make_pose(p=(0.5, 0.0, LENGTH_M / 2.0))
    return X_WO, X_WO @ across(0.0)


def test_bar_is_lifted_off_the_table(hand: FreeHand) -> None:
    X_WO, X_WG = on_the_table()
    assert hand.try_in_scene(X_WO, X_WG, 0.064).holds


def test_hand_in_the_table_collides(hand: FreeHand) -> None:
    X_WO, _ = on_the_table()
    assert hand.try_in_scene(X_WO, X_WO @ across(-0.075), 0.064).fault == "collides"


def test_scene_does_not_depend_on_where_it_is(hand: FreeHand) -> None:
    X_WO, X_WG = on_the_table()
    shift = make_pose(p=(0.05, -0.04, 0.0))
    here = hand.try_in_scene(X_WO, X_WG, 0.064)
    there = hand.try_in_scene(shift @ X_WO, shift @ X_WG, 0.064)
    assert there.holds and here.holds
    assert there.slip_m == pytest.approx(here.slip_m, abs=1e-3)


def test_slip_counts_only_once_the_hand_is_closed(hand: FreeHand) -> None:
    off_centre = across(0.0) @ make_pose(p=(0.0, 0.008, 0.0))
    hold = hand.try_grasp(off_centre, 0.064)
    assert hold.holds
    assert hold.slip_m < 0.004 < MAX_SLIP_M


def test_mass_is_what_the_hand_feels() -> None:
    light, heavy = (FreeHand(replace(bar(), mass_kg=mass), STATION) for mass in (0.05, 1.0))
    grasp = across(0.05)
    assert heavy.try_grasp(grasp, 0.064).turn_rad > light.try_grasp(grasp, 0.064).turn_rad


def test_bar_held_still_stays_for_as_long_as_asked(hand: FreeHand) -> None:
    down_G = np.array([0.0, 0.0, 1.0])
    held = hand.hold_still(across(0.0), 0.064, down_G, duration_s=0.5)
    assert not held.fault
    assert held.simulated_s > 0.5
    assert held.slip_m < 0.003
    assert held.turn_rad < np.radians(3.0)
    assert 0.0 < held.penetration_m < 0.002


def test_nothing_is_held_still_beside_the_bar(hand: FreeHand) -> None:
    held = hand.hold_still(across(0.12), 0.064, np.array([0.0, 0.0, 1.0]), duration_s=0.5)
    assert held.fault == "empty"
    assert held.slip_m == float("inf")
