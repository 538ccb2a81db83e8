"""The study of samplers: what it compares and what it writes; evaluation is tested elsewhere."""

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from split_drake.evaluation.evaluation import Evaluation
from split_drake.split.diffusion import NoiseSchedule
from split_drake.split.sampling import ReverseDiffusion
from split_drake.split.se3 import compose, uniform_rotations
from split_drake.studies import sampler_study
from split_drake.studies.sampler_study import (
    MEASURES,
    SHIPPED,
    SHORT,
    Sampler,
    StudyConfig,
    main,
    samplers,
)


@pytest.mark.parametrize("sampler", samplers(), ids=lambda sampler: sampler.name)
def test_integrators_evaluate_the_score_as_often_as_told(sampler: Sampler) -> None:
    sigmas: list[float] = []

    def score(X: Tensor, sigma: float) -> Tensor:
        sigmas.append(sigma)
        return torch.zeros(len(X), 6)

    generator, schedule = torch.Generator().manual_seed(0), NoiseSchedule()
    start = compose(uniform_rotations((2,), generator), torch.full((2, 3), 0.1))
    sampler.build()(ReverseDiffusion(score, schedule, generator, lambda p: p), start)
    assert len(sigmas) == sampler.evaluations
    first = SHIPPED.first_sigma if sampler.integrator == SHORT else schedule.sigma_max
    assert sigmas[0] == pytest.approx(first)
    assert min(sigmas) >= schedule.sigma_min - 1e-9


def test_the_shipped_sampler_is_among_those_compared() -> None:
    shipped = Sampler(SHORT, SHIPPED.evaluations, SHIPPED.temperature)
    assert samplers().count(shipped) == 1
    assert len({sampler.name for sampler in samplers()}) == len(samplers())


def test_a_warmer_sampler_spreads_further() -> None:
    spreads = []
    for temperature in (0.0, 1.0):
        generator, schedule = torch.Generator().manual_seed(0), NoiseSchedule()
        start = compose(uniform_rotations((1,), generator), torch.zeros(1, 3)).expand(64, 4, 4)
        X = Sampler("langevin", 16, temperature).build()(
            ReverseDiffusion(
                lambda X, sigma: torch.zeros(len(X), 6), schedule, generator, lambda p: p
            ),
            start,
        )
        spreads.append(float(X[:, :3, 3].std(dim=0).norm()))
    assert spreads[0] == pytest.approx(0.0, abs=1e-6)
    assert spreads[1] > 0.01


def test_the_test_mugs_are_no_choice(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="mugs is 'test'; expected 'train'"):
        StudyConfig(out=tmp_path, mugs="test")


def test_all_samplers_are_measured_and_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[dict[str, Any]] = []

    def evaluate(evaluation: Evaluation, *_: object) -> dict[str, Any]:
        detector = evaluation.detector
        asked.append(detector)
        share = {"all": {"share": 1.0 - 1.0 / detector["evaluations"]}}
        task = dict.fromkeys(MEASURES, share)
        of_tasks = {asked_for.name: task for asked_for in evaluation.tasks}
        return {"tasks": of_tasks, "median_detect_s": 0.1}

    monkeypatch.setattr(sampler_study, "evaluate", evaluate)
    main(StudyConfig(out=tmp_path))
    keys = ("integrator", "evaluations", "temperature")
    assert [Sampler(*(told[key] for key in keys)) for told in asked] == samplers()
    rows = json.loads((tmp_path / "study.json").read_text())
    page = (tmp_path / "index.html").read_text()
    assert page.count('<tr id="setting-') == len(rows) and 'src="study.png"' in page
    assert [row["evaluations"] for row in rows] == [told["evaluations"] for told in asked]
    assert rows[0]["samples_good"]["grasp"] == pytest.approx(0.99)
    assert (tmp_path / "study.png").read_bytes().startswith(b"\x89PNG")
    assert "multistep" in capsys.readouterr().out
