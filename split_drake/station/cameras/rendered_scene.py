"""The scene that is rendered: a copy of the simulated one, posed only where a camera looks."""

from collections.abc import Callable

from pydrake.geometry import QueryObject, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from split_drake.station.cameras.depth_cameras import add_renderer


def add_rendered_scene(
    builder: DiagramBuilder, plant: MultibodyPlant, add_models: Callable[[MultibodyPlant], object]
) -> SceneGraph:
    """Add a scene graph with a renderer, which shows the bodies of `plant` where these are.

    A renderer follows every update of the scene graph that it belongs to.  In that of the plant it
    would take a third of the simulation's time, though it is looked at a few times only.

    Args:
        builder: of the diagram that the plant is in.
        plant: finalized.
        add_models: adds to an empty plant what `plant` is made of, in the same order.

    Raises ValueError where what it adds has other positions than `plant`.
    """
    scene_graph = builder.AddNamedSystem("rendered_scene", SceneGraph())
    add_renderer(scene_graph)
    shown = MultibodyPlant(time_step=plant.time_step())
    shown.RegisterAsSourceForSceneGraph(scene_graph)
    add_models(shown)
    shown.Finalize()
    if shown.GetStateNames() != plant.GetStateNames():
        raise ValueError("add_models makes other joints than the plant has, or in another order")
    poses = builder.AddNamedSystem(
        "rendered_poses", MultibodyPositionToGeometryPose(shown, input_multibody_state=True)
    )
    builder.Connect(plant.get_state_output_port(), poses.get_input_port())
    builder.Connect(
        poses.get_output_port(), scene_graph.get_source_pose_port(shown.get_source_id())
    )
    return scene_graph


def query_of(scene_graph: SceneGraph, context: Context) -> QueryObject:
    """Return what answers questions about a scene graph, by the context of its diagram."""
    return scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
