"""Watertight meshes of parametric mugs: a revolved body joined with a swept handle."""

import manifold3d
import numpy as np
import trimesh

from split_drake.objects.mug_shape import InvalidMugError
from split_drake.objects.mugs.parameters import MugParameters, outer_radius_m
from split_drake.poses import Array

BODY_SECTORS = 48
PROFILE_ROWS = 14
RIM_POINTS = 5
PATH_POINTS = 28
GRIP_POINTS = 12
ROOT_LENGTH_M = 0.012
TABLE_GAP_M = 0.002
OVERLAP_M = 5e-5


def _walls(parameters: MugParameters, z: Array) -> tuple[Array, Array]:
    """Return outer and inner radius at heights `z`, the wall's thickness measured across it."""
    step = 1e-4
    outer = outer_radius_m(parameters, z)
    slope = (outer_radius_m(parameters, z + step) - outer_radius_m(parameters, z - step)) / (
        np.minimum(z + step, parameters.height_m) - np.maximum(z - step, 0.0)
    )
    return outer, outer - parameters.wall_m * np.sqrt(1.0 + slope**2)


def _cavity_outline(parameters: MugParameters) -> Array:
    """Return (N, 2) radius and height along the inside of the wall, from the base up."""
    z = np.linspace(parameters.base_m, parameters.height_m - parameters.wall_m / 2.0, PROFILE_ROWS)
    _, inner = _walls(parameters, z)
    if inner.min() < 0.008:
        raise InvalidMugError(f"narrow cavity: its radius falls to {inner.min():.4f} m")
    return np.column_stack([inner, z])


def _body_outline(parameters: MugParameters) -> Array:
    """Return (N, 2) radius and height around half the body's cross-section, rim rounded."""
    z = np.linspace(0.0, parameters.height_m - parameters.wall_m / 2.0, PROFILE_ROWS)
    outer, inner = _walls(parameters, z)
    angles = np.linspace(0.0, np.pi, RIM_POINTS + 2)[1:-1]
    rim = np.column_stack(
        [
            (outer[-1] + inner[-1]) / 2.0 + (outer[-1] - inner[-1]) / 2.0 * np.cos(angles),
            z[-1] + parameters.wall_m / 2.0 * np.sin(angles),
        ]
    )
    inside = _cavity_outline(parameters)[::-1]
    return np.vstack(
        [[0.0, 0.0], np.column_stack([outer, z]), rim, inside, [0.0, parameters.base_m]]
    )


def _revolve(outline: Array) -> manifold3d.Manifold:
    """Return the solid of revolution of (N, 2) radii and heights about z.

    It is turned by half a sector, so that the plane y = 0 cuts faces and not edges.
    """
    section = manifold3d.CrossSection([outline])
    solid = manifold3d.Manifold.revolve(section, BODY_SECTORS)
    return solid.rotate((0.0, 0.0, 180.0 / BODY_SECTORS))


def _resample(path: Array, count: int) -> Array:
    """Return `count` points evenly spread along the polyline `path` (N, D)."""
    lengths = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
    at = np.linspace(0.0, lengths[-1], count)
    return np.column_stack([np.interp(at, lengths, column) for column in path.T])


def handle_path(parameters: MugParameters) -> Array:
    """Return (N, 2) x and z of O along the handle's centreline, from the lower to the upper root.

    A superellipse |x / reach|^n + |z / half span|^n = 1 that stands on the line between its roots,
    which lie in the middle of the wall, and rises with |x| by `handle_lift_m` at its furthest.
    """
    half_grip = parameters.grip_thickness_m / 2.0
    room = parameters.height_m - 2.0 * (half_grip + TABLE_GAP_M)
    half_span = parameters.handle_span * room / 2.0
    z_center = half_grip + TABLE_GAP_M + half_span
    z_center += parameters.handle_position * (room - 2.0 * half_span)
    angle = np.linspace(-np.pi / 2.0, np.pi / 2.0, 400)
    power = 2.0 / parameters.handle_power
    rise = np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** power
    out = np.abs(np.cos(angle)) ** power
    reach = parameters.handle_reach_m * out
    reach *= 1.0 + parameters.handle_skew * rise
    z = z_center + half_span * rise
    roots = outer_radius_m(parameters, z[[0, -1]]) - parameters.wall_m / 2.0
    x = np.interp(z, z[[0, -1]], roots) + reach
    return _resample(np.column_stack([x, z + parameters.handle_lift_m * out]), PATH_POINTS)


def _grip_ring(parameters: MugParameters) -> Array:
    """Return (M, 2) the handle's cross-section, a stadium: across it in the plane y = 0, and y."""
    radius = parameters.grip_thickness_m / 2.0
    angle = (np.arange(GRIP_POINTS) + 0.5) * 2.0 * np.pi / GRIP_POINTS
    y = radius * np.sin(angle)
    y += np.sign(y) * radius * (parameters.grip_aspect - 1.0)
    return np.column_stack([radius * np.cos(angle), y])


def _handle(parameters: MugParameters) -> manifold3d.Manifold:
    """Return the handle as the union of the convex hulls of neighbouring cross-sections."""
    path = handle_path(parameters)
    into_body = np.array([ROOT_LENGTH_M, 0.0])
    path = np.vstack([path[0] - into_body, path, path[-1] - into_body])
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = np.column_stack([tangents[:, 1], -tangents[:, 0]])
    ring = _grip_ring(parameters)
    in_plane = path[:, None] + ring[None, :, :1] * across[:, None]
    y = np.broadcast_to(ring[None, :, 1], in_plane.shape[:2])
    rings = np.stack([in_plane[..., 0], y, in_plane[..., 1]], axis=-1)
    # Pieces that only touch would stay apart.
    overlap = OVERLAP_M * np.column_stack([tangents[:, 0], np.zeros(len(path)), tangents[:, 1]])
    pieces = [
        manifold3d.Manifold.hull_points(np.vstack(pair))
        for pair in zip(rings[:-1], rings[1:] + overlap[1:, None], strict=True)
    ]
    return manifold3d.Manifold.batch_boolean(pieces, manifold3d.OpType.Add)


def make_mesh(parameters: MugParameters) -> trimesh.Trimesh:
    """Return the mug's mesh in O, watertight, nothing of the handle inside the cavity.

    Raises InvalidMugError where the parts make no mug with exactly one opening.
    """
    inside = _cavity_outline(parameters)
    top = parameters.height_m + 0.01
    cavity = np.vstack([[0.0, parameters.base_m], inside, [inside[-1, 0], top], [0.0, top]])
    handle = _handle(parameters) - _revolve(cavity)
    solid = _revolve(_body_outline(parameters)) + handle
    if (parts := len(solid.decompose())) != 1:
        raise InvalidMugError(f"handle apart from body: the solid has {parts} parts")
    if solid.genus() != 1:
        raise InvalidMugError(f"no single opening: the solid has genus {solid.genus()}")
    surface = solid.to_mesh64()
    # Copies: views would keep manifold3d's mesh alive, which it complains of at the program's end.
    vertices, faces = np.array(surface.vert_properties[:, :3]), np.array(surface.tri_verts)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if not mesh.is_watertight:
        raise InvalidMugError("leaking mesh: an edge has not exactly two faces")
    return mesh
