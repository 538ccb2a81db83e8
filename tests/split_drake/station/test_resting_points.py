"""Objects stand still on the corners of their hulls."""

import numpy as np
import pytest
import trimesh

from split_drake.poses import make_pose, rotation_error_rad, rotation_x, transform_points
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import Layout
from split_drake.station.objects.resting_points import (
    MAX_POINTS,
    POINT_RADIUS_M,
    TOLERANCE_M,
    resting_points,
)
from split_drake.truth.state import Truth
from tests.split_drake.station.solids import solid_box, solid_cylinder, solids, stand


def test_box_stands_on_its_corners() -> None:
    box = solid_box("box", (0.05, 0.06, 0.07))
    centres = np.array([point.X_OP[:3, 3] for point in resting_points(box)])
    assert len(centres) == 8
    assert np.linalg.norm(np.abs(centres) - (0.025, 0.03, 0.035), axis=1).max() < 6e-4


def test_planes_come_no_nearer_than_the_tolerance() -> None:
    can = solid_cylinder("can", 0.03, 0.12)
    points = resting_points(can)
    assert len(points) <= MAX_POINTS
    centres = np.array([point.X_OP[:3, 3] for point in points])
    directions = trimesh.creation.icosphere(subdivisions=4).vertices
    hull = (can.mesh.vertices @ directions.T).max(axis=0)
    borne = (centres @ directions.T).max(axis=0) + POINT_RADIUS_M
    # Between the directions that are looked at, it may be a little more.
    assert (hull - borne).max() < TOLERANCE_M + 3e-4
    assert (borne - hull).max() < POINT_RADIUS_M


def test_standing_and_lying_objects_come_to_rest_and_do_not_creep() -> None:
    station = HandStation(solids(), Layout())
    truth = Truth(station)
    for index in range(5):
        stand(station, index, y=0.12 * (index - 2))
    lying = make_pose(rotation_x(np.pi / 2.0), (0.4, 0.0, 0.031))
    station.place_object(1, lying)
    station.advance(1.0)
    before = [truth.X_WO(index) for index in range(5)]
    speeds = [np.concatenate(truth.velocity(index)) for index in range(5)]
    assert np.abs(speeds).max() < 0.005
    station.advance(1.0)
    for index, X_WO in enumerate(before):
        assert np.linalg.norm(truth.X_WO(index)[:3, 3] - X_WO[:3, 3]) < 2e-5
        assert rotation_error_rad(truth.X_WO(index)[:3, :3], X_WO[:3, :3]) < 2e-4


@pytest.mark.parametrize("index", [0, 1])
def test_standing_objects_are_not_sunk_into_the_table(index: int) -> None:
    station = HandStation(solids(), Layout())
    stand(station, index)
    station.advance(0.5)
    item = station.objects[index]
    p_WPs = transform_points(Truth(station).X_WO(index), item.mesh.vertices)
    assert abs(p_WPs[:, 2].min()) < 4e-4
