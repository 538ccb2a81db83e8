"""A picture of shapes, kind by kind.

``python -m split_drake.objects.procedural.sheet --out shapes.png`` draws the training kinds,
``--split test`` those that are held out, ``--show pieces`` what stands for them in contact.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from numpy.typing import NDArray
from rich.progress import track

from split_drake.bad_input import require_numbers
from split_drake.experiments.command import run_command
from split_drake.files import replacing
from split_drake.objects.convex_pieces import piece_mesh
from split_drake.objects.procedural.split import ProceduralSource, Split, entries, kinds_of
from split_drake.objects.ray_caster import RayCaster
from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array

Colour = tuple[float, float, float]

# All shapes at one scale: the side of the square that a picture shows.
_VIEW_M = 0.175
_SUPERSAMPLING = 3
_SMOOTH_RAD = np.radians(35.0)
_BACKGROUND = 0.97
_PALETTE: tuple[Colour, ...] = tuple(plt.get_cmap("tab10")(i)[:3] for i in range(10))
_LIGHT = np.array([-0.35, -0.45, 0.82])
# Lights around the first one, that shadows have soft edges.
_SPREAD = 0.12
_LIGHTS = 5
_TO_CAMERA = np.array([0.52, -0.62, 0.59])


@dataclass(frozen=True)
class SheetConfig:
    """Which shapes to draw.

    Attributes:
        out: picture to write.
        split: of the shapes.
        examples: of each kind, the first ones.
        show: the meshes, or the collision pieces in one colour each.
        columns: kinds side by side.
        pixels: edge of each shape's picture.
    """

    out: Path
    split: Split = "train"
    examples: int = 6
    show: Literal["mesh", "pieces"] = "mesh"
    columns: int = 2
    pixels: int = 120

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("examples", "columns", "pixels"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")


def draw(parts: Sequence[tuple[trimesh.Trimesh, Colour]], pixels: int) -> Array:
    """Return a picture (pixels, pixels, 3) of coloured meshes that stand at z = 0, from above.

    Colours are red, green and blue, 0 to 1.
    """
    fine = pixels * _SUPERSAMPLING
    camera = _TO_CAMERA / np.linalg.norm(_TO_CAMERA)
    right = np.cross([0.0, 0.0, 1.0], camera)
    right /= np.linalg.norm(right)
    up = np.cross(camera, right)
    bounds = np.array([mesh.bounds for mesh, _ in parts])
    middle = (bounds[:, 0].min(axis=0) + bounds[:, 1].max(axis=0)) / 2.0
    across, along = np.meshgrid(*[(np.arange(fine) + 0.5) / fine - 0.5] * 2)
    p_OStarts = middle + camera + _VIEW_M * (across[..., None] * right - along[..., None] * up)
    image = _shade(_Model(parts), p_OStarts.reshape(-1, 3), camera).reshape(fine, fine, 3)
    return image.reshape(pixels, _SUPERSAMPLING, pixels, _SUPERSAMPLING, 3).mean(axis=(1, 3))


class _Model:
    """Coloured meshes that are smooth over blunt edges, as rays meet them."""

    def __init__(self, parts: Sequence[tuple[trimesh.Trimesh, Colour]]) -> None:
        smooth = [trimesh.graph.smooth_shade(mesh, angle=_SMOOTH_RAD) for mesh, _ in parts]
        colours = [colour for _, colour in parts]
        counts = [len(mesh.faces) for mesh in smooth]
        self.caster = RayCaster(trimesh.util.concatenate(smooth))
        self.triangles = np.concatenate([mesh.triangles for mesh in smooth])
        self.face_normals = np.concatenate([mesh.face_normals for mesh in smooth])
        self.corner_normals = np.concatenate([m.vertex_normals[m.faces] for m in smooth])
        self.colours = np.repeat(colours, counts, axis=0)

    def normals(self, points: Array, faces: NDArray[np.int32]) -> Array:
        """Return the normals (N, 3) at points on faces."""
        weights = trimesh.triangles.points_to_barycentric(self.triangles[faces], points)
        normals = np.einsum("nk,nki->ni", np.clip(weights, 0.0, 1.0), self.corner_normals[faces])
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-9))


def _shade(model: _Model, p_OStarts: Array, camera: Array) -> Array:
    """Return the colours (N, 3) that rays from `p_OStarts` along -camera see."""
    distance, faces = model.caster.cast(p_OStarts, np.broadcast_to(-camera, p_OStarts.shape))
    hit = faces >= 0
    ground = p_OStarts[:, 2] / camera[2]
    points = p_OStarts - np.where(hit, distance, ground)[:, None] * camera
    flat, smooth = np.tile([0.0, 0.0, 1.0], (2, len(points), 1))
    flat[hit] = model.face_normals[faces[hit]]
    smooth[hit] = model.normals(points[hit], faces[hit])
    base = np.full((len(points), 3), _BACKGROUND)
    base[hit] = model.colours[faces[hit]]
    lit = _lit_share(model.caster, points, flat)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    halfway = (light + camera) / np.linalg.norm(light + camera)
    diffuse, sky = np.clip(smooth @ light, 0.0, 1.0) * lit, 0.5 + 0.5 * smooth[:, 2]
    shine = 0.12 * lit * np.clip(smooth @ halfway, 0.0, 1.0) ** 40
    shaded = base * (0.30 + 0.20 * sky + 0.55 * diffuse)[:, None] + shine[:, None]
    floor = base * (0.72 + 0.28 * lit)[:, None]
    return np.clip(np.where(hit[:, None], shaded, floor), 0.0, 1.0)


def _lit_share(caster: RayCaster, points: Array, normals: Array) -> Array:
    """Return (N,) the share of the lights that points see."""
    starts, rng = points + 5e-4 * normals, np.random.default_rng(0)
    share = np.zeros(len(points))
    for _ in range(_LIGHTS):
        towards = _LIGHT + _SPREAD * rng.normal(size=starts.shape)
        share += caster.cast(starts, towards)[1] < 0
    return share / _LIGHTS


def _picture(body: RigidObject, colour: Colour, config: SheetConfig) -> Array:
    if config.show == "mesh":
        return draw([(body.mesh, colour)], config.pixels)
    hulls = [piece_mesh(piece) for piece in body.collision]
    colours = itertools.cycle(_PALETTE)
    return draw(list(zip(hulls, colours, strict=False)), config.pixels)


def draw_sheet(config: SheetConfig) -> None:
    """Draw the first shapes of every kind of a split, each kind under its name."""
    source, kinds = ProceduralSource(config.split), kinds_of(config.split)
    rows = -(-len(kinds) // config.columns)
    width, height = config.columns * config.examples, rows
    figure, axes = plt.subplots(
        rows, config.columns, figsize=(width * 1.2, height * 1.4), squeeze=False
    )
    for axis in axes.ravel():
        axis.axis("off")
    for number, kind in enumerate(track(kinds, "kinds")):
        names = [entry.name for entry in entries(config.split) if entry.kind == kind]
        colour = _PALETTE[number % len(_PALETTE)]
        bodies = [source.load(name).body for name in names[: config.examples]]
        axis = axes[number % rows, number // rows]
        axis.imshow(np.hstack([_picture(body, colour, config) for body in bodies]))
        axis.set_title(kind.replace("_", " "), loc="left", fontsize=11)
    figure.tight_layout(pad=0.3)
    with replacing(config.out) as temporary:
        figure.savefig(temporary, dpi=config.pixels / 1.2)
    plt.close(figure)


if __name__ == "__main__":
    run_command(draw_sheet, SheetConfig, __doc__)
