"""Training runs: they learn, stop at Ctrl-C, go on, and never overwrite one another."""

import os
import platform
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from split_drake.experiments.provenance import file_sha256
from split_drake.pose_task import MUG_TASKS, UPRIGHT, PoseTask, Symmetry
from split_drake.scene import Workspace
from split_drake.split.checkpoint import CheckpointError, default_weights, load_checkpoint
from split_drake.training import losses, trainer
from split_drake.training.train import TrainConfig, train
from split_drake.training.training_folder import TrainingFolder
from tests.helpers.training import BATCH, NETWORK, OPTIMIZER, PostScenes, make_scenes


def have_scenes(scenes: PostScenes, patch: pytest.MonkeyPatch) -> None:
    """Have these scenes stand in for any data set on disk."""
    patch.setattr("split_drake.training.train.SceneDataset.open", lambda folder: scenes)


@pytest.fixture(autouse=True)
def posts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have posts stand in for any data set on disk."""
    have_scenes(make_scenes(), monkeypatch)


@pytest.fixture
def options(tmp_path: Path) -> TrainConfig:
    """Return a run of 40 steps."""
    return short_run(tmp_path / "run")


def short_run(out: Path) -> TrainConfig:
    """Return a run of 40 steps with four lines of curves, saved at its end."""
    return TrainConfig(
        data=out / "posts",
        out=out,
        steps=40,
        device="cpu",
        log_steps=10,
        network=NETWORK,
        batch=BATCH,
        optimizer=OPTIMIZER,
    )


def curves_of(run: TrainConfig) -> list[dict[str, Any]]:
    """Return the lines of a run's curves."""
    return TrainingFolder(run.out).read_curves()


def test_a_run_learns_and_exports_its_weights(options: TrainConfig) -> None:
    train(options)
    curves = curves_of(options)
    assert [line["step"] for line in curves] == [10, 20, 30, 40]
    first, last = (sum(line[task.name] for task in MUG_TASKS) for line in (curves[0], curves[-1]))
    # How much of it 40 steps take differs with the processor's precision: 10 to 12%.
    assert last < 0.95 * first
    assert curves[-1]["focal"] < 0.7 * curves[0]["focal"]
    network, info = load_checkpoint(options.out / "split.safetensors")
    assert (info.steps, info.scenes, info.dataset_hash) == (40, 160, "post")
    assert network.config == NETWORK
    assert (info.tasks, info.workspace) == (MUG_TASKS, Workspace())


def test_a_run_is_for_the_tasks_of_its_data(
    options: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    posts, lid = make_scenes(), PoseTask("lid", Symmetry.any_turn("z"), "z along the thread")
    labels = {"lid": posts.labels["handle"], "upright": posts.labels["upright"]}
    have_scenes(replace(posts, tasks=(lid, UPRIGHT), labels=labels), monkeypatch)
    train(replace(options, steps=10))
    assert curves_of(options)[-1].keys() >= {"lid", "upright", "focal"}
    assert "grasp" not in curves_of(options)[-1]
    network, info = load_checkpoint(options.out / "split.safetensors")
    assert info.tasks == network.tasks == (lid, UPRIGHT)


def test_a_run_may_be_for_some_of_the_tasks(options: TrainConfig) -> None:
    train(replace(options, steps=10, tasks=("upright",)))
    _, info = load_checkpoint(options.out / "split.safetensors")
    assert info.tasks == (UPRIGHT,)
    with pytest.raises(SystemExit, match=r"another run \(tasks was \['upright'\], is \[\]\)"):
        train(replace(options, steps=10, resume=True))


def test_tasks_that_the_data_do_not_have_are_an_error(options: TrainConfig) -> None:
    message = "the dataset has no task 'lid'; it has grasp, handle, upright"
    with pytest.raises(SystemExit, match=f"--tasks: {message}"):
        train(replace(options, tasks=("lid",)))
    assert not options.out.exists()


def test_a_network_for_another_cube_than_that_of_the_data_is_refused(
    options: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    have_scenes(replace(make_scenes(), workspace=Workspace(edge_m=0.4)), monkeypatch)
    message = r"edge_m=0\.3 and table_m=0\.05; the workspace has edge_m=0\.4 .*--network\.edge-m"
    with pytest.raises(SystemExit, match=message):
        train(options)
    assert not options.out.exists()


def interrupt_at(step: int, patch: pytest.MonkeyPatch) -> None:
    """Have Ctrl-C pressed in the middle of the training's step with this number."""
    take_step = trainer.Trainer.take_step

    def interrupted(engine: trainer.Trainer, progress: float) -> losses.Losses:
        if engine.step == step:
            signal.raise_signal(signal.SIGINT)
        return take_step(engine, progress)

    patch.setattr(trainer.Trainer, "take_step", interrupted)


def test_a_run_resumed_after_ctrl_c_is_the_run_that_was_not_interrupted(
    options: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = replace(options, out=options.out / "whole", steps=14, precision="float32")
    broken = replace(whole, out=options.out / "broken")
    train(whole)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        interrupt_at(12, patch)
        train(broken)
    _, info = load_checkpoint(broken.out / "split.safetensors")
    assert info.steps == 13, "the step that Ctrl-C fell into was ended, and saved"
    train(replace(broken, resume=True))
    expected, found = (load_checkpoint(run.out / "split.safetensors") for run in (whole, broken))
    assert expected[1] == found[1]
    for name, value in expected[0].state_dict().items():
        assert torch.allclose(value, found[0].state_dict()[name], atol=1e-5), name


@pytest.fixture
def one_thread() -> Iterator[None]:
    """Sums come out in one order only where there is one thread."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def killed_run(out: Path) -> TrainConfig:
    """Return a run of 20 steps that is saved every 5."""
    return replace(short_run(out), steps=20, log_steps=5, save_minutes=0.0)


# Run in a process of its own; it is given the folder of the run, and the step to be killed in.
RUN_AND_BE_KILLED = """
import os, signal, sys
from pathlib import Path
import torch
from tests.helpers.training import make_scenes
from tests.split_drake.training.test_training_runs import killed_run
from split_drake.training import train, trainer

torch.set_num_threads(1)
take_step = trainer.Trainer.take_step

def killed(engine, progress):
    if engine.step == int(sys.argv[2]):
        os.kill(os.getpid(), signal.SIGKILL)
    return take_step(engine, progress)

trainer.Trainer.take_step = killed
train.SceneDataset.open = staticmethod(lambda folder: make_scenes())
train.train(killed_run(Path(sys.argv[1])))
"""


@pytest.mark.usefixtures("one_thread")
def test_a_killed_run_ends_to_the_bit_where_one_that_was_not_killed_does(tmp_path: Path) -> None:
    whole, broken = killed_run(tmp_path / "whole"), killed_run(tmp_path / "broken")
    train(whole)
    process = in_a_process(RUN_AND_BE_KILLED, str(broken.out), "13")
    assert process.returncode == -signal.SIGKILL, process.stderr
    assert torch.load(broken.out / "state.pt")["step"] == 10
    train(replace(broken, resume=True))
    expected, found = (load_checkpoint(run.out / "split.safetensors") for run in (whole, broken))
    assert expected[1] == found[1]
    for name, value in expected[0].state_dict().items():
        assert torch.equal(value, found[0].state_dict()[name]), name
    for lines in zip(curves_of(whole), curves_of(broken), strict=True):
        once, resumed = ({k: v for k, v in line.items() if k != "minutes"} for line in lines)
        assert once == resumed


ALLOCATE_TWICE = """
from resource import RUSAGE_SELF, getrusage
from split_drake.training.memory import keep_freed_memory

keep_freed_memory()
for _ in range(2):
    before = getrusage(RUSAGE_SELF).ru_minflt
    b"x" * 100_000_000
    print(getrusage(RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc's malloc is told to")
def test_freed_memory_is_kept() -> None:
    first, second = map(int, in_a_process(ALLOCATE_TWICE).stdout.split())
    assert second < first / 5, "the pages are there already"


def in_a_process(code: str, *args: str) -> subprocess.CompletedProcess[str]:
    """Run Python code that may import whatever the tests can."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-c", code, *args]
    return subprocess.run(command, env=environment, capture_output=True, text=True)


def test_resuming_continues_the_curves(options: TrainConfig) -> None:
    train(replace(options, steps=20))
    curves = options.out / "curves.jsonl"
    with curves.open("a") as file:
        file.write('{"step": 30}\n{"step": 4')
    train(replace(options, resume=True, steps=30))
    assert [line["step"] for line in curves_of(options)] == [10, 20, 30]
    assert "grasp" in curves_of(options)[-1], "what was beyond the state is trained again"
    with pytest.raises(SystemExit, match="another run \\(seed was 0, is 1\\)"):
        train(replace(options, resume=True, seed=1))


def test_commits_of_all_parts_of_a_run_are_kept(
    options: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    for steps, commit in enumerate(("aa", "bb", "bb", "cc"), start=1):
        monkeypatch.setattr("split_drake.training.train.git_commit", lambda commit=commit: commit)
        train(replace(options, steps=steps, resume=steps > 1))
    _, info = load_checkpoint(options.out / "split.safetensors")
    assert (info.earlier_commits, info.commit) == (("aa", "bb"), "cc")


def test_a_folder_with_a_run_is_not_overwritten(options: TrainConfig) -> None:
    with pytest.raises(SystemExit, match="no run to resume"):
        train(replace(options, resume=True))
    train(replace(options, steps=1))
    with pytest.raises(SystemExit, match="holds a run"):
        train(options)
    (options.out / "state.pt").write_bytes(b"")
    with pytest.raises(SystemExit, match=r"state\.pt is damaged"):
        train(replace(options, resume=True))


@pytest.mark.parametrize("resume", [False, True])
def test_a_run_killed_before_its_first_save_starts_anew(options: TrainConfig, resume: bool) -> None:
    train(replace(options, steps=10))
    (options.out / "state.pt").unlink()
    train(replace(options, steps=10, resume=resume))
    assert [line["step"] for line in curves_of(options)] == [10]
    (options.out / "state.pt").unlink()
    with pytest.raises(SystemExit, match="another run \\(seed was 0, is 1\\)"):
        train(replace(options, seed=1))


def test_a_run_can_start_from_a_checkpoint(options: TrainConfig) -> None:
    train(options)
    first = options.out / "split.safetensors"
    further = replace(options, out=options.out / "further", init=first, steps=10)
    train(further)
    start, learned = curves_of(options)[0], curves_of(further)[0]
    assert learned["upright"] < start["upright"]
    _, info = load_checkpoint(further.out / "split.safetensors")
    assert info.parent is not None
    assert info.parent["sha256"] == file_sha256(first)
    assert (info.parent["steps"], info.parent["dataset_hash"]) == (40, "post")
    assert info.parent["parent"] is None


def test_first_weights_are_checked_before_anything_is_written(options: TrainConfig) -> None:
    with pytest.raises(CheckpointError, match="does not exist"):
        train(replace(options, init=options.data / "absent.safetensors"))
    with pytest.raises(SystemExit, match="another architecture"):
        train(replace(options, init=default_weights()))
    assert not options.out.exists()


@pytest.mark.parametrize(("minutes", "steps"), [(None, None), (1.0, 5)])
def test_a_run_has_one_length(minutes: float | None, steps: int | None, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected one of them"):
        TrainConfig(data=tmp_path, out=tmp_path, minutes=minutes, steps=steps)


def test_tasks_that_curves_have_no_room_for_are_refused(
    options: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenes = make_scenes()
    task = replace(MUG_TASKS[0], name="step")
    have_scenes(
        replace(scenes, tasks=(task,), labels={"step": scenes.labels["grasp"]}), monkeypatch
    )
    with pytest.raises(SystemExit, match="a task is called 'step'"):
        train(options)


def test_a_run_goes_on_in_the_type_that_it_began_in(
    options: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    for faster, steps in ((False, 10), (True, 20)):
        monkeypatch.setattr(
            "split_drake.training.train.uses_bfloat16", lambda *_, faster=faster: faster
        )
        train(replace(options, steps=steps, resume=steps > 10))
    assert [line["step"] for line in curves_of(options)] == [10, 20]
    assert TrainingFolder(options.out).options()["bfloat16"] is False
    with pytest.raises(SystemExit, match=r"precision was 'auto', is 'bfloat16'"):
        train(replace(options, precision="bfloat16", resume=True))
