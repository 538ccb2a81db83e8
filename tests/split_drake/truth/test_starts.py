"""When something rests, and where objects are dropped, without a simulator."""

from collections.abc import Callable
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from split_drake.objects.mugs.split import load_mug
from split_drake.poses import Array, make_pose, rotation_x, transform_points
from split_drake.scene import Workspace
from split_drake.station.station import Station
from split_drake.truth.rest import REST_DISTANCE_M, REST_S, REST_TURN_RAD, wait_for_rest
from split_drake.truth.starts import (
    DROP_HEIGHT_M,
    OUTSIDE_WORKSPACE,
    SPREAD_M,
    draw_drop,
    drop_pose,
    outside_workspace,
)
from split_drake.truth.state import Truth

MUG = load_mug("train_001").body
TABLE = Workspace()
seeds = st.integers(0, 2**32 - 1)


class Moving:
    """A station and its truth, in which an object moves as a function of time."""

    def __init__(self, X_WO_at: Callable[[float], Array]) -> None:
        self.time_s = 0.0
        self._X_WO_at = X_WO_at

    def advance(self, duration_s: float) -> None:
        self.time_s += duration_s

    def X_WO(self, index: int) -> Array:
        return self._X_WO_at(self.time_s)


def rests_after_s(X_WO_at: Callable[[float], Array], timeout_s: float = 2.0) -> float | None:
    """Return when an object that moves so is found to rest; None where it is not."""
    moving = Moving(X_WO_at)
    rests = wait_for_rest(cast(Station, moving), cast(Truth, moving), 0, timeout_s)
    return moving.time_s if rests else None


def sliding(speed_m_s: float, until_s: float = np.inf) -> Callable[[float], Array]:
    return lambda time_s: make_pose(p=(speed_m_s * min(time_s, until_s), 0.0, 0.0))


def turning(speed_rad_s: float) -> Callable[[float], Array]:
    return lambda time_s: make_pose(rotation_x(speed_rad_s * time_s))


def test_an_object_rests_once_it_has_kept_its_place() -> None:
    assert rests_after_s(sliding(0.0)) == pytest.approx(REST_S)
    assert rests_after_s(sliding(0.1, until_s=0.5)) == pytest.approx(0.5 + REST_S, abs=0.02)
    assert rests_after_s(sliding(0.1, until_s=0.5), timeout_s=0.6) is None


@pytest.mark.parametrize(("share", "rests"), [(0.9, True), (1.2, False)])
def test_slow_motion_counts_by_how_far_it_leads(share: float, rests: bool) -> None:
    assert (rests_after_s(sliding(share * REST_DISTANCE_M / REST_S)) is not None) is rests
    assert (rests_after_s(turning(share * REST_TURN_RAD / REST_S)) is not None) is rests


def test_chatter_in_place_is_rest() -> None:
    """Fast to and fro, but never far: speeds would not tell."""
    chatter = [0.0, 0.4 * REST_DISTANCE_M]
    assert rests_after_s(lambda t: make_pose(p=(chatter[round(100.0 * t) % 2], 0.0, 0.0)))


@given(seeds)
def test_an_object_is_dropped_from_2_cm_above_its_place(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R_WO = Rotation.random(random_state=rng).as_matrix()
    p_WT = rng.uniform(-0.5, 0.5, 3)
    X_WO = drop_pose(MUG, R_WO, p_WT)
    lowest_m = transform_points(X_WO, MUG.mesh.vertices)[:, 2].min()
    assert lowest_m == pytest.approx(p_WT[2] + DROP_HEIGHT_M)
    middle = transform_points(X_WO, MUG.mesh.bounds.mean(axis=0)[None])[0]
    np.testing.assert_allclose(middle[:2], p_WT[:2], atol=1e-12)
    np.testing.assert_array_equal(X_WO[:3, :3], R_WO)


def test_drops_spread_in_place_and_over_all_orientations() -> None:
    rng = np.random.default_rng(0)
    X_WOs = np.stack([draw_drop(MUG, TABLE, rng) for _ in range(300)])
    middles = transform_points(X_WOs, MUG.mesh.bounds.mean(axis=0)[None])[:, 0, :2]
    offsets = np.abs(middles - TABLE.p_WCenter[:2])
    assert 0.9 * SPREAD_M < offsets.max() <= SPREAD_M
    assert np.abs(X_WOs[:, :3, 2].mean(axis=0)).max() < 0.15, "no direction is preferred"


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_no_part_of_an_object_may_be_beside_the_workspace(axis: int, sign: float) -> None:
    reach_m = (sign * MUG.mesh.vertices[:, axis]).max()
    for room_m, fault in ((0.001, ""), (-0.001, OUTSIDE_WORKSPACE)):
        p_WO = np.array(TABLE.p_WCenter)
        p_WO[axis] += sign * (TABLE.edge_m / 2.0 - reach_m - room_m)
        assert outside_workspace(MUG, make_pose(p=p_WO), TABLE) == fault
