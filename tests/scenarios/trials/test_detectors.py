"""The detectors that a trial asks."""

from dataclasses import fields, replace
from pathlib import Path
from unittest.mock import Mock

from scenarios.mug_hang import MugHangOptions, specs_of
from scenarios.trials.detectors import make_detectors
from split_drake.split.detector import SAMPLERS, SIXTEEN_EVALUATIONS, WIDE_TEMPERATURE


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
