"""Building mugs from parameters."""

import numpy as np
import shapely
import trimesh

from split_drake.objects.mug_shape import InvalidMugError, MugShape
from split_drake.objects.mugs.collision import collision_geometry
from split_drake.objects.mugs.mesh import make_mesh
from split_drake.objects.mugs.parameters import MugParameters
from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array, make_pose

# A peg through the middle of the opening needs this much room around its axis.
OPENING_CLEARANCE_M = 0.009


def opening_outline(mesh: trimesh.Trimesh) -> Array:
    """Return (M, 3) the closed outline of the handle's opening in the plane y = 0 of O.

    Raises InvalidMugError where the mesh cut by that plane has not exactly one hole.
    """
    section = mesh.section(plane_origin=np.zeros(3), plane_normal=np.array([0.0, 1.0, 0.0]))
    rings = [] if section is None else [np.asarray(ring) for ring in section.discrete]
    if len(rings) != 2:
        raise InvalidMugError(f"no single opening: the plane y = 0 cuts {len(rings)} rings")
    return min(rings, key=lambda ring: shapely.Polygon(ring[:, [0, 2]]).area)


def _handle_pose(opening_OPs: Array) -> Array:
    """Return X_OH, parallel to O with its origin at the centroid of the opening's outline."""
    polygon = shapely.Polygon(opening_OPs[:, [0, 2]])
    center = polygon.centroid
    clearance = center.distance(polygon.exterior) if polygon.contains(center) else 0.0
    if clearance < OPENING_CLEARANCE_M:
        raise InvalidMugError(
            f"tight opening: {clearance:.4f} m of room around its centroid, "
            f"expected {OPENING_CLEARANCE_M}"
        )
    return make_pose(p=(center.x, 0.0, center.y))


def build_mug(name: str, parameters: MugParameters, split: str = "", number: int = 0) -> MugShape:
    """Return the mug that `parameters` describe, which belongs to a split or to none.

    Raises InvalidMugError where they describe none: the reason, a colon, and the numbers.
    """
    mesh = make_mesh(parameters)
    opening_OPs = opening_outline(mesh)
    X_OH = _handle_pose(opening_OPs)
    inertia = mesh.moment_inertia * (parameters.mass_kg / mesh.volume)
    body = RigidObject(
        name=name,
        mesh=mesh,
        mass_kg=parameters.mass_kg,
        p_OCom=np.asarray(mesh.center_mass),
        inertia_kg_m2=inertia,
        collision=collision_geometry(parameters),
    )
    diameter_m = 2.0 * parameters.outer_radius_m
    return MugShape.of(body, X_OH, opening_OPs, diameter_m, split, number)
