"""Running an evaluation: scenes in worker processes, records as they arise, then the figures.

The folder of an evaluation holds what it was asked (config.json), a line a scene (scenes.jsonl),
and, once all scenes are there, metrics.json, reliability.png and errors.png.  One that was killed
goes on where it was.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import torch
from rich.console import Console

from split_drake.evaluation.examiner import DetectorMaker, Examiner
from split_drake.evaluation.plots import plot_errors, plot_reliability
from split_drake.evaluation.record import SceneRecord
from split_drake.evaluation.scenes import EvalMugs, EvalOptions
from split_drake.evaluation.summary import summarize
from split_drake.experiments.pool import WorkerPool
from split_drake.experiments.run import RunFolder, as_json
from split_drake.files import write_json

SCENES = "scenes.jsonl"
METRICS = "metrics.json"

# Of this process, where it is a worker.
_examiners: list[Examiner] = []


def _start_worker(make_detector: DetectorMaker, options: EvalOptions) -> None:
    # One thread each: the workers share the cores, and a sum's order does not depend on them.
    torch.set_num_threads(1)
    _examiners.append(Examiner(make_detector(), EvalMugs(options), options))


def _examine(index: int) -> SceneRecord:
    return _examiners[0].examine(index)


def _examine_all(
    make_detector: DetectorMaker, options: EvalOptions, indices: Sequence[int], workers: int
) -> Iterator[SceneRecord]:
    """Yield a record for each scene, in order of completion."""
    start_worker = partial(_start_worker, make_detector, options)
    return WorkerPool(_examine, workers, start_worker=start_worker).run(indices)


def evaluation_run(folder: Path) -> RunFolder[SceneRecord]:
    """Return the folder of an evaluation, whose log is scenes.jsonl."""
    return RunFolder(folder, SCENES, SceneRecord.from_fields)


def evaluate(
    make_detector: DetectorMaker,
    detector: dict[str, Any],
    options: EvalOptions,
    out: Path,
    workers: int,
    console: Console,
) -> dict[str, Any]:
    """Evaluate a detector, write all figures to the folder `out`, and return the metrics.

    Scenes that the folder holds already are not examined again; there may be more of them than
    asked for, or fewer.

    Args:
        make_detector: called in each worker.
        detector: JSON values that tell this detector from others.
        options: the scenes.
        workers: processes; the figures do not depend on them.

    Raises AnotherRunError where the folder holds the records of other scenes or of another
    detector.
    """
    question = as_json(
        options.of_each_scene() | {"mugs_sha256": options.source.sha256(), "detector": detector}
    )
    run = evaluation_run(out)
    run.claim(question)
    wanted = range(EvalMugs(options).scenes())
    there = {record.index for record in run.records()}
    missing = [index for index in wanted if index not in there]
    run.collect(_examine_all(make_detector, options, missing, workers), len(missing), console)
    records = {record.index: record for record in run.records()}
    return _report([records[index] for index in wanted], question, out)


def _report(records: list[SceneRecord], question: dict[str, Any], out: Path) -> dict[str, Any]:
    """Write metrics and pictures, and return the metrics."""
    metrics = {**summarize(records), **question}
    write_json(out / METRICS, metrics)
    plot_reliability(metrics, out / "reliability.png")
    plot_errors(records, out / "errors.png")
    return metrics
