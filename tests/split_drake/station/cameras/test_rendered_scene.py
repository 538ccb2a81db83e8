"""What cameras see is where the simulation has it, and costs the simulation nothing."""

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from split_drake.objects.mugs.split import load_mug
from split_drake.poses import make_pose
from split_drake.robot.panda import add_panda
from split_drake.station.cameras.rendered_scene import add_rendered_scene
from split_drake.station.fixtures import add_table
from split_drake.station.layout import Layout
from split_drake.station.station import Station
from tests.helpers.stations import STATION


def test_a_copy_with_other_joints_is_refused() -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 0.002)
    add_panda(plant)
    plant.Finalize()
    with pytest.raises(ValueError, match="other joints than the plant has"):
        add_rendered_scene(builder, plant, lambda shown: add_table(shown, Layout()))


def test_cameras_follow_what_moves() -> None:
    station = Station(STATION, [load_mug("test_004").body])
    station.place_object(0, make_pose(p=(0.5, 0.0, 0.0)))
    before = station.capture()[0].points(0.02)
    station.place_object(0, make_pose(p=(0.5, 0.1, 0.0)))
    after = station.capture()[0].points(0.02)
    np.testing.assert_allclose(after.mean(0) - before.mean(0), (0.0, 0.1, 0.0), atol=0.01)
    station.park_object(0)
    assert len(station.capture()[0].points(0.02)) == 0


def test_what_is_simulated_is_not_rendered_and_what_is_rendered_does_not_collide() -> None:
    station = Station(STATION, [load_mug("test_004").body])
    simulated, rendered = (
        station.diagram.GetSubsystemByName(name).model_inspector()
        for name in ("scene_graph", "rendered_scene")
    )
    own = len(simulated.GetAllGeometryIds(Role.kProximity))
    assert own - len(rendered.GetAllGeometryIds(Role.kProximity)) == len(
        station.objects[0].collision
    )
    seen = len(rendered.GetAllGeometryIds(Role.kPerception))
    assert seen == len(simulated.GetAllGeometryIds(Role.kPerception)) + 1
