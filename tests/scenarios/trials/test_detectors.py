"""The detector that a trial asks for."""

from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

from scenarios.mug_hang import MugHangOptions, specs_of
from scenarios.trials.detectors import make_detector
from split_drake.split.detector import SAMPLERS, SIXTEEN_EVALUATIONS, SplitDetector


def test_a_trial_samples_with_as_many_evaluations_as_it_asks_for(tmp_path: Path) -> None:
    (spec,) = specs_of(MugHangOptions(trials=1), tmp_path, ())
    assert spec.evaluations == 4
    for evaluations in (4, 16):
        detector = make_detector(replace(spec, evaluations=evaluations), Mock())
        assert isinstance(detector, SplitDetector)
        assert detector.config == SAMPLERS[evaluations]
        assert detector.config.langevin.evaluations == evaluations
    wide = make_detector(spec, Mock(), wide=True)
    assert isinstance(wide, SplitDetector)
    assert wide.config.acceptance == SIXTEEN_EVALUATIONS.acceptance
