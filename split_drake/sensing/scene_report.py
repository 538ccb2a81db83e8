"""What of a user's images or cloud a detector gets to see, and what looks wrong about it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from split_drake.camera import DepthView
from split_drake.objects_in_view import objects_in_view
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace

# A table is what covers this share of the cube's footprint, in cells, within a layer so thick.
_CELL_M, _COVER, _LAYER_M = 0.01, 0.3, 0.006
# Tables are looked for within this of where the workspace says; nearer than the least is right.
_TABLE_RANGE_M, _TABLE_ERROR_M = 0.06, 0.006
# What has this share of its points this near to a side of the cube goes on beyond it.
_CUT_SHARE, _CUT_M = 0.01, 0.004
# An object of which fewer points are seen is hardly seen.
_FEW_POINTS = 300


@dataclass(frozen=True)
class SceneReport:
    """How many points are left at each step from sensor to detector, and warnings in words.

    Attributes:
        seen: points that sensors measured.
        above_table: of these, points higher than the table.
        in_cube: of those, points in the workspace.
        voxels: that are occupied by the sampled points.
        objects: in view.
        warnings: a sentence for each thing that looks wrong.
    """

    seen: int
    above_table: int
    in_cube: int
    voxels: int
    objects: int
    warnings: tuple[str, ...]

    def facts(self) -> list[str]:
        """Return a sentence of the numbers, and the warnings after it."""
        numbers = (
            f"{self.seen} points were measured, {self.above_table} of them above the table, "
            f"{self.in_cube} of those in the cube; they fill {self.voxels} voxels and are of "
            f"{self.objects} {'object' if self.objects == 1 else 'objects'}"
        )
        return [numbers, *self.warnings]


def report_of(scene: Scene, measured: Array, counted: Workspace | None = None) -> SceneReport:
    """Return the report of a scene.

    Args:
        scene: of it.
        measured: (N, 3) points that it was made of, metres in W.
        counted: the workspace with the clearance up to which points counted as table; the scene's
            own where not given.
    """
    counted = counted or scene.workspace
    measured = measured[np.isfinite(measured).all(axis=1)]
    objects = len(objects_in_view(scene.p_WPs))
    return SceneReport(
        len(measured),
        int((measured[:, 2] > counted.lowest_z_m).sum()),
        len(scene.p_WPs),
        int(scene.grid().sum()),
        objects,
        tuple(_warnings(scene, measured, objects, counted)),
    )


def measured_points(views: Sequence[DepthView]) -> Array:
    """Return all points (N, 3) in W that the views show, the table among them."""
    return np.concatenate([view.points() for view in views])


def table_height(measured: Array, workspace: Workspace) -> float | None:
    """Return the height in W of the widest level layer of points near the workspace's bottom.

    None where no layer covers enough of the cube's footprint to be a table.

    Args:
        measured: (N, 3) points in W, table included.
        workspace: where the table should be.
    """
    corner = workspace.p_WV
    cells = np.floor((measured[:, :2] - corner[:2]) / _CELL_M).astype(int)
    across = round(workspace.edge_m / _CELL_M)
    height = measured[:, 2] - workspace.p_WCenter[2]
    inside = np.all((cells >= 0) & (cells < across), axis=1) & (np.abs(height) < _TABLE_RANGE_M)
    cells, height = cells[inside], height[inside]
    layer = np.floor(height / (_LAYER_M / 2.0)).astype(int)
    best = max(np.unique(layer), key=lambda n: _cover(cells, layer, n, across), default=None)
    if best is None or _cover(cells, layer, best, across) < _COVER:
        return None
    return float(np.median(height[_within(layer, best)])) + workspace.p_WCenter[2]


def _within(layer: np.ndarray, first: int) -> np.ndarray:
    return (layer == first) | (layer == first + 1)


def _cover(cells: np.ndarray, layer: np.ndarray, first: int, across: int) -> float:
    """Return the share of the footprint's cells that two layers, from `first` on, cover."""
    return len(np.unique(cells[_within(layer, first)], axis=0)) / across**2


def _warnings(scene: Scene, measured: Array, objects: int, counted: Workspace) -> Iterator[str]:
    workspace = scene.workspace
    for index, view in enumerate(scene.views):
        if not view.depth_m.any():
            yield f"no pixel of image {index + 1} shows anything"
    table_z = table_height(measured, workspace)
    if table_z is not None and abs(table_z - workspace.p_WCenter[2]) > _TABLE_ERROR_M:
        yield (
            f"the table seems to be at z = {table_z:.3f} m, the workspace has it at "
            f"{workspace.p_WCenter[2]:.3f} m: check the cameras' poses, or the workspace's center"
        )
    if counted.table_clearance_m > workspace.table_clearance_m:
        yield (
            "the table is noisy: what is lower than "
            f"{1e3 * counted.table_clearance_m:.0f} mm above it counts as table, in place of "
            f"{1e3 * workspace.table_clearance_m:.0f} mm"
        )
    if objects > 1:
        yield f"{objects} objects are in view; each is looked at alone"
    if sides := _cut_sides(scene):
        yield f"what is seen goes on beyond the cube's side {', '.join(sides)}: move its center"
    if len(scene.p_WPs) < _FEW_POINTS:
        yield (
            f"only {len(scene.p_WPs)} points are in the cube: is the camera far away, or the "
            "object black or of glass?"
        )


def _cut_sides(scene: Scene) -> list[str]:
    p_VPs = scene.p_WPs - scene.workspace.p_WV
    enough = max(_CUT_SHARE * len(p_VPs), 20)
    sides = []
    for axis, name in enumerate("xyz"):
        if name != "z" and (p_VPs[:, axis] < _CUT_M).sum() > enough:
            sides.append(f"-{name}")
        if (p_VPs[:, axis] > scene.workspace.edge_m - _CUT_M).sum() > enough:
            sides.append(f"+{name}")
    return sides
