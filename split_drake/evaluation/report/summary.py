"""What the records of an evaluation come to: figures by task, and by whether the feature shows."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.table import Column, Table

from split_drake.evaluation.calibration import area_under_curve, reliability
from split_drake.evaluation.judges import main_checks
from split_drake.evaluation.record import SceneRecord, Scored, TaskRecord
from split_drake.experiments.statistics import Rate
from split_drake.pose_task import PoseTask

Figures = dict[str, Any]


def share(flags: Sequence[bool]) -> Figures | None:
    """Return share, counts and Wilson's 95% interval of scenes with a flag; None without scenes."""
    if not flags:
        return None
    rate = Rate.of(flags)
    return {
        "share": rate.value,
        "hits": rate.successes,
        "scenes": rate.trials,
        "wilson95": list(rate.wilson95),
    }


def pooled(tallies: Sequence[tuple[int, int]]) -> Figures | None:
    """Return the share of all that was counted; None where nothing was.

    It has no interval, since what is counted within a scene is not independent.
    """
    hits, total = (sum(column) for column in zip(*tallies, strict=True)) if tallies else (0, 0)
    return {"share": hits / total, "hits": hits, "of": total} if total else None


def groups(records: Sequence[SceneRecord]) -> dict[str, list[SceneRecord]]:
    """Return all records, those of scenes that show the object's feature, and those that don't."""
    return {
        "all": list(records),
        "visible": [record for record in records if record.visible],
        "hidden": [record for record in records if not record.visible],
    }


def _names(records: Sequence[TaskRecord], kind: str) -> list[str]:
    """Return the names of the records' `kind`, in order of appearance."""
    return list(dict.fromkeys(name for record in records for name in getattr(record, kind)))


def calibration(samples: Sequence[Scored]) -> Figures | None:
    """Return AUC, expected calibration error and reliability by bins; None without samples."""
    scores = np.concatenate([scored.scores for scored in samples]) if samples else np.zeros(0)
    if not len(scores):
        return None
    good = np.concatenate([scored.flags for scored in samples])
    bins = reliability(scores, good)
    filled = bins.counts > 0
    area = area_under_curve(scores, good)
    return {
        "samples": len(scores),
        "auc": None if np.isnan(area) else area,
        "expected_error": bins.expected_error,
        "bins": {
            "counts": bins.counts[filled].tolist(),
            "scores": bins.scores[filled].tolist(),
            "shares": bins.shares[filled].tolist(),
        },
    }


def summarize_task(records: Sequence[SceneRecord], task: str) -> Figures:
    """Return {measure: {group: figures}} of a task, and the evaluator's calibration.

    Shares are of scenes, unless they are pooled over samples or true poses; values are medians over
    scenes.
    """
    by_group = {
        group: [record.tasks[task] for record in members]
        for group, members in groups(records).items()
    }
    everything = by_group["all"]
    figures: Figures = {}
    for name in _names(everything, "checks"):
        figures[name] = {
            group: share([r.checks[name] for r in members if name in r.checks])
            for group, members in by_group.items()
        }
    for name in _names(everything, "values"):
        figures[f"median_{name}"] = {
            group: _median([r.values[name] for r in members if name in r.values])
            for group, members in by_group.items()
        }
    for name in _names(everything, "tallies"):
        figures[name] = {
            group: pooled([r.tallies[name] for r in members if name in r.tallies])
            for group, members in by_group.items()
        }
    figures["calibration"] = calibration([r.samples for r in everything])
    figures["calibration_in_physics"] = calibration([r.tried for r in everything if r.tried])
    return figures


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def summarize(records: Sequence[SceneRecord], tasks: Sequence[str]) -> Figures:
    """Return the metrics of tasks, given by their names, over at least one scene.

    What is of a task is under "tasks", or under "by_subject" and the object's name, so that a task
    may have any name.
    """
    by_subject: dict[str, list[SceneRecord]] = {}
    for record in records:
        by_subject.setdefault(record.subject, []).append(record)
    return {
        "tasks": {task: summarize_task(records, task) for task in tasks},
        "scenes": {group: len(members) for group, members in groups(records).items()},
        "median_detect_s": float(np.median([record.detect_s for record in records])),
        "by_subject": {
            name: _of_subject(members, tasks) for name, members in sorted(by_subject.items())
        },
    }


def _of_subject(records: Sequence[SceneRecord], tasks: Sequence[str]) -> Figures:
    """Return {task: {check: {group: share}}} of one object."""
    figures: Figures = {}
    for task in tasks:
        everything = summarize_task(records, task)
        checks = _names([record.tasks[task] for record in records], "checks")
        figures[task] = {name: everything[name] for name in checks}
    return figures


def format_figure(figure: Any) -> str:
    """Return a figure as a table shows it."""
    if figure is None:
        return "-"
    if not isinstance(figure, Mapping):
        return f"{figure:.2f}"
    if "wilson95" not in figure:
        return f"{figure['share']:.1%}  {figure['hits']}/{figure['of']}"
    low, high = (100.0 * end for end in figure["wilson95"])
    return f"{figure['share']:.1%} [{low:.1f}, {high:.1f}]  {figure['hits']}/{figure['scenes']}"


def metrics_table(metrics: Mapping[str, Any], tasks: Sequence[str]) -> Table:
    """Return the metrics of tasks as a table with a column for each group of scenes."""
    scenes = metrics["scenes"]
    table = Table(Column("", no_wrap=True), *(f"{scenes[group]} {group}" for group in scenes))
    for task in tasks:
        table.add_section()
        for name, figures in metrics["tasks"][task].items():
            if name.startswith("calibration"):
                continue
            cells = (format_figure(figures[group]) for group in scenes)
            table.add_row(f"{task} {name}", *cells)
    return table


def calibration_table(metrics: Mapping[str, Any], tasks: Sequence[str]) -> Table:
    """Return how well the evaluator's scores tell good samples, a row a task."""
    table = Table("evaluator", "samples", "AUC", "expected calibration error")
    for task in tasks:
        for name in ("calibration", "calibration_in_physics"):
            figures = metrics["tasks"][task][name]
            if figures is not None:
                label = f"{task}, in physics" if name.endswith("physics") else task
                auc, error = format_figure(figures["auc"]), f"{figures['expected_error']:.3f}"
                table.add_row(label, str(figures["samples"]), auc, error)
    return table


def subjects_table(metrics: Mapping[str, Any], tasks: Sequence[PoseTask]) -> Table:
    """Return the main shares of each object; those that an object is not judged by are dashes."""
    columns = main_checks(tasks)
    table = Table("object", *(f"{task} {check}, {group}" for task, check, group in columns))
    for subject, figures in metrics["by_subject"].items():
        shares = (figures[task.name].get(check, {}).get(group) for task, check, group in columns)
        table.add_row(subject, *map(format_figure, shares))
    return table
