"""The command that checks meshes: a line each, a picture, and an exit status."""

from pathlib import Path

import matplotlib.image
import pytest
import trimesh

from scenarios.check_meshes import CheckOptions, main
from split_drake.bad_input import BadInputError
from tests.helpers.mug_meshes import mug


def test_a_line_a_mesh_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = tmp_path / "mugs", tmp_path / "sheet.png"
    folder.mkdir()
    mug().export(folder / "good.stl")
    main(CheckOptions(folder, out, pixels=40, workers=1))
    line, picture = capsys.readouterr().out.splitlines()
    assert line.startswith("good: 11.1 x 8.0 x 9.0 cm, 300 g (assumed), handle with an opening of ")
    assert str(out) in picture
    assert matplotlib.image.imread(out)[..., :3].std() > 0.02
    mixed = folder.rename(tmp_path / "mixed")
    trimesh.creation.box((0.08, 0.08, 0.1)).export(mixed / "brick.stl")
    with pytest.raises(SystemExit) as caught:
        main(CheckOptions(mixed, workers=1))
    assert caught.value.code == 1
    refusal, line = capsys.readouterr().out.splitlines()
    assert refusal.startswith("refused: ")
    assert "brick.stl: no upright round body" in refusal
    assert line.startswith("good: ")


def test_options_that_cannot_be_used(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="there is no folder"):
        main(CheckOptions(tmp_path / "none"))
    with pytest.raises(BadInputError, match=r"--out is x\.jpg; expected a file called \.png"):
        CheckOptions(tmp_path, Path("x.jpg"))
    with pytest.raises(BadInputError, match="--columns is 0"):
        CheckOptions(tmp_path, columns=0)
