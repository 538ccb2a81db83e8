"""Numbers that are none are refused, with their name and what was expected."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from split_drake.bad_input import BadInputError, require_count, require_number, require_numbers
from split_drake.data.randomization import DomainRandomization
from split_drake.experiments.pool import WorkerPool
from split_drake.experiments.run import CONFIG, claim_folder
from split_drake.scene import Scene, Workspace
from split_drake.split.detector import SamplerConfig
from split_drake.split.diffusion import NoiseSchedule
from split_drake.split.sampling import LangevinConfig
from split_drake.station.layout import HookShape
from split_drake.training.augmentation import AugmentationConfig

NO_NUMBERS = (math.nan, math.inf, -math.inf, 1e38, "0.1", True, None)


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_what_is_no_number_is_named(value: object) -> None:
    with pytest.raises(BadInputError, match=r"^size is .*; expected a number that is finite$"):
        require_number("size", value)
    with pytest.raises(BadInputError, match=r"^count is .*; expected a whole number, 0 or more$"):
        require_count("count", value)


def test_ranges_are_told() -> None:
    for value in (0, 1.0, np.float32(0.5), np.int64(1)):
        require_number("size", value, 0.0, 1.0)
    require_count("count", np.int32(3), 1)
    with pytest.raises(BadInputError, match=r"^size is 1\.5; expected a number from 0 to 1$"):
        require_number("size", 1.5, 0.0, 1.0)
    with pytest.raises(BadInputError, match=r"^size is 3; expected a number, 2 or less$"):
        require_number("size", 3, most=2.0)
    with pytest.raises(BadInputError, match=r"^count is 1\.0; expected a whole number, 1 or more$"):
        require_count("count", 1.0, 1)


@dataclass(frozen=True)
class Numbers:
    """All kinds of fields."""

    size: float = 1.0
    limit: float | None = None
    count: int = 1
    seed: int = 0
    pair: tuple[float, float] = (0.0, 1.0)
    name: str = ""
    on: bool = False


def test_fields_are_checked_by_what_they_are_declared_to_be() -> None:
    require_numbers(Numbers(limit=2.0, seed=2**80, name="nan"))
    for wrong in (
        Numbers(size=math.nan),
        Numbers(limit=math.inf),
        Numbers(count=1.5),  # type: ignore[arg-type]
        Numbers(seed=-1),
        Numbers(pair=(0.0, 1e38)),
    ):
        with pytest.raises(BadInputError, match=r"^(size|limit|count|seed|pair) is .*; expected"):
            require_numbers(wrong)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SamplerConfig(samples=1.5), "samples is 1.5"),  # type: ignore[arg-type]
        (lambda: SamplerConfig(start_margin_m=math.nan), "start_margin_m is nan"),
        (lambda: SamplerConfig(start_margin_m=30.0), "start_margin_m is 30.0; .* from 0 to 1$"),
        (lambda: LangevinConfig(temperature=1e38), "temperature is 1e\\+38"),
        (lambda: LangevinConfig(step_scale=math.inf), "step_scale is inf"),
        (lambda: LangevinConfig(steps=2.5), "steps is 2.5"),  # type: ignore[arg-type]
        (lambda: NoiseSchedule(sigma_max=math.inf), "sigma_max is inf"),
        (lambda: Workspace(edge_m=math.nan), "edge_m is nan"),
        (lambda: Workspace(p_WCenter=(0.5, math.inf, 0.0)), "p_WCenter is inf"),
        (lambda: Workspace(p_WCenter=(0.5, 0.0)), "expected three metres"),  # type: ignore[arg-type]
        (lambda: Workspace(edge_m=-0.3), "edge_m is -0.3, .*expected a cube"),
        (lambda: HookShape(peg_radius_m=math.nan), "peg_radius_m is nan"),
        (lambda: DomainRandomization(edge_step_m=1e38), "edge_step_m is 1e\\+38"),
        (lambda: AugmentationConfig(noise_m=(0.0, math.inf)), "noise_m is inf"),
        (lambda: WorkerPool(str, 1.5), "workers is 1.5"),  # type: ignore[arg-type]
    ],
)
def test_public_settings_take_numbers_alone(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("noise_m", [math.nan, math.inf, 1e38, -0.001, 5.0, None])
def test_noise_is_that_of_a_depth_camera(noise_m: float) -> None:
    points = np.tile([0.5, 0.0, 0.05], (2000, 1))
    scene = Scene(points, points, Workspace())
    message = r"^noise_m is .*; expected a number from 0 to 0\.1, a standard deviation in metres$"
    with pytest.raises(BadInputError, match=message):
        scene.with_noise(noise_m, np.random.default_rng(0))
    assert np.isfinite(scene.with_noise(0.1, np.random.default_rng(0)).p_WSs).all()


def test_what_json_does_not_have_is_in_no_config(tmp_path: Path) -> None:
    for value in (math.nan, [1.0, math.inf], {"a": -math.inf}, np.array([math.nan])):
        with pytest.raises(BadInputError, match=r"^size is .*; expected finite numbers$"):
            claim_folder(tmp_path / "run", {"seed": 1, "size": value}).__enter__()
    assert not (tmp_path / "run").exists()
    with claim_folder(tmp_path / "run", {"size": 1.0}):
        json.loads((tmp_path / "run" / CONFIG).read_text())
