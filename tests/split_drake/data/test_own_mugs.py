"""A dataset of the user's own mugs: their rests, their grasps, and scenes of them."""

from pathlib import Path

import pytest

from split_drake.bad_input import BadInputError
from split_drake.data import rests
from split_drake.data.generate import GenerateConfig, generate_shard
from split_drake.data.rests import SettleConfig, load_rests, settle_split
from split_drake.grasps.check_grasps import CheckConfig, check_split
from split_drake.grasps.store import load_checked_grasps
from split_drake.objects.mugs.split import load_mug
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout


def test_scenes_of_own_mugs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "mine"
    folder.mkdir()
    load_mug("test_004").body.mesh.export(folder / "cup.stl")
    (folder / "broken.stl").write_text("solid")
    mugs = str(folder)
    with pytest.raises(BadInputError, match=r"grasps of .* is missing; expected .*--mugs"):
        GenerateConfig(tmp_path / "data", mugs, workers=1).recipe()
    settle_split(SettleConfig(mugs, count=2, workers=1), Layout())
    checks = CheckConfig(mugs, per_mug=30, out=tmp_path / "checks", workers=1)
    check_split(checks, StationConfig(Layout()))
    assert load_rests(mugs, "cup").X_TOs.shape == (2, 4, 4)
    assert len(load_checked_grasps(mugs, "cup")) == 30
    assert rests.rests_path(mugs).is_relative_to("datasets/mugs")
    config = GenerateConfig(tmp_path / "data", mugs, scenes_per_mug=1, workers=1)
    recipe = config.recipe()
    assert recipe.source.names() == ("cup",)
    assert recipe.made_from["left_out"] == "broken"
    (tmp_path / "data").mkdir()
    generate_shard(recipe, tmp_path / "data", "cup")
    assert (tmp_path / "data" / "cup.npz").is_file()
