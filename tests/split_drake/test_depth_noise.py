"""What depth cameras do to a depth image."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from split_drake.camera import DepthView, Intrinsics
from split_drake.depth_noise import DEPTH_NOISE, DepthNoise
from split_drake.poses import Array, make_pose

INTRINSICS = Intrinsics.centered(160, 120, 140.0)
QUIET = DepthNoise(
    constant_m=0.0,
    quadratic_per_m=0.0,
    correlation_px=0.0,
    step_per_m=0.0,
    max_incidence_rad=np.pi / 2.0,
    edge_jump_m=0.01,
    edge_hole_share=0.0,
    edge_px=1,
    flying_share=0.0,
)


def wall(distance_m: float) -> DepthView:
    """Return a view straight onto a wall."""
    return DepthView(np.full((120, 160), distance_m), INTRINSICS, make_pose())


def step() -> DepthView:
    """Return a view of a wall at 0.5 m, beside one at 0.8 m from the image's middle on."""
    depth = np.full((120, 160), 0.5)
    depth[:, 80:] = 0.8
    return DepthView(depth, INTRINSICS, make_pose())


def seen(noise: DepthNoise, view: DepthView) -> Array:
    return noise.seen(view, np.random.default_rng(0)).depth_m.astype(float)


def test_a_camera_that_does_not_err_shows_what_is_there() -> None:
    np.testing.assert_allclose(seen(QUIET, step()), step().depth_m)


@pytest.mark.parametrize("correlation_px", [0.0, 1.5])
def test_errors_grow_with_the_square_of_the_distance(correlation_px: float) -> None:
    noise = replace(QUIET, constant_m=0.001, quadratic_per_m=0.004, correlation_px=correlation_px)
    for distance_m in (0.5, 1.0):
        errors = seen(noise, wall(distance_m)) - distance_m
        assert errors.std() == pytest.approx(0.001 + 0.004 * distance_m**2, rel=0.05)
        assert abs(errors.mean()) < 0.001


def test_errors_of_neighbours_are_alike() -> None:
    errors = seen(replace(QUIET, constant_m=0.001, correlation_px=1.5), wall(0.5)) - 0.5
    white = seen(replace(QUIET, constant_m=0.001), wall(0.5)) - 0.5
    assert np.corrcoef(errors[:, :-1].ravel(), errors[:, 1:].ravel())[0, 1] > 0.8
    assert abs(np.corrcoef(white[:, :-1].ravel(), white[:, 1:].ravel())[0, 1]) < 0.05


def test_depth_comes_in_steps() -> None:
    ramp = DepthView(
        np.linspace(0.5, 1.0, 19200, dtype=np.float32).reshape(120, 160), INTRINSICS, make_pose()
    )
    depth = seen(replace(QUIET, step_per_m=0.01), ramp)
    levels = np.unique(depth)
    assert len(levels) == pytest.approx(100, abs=2)  # of 1/z, from 1 to 2 per metre
    np.testing.assert_allclose(np.diff(1.0 / levels), -0.01, atol=1e-5)
    assert np.abs(depth - ramp.depth_m).max() <= 0.0051


def test_what_is_seen_at_a_grazing_angle_is_not_seen() -> None:
    rays_x = (np.arange(160) - INTRINSICS.cx) / INTRINSICS.fx
    tilt = np.radians(70.0)
    # A plane through (0, 0, 1), turned by `tilt` about y.
    depth = np.tile(1.0 / (1.0 - np.tan(tilt) * rays_x.clip(max=0.2)), (120, 1))
    view = DepthView(depth, INTRINSICS, make_pose())
    noise = replace(QUIET, max_incidence_rad=float(np.radians(60.0)), edge_jump_m=1.0)
    incidence = np.abs(np.degrees(np.arctan(rays_x)) + 70.0)
    lost = seen(noise, view)[60] == 0.0
    assert lost[(incidence > 62.0) & (rays_x < 0.18)].all()
    assert not lost[(incidence < 58.0) & (rays_x < 0.18)].any()


def test_rims_have_holes_and_flying_pixels() -> None:
    torn = seen(replace(QUIET, edge_hole_share=1.0), step())
    assert set(np.flatnonzero((torn == 0.0).all(axis=0))) == {78, 79, 80, 81}
    assert (torn[:, :78] > 0.0).all()
    flown = seen(replace(QUIET, flying_share=0.5), step())
    between = (flown > 0.501) & (flown < 0.799)
    assert not np.delete(between, (79, 80), axis=1).any()
    assert 0.4 < between[:, 79:81].mean() < 0.6


def test_what_shows_nothing_still_shows_nothing() -> None:
    depth = np.full((120, 160), 0.6)
    depth[:40], depth[80:] = 0.0, np.inf
    noisy = seen(DEPTH_NOISE["high"] or QUIET, DepthView(depth, INTRINSICS, make_pose()))
    assert (noisy[:40] == 0.0).all()
    assert (noisy[80:] == 0.0).all()
    assert (noisy[50:70] > 0.0).mean() > 0.95


def test_levels_are_ever_worse() -> None:
    assert DEPTH_NOISE["none"] is None
    errors = [
        (seen(noise, wall(0.8)) - 0.8).std() for noise in DEPTH_NOISE.values() if noise is not None
    ]
    assert 0.0 < errors[0] < 0.5 * errors[1] < 0.25 * errors[2]


def test_the_same_seed_has_the_same_noise() -> None:
    noise = DEPTH_NOISE["middle"] or QUIET
    np.testing.assert_array_equal(seen(noise, step()), seen(noise, step()))


@pytest.mark.parametrize(
    ("name", "value"), [("constant_m", -1.0), ("constant_m", np.nan), ("flying_share", 1.5)]
)
def test_what_is_no_noise_is_refused(name: str, value: float) -> None:
    fields: dict[str, Any] = {**asdict(QUIET), name: value}
    with pytest.raises(ValueError, match=f"{name} is {value}; expected"):
        DepthNoise(**fields)
