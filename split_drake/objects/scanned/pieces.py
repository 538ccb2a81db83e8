"""What a mug collides as: pieces fitted to its mesh, or a decomposition where these fail."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

from split_drake.objects.convex_pieces import convex_piece, piece_mesh
from split_drake.objects.meshes.decomposition import convex_hulls
from split_drake.objects.meshes.mass import is_closed
from split_drake.objects.meshes.mesh_file import ObjectFileError
from split_drake.objects.mug_shape import InvalidMugError
from split_drake.objects.ray_caster import RayCaster
from split_drake.objects.rigid import Primitive
from split_drake.objects.scanned.collision import fit_collision
from split_drake.objects.scanned.handle import Silhouette, measure_grip
from split_drake.objects.scanned.profile import BodyProfile
from split_drake.poses import Array

# Decompositions are kept here, below where a command runs.
CACHE = Path("runs/decompositions")
DECOMPOSED = "it collides as a convex decomposition"
# From all around, a mesh and pieces that stand for it are met within `CLOSE_M` by this share of
# rays: of a closed mesh, and of one that is open, where rays go through its gaps.
MIN_CLOSE = 0.9
MIN_CLOSE_OPEN = 0.75
CLOSE_M = 0.003
# Of the hook's peg, for which pieces leave room.
PEG_RADIUS_M = 0.006

_HEIGHTS = 40
_AZIMUTHS = 90
_FAR_M = 0.5
_PEG_RAYS = 24


def collision_pieces(
    mesh: trimesh.Trimesh, profile: BodyProfile, silhouette: Silhouette, X_OH: Array
) -> tuple[tuple[Primitive, ...], tuple[str, ...]]:
    """Return convex pieces that stand for a mug's mesh, given in O, and remarks on them.

    Raises InvalidMugError where neither fitted pieces nor a decomposition follow the mesh and let
    a peg through the opening.
    """
    try:
        fitted = fit_collision(profile, measure_grip(mesh, silhouette, profile))
        require_fidelity(mesh, fitted, X_OH)
    except InvalidMugError as fault:
        try:
            return decomposed_pieces(mesh, X_OH), (f"{DECOMPOSED} ({fault})",)
        except InvalidMugError as second:
            raise InvalidMugError(f"{fault}; nor decomposed: {second}") from second
    return fitted, ()


def decomposed_pieces(mesh: trimesh.Trimesh, X_OH: Array) -> tuple[Primitive, ...]:
    """Return the pieces of a convex decomposition; raise InvalidMugError where they will not do."""
    try:
        hulls = convex_hulls(mesh, CACHE)
    except ObjectFileError as error:
        raise InvalidMugError(str(error)) from error
    pieces = tuple(map(convex_piece, hulls))
    require_fidelity(mesh, pieces, X_OH)
    return pieces


def require_fidelity(mesh: trimesh.Trimesh, pieces: Sequence[Primitive], X_OH: Array) -> None:
    """Raise InvalidMugError where pieces do not follow a mesh's outside, or close its opening.

    Level rays towards the mug's axis and along y meet both; gaps of the mesh do not count.
    """
    solid = trimesh.util.concatenate([piece_mesh(piece) for piece in pieces])
    p_Os, d_Os = _rays(mesh)
    of_mesh, _ = RayCaster(mesh).cast(p_Os, d_Os)
    of_pieces, _ = RayCaster(solid).cast(p_Os, d_Os)
    met = np.isfinite(of_mesh)
    with np.errstate(invalid="ignore"):
        close = float((np.abs(of_pieces[met] - of_mesh[met]) < CLOSE_M).mean())
    least = MIN_CLOSE if is_closed(mesh) else MIN_CLOSE_OPEN
    if close < least:
        raise InvalidMugError(
            f"unlike its pieces: {close:.0%} of its outside lie within {CLOSE_M:g} m of them, "
            f"expected {least:.0%}"
        )
    _require_room(solid, X_OH)


def _rays(mesh: trimesh.Trimesh) -> tuple[Array, Array]:
    """Return starts and directions (N, 3) of rays from all around, towards O's axis."""
    top = float(mesh.bounds[1, 2])
    heights = top * (np.arange(_HEIGHTS) + 0.5) / _HEIGHTS
    angle = np.linspace(0.0, 2.0 * np.pi, _AZIMUTHS, endpoint=False)
    z, azimuth = (grid.ravel() for grid in np.meshgrid(heights, angle))
    inward = -np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(z)])
    starts = -_FAR_M * inward
    starts[:, 2] = z
    # The handle, whose opening and edges rays towards the axis hardly meet, is seen from beside.
    x = np.linspace(0.0, float(mesh.bounds[1, 0]), _AZIMUTHS)
    x, z = (grid.ravel() for grid in np.meshgrid(x, heights))
    aside = np.column_stack([x, np.full_like(x, -_FAR_M), z])
    along = np.broadcast_to((0.0, 1.0, 0.0), aside.shape)
    return np.vstack([starts, aside]), np.vstack([inward, along])


def _require_room(solid: trimesh.Trimesh, X_OH: Array) -> None:
    """Raise InvalidMugError where a thin peg along H's y does not pass beside the pieces."""
    angle = np.linspace(0.0, 2.0 * np.pi, _PEG_RAYS, endpoint=False)
    around = np.column_stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)])
    starts = X_OH[:3, 3] + PEG_RADIUS_M * around - (0.0, _FAR_M, 0.0)
    distances, _ = RayCaster(solid).cast(starts, np.broadcast_to((0.0, 1.0, 0.0), starts.shape))
    blocked = float(np.isfinite(distances).mean())
    if blocked > 0.0:
        raise InvalidMugError(
            f"blocked opening: its pieces stop {blocked:.0%} of the rays through it, expected none"
        )
