"""A dataset of 20 scenes of blocks, with their fields."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from split_drake.baselines.learning.draw_fields import draw_shard
from split_drake.data.clutter.generate import generate_shard, write_manifest
from split_drake.data.clutter.scenes import ClutterRecipe, ClutterScene, ClutterScenes
from split_drake.data.dataset import read_manifest
from split_drake.experiments.run import claim_folder
from split_drake.station.layout import Layout
from tests.split_drake.data.clutter.conftest import Blocks, write_library

SCENES = 20


class Lesson(NamedTuple):
    """Folders that methods learn from."""

    data: Path
    fields: Path
    recipe: ClutterRecipe


@pytest.fixture(scope="session")
def blocks_recipe(tmp_path_factory: pytest.TempPathFactory) -> ClutterRecipe:
    path = tmp_path_factory.mktemp("library") / "blocks.npz"
    write_library(Blocks(), path)
    return ClutterRecipe(Blocks(), path, Layout())


@pytest.fixture(scope="session")
def lesson(blocks_recipe: ClutterRecipe, tmp_path_factory: pytest.TempPathFactory) -> Lesson:
    data, fields = (tmp_path_factory.mktemp(name) for name in ("data", "fields"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("split_drake.data.clutter.generate.SCENES_PER_SHARD", SCENES)
        with claim_folder(data, blocks_recipe.config()) as config:
            generate_shard(blocks_recipe, data, 0)
            write_manifest(data, config)
    with claim_folder(fields, {"dataset_hash": read_manifest(data)["sha256"]}):
        draw_shard(blocks_recipe, data, fields, "clutter_00000")
    return Lesson(data, fields, blocks_recipe)


@pytest.fixture(scope="session")
def scenes(blocks_recipe: ClutterRecipe) -> list[ClutterScene]:
    """The first scenes of the dataset."""
    drawn = ClutterScenes(blocks_recipe, np.random.default_rng([0, 0])).draw_all()
    return [next(drawn) for _ in range(4)]
