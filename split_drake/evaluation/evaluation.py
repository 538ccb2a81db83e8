"""Running an evaluation: scenes in worker processes, records as they arise, then the figures.

The folder of an evaluation holds what it was asked (config.json), a line a scene (scenes.jsonl),
and, once all scenes are there, metrics.json, reliability.png and errors.png.  One that was killed
goes on where it was.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from rich.console import Console

from split_drake.evaluation.examiner import DetectorMaker, Examiner
from split_drake.evaluation.judges import require_true_poses
from split_drake.evaluation.record import SceneRecord
from split_drake.evaluation.report.page import page_of
from split_drake.evaluation.report.plots import plot_errors, plot_reliability
from split_drake.evaluation.report.summary import summarize
from split_drake.evaluation.scenes import EvalOptions, EvalSubjects
from split_drake.experiments.pages.render import render
from split_drake.experiments.pool import WorkerPool
from split_drake.experiments.run import RunFolder, as_json
from split_drake.files import write_atomically, write_json
from split_drake.pose_task import PoseTask

SCENES = "scenes.jsonl"
METRICS = "metrics.json"

# Of this process, where it is a worker.
_examiners: list[Examiner] = []


def _start_worker(make_examiner: Callable[[], Examiner]) -> None:
    # One thread each: the workers share the cores, and a sum's order does not depend on them.
    torch.set_num_threads(1)
    _examiners.append(make_examiner())


def _examine(index: int) -> SceneRecord:
    return _examiners[0].examine(index)


@dataclass(frozen=True)
class Evaluation:
    """What is evaluated, and on what; pickled by worker processes.

    Attributes:
        make_detector: called in each worker.
        detector: JSON values that tell this detector from others.
        tasks: that it is asked for.
        subjects: the objects.
        options: of the scenes.
        scenes: how many.
    """

    make_detector: DetectorMaker
    detector: dict[str, Any]
    tasks: tuple[PoseTask, ...]
    subjects: EvalSubjects
    options: EvalOptions
    scenes: int

    def question(self) -> dict[str, Any]:
        """Return what each scene's record depends on: all but how many there are."""
        return as_json(
            {
                **asdict(self.options),
                **self.subjects.config(),
                "tasks": [asdict(task) for task in self.tasks],
                "detector": self.detector,
            }
        )

    def require_true_poses(self) -> None:
        """Raise UnknownTaskError where the first object lacks poses that the tasks are judged by.

        The first stands for all, since making them may take seconds each: objects of a family have
        the same tasks.
        """
        require_true_poses(self.tasks, self.subjects.make(0, self.options.seed).shape)

    def examiner(self) -> Examiner:
        """Return what examines one scene after another."""
        return Examiner(self.make_detector(), self.tasks, self.subjects, self.options)


def _examine_all(
    evaluation: Evaluation, indices: Sequence[int], workers: int
) -> Iterator[SceneRecord]:
    """Yield a record for each scene, in order of completion."""
    start_worker = partial(_start_worker, evaluation.examiner)
    return WorkerPool(_examine, workers, start_worker=start_worker).run(indices)


def evaluation_run(folder: Path) -> RunFolder[SceneRecord]:
    """Return the folder of an evaluation, whose log is scenes.jsonl."""
    return RunFolder(folder, SCENES, SceneRecord.from_fields)


def evaluate(evaluation: Evaluation, out: Path, workers: int, console: Console) -> dict[str, Any]:
    """Evaluate a detector, write all figures to the folder `out`, and return the metrics.

    Scenes that the folder holds already are not examined again; there may be more of them than
    asked for, or fewer.  The figures do not depend on the number of workers.

    Raises AnotherRunError where the folder holds the records of other scenes or of another
    detector, and UnknownTaskError where the objects lack true poses of a task; a folder that was
    new is then not made.
    """
    question = evaluation.question()
    run = evaluation_run(out)
    if not run.log.exists():
        evaluation.require_true_poses()
    wanted = range(evaluation.scenes)
    with run.claim(question):
        there = {record.index for record in run.records()}
        missing = [index for index in wanted if index not in there]
        run.collect(_examine_all(evaluation, missing, workers), len(missing), console)
        records = {record.index: record for record in run.records()}
        if not records.keys() >= set(wanted):
            raise KeyboardInterrupt  # which ended the collecting
        return _report([records[index] for index in wanted], evaluation.tasks, question, out)


def _report(
    records: list[SceneRecord], tasks: Sequence[PoseTask], question: dict[str, Any], out: Path
) -> dict[str, Any]:
    """Write metrics and pictures, and return the metrics."""
    names = [task.name for task in tasks]
    metrics = {**summarize(records, names), "question": question}
    write_json(out / METRICS, metrics)
    pictures = ("reliability.png", "errors.png")
    plot_reliability(metrics, names, out / pictures[0])
    plot_errors(records, names, out / pictures[1])
    write_atomically(out / "index.html", render(page_of(records, tasks, question, pictures)))
    return metrics
