"""Table, hook, bin and free objects as bodies of a MultibodyPlant.

Every function works on plants with and without a scene graph's visuals in use, so that the station
and a planner's collision checker stand on the same geometry.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh
from pydrake.common import MemoryFile
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    InMemoryMesh,
    Mesh,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody, RotationalInertia, SpatialInertia

from split_drake.objects.rigid import Primitive, RigidObject
from split_drake.poses import Array, invert_pose, make_pose, rotation_x
from split_drake.station.layout import FLOOR_DEPTH_M, Layout

TABLE_BODY = "table"
HOOK_BODY = "hook"
BIN_BODY = "bin"
SOLIDS_BODY = "solids"

LEG_EDGE_M = 0.05

_STAND_RGBA = (0.30, 0.32, 0.35, 1.0)
_TABLE_RGBA = (0.76, 0.64, 0.50, 1.0)
_BIN_RGBA = (0.45, 0.55, 0.62, 1.0)
_STEEL_RGBA = (0.52, 0.54, 0.57, 1.0)
_OBJECT_RGBA = (
    (0.16, 0.45, 0.62, 1.0),
    (0.80, 0.38, 0.24, 1.0),
    (0.36, 0.56, 0.36, 1.0),
    (0.86, 0.68, 0.28, 1.0),
    (0.52, 0.40, 0.60, 1.0),
)


def drake_shape(primitive: Primitive) -> Shape:
    """Return the Drake shape of a collision primitive."""
    if primitive.kind == "convex":
        return Convex(points=primitive.p_PVs.T, label="collision piece")
    makers = {"box": Box, "cylinder": Cylinder, "capsule": Capsule, "sphere": Sphere}
    return makers[primitive.kind](*primitive.size)


def table_primitive(layout: Layout) -> Primitive:
    """Return the table's top in W."""
    z_m = layout.table_z_m - layout.table_size_m[2] / 2.0
    return Primitive("box", layout.table_size_m, make_pose(p=(*layout.p_WTable, z_m)))


def hook_primitives(layout: Layout) -> tuple[Primitive, Primitive]:
    """Return peg and post in K; the post stands upright on the table's top."""
    hook = layout.hook
    peg_length = hook.post_distance_m + hook.tip_distance_m - hook.peg_radius_m
    peg_center = (0.0, peg_length / 2.0 - hook.post_distance_m, 0.0)
    peg = Primitive(
        "capsule",
        (hook.peg_radius_m, peg_length),
        make_pose(rotation_x(-np.pi / 2.0), peg_center),
    )
    x, y = (layout.X_WK @ (0.0, -hook.post_distance_m, 0.0, 1.0))[:2]
    post_height = layout.post_height_m
    X_WPost = make_pose(p=(x, y, layout.table_z_m + post_height / 2.0))
    X_KPost = invert_pose(layout.X_WK) @ X_WPost
    return peg, Primitive("cylinder", (hook.post_radius_m, post_height), X_KPost)


def bin_primitives(layout: Layout, margin_m: float = 0.0) -> tuple[Primitive, ...]:
    """Return floor and walls of the bin in W, grown by a margin; nothing where there is none."""
    if layout.bin is None:
        return ()
    (x, y, depth), wall = layout.bin.size_m, layout.bin.wall_m
    along_x, along_y = (x + wall) / 2.0, (y + wall) / 2.0
    boxes = [((x + 2.0 * wall, y + 2.0 * wall, wall), (0.0, 0.0, -depth - wall / 2.0))]
    for side in (-1.0, 1.0):
        boxes.append(((wall, y + 2.0 * wall, depth), (side * along_x, 0.0, -depth / 2.0)))
        boxes.append(((x, wall, depth), (0.0, side * along_y, -depth / 2.0)))
    return tuple(
        Primitive(
            "box",
            tuple(edge + 2.0 * margin_m for edge in size),
            make_pose(p=np.add(layout.bin.p_WRim, p_RimBox)),
        )
        for size, p_RimBox in boxes
    )


def add_table(plant: MultibodyPlant, layout: Layout, margin_m: float = 0.0) -> RigidBody:
    """Add the table, grown by a margin on all sides, welded to the world; return its body."""
    table = table_primitive(layout)
    table = replace(table, size=tuple(edge + 2.0 * margin_m for edge in table.size))
    return _add_fixed(plant, TABLE_BODY, np.eye(4), (table,), _TABLE_RGBA)


def add_hook(plant: MultibodyPlant, layout: Layout) -> RigidBody:
    """Add the hook (peg and post), its body's frame being K, and return its body."""
    return _add_fixed(plant, HOOK_BODY, layout.X_WK, hook_primitives(layout), _STEEL_RGBA)


def add_bin(plant: MultibodyPlant, layout: Layout, margin_m: float = 0.0) -> None:
    """Add the bin, grown by a margin, welded to the world, where the layout has one."""
    if layout.bin is not None:
        _add_fixed(plant, BIN_BODY, np.eye(4), bin_primitives(layout, margin_m), _BIN_RGBA)


def add_solids(plant: MultibodyPlant, solids: Sequence[Primitive]) -> None:
    """Add shapes, their poses in W, welded to the world, where there are any."""
    if solids:
        _add_fixed(plant, SOLIDS_BODY, np.eye(4), solids, _STAND_RGBA)


def add_scenery(plant: MultibodyPlant, layout: Layout) -> None:
    """Add what is seen around the station but never touched: robot's and bin's stand, legs."""
    x, y = layout.p_WTable
    size_x, size_y, thickness = layout.table_size_m
    leg_height = FLOOR_DEPTH_M + layout.table_z_m - thickness
    inset = LEG_EDGE_M / 2.0 + 0.02
    z_leg = layout.table_z_m - thickness - leg_height / 2.0
    pieces = {
        "stand": (Box(0.26, 0.26, FLOOR_DEPTH_M), (-0.02, 0.0, -FLOOR_DEPTH_M / 2.0), _STAND_RGBA),
    }
    if layout.bin is not None:
        bin_x, bin_y, rim_z = layout.bin.p_WRim
        height = FLOOR_DEPTH_M + rim_z - layout.bin.size_m[2] - layout.bin.wall_m
        stand = Box(0.12, 0.12, height)
        pieces["bin_stand"] = (stand, (bin_x, bin_y, height / 2.0 - FLOOR_DEPTH_M), _STAND_RGBA)
    for number, (sign_x, sign_y) in enumerate(itertools.product((-1.0, 1.0), repeat=2)):
        p_WLeg = (x + sign_x * (size_x / 2.0 - inset), y + sign_y * (size_y / 2.0 - inset), z_leg)
        leg = Box(LEG_EDGE_M, LEG_EDGE_M, leg_height)
        pieces[f"table_leg_{number}"] = (leg, p_WLeg, _TABLE_RGBA)
    for name, (shape, p_W, rgba) in pieces.items():
        plant.RegisterVisualGeometry(plant.world_body(), RigidTransform(p_W), shape, name, rgba)


def _add_fixed(
    plant: MultibodyPlant,
    name: str,
    X_WB: Array,
    primitives: Sequence[Primitive],
    rgba: tuple[float, ...],
) -> RigidBody:
    """Add a body that does not move, seen and touched as `primitives`, whose X_OP are in B."""
    body = plant.AddRigidBody(name, plant.AddModelInstance(name))
    plant.WeldFrames(plant.world_frame(), body.body_frame(), RigidTransform(X_WB))
    for number, primitive in enumerate(primitives):
        shape, X_BP = drake_shape(primitive), RigidTransform(primitive.X_OP)
        plant.RegisterVisualGeometry(body, X_BP, shape, f"{name}_{number}", rgba)
    _add_collision(plant, body, primitives)
    return body


def add_objects(
    plant: MultibodyPlant,
    objects: Sequence[RigidObject],
    visible: bool = True,
    table_z_m: float = 0.0,
    solid: bool = True,
) -> tuple[RigidBody, ...]:
    """Add free bodies, named as the objects, and return them in the same order.

    Where nobody looks, `visible` may be False, and `solid` where nothing touches them: meshes that
    are seen and pieces that are touched take time to prepare.

    By default they rest beside each other at the height of a table, 0.15 m apart along y, from
    (0.5, 0) on.

    Raises ValueError where a body has an object's name already.
    """
    bodies = []
    for index, item in enumerate(objects):
        rgba = _OBJECT_RGBA[index % len(_OBJECT_RGBA)] if visible else None
        body = _add_object(plant, item, rgba)
        if solid:
            _add_collision(plant, body, item.collision)
        p_WO = (0.5, 0.15 * index, table_z_m - float(item.mesh.bounds[0][2]))
        plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform(p_WO))
        bodies.append(body)
    return tuple(bodies)


def _add_object(
    plant: MultibodyPlant, item: RigidObject, rgba: tuple[float, ...] | None
) -> RigidBody:
    if plant.HasBodyNamed(item.name):
        raise ValueError(f"an object's name is {item.name!r}; expected one that is not taken")
    body = plant.AddRigidBody(item.name, plant.AddModelInstance(item.name), spatial_inertia(item))
    if rgba is not None:
        mesh = drake_mesh(item.mesh)
        plant.RegisterVisualGeometry(body, RigidTransform(), mesh, item.name, rgba)
    return body


def _add_collision(plant: MultibodyPlant, body: RigidBody, primitives: Sequence[Primitive]) -> None:
    friction = CoulombFriction(1.0, 1.0)
    for number, primitive in enumerate(primitives):
        shape, X_BP = drake_shape(primitive), RigidTransform(primitive.X_OP)
        plant.RegisterCollisionGeometry(body, X_BP, shape, f"{body.name()}_{number}", friction)


def spatial_inertia(item: RigidObject) -> SpatialInertia:
    """Return the inertia about the origin of O, as Drake wants it."""
    inertia = np.asarray(item.inertia_kg_m2)
    I_OCom = RotationalInertia(*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2])
    return SpatialInertia.MakeFromCentralInertia(item.mass_kg, item.p_OCom, I_OCom)


def drake_mesh(mesh: trimesh.Trimesh) -> Mesh:
    """Return the mesh as an in-memory OBJ that renderers and Meshcat can draw, smoothly shaded."""
    smooth = trimesh.graph.smooth_shade(mesh, angle=np.radians(35.0))
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in smooth.vertices]
    lines += [f"vn {x:.4f} {y:.4f} {z:.4f}" for x, y, z in smooth.vertex_normals]
    lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in smooth.faces + 1]
    return Mesh(InMemoryMesh(mesh_file=MemoryFile("\n".join(lines), ".obj", "object.obj")))
