"""Plans as rows of numbers."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from planning.plan_rows import MotionFileError, import_rows
from planning.problem import SAMPLE_S, rows_of
from tests.helpers.planning import reorient_plan


def test_a_plan_is_exported_as_json_and_read_back(tmp_path: Path) -> None:
    plan = reorient_plan()
    plan.export(tmp_path / "plan.json")
    rows = import_rows(tmp_path / "plan.json")
    assert rows == rows_of(plan.segments)
    assert len(rows) == sum(len(segment.trajectory.times_s) for segment in plan.segments)
    np.testing.assert_allclose([row.time_s for row in rows], SAMPLE_S * np.arange(len(rows)))
    assert rows[0].q == tuple(plan.segments[0].trajectory.qs[0])
    assert rows[-1].q == tuple(plan.segments[-1].trajectory.qs[-1])
    assert list(dict.fromkeys(row.segment for row in rows))[:3] == ["transit", "approach", "close"]
    closing = [row.opening_m for row in rows if row.segment == "close"]
    close = next(segment for segment in plan.segments if segment.name == "close")
    assert closing[0] == close.opening_start_m
    assert closing[-1] == pytest.approx(close.opening_end_m)


def test_a_plan_is_exported_as_csv(tmp_path: Path) -> None:
    plan = reorient_plan()
    plan.export(str(tmp_path / "plan.csv"))
    with (tmp_path / "plan.csv").open() as file:
        header, *lines = csv.reader(file)
    assert header[:2] == ["time_s", "panda_joint1_rad"]
    assert header[-3:] == ["opening_m", "force_n", "segment"]
    rows = rows_of(plan.segments)
    for line, row in ((lines[0], rows[0]), (lines[-1], rows[-1])):
        numbers = [row.time_s, *row.q, *row.v, row.opening_m, row.force_n]
        assert [float(text) for text in line[:-1]] == numbers
        assert line[-1] == row.segment
    assert len(lines) == len(rows)


def test_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MotionFileError, match=r"plan.yaml ends in '.yaml'; expected .csv or .json"):
        reorient_plan().export(tmp_path / "plan.yaml")


def test_what_is_no_motion_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    with pytest.raises(MotionFileError, match=r"plan.json is no exported motion"):
        import_rows(path)
    for text in ("{", "[]", '{"format": "other"}'):
        path.write_text(text)
        with pytest.raises(MotionFileError, match=r"plan.json is no exported motion"):
            import_rows(path)
    reorient_plan().export(path)
    whole = json.loads(path.read_text())
    path.write_text(json.dumps({name: whole[name] for name in whole if name != "q_rad"}))
    with pytest.raises(MotionFileError, match=r"plan.json has no q_rad; expected time_s"):
        import_rows(path)
    path.write_text(json.dumps({**whole, "q_rad": whole["q_rad"][:-1]}))
    with pytest.raises(MotionFileError, match="columns that do not fit"):
        import_rows(path)
    path.write_text(json.dumps({**whole, "q_rad": [q[:-1] for q in whole["q_rad"]]}))
    with pytest.raises(MotionFileError, match="not seven finite angles"):
        import_rows(path)
