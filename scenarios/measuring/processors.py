"""Plans on other processors: `python -m scenarios.measuring.processors --out DIR`.

PyTorch and oneDNN have code of their own for each kind of processor.  Environment variables make
them use that of older ones, so that one machine can stand in for several: `SETTINGS`.  The first
plan of each trial of `scenarios.mug_hang` is made with each of them, by processes of their own, and
compared.
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from planning.problem import Plan, PlanningProblem
from planning.subgoal import find_subgoal
from scenarios.trials.detection import station_of
from scenarios.trials.mug_tasks import MugTaskName
from scenarios.trials.perception import Perceiver
from scenarios.trials.setup import TrialGenerators, planner_named, set_up
from scenarios.trials.spec import TrialSpec
from split_drake.bad_input import require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.provenance import processor
from split_drake.files import write_json
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.scene import EmptySceneError
from split_drake.truth.starts import NoStartError

# By name, what the environment of a process is given.
SETTINGS: Mapping[str, Mapping[str, str]] = {
    "as it is": {},
    "AVX2": {"ONEDNN_MAX_CPU_ISA": "AVX2", "ATEN_CPU_CAPABILITY": "default"},
    "SSE4.1": {"ONEDNN_MAX_CPU_ISA": "SSE41", "ATEN_CPU_CAPABILITY": "default"},
}
# Joint angles and metres up to which plans are the same.
_SAME = 1e-6


@dataclass(frozen=True)
class ProcessorOptions:
    """Which plans to compare.

    Attributes:
        out: folder for a file of plans for each setting; those that exist are kept.
        trials: how many.
        seed: of the first.
        task: that is planned for.
        noise_m: standard deviation of the noise on the sampled points.
        setting: make the plans of this one alone, in this process as it is.
    """

    out: Path
    trials: int = 40
    seed: int = 0
    task: MugTaskName = "hang"
    noise_m: float = 0.005
    setting: str | None = None

    def __post_init__(self) -> None:
        require_numbers(self)
        if self.trials < 1:
            raise ValueError(f"--trials is {self.trials}; expected at least 1")
        if self.setting is not None and self.setting not in SETTINGS:
            raise ValueError(
                f"--setting is {self.setting!r}; expected one of {', '.join(SETTINGS)}"
            )


def first_plan(spec: TrialSpec) -> dict[str, Any]:
    """Return what a trial's first plan comes to, or why there is none, as JSON holds it."""
    rngs = TrialGenerators.of(spec.seed)
    try:
        setup = set_up(spec, rngs)
        scene, pose_sets = Perceiver(spec, setup, rngs).look(spec.task.perceived_tasks)
    except (NoStartError, EmptySceneError) as error:
        return {"seed": spec.seed, "reason": str(error)}
    layout = setup.station.config.layout
    problem = PlanningProblem(spec.task, pose_sets, scene.p_WPs, setup.station.q, layout)
    outcome = planner_named(spec.planner).plan(problem, rngs.planner)
    if not isinstance(outcome, Plan):
        return {"seed": spec.seed, "reason": outcome.reason}
    return {
        "seed": spec.seed,
        "X_WGrasp": outcome.X_WGrasp.tolist(),
        "X_WGplace": outcome.X_WGplace.tolist(),
        "duration_s": [segment.trajectory.duration_s for segment in outcome.segments],
        "q": [segment.trajectory.qs[-1].tolist() for segment in outcome.segments],
    }


def same_plan(first: Mapping[str, Any], second: Mapping[str, Any]) -> bool:
    """Return whether two results of `first_plan` agree, to a millionth of a radian and a metre."""
    if first.keys() != second.keys():
        return False
    return all(_same(first[key], second[key]) for key in first)


def _same(first: Any, second: Any) -> bool:
    if isinstance(first, str):
        return bool(first == second)
    a, b = np.asarray(first), np.asarray(second)
    return a.shape == b.shape and bool(np.allclose(a, b, rtol=0.0, atol=_SAME))


def _specs(options: ProcessorOptions) -> list[TrialSpec]:
    station = station_of("split", None)
    return [
        TrialSpec(
            index=index,
            seed=options.seed + index,
            mugs=MugSource("test"),
            task=find_subgoal(options.task),
            detector="split",
            planner="default",
            checkpoint=None,
            noise_m=options.noise_m,
            record="none",
            folder=options.out,
            station=station,
        )
        for index in range(options.trials)
    ]


def _file(options: ProcessorOptions, setting: str) -> Path:
    name = setting.replace(" ", "_").replace(".", "")
    return options.out / f"{options.task}_{options.seed}_{options.trials}_{name}.json"


def _make_plans(options: ProcessorOptions, setting: str, console: Console) -> None:
    plans = [first_plan(spec) for spec in track(_specs(options), setting, console=console)]
    content = {"setting": setting, "processor": processor(), "plans": plans}
    write_json(_file(options, setting), content)


def _plans(options: ProcessorOptions, setting: str) -> Sequence[Mapping[str, Any]]:
    """Return the plans made with a setting, by a process of its own where there are none."""
    path = _file(options, setting)
    if not path.exists():
        command = [
            sys.executable,
            "-m",
            "scenarios.measuring.processors",
            "--out",
            str(options.out),
        ]
        command += ["--trials", str(options.trials), "--seed", str(options.seed)]
        command += ["--task", options.task, "--noise-m", str(options.noise_m)]
        environment = {**os.environ, **SETTINGS[setting]}
        subprocess.run([*command, "--setting", setting], env=environment, check=True)
    plans: list[Mapping[str, Any]] = json.loads(path.read_text())["plans"]
    return plans


def main(options: ProcessorOptions) -> None:
    """Make the plans with each setting, and say how many are the same."""
    console = Console()
    if options.setting is not None:
        _make_plans(options, options.setting, console)
        return
    made = [_plans(options, setting) for setting in SETTINGS]
    equal = [
        all(same_plan(plans[0], plan) for plan in plans[1:]) for plans in zip(*made, strict=True)
    ]
    for setting, plans in zip(SETTINGS, made, strict=True):
        alike = sum(map(same_plan, made[0], plans))
        console.print(f"{setting}: {alike} of {options.trials} plans are those of 'as it is'")
    console.print(f"the same with every setting: {sum(equal)} of {options.trials}")
    console.print(f"on {processor()}", markup=False)


if __name__ == "__main__":
    run_command(main, ProcessorOptions, __doc__)
