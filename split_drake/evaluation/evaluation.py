"""Running an evaluation: scenes in worker processes, records as they arise, then the figures.

The folder of an evaluation holds what it was asked (config.json), a line a scene (scenes.jsonl),
and, once all scenes are there, metrics.json, reliability.png and errors.png.  One that was killed
goes on where it was.
"""

import json
import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.progress import track

from split_drake.evaluation.examiner import DetectorMaker, Examiner
from split_drake.evaluation.plots import plot_errors, plot_reliability
from split_drake.evaluation.record import SceneRecord, read_records
from split_drake.evaluation.scenes import EvalMugs, EvalOptions, sources_sha256
from split_drake.evaluation.summary import summarize
from split_drake.files import write_json

CONFIG = "config.json"
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
    executor = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_worker,
        initargs=(make_detector, options),
    )
    try:
        for future in as_completed([executor.submit(_examine, index) for index in indices]):
            yield future.result()
    finally:
        executor.shutdown(cancel_futures=True)


def _take_up(out: Path, question: dict[str, Any]) -> list[SceneRecord]:
    """Return the records that the folder holds already; exit where they answer another question."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / CONFIG
    if path.exists():
        before = json.loads(path.read_text())
        keys = before.keys() | question.keys()
        if changed := sorted(key for key in keys if before.get(key) != question.get(key)):
            raise SystemExit(
                f"{out} holds an evaluation with other values of {', '.join(changed)}; "
                "choose another folder"
            )
    else:
        write_json(path, question)
    return read_records(out / SCENES)


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

    Raises SystemExit where the folder holds the records of other scenes or of another detector.
    """
    question = options.of_each_scene() | {
        "mugs_sha256": sources_sha256(options),
        "detector": detector,
    }
    question = json.loads(json.dumps(question))
    records = {record.index: record for record in _take_up(out, question)}
    wanted = range(EvalMugs(options).scenes())
    missing = [index for index in wanted if index not in records]
    arriving = _examine_all(make_detector, options, missing, workers)
    with (out / SCENES).open("a") as file:
        for record in track(
            arriving, "scenes", len(missing), console=console, disable=not console.is_terminal
        ):
            file.write(record.to_json() + "\n")
            file.flush()
            records[record.index] = record
    return _report([records[index] for index in wanted], question, out)


def _report(records: list[SceneRecord], question: dict[str, Any], out: Path) -> dict[str, Any]:
    """Write metrics and pictures, and return the metrics."""
    metrics = {**summarize(records), **question}
    write_json(out / METRICS, metrics)
    plot_reliability(metrics, out / "reliability.png")
    plot_errors(records, out / "errors.png")
    return metrics
