"""The true poses of the mug that is there, with noise where the trial wants some."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from scenarios.trials.detection import Detectors, TrialDetector
from scenarios.trials.mug_check import read_grasps
from scenarios.trials.pose_noise import NoisyDetector
from scenarios.trials.setup import Setup
from scenarios.trials.spec import TrialSpec
from split_drake.grasps.sampling import GraspLabels, sample_grasps
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.truth.oracle import OracleDetector


def make(spec: TrialSpec, setup: Setup) -> Detectors:
    """Return the mug's true poses, which are all there are, whenever they are asked for."""
    grasps = _true_grasps(spec.mugs, setup.mug.name, spec.folder)
    true = OracleDetector(setup.truth, setup.mug, grasps)
    return Detectors.alike(NoisyDetector(true, spec.pose_noise) if spec.pose_noise else true)


@lru_cache(maxsize=64)
def _true_grasps(mugs: MugSource, name: str, folder: Path) -> GraspLabels:
    """Return the true grasps of a mug, the same in every trial with it."""
    if mugs.folder is not None:
        return read_grasps(folder, name)
    return sample_grasps(mugs.load(name).body, np.random.default_rng(0))


DETECTOR = TrialDetector("oracle", make, knows_truth=True)
