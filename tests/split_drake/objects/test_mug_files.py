"""Mugs from mesh files: the frame they are brought into, what is fitted to them, and refusals."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh

from split_drake.objects.meshes.mass import is_closed, mass_properties
from split_drake.objects.mug_shape import InvalidMugError, MugShape
from split_drake.objects.mugs.split import load_mug, mug_names, mug_parameters
from split_drake.objects.scanned.build import MASS_KG, build_mug_from_mesh
from split_drake.objects.scanned.files import load_mug_file, load_mug_folder
from split_drake.objects.scanned.handle import CELL_M, see_through
from split_drake.objects.scanned.profile import measure_profile
from split_drake.poses import Array, make_pose, rotation_x, rotation_z
from tests.split_drake.objects.test_mugs import piece_surface, signed_distances

REAL_MUGS = Path(__file__).parents[4] / "shared" / "real_mugs"
ONE_OF_EACH_PROFILE = {mug_parameters(name).profile: name for name in mug_names("test")}
X_FO = make_pose(rotation_z(2.2), (0.31, -0.07, 0.2))


def placed(mesh: trimesh.Trimesh, X: Array) -> trimesh.Trimesh:
    """Return a copy of a mesh at `X`."""
    moved = mesh.copy()
    moved.apply_transform(X)
    return moved


def opening_area(mug: MugShape) -> float:
    return float(shapely.Polygon(mug.opening_OPs[:, [0, 2]]).area)


def distances_to_pieces(mug: MugShape, p_OPs: Array) -> Array:
    return np.min([signed_distances(piece, p_OPs) for piece in mug.body.collision], axis=0)


def cup(foot_m: float = 0.04) -> trimesh.Trimesh:
    """Return a mug without a handle, standing on a disc of radius `foot_m`."""
    outside = [[0.0, 0.0], [foot_m, 0.0], [0.04, 0.01], [0.04, 0.09]]
    inside = [[0.036, 0.09], [0.036, 0.012], [0.0, 0.012]]
    return trimesh.creation.revolve(outside + inside, sections=48)


def ring_handle(azimuth_rad: float = 0.0) -> trimesh.Trimesh:
    """Return a torus that sticks out of the cup."""
    torus = trimesh.creation.torus(major_radius=0.022, minor_radius=0.005)
    upright = make_pose(rotation_x(np.pi / 2.0), (0.042, 0.0, 0.045))
    return placed(torus, make_pose(rotation_z(azimuth_rad)) @ upright)


def plug() -> trimesh.Trimesh:
    """Return a handle without an opening."""
    return trimesh.creation.box((0.06, 0.01, 0.05), make_pose(p=(0.05, 0.0, 0.045)))


@pytest.fixture(scope="module", params=ONE_OF_EACH_PROFILE.values())
def pair(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[MugShape, MugShape]:
    """Return a parametric mug, and the same from a file in which it is turned and shifted."""
    known = load_mug(request.param)
    path = tmp_path_factory.mktemp("mugs") / f"{request.param}.stl"
    placed(known.body.mesh, X_FO).export(path)
    return known, load_mug_file(path)


def test_a_turned_and_shifted_mug_is_the_same(pair: tuple[MugShape, MugShape]) -> None:
    known, loaded = pair
    assert loaded.body.name == known.body.name
    assert np.allclose(loaded.X_OH, known.X_OH, atol=7e-4)
    assert np.allclose(loaded.body.mesh.bounds, known.body.mesh.bounds, atol=5e-4)
    assert np.allclose(loaded.body.p_OCom, known.body.p_OCom, atol=5e-4)
    assert opening_area(loaded) == pytest.approx(opening_area(known), rel=0.03)
    assert loaded.outer_diameter_m == pytest.approx(known.outer_diameter_m, abs=0.0015)
    scale = MASS_KG / known.body.mass_kg
    assert np.allclose(loaded.body.inertia_kg_m2, known.body.inertia_kg_m2 * scale, atol=5e-6)


def test_collision_follows_the_mesh(pair: tuple[MugShape, MugShape]) -> None:
    _, loaded = pair
    p_OPs, _ = trimesh.sample.sample_surface(loaded.body.mesh, 3000, seed=0)
    distances = distances_to_pieces(loaded, p_OPs)
    assert np.mean(np.abs(distances) < 0.0015) > 0.97
    assert np.abs(distances).max() < 0.004
    p_OQs = np.concatenate([piece_surface(piece) for piece in loaded.body.collision])
    assert p_OQs[:, 2].min() > -3e-4
    assert len(loaded.body.collision) <= 110


def test_a_peg_fits_through_the_opening(pair: tuple[MugShape, MugShape]) -> None:
    _, loaded = pair
    along = np.linspace(-0.05, 0.05, 60)[:, None] * (0.0, 1.0, 0.0)
    assert distances_to_pieces(loaded, loaded.X_OH[:3, 3] + along).min() > 0.0075


def test_a_mesh_with_gaps_and_inner_surfaces_gives_the_same_mug() -> None:
    cavity = trimesh.creation.cylinder(radius=0.038, height=0.3)
    whole = trimesh.boolean.union([cup(), trimesh.boolean.difference([ring_handle(), cavity])])
    patched = trimesh.util.concatenate([cup(), ring_handle()])
    patched.update_faces(np.arange(len(patched.faces)) % 97 > 0)
    assert whole.is_watertight
    assert not is_closed(patched)
    first, second = (build_mug_from_mesh("mug", mesh) for mesh in (whole, patched))
    assert np.allclose(first.X_OH, second.X_OH, atol=1e-3)
    assert opening_area(first) == pytest.approx(opening_area(second), rel=0.03)
    assert len(first.body.collision) == pytest.approx(len(second.body.collision), abs=6)


def test_faces_that_look_inwards_are_turned() -> None:
    mesh = load_mug("test_000").body.mesh.copy()
    mesh.invert()
    assert build_mug_from_mesh("mug", mesh).body.mesh.volume > 0.0


def test_an_edge_of_four_faces_does_not_open_a_mesh() -> None:
    lower = trimesh.creation.box((0.1, 0.1, 0.1))
    upper = placed(lower, make_pose(p=(0.1, 0.0, 0.1)))
    boxes = trimesh.util.concatenate([lower, upper])
    boxes.merge_vertices()
    assert not boxes.is_watertight
    assert is_closed(boxes)
    assert np.allclose(mass_properties(boxes, 0.2)[0], (0.05, 0.0, 0.05), atol=1e-9)
    boxes.update_faces(np.arange(len(boxes.faces)) > 0)
    assert not is_closed(boxes)


def test_a_shell_is_as_heavy_everywhere() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    sphere.update_faces(np.arange(len(sphere.faces)) > 0)
    p_OCom, inertia = mass_properties(placed(sphere, make_pose(p=(0.1, 0.0, 0.03))), 0.2)
    assert np.allclose(p_OCom, (0.1, 0.0, 0.03), atol=5e-5)
    assert np.allclose(inertia, 2.0 / 3.0 * 0.2 * 0.05**2 * np.eye(3), rtol=5e-3, atol=1e-6)


def test_a_folder_holds_files_and_folders(tmp_path: Path) -> None:
    mesh = load_mug("test_000").body.mesh
    (tmp_path / "second").mkdir()
    for path in (tmp_path / "third.stl", tmp_path / "first.glb", tmp_path / "second" / "mug.ply"):
        mesh.export(path)
    (tmp_path / "second" / "meta.json").write_text("{}")
    mugs = load_mug_folder(tmp_path)
    assert [mug.body.name for mug in mugs] == ["first", "second", "third"]
    assert np.allclose(mugs[0].X_OH, mugs[2].X_OH, atol=1e-4)


def test_folders_without_a_mesh_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="holds no mesh file"):
        load_mug_folder(tmp_path)
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        load_mug_folder(tmp_path / "none")
    with pytest.raises(FileNotFoundError, match=r"none\.obj is no file"):
        load_mug_file(tmp_path / "none.obj")


REFUSALS: dict[str, tuple[Callable[[], trimesh.Trimesh], str]] = {
    "no handle": (cup, "no handle"),
    "no opening": (lambda: trimesh.util.concatenate([cup(), plug()]), "no single opening: .* 0 "),
    "two handles": (
        lambda: trimesh.util.concatenate([cup(), ring_handle(), ring_handle(np.pi)]),
        "no single handle",
    ),
    "huge": (
        lambda: placed(load_mug("test_000").body.mesh, np.diag([7.0] * 3 + [1.0])),
        "wrong size",
    ),
    "tiny": (
        lambda: placed(load_mug("test_000").body.mesh, np.diag([0.1] * 3 + [1.0])),
        "wrong size",
    ),
    "lying": (
        lambda: placed(load_mug("test_000").body.mesh, make_pose(rotation_x(np.pi / 2.0))),
        "no upright round body",
    ),
    "upside down": (
        lambda: placed(load_mug("test_000").body.mesh, make_pose(rotation_x(np.pi))),
        "no cavity that opens upwards",
    ),
    "falling over": (
        lambda: trimesh.util.concatenate([cup(foot_m=0.002), ring_handle()]),
        "cannot stand",
    ),
    "a box": (lambda: trimesh.creation.box((0.08, 0.08, 0.1)), "no upright round body"),
}


@pytest.mark.parametrize("kind", REFUSALS)
def test_what_is_no_mug_is_refused_with_the_reason(kind: str, tmp_path: Path) -> None:
    make, reason = REFUSALS[kind]
    make().export(tmp_path / "odd.obj")
    with pytest.raises(InvalidMugError, match=rf"odd\.obj: {reason}"):
        load_mug_file(tmp_path / "odd.obj")


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("points.obj", "v 0 0 0\n", "holds no faces"),
        ("nothing.stl", "", "is an empty file"),
        ("garbage.ply", "a mug", "cannot be read"),
        ("notes.txt", "a mug", "is no mesh file"),
    ],
)
def test_files_without_a_mesh_are_refused(
    name: str, content: str, reason: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(InvalidMugError, match=f"{name} {reason}.*; expected"):
        load_mug_file(tmp_path / name)


@pytest.fixture(scope="module")
def real_mugs() -> tuple[MugShape, ...]:
    if not REAL_MUGS.is_dir():
        pytest.skip(f"{REAL_MUGS} is absent")
    return load_mug_folder(REAL_MUGS)


def test_real_mugs_are_as_they_were_annotated(real_mugs: tuple[MugShape, ...]) -> None:
    for mug in real_mugs:
        folder = REAL_MUGS / mug.body.name
        meta = json.loads((folder / "meta.json").read_text())
        upright = trimesh.load_mesh(folder / "mug.obj")
        turned = build_mug_from_mesh("turned", placed(upright, X_FO))
        assert np.allclose(turned.X_OH, mug.X_OH, atol=5e-4), mug.body.name
        # The files stand as annotated: the handle towards +x, the base at z = 0, the axis in z.
        assert np.allclose(mug.body.mesh.bounds, upright.bounds, atol=0.0015), mug.body.name
        # What is annotated as its centre is where the widest peg passes; long openings have many.
        x, z = meta["handle"]["hole_centre_xz_m"]
        assert np.allclose(mug.X_OH[[0, 2], 3], (x, z), atol=(0.0025, 0.009)), mug.body.name
        seen = see_through(mug.body.mesh)
        area_m2 = seen.opening.sum() * CELL_M**2
        assert area_m2 == pytest.approx(meta["handle"]["hole_area_mm2"] * 1e-6, rel=0.01)
        peg_m = 2.0 * seen.room_m(seen.p_OMiddle())
        assert peg_m == pytest.approx(meta["handle"]["peg_diam_mm"] * 1e-3, abs=0.0015)


def test_collision_follows_the_outside_of_real_mugs(real_mugs: tuple[MugShape, ...]) -> None:
    for mug in real_mugs:
        p_OPs, _ = trimesh.sample.sample_surface(mug.body.mesh, 4000, seed=0)
        radius = measure_profile(mug.body.mesh).outer_radius_m(p_OPs[:, 2])
        outside = np.hypot(p_OPs[:, 0], p_OPs[:, 1]) > radius - 5e-4
        distances = distances_to_pieces(mug, p_OPs[outside])
        assert np.mean(np.abs(distances) < 0.0015) > 0.97, mug.body.name
