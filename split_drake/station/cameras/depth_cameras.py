"""Simulated depth cameras, rendered without a display."""

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    QueryObject,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, RgbdSensor

from split_drake.camera import DepthView, Intrinsics
from split_drake.poses import Array
from split_drake.station.cameras.egl import check_rendering
from split_drake.station.layout import CameraPlacement

RENDERER = "vtk"
MIN_DEPTH_M = 0.1
MAX_DEPTH_M = 3.0


def add_renderer(scene_graph: SceneGraph) -> None:
    """Add the renderer that depth cameras and photographs use."""
    check_rendering()
    lights = [
        LightParameter(
            type="directional", frame="world", direction=(-0.5, -0.4, -1.0), intensity=0.8
        ),
        LightParameter(
            type="directional", frame="world", direction=(-0.6, 0.9, -0.4), intensity=0.45
        ),
        LightParameter(type="directional", frame="camera", intensity=0.5),
    ]
    params = RenderEngineVtkParams(
        default_clear_color=(0.93, 0.94, 0.96),
        lights=lights,
        cast_shadows=True,
        shadow_map_size=2048,
    )
    scene_graph.AddRenderer(RENDERER, MakeRenderEngineVtk(params))


def add_depth_camera(
    builder: DiagramBuilder, scene_graph: SceneGraph, placement: CameraPlacement
) -> RgbdSensor:
    """Add a camera fixed to the world and export its image as the port `<name>.depth_image`."""
    depth_camera = DepthRenderCamera(
        _camera_core(placement.intrinsics), DepthRange(MIN_DEPTH_M, MAX_DEPTH_M)
    )
    sensor = builder.AddNamedSystem(
        placement.name,
        RgbdSensor(
            SceneGraph.world_frame_id(), RigidTransform(placement.X_WC), depth_camera=depth_camera
        ),
    )
    builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
    builder.ExportOutput(sensor.depth_image_32F_output_port(), depth_port_name(placement))
    return sensor


def depth_port_name(placement: CameraPlacement) -> str:
    """Return the name of the diagram port that carries a camera's image."""
    return f"{placement.name}.depth_image"


def depth_view(image: ImageDepth32F, placement: CameraPlacement) -> DepthView:
    """Return the image of a camera as a DepthView; pixels out of range are 0 (near) or inf."""
    return DepthView(image.data[:, :, 0].copy(), placement.intrinsics, placement.X_WC)


def photograph(query: QueryObject, intrinsics: Intrinsics, X_WC: Array) -> NDArray[np.uint8]:
    """Return an (H, W, 3) colour picture of the world from a camera at X_WC."""
    camera = ColorRenderCamera(_camera_core(intrinsics))
    image = query.RenderColorImage(camera, SceneGraph.world_frame_id(), RigidTransform(X_WC))
    return np.array(image.data[:, :, :3])


def _camera_core(intrinsics: Intrinsics) -> RenderCameraCore:
    # RenderEngineVtk puts the centre of the first pixel at (0.5, 0.5), Intrinsics at (0, 0).
    info = CameraInfo(
        intrinsics.width,
        intrinsics.height,
        intrinsics.fx,
        intrinsics.fy,
        intrinsics.cx + 0.5,
        intrinsics.cy + 0.5,
    )
    clipping = ClippingRange(MIN_DEPTH_M / 2.0, 2.0 * MAX_DEPTH_M)
    return RenderCameraCore(RENDERER, info, clipping, RigidTransform())
