"""Folders of objects: what is usable, what is refused, and the bodies that come of it."""

import pickle
from pathlib import Path

import numpy as np
import pytest
import trimesh

from split_drake.objects.files.folder import ObjectFolder, inspect_folder
from split_drake.objects.meshes.decomposition import SETTINGS, convex_hulls, convex_parts
from split_drake.objects.meshes.mesh_file import ObjectFileError
from split_drake.objects.piece_fidelity import measure_fidelity
from split_drake.objects.procedural.prisms import extruded
from split_drake.objects.procedural.revolved import turned

ROOT = Path(__file__).parents[4]
VGN = ROOT.parent / "shared" / "vgn_objects"
CUBE = trimesh.creation.box((0.04, 0.05, 0.06))
OUTLINE = [(0.0, 0.0), (0.08, 0.0), (0.08, 0.02), (0.02, 0.02), (0.02, 0.06), (0.0, 0.06)]
ELL = extruded([OUTLINE], 0.03).mesh
URDF = """<robot name="r"><link name="l">{inertial}
<visual><geometry><mesh filename="{visual}"/></geometry></visual>
<collision><geometry><mesh filename="{collision}"/></geometry></collision></link></robot>"""
INERTIAL = '<inertial><mass value="0.4"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'


def source(folder: Path) -> ObjectFolder:
    return ObjectFolder(folder, folder.parent / "cache")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "objects"
    path.mkdir()
    return path


def test_plain_meshes_become_bodies_by_decomposition(folder: Path) -> None:
    ELL.export(folder / "ell.ply")
    objects = source(folder)
    assert objects.names() == ("ell",)
    body = objects.load("ell").body
    assert body.mass_kg == pytest.approx(300.0 * ELL.volume)
    assert body.p_OCom == pytest.approx(ELL.center_mass)
    fidelity = measure_fidelity(body.mesh, body.collision, 500)
    assert fidelity.uncovered_m.max() < 0.001
    assert fidelity.protruding_m.max() < 0.002
    (kept,) = objects.cache.iterdir()
    stamp = kept.stat().st_mtime_ns
    again = objects.load("ell").body
    assert kept.stat().st_mtime_ns == stamp
    assert len(again.collision) == len(body.collision)
    kept.write_bytes(b"cut short")
    assert len(objects.load("ell").body.collision) == len(body.collision)


def test_convex_meshes_need_no_decomposition(folder: Path) -> None:
    CUBE.export(folder / "cube.stl")
    body = source(folder).load("cube").body
    assert not source(folder).cache.exists()
    assert sum(len(piece.p_PVs) for piece in body.collision) == 8 * 8


def test_convex_parts_are_told_apart_and_others_are_none() -> None:
    pair = trimesh.util.concatenate([CUBE, CUBE.copy().apply_translation((0.04, 0.0, 0.0))])
    parts = convex_parts(pair)
    assert parts is not None
    assert [len(part) for part in parts] == [8, 8]
    assert convex_parts(ELL) is None
    opened = trimesh.Trimesh(CUBE.vertices, CUBE.faces[2:], process=False)
    assert convex_parts(opened) is None


def test_a_waist_is_found_that_no_two_faces_show() -> None:
    z = np.linspace(0.0, 0.1, 100)
    waisted = turned(np.column_stack([0.02 - 0.001 * np.sin(np.pi * z / 0.1), z])).mesh
    assert waisted.face_adjacency_projections.max() < 1e-5
    assert convex_parts(waisted) is None


def test_open_meshes_are_decomposed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Coarser than usual, that it takes less time.
    for name, value in (("preprocess_resolution", 20), ("mcts_iterations", 5), ("threshold", 0.01)):
        monkeypatch.setitem(SETTINGS, name, value)
    opened = trimesh.Trimesh(CUBE.vertices, CUBE.faces[2:], process=False)
    hulls = convex_hulls(opened, tmp_path)
    assert np.ptp(np.vstack(hulls), axis=0) == pytest.approx(CUBE.extents, abs=0.003)


def test_urdf_bodies_weigh_what_the_file_says(folder: Path) -> None:
    CUBE.export(folder / "seen.obj")
    pair = trimesh.util.concatenate([CUBE, CUBE.copy().apply_translation((0.02, 0.0, 0.0))])
    pair.export(folder / "touched.obj")
    text = URDF.format(inertial=INERTIAL, visual="seen.obj", collision="touched.obj")
    (folder / "body.urdf").write_text(text)
    objects = source(folder)
    assert objects.names() == ("body",)
    loaded = objects.load("body")
    assert loaded.body.mass_kg == 0.4
    # The unit matrix is a placeholder: inertia is that of the mesh, which is the parts' union.
    assert loaded.body.inertia_kg_m2.max() < 1e-3
    assert loaded.body.mesh.is_watertight
    assert loaded.body.mesh.volume == pytest.approx(0.06 * 0.05 * 0.06, rel=1e-4)
    assert loaded.body.p_OCom == pytest.approx([0.01, 0.0, 0.0], abs=1e-6)
    seen = ObjectFolder(folder, objects.cache, seen="visual")
    assert seen.load("body").body.mesh.volume == pytest.approx(CUBE.volume, rel=1e-4)
    assert seen.sha256() != objects.sha256()


def test_one_bad_object_does_not_spoil_the_folder(folder: Path) -> None:
    CUBE.export(folder / "good.obj")
    (folder / "._good.obj").write_bytes(b"what macOS adds")
    (folder / "empty.stl").write_bytes(b"")
    CUBE.export(folder / "twice.obj")
    CUBE.export(folder / "twice.ply")
    for inner in ("inner", "several", "none"):
        (folder / inner).mkdir()
    CUBE.export(folder / "inner" / "mesh.obj")
    CUBE.export(folder / "several" / "one.obj")
    CUBE.export(folder / "several" / "two.obj")
    objects = source(folder)
    assert objects.names() == ("good", "inner")
    refused = objects.contents().refused
    assert list(refused) == ["empty", "several", "twice"]
    assert "empty.stl is an empty file; expected a mesh" in refused["empty"]
    assert "'several' (one.obj, two.obj); expected one a body" in refused["several"]
    assert "'twice' (twice.obj, twice.ply)" in refused["twice"]
    with pytest.raises(ObjectFileError, match="is an empty file"):
        objects.load("empty")
    with pytest.raises(ObjectFileError, match="holds no 'other'; expected one of its objects"):
        objects.load("other")


def test_folders_without_objects_are_refused(folder: Path) -> None:
    with pytest.raises(ObjectFileError, match=r"holds no object; expected URDF files or meshes"):
        source(folder).names()
    with pytest.raises(ObjectFileError, match="is no folder; expected one of URDF or mesh files"):
        source(folder / "nowhere")


def test_folders_of_bad_objects_say_why(folder: Path) -> None:
    (folder / "bad.obj").write_text("")
    with pytest.raises(ObjectFileError, match=r"holds no usable object: .*bad\.obj is an empty"):
        source(folder).names()


def test_impossible_options_are_refused(folder: Path) -> None:
    with pytest.raises(ValueError, match="density_kg_m3 is 0"):
        ObjectFolder(folder, folder, density_kg_m3=0)
    with pytest.raises(ValueError, match="seen is 'both'; expected one of"):
        ObjectFolder(folder, folder, seen="both")  # type: ignore[arg-type]


def test_a_folder_can_be_given_to_workers(folder: Path) -> None:
    CUBE.export(folder / "cube.obj")
    objects = source(folder)
    assert pickle.loads(pickle.dumps(objects)) == objects


@pytest.mark.skipif(not VGN.is_dir(), reason=f"VGN's objects are not at {VGN}")
@pytest.mark.parametrize(("scenario", "count"), [("packed", 114), ("pile", 303)])
def test_vgns_objects_are_usable(scenario: str, count: int, tmp_path: Path) -> None:
    objects = ObjectFolder(VGN / scenario / "train", tmp_path / "cache")
    assert inspect_folder(objects.path).refused == {}
    assert len(objects.names()) == count
    for name in objects.names()[::40]:
        body = objects.load(name).body
        assert body.mesh.is_watertight
        fidelity = measure_fidelity(body.mesh, body.collision, 300)
        assert max(fidelity.uncovered_m.max(), fidelity.protruding_m.max()) < 1e-4
    assert not objects.cache.exists()
