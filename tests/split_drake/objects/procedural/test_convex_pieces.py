"""Convex collision pieces: what is refused, how they are cut, and that bodies rest on them."""

from typing import cast

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from split_drake.objects.antipodal import antipodal_share
from split_drake.objects.convex_pieces import convex_piece, piece_mesh, pieces_that_rest
from split_drake.objects.piece_fidelity import measure_fidelity
from split_drake.objects.procedural.kinds import build_body
from split_drake.objects.procedural.split import ProceduralSource
from split_drake.objects.rigid import Kind, Primitive, RigidObject
from split_drake.poses import Array, make_pose, rotation_x
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout
from split_drake.station.station import Station
from split_drake.truth.rest import wait_for_rest
from split_drake.truth.starts import drop_pose
from split_drake.truth.state import Truth

CUBE = trimesh.creation.box((0.04, 0.05, 0.06))


@pytest.mark.parametrize(
    ("kind", "size", "message"),
    [
        ("cone", (0.1,), r"kind is 'cone'; expected one of \('box', 'cylinder'"),
        ("box", (0.1, 0.1), "size of a box is .*; expected edges along x, y and z"),
        ("sphere", (0.0,), "size of a sphere is .*; expected positive numbers"),
        ("capsule", (0.1, float("nan")), "size of a capsule is .*; expected positive numbers"),
        ("convex", (0.1,), "size of a convex is .*; expected nothing"),
    ],
)
def test_kinds_and_sizes_are_checked(kind: str, size: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Primitive(cast(Kind, kind), size, np.eye(4))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((3, 3)), r"shape \(3, 3\); expected \(N, 3\) of at least 4"),
        (CUBE.vertices[:, :2], r"shape \(8, 2\); expected \(N, 3\)"),
        (CUBE.vertices * (1.0, 1.0, 0.0), "lie in one plane; expected vertices that span"),
        (CUBE.vertices * (1.0, 1.0, np.inf), "NaN or infinite"),
    ],
)
def test_vertices_are_checked(points: Array, message: str) -> None:
    with pytest.raises(ValueError, match=message), np.errstate(invalid="ignore"):
        Primitive("convex", (), np.eye(4), points)


def test_only_convex_pieces_have_vertices() -> None:
    with pytest.raises(ValueError, match=r"p_PVs of a box has shape \(8, 3\); expected \(0, 3\)"):
        Primitive("box", (0.1, 0.1, 0.1), np.eye(4), CUBE.vertices)


def test_a_pose_is_checked() -> None:
    with pytest.raises(ValueError, match="X_OP of a sphere is no pose"):
        Primitive("sphere", (0.1,), np.eye(3))


def test_inner_points_are_left_out() -> None:
    piece = convex_piece(np.vstack([CUBE.vertices, CUBE.vertices * 0.5]))
    assert len(piece.p_PVs) == 8
    with pytest.raises(ValueError, match="one plane"):
        convex_piece(CUBE.vertices * (1.0, 0.0, 1.0))


@given(st.integers(0, 2**32 - 1))
def test_cut_pieces_fill_the_hull(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(12, 3)) * (0.01, 0.02, 0.03)
    whole = trimesh.convex.convex_hull(points)
    pieces = pieces_that_rest([points])
    assert len(pieces) <= 8
    volumes = [piece_mesh(piece).volume for piece in pieces]
    assert sum(volumes) == pytest.approx(whole.volume, rel=1e-6)
    assert np.ptp(np.vstack([piece.p_PVs for piece in pieces]), axis=0) == pytest.approx(
        whole.extents
    )


@pytest.mark.parametrize(
    "piece",
    [
        Primitive("box", (0.02, 0.03, 0.04), make_pose(p=(0.1, 0.0, 0.0))),
        Primitive("cylinder", (0.01, 0.04), make_pose(rotation_x(0.3))),
        Primitive("capsule", (0.01, 0.04), np.eye(4)),
        Primitive("sphere", (0.02,), np.eye(4)),
        convex_piece(CUBE.vertices),
    ],
    ids=lambda piece: piece.kind,
)
def test_every_kind_of_piece_has_a_mesh(piece: Primitive) -> None:
    mesh = piece_mesh(piece)
    assert mesh.is_watertight
    fidelity = measure_fidelity(mesh, [piece], count=300)
    assert fidelity.uncovered_m.max() == fidelity.protruding_m.max() == 0.0


def test_fidelity_tells_gaps_from_bulges() -> None:
    grown = convex_piece(CUBE.vertices * (1.1, 1.0, 1.0))  # 2 mm beyond either side
    fidelity = measure_fidelity(CUBE, [grown])
    assert fidelity.uncovered_m.max() == 0.0
    assert fidelity.protruding_m.max() == pytest.approx(0.002, abs=1e-5)
    shrunk = convex_piece(CUBE.vertices * (0.9, 1.0, 1.0))
    fidelity = measure_fidelity(CUBE, [shrunk])
    assert fidelity.uncovered_m.max() == pytest.approx(0.002, abs=1e-5)
    assert fidelity.protruding_m.max() == 0.0
    assert 0.5 < fidelity.share_within(0.0015) < 1.0


def test_what_is_wider_than_the_hand_has_no_grasp() -> None:
    assert antipodal_share(CUBE) == 1.0
    assert antipodal_share(CUBE, max_width_m=0.045) == pytest.approx(0.4, abs=0.1)
    assert antipodal_share(trimesh.creation.box((0.1, 0.1, 0.1))) == 0.0
    # Inside of a narrow tube there is no room for a finger, on its outside there is.
    assert antipodal_share(trimesh.creation.annulus(0.005, 0.02, 0.09)) < 0.2
    assert antipodal_share(trimesh.creation.annulus(0.015, 0.02, 0.09)) > 0.8


def dropped(body: RigidObject, count: int) -> tuple[list[float], list[float]]:
    """Drop a body in several orientations; return the depths in the table and the creep, metres."""
    station = Station(StationConfig(layout=Layout()), (body,))
    truth, depths_m, creep_m = Truth(station), [], []
    p_WT = np.array(station.config.layout.workspace.p_WCenter)
    for turn in range(count):
        R_WO = rotation_x(np.pi / 2.0 * turn + 0.2)
        station.place_object(0, drop_pose(body, R_WO, p_WT))
        assert wait_for_rest(station, truth, 0, 5.0)
        p_WStart = truth.X_WO(0)[:3, 3]
        station.advance(0.3)
        X_WO = truth.X_WO(0)
        creep_m.append(float(np.linalg.norm(X_WO[:3, 3] - p_WStart)))
        depths_m.append(-float((body.mesh.vertices @ X_WO[2, :3]).min() + X_WO[2, 3]))
    return depths_m, creep_m


@pytest.mark.parametrize("kind", ["box", "bowl", "stool"])
def test_bodies_of_convex_pieces_rest_on_the_table(kind: str) -> None:
    depths_m, creep_m = dropped(build_body(kind, 0), 2)
    assert max(depths_m) < 0.001
    assert min(depths_m) > -0.001
    assert max(creep_m) < 0.0005


def test_a_single_piece_would_rock() -> None:
    whole = ProceduralSource("train").load("box_0").body
    pieces = (convex_piece(whole.mesh.vertices),)
    one = RigidObject("one", whole.mesh, whole.mass_kg, whole.p_OCom, whole.inertia_kg_m2, pieces)
    assert max(dropped(whole, 1)[0]) < max(dropped(one, 1)[0])
