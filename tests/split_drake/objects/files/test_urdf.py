"""URDF files of one body: what is read, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from split_drake.objects.files.urdf import Inertial, read_urdf
from split_drake.objects.meshes.mesh_file import ObjectFileError

CUBE = trimesh.creation.box((0.04, 0.05, 0.06))
MESH = '<{role}>{origin}<geometry><mesh filename="cube.obj"{scale}/></geometry></{role}>'
INERTIAL = (
    '<inertial>{origin}<mass value="{mass}"/>'
    '<inertia ixx="2e-4" ixy="1e-6" ixz="0" iyy="3e-4" iyz="0" izz="4e-4"/></inertial>'
)


def mesh(role: str, origin: str = "", scale: str = "") -> str:
    return MESH.format(role=role, origin=origin, scale=scale)


def inertial(mass: str = "0.3", origin: str = "") -> str:
    return INERTIAL.format(mass=mass, origin=origin)


def written(folder: Path, link: str) -> Path:
    """Write a URDF file of one link, beside a mesh."""
    CUBE.export(folder / "cube.obj")
    path = folder / "cube.urdf"
    path.write_text(
        f'<?xml version="1.0"?><robot name="cube"><link name="base">{link}</link></robot>'
    )
    return path


def test_meshes_are_put_where_their_origins_are(tmp_path: Path) -> None:
    origin = '<origin xyz="0 0 0.1" rpy="0 0 1.5707963"/>'
    link = mesh("visual") + mesh("collision", origin, ' scale="2 1 1"')
    body = read_urdf(written(tmp_path, link))
    assert body.visual is not None
    assert body.collision is not None
    assert body.visual.read().extents == pytest.approx(CUBE.extents, abs=1e-6)
    moved = body.collision.read()
    assert moved.extents == pytest.approx([0.05, 0.08, 0.06], abs=1e-6)
    assert moved.bounds.mean(axis=0) == pytest.approx([0.0, 0.0, 0.1], abs=1e-6)
    assert body.inertial is None


def test_inertia_is_turned_into_the_bodys_axes(tmp_path: Path) -> None:
    origin = '<origin xyz="0.01 0 0" rpy="0 0 1.5707963267948966"/>'
    body = read_urdf(written(tmp_path, mesh("visual") + inertial(origin=origin)))
    assert body.inertial is not None
    assert body.inertial.mass_kg == 0.3
    assert body.inertial.p_LCom == pytest.approx([0.01, 0.0, 0.0])
    expected = [[3e-4, -1e-6, 0.0], [-1e-6, 2e-4, 0.0], [0.0, 0.0, 4e-4]]
    assert np.allclose(body.inertial.inertia_kg_m2, expected)


def test_placeholders_are_told_from_inertias() -> None:
    real = CUBE.moment_inertia * (0.3 / CUBE.volume)
    assert Inertial(0.3, np.zeros(3), real).is_possible_for(CUBE)
    for matrix in (np.eye(3), np.zeros((3, 3)), np.diag([1e-5, 1e-5, 9e-5]), -real):
        assert not Inertial(0.3, np.zeros(3), matrix).is_possible_for(CUBE)


@pytest.mark.parametrize(
    ("link", "reason"),
    [
        ("", "names no mesh; expected a visual or a collision mesh"),
        (mesh("visual") * 2, "has 2 visual meshes; expected one a body"),
        (
            "<visual><geometry><box size='1 1 1'/></geometry></visual>",
            "has a visual geometry that is no mesh; expected a mesh file",
        ),
        (mesh("visual").replace("cube.obj", "lost.obj"), "names lost.obj, which is missing"),
        (mesh("visual", scale=' scale="1 1"'), "holds '1 1'; expected 3 finite numbers"),
        (mesh("visual", scale=' scale="1 1 nan"'), "expected 3 finite numbers"),
        (mesh("visual").replace("filename", "file"), r"lacks an attribute \('filename'\)"),
        (mesh("visual") + inertial("-1"), r"gives a mass of -1\.0 kg; expected more than 0"),
        (mesh("visual") + inertial("heavy"), "holds 'heavy'; expected 1 finite numbers"),
        ("</link><link name='second'>", "has 2 links; expected one"),
        ("<visual>", "is no XML"),
    ],
)
def test_bad_files_are_refused_in_one_sentence(tmp_path: Path, link: str, reason: str) -> None:
    path = written(tmp_path, link)
    with pytest.raises(ObjectFileError, match=reason) as caught:
        read_urdf(path)
    assert str(path) in str(caught.value)
