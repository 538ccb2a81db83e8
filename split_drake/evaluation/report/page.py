"""The page of an evaluation: shares of scenes, and every scene with what its samples are worth."""

from collections.abc import Mapping, Sequence
from typing import Any

from split_drake.evaluation.judges import main_checks
from split_drake.evaluation.record import SceneRecord, TaskRecord
from split_drake.experiments.pages.plots import bars_of
from split_drake.experiments.pages.run_page import Bar, Cell, Column, Row, RunPage, failures_first
from split_drake.experiments.pages.study_page import picture
from split_drake.experiments.provenance import short_hash
from split_drake.experiments.statistics import Rate
from split_drake.pose_task import PoseTask

_MISSING = "not judged"


def page_of(
    records: Sequence[SceneRecord],
    tasks: Sequence[PoseTask],
    question: Mapping[str, Any],
    pictures: Sequence[str],
) -> RunPage:
    """Return the page of an evaluation.

    Args:
        records: of its scenes.
        tasks: that were judged.
        question: what was evaluated, as metrics.json has it.
        pictures: files beside the page.
    """
    return RunPage(
        title=f"evaluation: {', '.join(str(task) for task in tasks)}",
        facts=_facts(records, question),
        bars=_bars(records, tasks),
        plots=(*_worst_objects(records, tasks), *(picture(name) for name in pictures)),
        columns=(
            Column("scene", numeric=True),
            Column("object", chosen=True),
            Column("feature", chosen=True),
            *(Column(f"{task}", chosen=True) for task in tasks),
            *(Column(f"{task} samples good, %", numeric=True) for task in tasks),
            Column("detection, s", numeric=True),
        ),
        rows=failures_first([_row(record, tasks) for record in records]),
        thing="scene",
    )


def _facts(
    records: Sequence[SceneRecord], question: Mapping[str, Any]
) -> tuple[tuple[str, str], ...]:
    detector = question.get("detector", {})
    facts = {
        "scenes": len(records),
        "objects": question.get("mugs"),
        "noise": f"{1e3 * question['noise_m']:g} mm on the points",
        "seed": question.get("seed"),
        "weights": short_hash(detector.get("checkpoint_sha256")),
        "trained at": short_hash(detector.get("commit")),
    }
    return tuple((name, str(value)) for name, value in facts.items() if value not in (None, ""))


def _bars(records: Sequence[SceneRecord], tasks: Sequence[PoseTask]) -> tuple[Bar, ...]:
    """Return the shares of the checks that are told of each object, in all scenes."""
    names = dict.fromkeys((task.name, check) for task, check, _ in main_checks(tasks))
    found = {
        (task, check): [
            record.tasks[task].checks[check]
            for record in records
            if check in record.tasks[task].checks
        ]
        for task, check in names
    }
    return tuple(
        Bar.of(f"{task}: {check.replace('_', ' ')}", Rate.of(flags))
        for (task, check), flags in found.items()
        if flags
    )


def _worst_objects(
    records: Sequence[SceneRecord], tasks: Sequence[PoseTask], most: int = 8
) -> tuple[str, ...]:
    """Return a plot of the objects with the most scenes that failed; none where none did."""
    failed: dict[str, int] = {}
    for record in records:
        if not _all_good(record, tasks):
            failed[record.subject] = failed.get(record.subject, 0) + 1
    worst = dict(sorted(failed.items(), key=lambda each: -each[1])[:most])
    return (bars_of("scenes that failed, by object", worst),) if worst else ()


def _all_good(record: SceneRecord, tasks: Sequence[PoseTask]) -> bool:
    return all(_verdict(record.tasks[task.name]) is not False for task in tasks)


def _verdict(record: TaskRecord) -> bool | None:
    """Return whether the top-ranked sample is good; None where that was not judged."""
    return record.checks.get("top_good")


def _row(record: SceneRecord, tasks: Sequence[PoseTask]) -> Row:
    parts = [record.tasks[task.name] for task in tasks]
    return Row(
        key=str(record.index),
        good=_all_good(record, tasks),
        cells=(
            Cell(record.index),
            Cell(record.subject),
            Cell("shows" if record.visible else "hidden"),
            *(_outcome(part) for part in parts),
            *(_share(part) for part in parts),
            Cell(round(record.detect_s, 2)),
        ),
        # Scores of all samples would make the page of 2000 scenes weigh 20 MB; scenes.jsonl has
        # them.
        record={
            "index": record.index,
            "subject": record.subject,
            "tasks": {
                task.name: {
                    "checks": dict(part.checks),
                    "values": {name: round(value, 3) for name, value in part.values.items()},
                    "tallies": {name: list(counts) for name, counts in part.tallies.items()},
                }
                for task, part in zip(tasks, parts, strict=True)
            },
        },
    )


def _outcome(part: TaskRecord) -> Cell:
    verdict = _verdict(part)
    text = _MISSING if verdict is None else "good" if verdict else "not good"
    return Cell(text, good=verdict)


def _share(part: TaskRecord) -> Cell:
    hits, of = part.tallies.get("samples_good", (0, 0))
    return Cell(round(100.0 * hits / of, 1) if of else None)
