"""The fixed split of shapes, and how it is drawn."""

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
import trimesh

from split_drake.objects.procedural.kinds import build_body
from split_drake.objects.procedural.sheet import SheetConfig, draw, draw_sheet
from split_drake.objects.procedural.split import (
    SIZE_M,
    InvalidShapeError,
    ProceduralSource,
    Split,
    SplitConfig,
    check_shape,
    draw_shapes,
    entries,
    kinds_of,
    write_split,
)
from split_drake.objects.rigid import RigidObject

SPLITS: tuple[Split, ...] = ("train", "test")


def test_the_split_has_as_many_shapes_of_kinds_that_differ() -> None:
    train, test = (ProceduralSource(split) for split in SPLITS)
    assert (len(train.names()), len(test.names())) == (1200, 120)
    kinds = [{entry.kind for entry in entries(split)} for split in SPLITS]
    assert kinds == [set(kinds_of("train")), set(kinds_of("test"))]
    assert not kinds[0] & kinds[1]
    assert train.sha256() != test.sha256()


def test_kinds_take_turns() -> None:
    for split in SPLITS:
        kinds = kinds_of(split)
        assert tuple(entry.kind for entry in entries(split)[: len(kinds)]) == kinds


@pytest.mark.parametrize("split", SPLITS)
def test_shapes_are_still_those_that_were_drawn(split: Split) -> None:
    # Where a kind is changed, the split is another one: it has to be drawn anew, and told.
    source, last = ProceduralSource(split), len(entries(split))
    for number in range(last - len(kinds_of(split)), last):
        entry = entries(split)[number]
        loaded = source.load(entry.name)
        assert (loaded.split, loaded.number, loaded.name) == (split, number, entry.name)
        assert loaded.body.mesh.volume * 1e9 == pytest.approx(entry.volume_mm3, abs=1.0)
        check_shape(loaded.body)


def test_a_source_is_an_object_source_that_workers_can_be_given() -> None:
    source = pickle.loads(pickle.dumps(ProceduralSource("test")))
    assert source == ProceduralSource("test")
    assert source.load(source.names()[0]).X_OPs == {}


def test_unknown_names_and_splits_are_named() -> None:
    with pytest.raises(ValueError, match=r"no shape of test is called 'box_0'; expected jar_0"):
        ProceduralSource("test").load("box_0")
    with pytest.raises(ValueError, match=r"split is 'validation'; expected one of"):
        ProceduralSource(cast(Split, "validation"))


def with_mesh(mesh: trimesh.Trimesh) -> RigidObject:
    return replace(build_body("box", 0), mesh=mesh)


@pytest.mark.parametrize(
    ("mesh", "reason"),
    [
        (trimesh.creation.box((0.2, 0.05, 0.05)), r"wrong size: 0\.200 m, expected 0\.02 to 0\.15"),
        (trimesh.creation.box((0.05, 0.05, 0.005)), r"too thin: 0\.0050 m"),
        (trimesh.creation.box((0.1, 0.1, 0.1)), r"no grasp: 0\.0% of its surface"),
        (
            trimesh.util.concatenate(
                [
                    trimesh.creation.box((0.03,) * 3, make)
                    for make in (
                        None,
                        np.diag([1, 1, 1, 1]) + np.array([[0, 0, 0, 0.05], *np.zeros((3, 4))]),
                    )
                ]
            ),
            "parts apart: the mesh has 2 bodies",
        ),
        (
            trimesh.Trimesh(
                *(lambda m: (m.vertices, m.faces[1:]))(trimesh.creation.box((0.05,) * 3))
            ),
            "leaking mesh",
        ),
    ],
    ids=["large", "thin", "wide", "apart", "open"],
)
def test_useless_shapes_are_refused(mesh: trimesh.Trimesh, reason: str) -> None:
    with pytest.raises(InvalidShapeError, match=reason):
        check_shape(with_mesh(mesh))


def test_drawing_counts_what_it_refuses() -> None:
    drawn, refused = draw_shapes("pyramid", 3)
    assert [entry.kind for entry in drawn] == ["pyramid"] * 3
    seeds = [entry.seed for entry in drawn]
    assert seeds == sorted(seeds)
    assert seeds[-1] + 1 == len(drawn) + refused.total()
    assert max(build_body("pyramid", seeds[0]).mesh.extents) <= SIZE_M[1]


def test_writing_needs_shapes(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="train is 0; expected at least 1"):
        SplitConfig(train=0)


def test_the_split_is_written_as_it_ships(tmp_path: Path) -> None:
    config = SplitConfig(out=tmp_path, train=len(kinds_of("train")), test=1, workers=1)
    write_split(config)
    written = json.loads((tmp_path / "test.json").read_text())["shapes"]
    first = entries("test")[0]
    assert written == [{"kind": first.kind, "seed": first.seed, "volume_mm3": first.volume_mm3}]


def test_a_picture_shows_the_shape() -> None:
    image = draw([(trimesh.creation.box((0.05,) * 3), (0.1, 0.2, 0.9))], 24)
    assert image.shape == (24, 24, 3)
    blue = (image[..., 2] - image[..., 0]) > 0.2
    assert blue[12, 12]
    assert 0.03 < blue.mean() < 0.4


def test_a_sheet_is_drawn(tmp_path: Path) -> None:
    out = tmp_path / "sheet.png"
    draw_sheet(SheetConfig(out, "test", examples=1, show="pieces", pixels=16))
    assert out.stat().st_size > 2000
    with pytest.raises(ValueError, match="examples is 0"):
        SheetConfig(out, examples=0)
