"""The detectors that a trial asks."""

from dataclasses import fields, replace
from pathlib import Path
from unittest.mock import Mock

import pytest

from scenarios.mug_hang import MugHangOptions, specs_of
from scenarios.trials.detectors import TRIAL_STEP_S, make_detectors, station_of
from split_drake.models_folder import MODELS_FOLDER
from split_drake.split.detector import SAMPLERS, SIXTEEN_EVALUATIONS, WIDE_TEMPERATURE
from split_drake.station.file.station_file import station_to_yaml


def test_a_trial_samples_with_as_many_evaluations_as_it_asks_for(tmp_path: Path) -> None:
    (spec,) = specs_of(MugHangOptions(trials=1), tmp_path, ())
    assert spec.evaluations == 4
    for evaluations in (4, 16):
        detectors = make_detectors(replace(spec, evaluations=evaluations), Mock())
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
