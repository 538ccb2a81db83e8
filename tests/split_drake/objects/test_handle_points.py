"""Counting points on handles, against the family's own profile and by hand."""

import numpy as np
import pytest
import trimesh

from split_drake.objects.handle_points import HANDLE_MARGIN_M, HandlePoints
from split_drake.objects.mugs.parameters import outer_radius_m
from split_drake.objects.mugs.split import load_mug, mug_parameters
from split_drake.poses import make_pose, rotation_z, transform_points
from split_drake.station.layout import Layout

# Straight, tapered, curved, flared, barrel and teacup, whatever their order in the split.
NAMES = tuple(f"train_{number:03d}" for number in range(8))


@pytest.mark.parametrize("name", NAMES)
def test_counts_agree_with_the_family_s_profile(name: str) -> None:
    mesh, parameters = load_mug(name).body.mesh, mug_parameters(name)
    p_OPs, _ = trimesh.sample.sample_surface(mesh, 3000, seed=1)
    radius_m = outer_radius_m(parameters, p_OPs[:, 2]) + HANDLE_MARGIN_M
    expected = int((np.hypot(p_OPs[:, 0], p_OPs[:, 1]) > radius_m).sum())
    X_WO = make_pose(rotation_z(2.0), (0.5, 0.1, 0.02))
    counted = HandlePoints(mesh).count(X_WO, transform_points(X_WO, p_OPs))
    assert expected > 100
    assert abs(counted - expected) <= 0.02 * expected + 2


def test_body_and_table_do_not_count() -> None:
    mug = load_mug("train_002")
    handle = HandlePoints(mug.body.mesh)
    body = mug.body.mesh.vertices[mug.body.mesh.vertices[:, 0] < 0.0]
    assert handle.count(np.eye(4), body) == 0
    x, y = np.meshgrid(np.linspace(-0.15, 0.15, 80), np.linspace(-0.15, 0.15, 80))
    table = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -0.003)])
    assert handle.count(np.eye(4), table) == 0
    opening_edge = mug.opening_OPs[mug.opening_OPs[:, 0] > mug.X_OH[0, 3]]
    assert handle.count(np.eye(4), opening_edge) == len(opening_edge)


def test_a_handle_is_seen_from_its_side_and_hidden_behind_the_body() -> None:
    handle = HandlePoints(load_mug("train_002").body.mesh)
    p_WCamera = Layout().cameras[1].X_WC[:3, 3]
    low = p_WCamera * (1.0, 1.0, 0.1)
    towards = make_pose(rotation_z(np.pi / 2.0), (0.5, 0.0, 0.0))
    away = make_pose(rotation_z(-np.pi / 2.0), (0.5, 0.0, 0.0))
    assert handle.seen_share(towards, low) > 0.3
    assert handle.seen_share(away, low) < 0.05


def test_objects_without_a_handle_are_refused() -> None:
    with pytest.raises(ValueError, match="expected a handle towards"):
        HandlePoints(trimesh.creation.cylinder(radius=0.04, height=0.1))
