"""Noise on the oracle's poses: as large as asked for, by the trial's seed, on true poses only."""

from collections.abc import Sequence

import numpy as np
import pytest

from scenarios.mug_hang import MugHangOptions, run_config
from scenarios.trials.pose_noise import NoisyDetector, PoseNoise
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, MUG_TASKS, PoseTask, find_tasks
from split_drake.poses import invert_pose, make_pose, rotation_x
from split_drake.scene import Scene, Workspace

X_WP = make_pose(rotation_x(1.0), (0.5, 0.1, 0.2))
POSES = PoseSet(GRASP, np.tile(X_WP, (4000, 1, 1)), np.linspace(1.0, 0.0, 4000))
POINT = np.array([[0.5, 0.0, 0.1]])
SCENE = Scene(POINT, POINT, Workspace())


class Known:
    """Finds the same poses whatever it sees."""

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        found = find_tasks(tasks, MUG_TASKS, "a detector of what is known")
        return {task.name: PoseSet(task, POSES.X_WPs, POSES.scores) for task in found}


def test_the_noise_has_the_size_that_was_asked_for() -> None:
    noisy = PoseNoise(0.003, 0.02).added_to(POSES, np.random.default_rng(0))
    shifts = noisy.X_WPs[:, :3, 3] - X_WP[:3, 3]
    R_Ws = noisy.X_WPs[:, :3, :3] @ invert_pose(X_WP)[:3, :3]
    turns = np.stack([R_Ws[:, 2, 1], R_Ws[:, 0, 2], R_Ws[:, 1, 0]], axis=1)
    for values, expected in ((shifts, 0.003), (turns, 0.02)):
        np.testing.assert_allclose(values.mean(axis=0), 0.0, atol=0.1 * expected)
        np.testing.assert_allclose(values.std(axis=0), expected, rtol=0.05)
    np.testing.assert_array_equal(noisy.scores, POSES.scores)


def test_poses_of_no_set_stay_none() -> None:
    empty = PoseSet(GRASP, np.empty((0, 4, 4)), np.empty(0))
    assert len(PoseNoise(0.003, 0.02).added_to(empty, np.random.default_rng(0))) == 0


def test_the_same_seed_draws_the_same_noise_for_every_pose_of_every_set() -> None:
    detector = NoisyDetector(Known(), PoseNoise(0.003, 0.0))
    one, same, other = (
        detector.detect(SCENE, MUG_TASKS, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    for task in one:
        np.testing.assert_array_equal(one[task].X_WPs, same[task].X_WPs)
        assert np.all(one[task].X_WPs[:, :3, 3] != other[task].X_WPs[:, :3, 3])
        np.testing.assert_array_equal(one[task].X_WPs[:, :3, :3], POSES.X_WPs[:, :3, :3])


def test_options_say_millimetres_and_degrees_and_the_config_keeps_them() -> None:
    options = MugHangOptions(detector="oracle", pose_noise_mm=3.0, pose_noise_deg=1.0)
    assert options.pose_noise.shift_m == pytest.approx(0.003)
    assert options.pose_noise.turn_rad == pytest.approx(np.radians(1.0))
    config = run_config(options)
    assert (config["pose_noise_mm"], config["pose_noise_deg"]) == (3.0, 1.0)
    assert not MugHangOptions(detector="oracle").pose_noise


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"detector": "oracle", "pose_noise_mm": -1.0}, "--pose-noise-mm is -1.0"),
        ({"detector": "oracle", "pose_noise_deg": float("inf")}, "--pose-noise-deg is inf"),
        ({"detector": "split", "pose_noise_mm": 3.0}, "--detector is 'split'"),
    ],
)
def test_noise_that_makes_no_sense_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MugHangOptions(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize("sizes", [(-0.001, 0.0), (0.0, -0.1), (float("nan"), 0.0)])
def test_noise_is_no_less_than_none(sizes: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match=r"expected 0 or more|expected a number that is finite"):
        PoseNoise(*sizes)
