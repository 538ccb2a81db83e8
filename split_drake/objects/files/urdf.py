"""What a URDF file says of one rigid body: its meshes, mass and inertia."""

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from split_drake.objects.meshes.mesh_file import ObjectFileError, read_mesh
from split_drake.poses import Array, make_pose


@dataclass(frozen=True)
class UrdfMesh:
    """A mesh file of a body L.

    Attributes:
        path: of the file.
        scale: (3,) along its axes.
        X_LM: (4, 4) where it is put.
    """

    path: Path
    scale: tuple[float, float, float]
    X_LM: Array

    def read(self) -> trimesh.Trimesh:
        """Return the mesh in L; raise ObjectFileError where it is of no use."""
        return read_mesh(self.path, self.scale).apply_transform(self.X_LM)


@dataclass(frozen=True)
class Inertial:
    """Mass properties as a file gives them.

    Attributes:
        mass_kg: above 0.
        p_LCom: (3,) centre of mass.
        inertia_kg_m2: (3, 3) about it, axes of L; all zero where the file gives none.
    """

    mass_kg: float
    p_LCom: Array
    inertia_kg_m2: Array

    def is_possible_for(self, mesh: trimesh.Trimesh) -> bool:
        """Return whether a body within the mesh's hull can have this inertia.

        Files often hold a placeholder, such as the unit matrix, which no body of that size has.
        """
        a, b, c = np.linalg.eigvalsh(self.inertia_kg_m2)
        farthest_m = np.linalg.norm(mesh.vertices - self.p_LCom, axis=1).max()
        return bool(a > 0.0 and c <= (a + b) * (1.0 + 1e-9) and c <= self.mass_kg * farthest_m**2)


@dataclass(frozen=True)
class UrdfBody:
    """The one body of a URDF file.

    Attributes:
        visual, collision: its meshes; None where it has none, but one there is.
        inertial: None where the file gives none.
    """

    visual: UrdfMesh | None
    collision: UrdfMesh | None
    inertial: Inertial | None


def read_urdf(path: Path) -> UrdfBody:
    """Return the body that a URDF file describes, its meshes unread.

    Raises ObjectFileError where it is no URDF of one body with a mesh or two.
    """
    try:
        robot = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise ObjectFileError(f"{path} is no XML ({error}); expected a URDF file") from error
    links = robot.findall("link")
    if len(links) != 1:
        raise ObjectFileError(f"{path} has {len(links)} links; expected one, a rigid body")
    try:
        visual, collision = (_mesh(path, links[0], role) for role in ("visual", "collision"))
        inertial = _inertial(path, links[0])
    except KeyError as error:
        raise ObjectFileError(
            f"{path} lacks an attribute ({error}); expected a URDF file"
        ) from error
    if visual is None and collision is None:
        raise ObjectFileError(f"{path} names no mesh; expected a visual or a collision mesh")
    return UrdfBody(visual, collision, inertial)


def _mesh(path: Path, link: ElementTree.Element, role: str) -> UrdfMesh | None:
    found = link.findall(role)
    if not found:
        return None
    if len(found) > 1:
        raise ObjectFileError(f"{path} has {len(found)} {role} meshes; expected one a body")
    mesh = found[0].find("geometry/mesh")
    if mesh is None:
        raise ObjectFileError(f"{path} has a {role} geometry that is no mesh; expected a mesh file")
    file = path.parent / mesh.attrib["filename"]
    if not file.is_file():
        raise ObjectFileError(
            f"{path} names {mesh.attrib['filename']}, which is missing; "
            f"expected it relative to {path.parent}"
        )
    x, y, z = _numbers(path, mesh.get("scale", "1 1 1"), 3)
    return UrdfMesh(file, (x, y, z), _origin(path, found[0]))


def _origin(path: Path, element: ElementTree.Element) -> Array:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    rpy = _numbers(path, origin.get("rpy", "0 0 0"), 3)
    xyz = _numbers(path, origin.get("xyz", "0 0 0"), 3)
    return make_pose(Rotation.from_euler("xyz", rpy).as_matrix(), xyz)


def _inertial(path: Path, link: ElementTree.Element) -> Inertial | None:
    element = link.find("inertial")
    mass = None if element is None else element.find("mass")
    if element is None or mass is None:
        return None
    (mass_kg,) = _numbers(path, mass.attrib["value"], 1)
    if not mass_kg > 0.0:
        raise ObjectFileError(f"{path} gives a mass of {mass_kg} kg; expected more than 0")
    X_LI, matrix = _origin(path, element), np.zeros((3, 3))
    inertia = element.find("inertia")
    if inertia is not None:
        for i, j in zip(*np.triu_indices(3), strict=True):
            name = f"i{'xyz'[i]}{'xyz'[j]}"
            (matrix[i, j],) = (matrix[j, i],) = _numbers(path, inertia.get(name, "0"), 1)
    return Inertial(mass_kg, X_LI[:3, 3], X_LI[:3, :3] @ matrix @ X_LI[:3, :3].T)


def _numbers(path: Path, text: str, count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(map(float, text.split()))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ObjectFileError(f"{path} holds {text!r}; expected {count} finite numbers there")
    return numbers
