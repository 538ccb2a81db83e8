"""Curves of training runs are read while they are written, and drawn."""

import json
from pathlib import Path

import numpy as np
import pytest

from split_drake.training.curves import CurvesConfig, draw_curves, main, read_curves


def write_run(folder: Path, keys: tuple[str, ...] = ("grasp", "handle", "upright")) -> Path:
    """Write the curves of a run: 100 scenes a line, the first in one minute, then in half a one."""
    lines = [
        {
            "step": 50 * number,
            "scenes": 100 * number,
            "minutes": 0.5 + 0.5 * number,
            "learning_rate": 1e-3,
            **dict.fromkeys(keys, 1.0 / number),
            "focal": 0.1 / number,
        }
        for number in (1, 2, 3)
    ]
    folder.mkdir()
    text = "".join(json.dumps(line) + "\n" for line in lines)
    (folder / "curves.jsonl").write_text(text + '{"step": 200, "sce')
    return folder


def test_curves_are_read_up_to_the_line_that_is_being_written(tmp_path: Path) -> None:
    curves = read_curves(write_run(tmp_path / "run"))
    assert curves["scenes"].tolist() == [100, 200, 300]
    assert curves["grasp"].tolist() == pytest.approx([1.0, 1 / 2, 1 / 3])
    assert curves["scenes_per_s"].tolist() == pytest.approx([100 / 60, 100 / 30, 100 / 30])


def test_each_panel_shows_the_runs_that_have_its_curve(tmp_path: Path) -> None:
    runs = {
        "all": read_curves(write_run(tmp_path / "all")),
        "handles": read_curves(write_run(tmp_path / "handles", keys=("handle",))),
    }
    panels = {axes.get_title(): axes for axes in draw_curves(runs).axes}
    names = {
        title: [line.get_label() for line in axes.get_lines()] for title, axes in panels.items()
    }
    assert names == {
        "denoising loss, grasp": ["all"],
        "denoising loss, handle": ["all", "handles"],
        "denoising loss, upright": ["all"],
        "focal loss of the evaluator": ["all", "handles"],
        "learning rate": ["all", "handles"],
        "scenes a second": ["all", "handles"],
    }
    second = panels["denoising loss, handle"].get_lines()[1]
    assert np.asarray(second.get_xydata()).tolist() == [[100, 1.0], [200, 0.5], [300, 1 / 3]]
    assert second.get_color() == "C1"


def test_tasks_of_any_name_have_a_panel(tmp_path: Path) -> None:
    lids = read_curves(write_run(tmp_path / "lids", keys=("grasp", "lid")))
    panels = [axes for axes in draw_curves({"lids": lids}).axes if axes.get_visible()]
    assert [axes.get_title() for axes in panels] == [
        "denoising loss, grasp",
        "denoising loss, lid",
        "focal loss of the evaluator",
        "learning rate",
        "scenes a second",
    ]


def test_the_command_writes_an_image(tmp_path: Path) -> None:
    out = tmp_path / "plots" / "curves.png"
    main(CurvesConfig(runs=(write_run(tmp_path / "run"),), out=out))
    assert out.read_bytes().startswith(b"\x89PNG")


def test_folders_without_curves_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"has no curves; expected the folder of a training run"):
        read_curves(tmp_path)
    with pytest.raises(ValueError, match="expected the folder of at least one"):
        CurvesConfig(runs=())
