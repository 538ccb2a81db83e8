"""The detectors that a trial asks."""

import sys
from dataclasses import fields, replace
from importlib import import_module
from pathlib import Path
from unittest.mock import Mock

import pytest

from scenarios.mug_hang import MugHangOptions, specs_of
from scenarios.trials.detection import TRIAL_STEP_S, station_of, trial_detector, trial_detectors
from split_drake.bad_input import BadInputError
from split_drake.models_folder import MODELS_FOLDER
from split_drake.split.detector import SAMPLERS, SIXTEEN_EVALUATIONS, WIDE_TEMPERATURE
from split_drake.station.file.station_file import station_to_yaml
from split_drake.station.layout import Layout

OWN_DETECTOR = """
from split_drake.pose_set import PoseSet
from scenarios.trials.detection import Detectors, TrialDetector


class Nothing:
    def detect(self, scene, tasks, rng):
        return {task.name: PoseSet(task, [], []) for task in tasks}


DETECTOR = TrialDetector("nothing", lambda spec, setup: Detectors.alike(Nothing()))
"""


def test_a_trial_samples_with_as_many_evaluations_as_it_asks_for(tmp_path: Path) -> None:
    (spec,) = specs_of(MugHangOptions(trials=1), tmp_path, ())
    assert spec.evaluations == 4
    for evaluations in (4, 16):
        detectors = trial_detector("split").make(replace(spec, evaluations=evaluations), Mock())
        usual, again, again_for_grasps = (
            getattr(detectors, each.name) for each in fields(detectors)
        )
        assert usual.config == SAMPLERS[evaluations]
        assert usual.config.langevin.evaluations == evaluations
        assert again.config == SIXTEEN_EVALUATIONS
        assert again_for_grasps.config.langevin == replace(
            SIXTEEN_EVALUATIONS.langevin, temperature=WIDE_TEMPERATURE
        )


@pytest.mark.parametrize("detector", ["split", "oracle"])
def test_the_file_of_the_usual_station_is_the_usual_station(detector: str) -> None:
    usual = station_of(detector, None)
    read = station_of(detector, None, MODELS_FOLDER / "stations/default.yaml")
    assert station_to_yaml(read) == station_to_yaml(usual)
    assert read.time_step_s == TRIAL_STEP_S


def test_a_detector_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room = import_module("scenarios.trials.detectors")
    monkeypatch.setattr(room, "__path__", [*room.__path__, str(tmp_path)])
    (tmp_path / "nothing.py").write_text(OWN_DETECTOR)
    trial_detectors.cache_clear()
    try:
        (spec,) = specs_of(MugHangOptions(trials=1, detector="nothing"), tmp_path, ())
        assert spec.station.layout.workspace == Layout().workspace
        detectors = trial_detector(spec.detector).make(spec, Mock())
        assert detectors.usual is detectors.again is detectors.again_for_grasps
        with pytest.raises(ValueError, match="go with --detector oracle"):
            MugHangOptions(detector="nothing", pose_noise_mm=1.0)
    finally:
        trial_detectors.cache_clear()
        sys.modules.pop("scenarios.trials.detectors.nothing", None)


def test_a_detector_that_nobody_wrote_is_told_with_those_there_are() -> None:
    with pytest.raises(BadInputError, match="no detector 'nothing'; expected one of oracle, split"):
        MugHangOptions(detector="nothing")
