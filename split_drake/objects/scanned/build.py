"""Mugs made of meshes: brought into their frame O, measured, weighed, and given pieces."""

from dataclasses import dataclass

import numpy as np
import shapely
import trimesh

from split_drake.objects.meshes.mass import mass_properties, shell_properties
from split_drake.objects.meshes.mesh_file import tidied
from split_drake.objects.mug_shape import InvalidMugError, MugShape
from split_drake.objects.rigid import RigidObject
from split_drake.objects.scanned.frame import find_frame, into_frame
from split_drake.objects.scanned.handle import (
    PEG_ROOM_M,
    Silhouette,
    cast_outline,
    see_through,
)
from split_drake.objects.scanned.pieces import collision_pieces
from split_drake.objects.scanned.profile import BodyProfile, measure_profile
from split_drake.poses import Array, make_pose

MASS_KG = 0.30
MIN_SIZE_M = 0.02
# A workspace of 30 cm holds a mug of this size up to 3 cm off its middle.
MAX_SIZE_M = 0.24
# Vertices that are only close, and slivers, stay: without them the mesh could leak.
_MERGE_DIGITS = 12
# Points this close to the table count as what a mug stands on.
_FOOT_M = 0.002
_SHEET_M = 0.001


@dataclass(frozen=True)
class BuiltMug:
    """A mug, and what had to be done to have one.

    Attributes:
        shape: the mug.
        remarks: a clause each, for people; none where all went as usual.
    """

    shape: MugShape
    remarks: tuple[str, ...]


def build_mug_from_mesh(name: str, mesh_F: trimesh.Trimesh) -> MugShape:
    """Return the mug of a mesh, see `build_mug`."""
    return build_mug(name, mesh_F).shape


def build_mug(name: str, mesh_F: trimesh.Trimesh) -> BuiltMug:
    """Return the mug whose mesh, in a frame F with z up, is given in metres.

    It collides as pieces that are fitted to its wall and handle, or by convex decomposition where
    these do not follow the mesh.

    Raises InvalidMugError where the mesh is no mug: the reason, a colon, and the numbers.
    """
    mesh = tidied(mesh_F, _MERGE_DIGITS)
    _check_faces(mesh)
    _check_size(mesh)
    mesh = into_frame(mesh, find_frame(mesh))
    profile = measure_profile(mesh)
    silhouette = see_through(mesh, float(np.median(profile.outer_m)) / 2.0)
    opening_OPs = cast_outline(mesh, silhouette.p_OMiddle())
    X_OH = _handle_pose(opening_OPs, silhouette)
    p_OCom, inertia = _mass_properties(mesh, profile)
    _check_stands(mesh, p_OCom)
    pieces, remarks = collision_pieces(mesh, profile, silhouette, X_OH)
    body = RigidObject(
        name=name,
        mesh=mesh,
        mass_kg=MASS_KG,
        p_OCom=p_OCom,
        inertia_kg_m2=inertia,
        collision=pieces,
    )
    diameter = 2.0 * float(profile.outer_m.max())
    return BuiltMug(MugShape.of(body, X_OH, opening_OPs, diameter), remarks)


def _mass_properties(mesh: trimesh.Trimesh, profile: BodyProfile) -> tuple[Array, Array]:
    """Return centre of mass (3,) and inertia (3, 3); of a shell where the wall is thin as one.

    A wall thinner than any mug's is a sheet, beside which a solid handle would weigh too much.
    """
    thin = float(np.median(profile.wall_m)) < _SHEET_M
    return (shell_properties if thin else mass_properties)(mesh, MASS_KG)


def _check_faces(mesh: trimesh.Trimesh) -> None:
    if not len(mesh.faces):
        raise InvalidMugError("empty mesh: it has no faces, expected those of a mug")


def _check_size(mesh: trimesh.Trimesh) -> None:
    size = float(mesh.extents.max())
    if not MIN_SIZE_M <= size <= MAX_SIZE_M:
        raise InvalidMugError(
            f"wrong size: it measures {size:.4g} m along its longest edge, expected {MIN_SIZE_M:g} "
            f"to {MAX_SIZE_M:g} m; are its units metres?"
        )


def _check_stands(mesh: trimesh.Trimesh, p_OCom: Array) -> None:
    foot = mesh.vertices[mesh.vertices[:, 2] < _FOOT_M, :2]
    support = shapely.MultiPoint(foot).convex_hull
    outside_m = support.distance(shapely.Point(p_OCom[:2]))
    if outside_m > 0.0:
        raise InvalidMugError(
            f"cannot stand: its centre of mass lies {outside_m:.4f} m beside what it stands on"
        )


def _handle_pose(opening_OPs: Array, silhouette: Silhouette) -> Array:
    """Return X_OH, parallel to O with its origin at the centroid of the opening's outline."""
    center = shapely.Polygon(opening_OPs[:, [0, 2]]).centroid
    room_m = silhouette.room_m(np.array([center.x, center.y]))
    if room_m < PEG_ROOM_M:
        raise InvalidMugError(
            f"tight opening: {room_m:.4f} m of room around its centroid, expected {PEG_ROOM_M}"
        )
    return make_pose(p=(center.x, 0.0, center.y))
