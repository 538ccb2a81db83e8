"""Depth images from wherever a camera stands, without a sensor in the diagram for each."""

from functools import lru_cache

import numpy as np
from pydrake.geometry import DepthRenderCamera, QueryObject, SceneGraph
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder

from split_drake.camera import DepthView, Intrinsics
from split_drake.station.cameras.depth_cameras import add_depth_camera, depth_view
from split_drake.station.layout import CameraPlacement


def render_depth(query: QueryObject, placement: CameraPlacement) -> DepthView:
    """Return what a camera would see now, as one of the station's depth cameras there would."""
    camera = _render_camera(placement.intrinsics)
    X_WC = RigidTransform(placement.X_WC)
    return depth_view(query.RenderDepthImage(camera, SceneGraph.world_frame_id(), X_WC), placement)


@lru_cache(maxsize=16)
def _render_camera(intrinsics: Intrinsics) -> DepthRenderCamera:
    """Return what the station's cameras of these intrinsics render with.

    It is taken from such a camera, in a diagram that is thrown away.
    """
    builder = DiagramBuilder()
    scene_graph = builder.AddSystem(SceneGraph())
    sensor = add_depth_camera(builder, scene_graph, CameraPlacement("any", intrinsics, np.eye(4)))
    return sensor.default_depth_render_camera()
