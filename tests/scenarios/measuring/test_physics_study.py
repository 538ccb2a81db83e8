"""The physics study: cells that differ in one thing, records, tables, going on."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.measuring.physics_study import StudyOptions, main, study_config
from scenarios.study.cells import FACTORS, study_cells
from scenarios.study.report import paired_p, study_rows, write_study
from scenarios.study.trials import (
    StudyRecord,
    StudyTrial,
    crashed_study_trial,
    run_study_trial,
    study_run,
)
from split_drake.experiments.run import json_line
from tests.helpers.stations import STATION

CELLS = study_cells(STATION, FACTORS)


def record(index: int, outcome: str, cell: str = "hang: default") -> StudyRecord:
    return StudyRecord(cell, index, index, "test_000", outcome)


def test_cells_differ_from_the_default_in_one_thing() -> None:
    assert len({cell.name for cell in CELLS}) == len(CELLS)
    assert {cell.factor for cell in CELLS} == {None, *FACTORS}
    default = STATION
    for cell in CELLS:
        changed = {
            name
            for name, value in vars(cell.station).items()
            if name != "layout" and value != getattr(default, name)
        }
        expected = {
            "time step": {"time_step_s"},
            "contact": {"contact_model", "contact_approximation"},
            "near-rigid": {"near_rigid_threshold"},
            "friction": {"friction"},
        }
        assert changed <= expected.get(cell.factor or "", set()), cell.name
        assert (cell.mass_kg is not None) == (cell.factor == "mass")


def test_pegs_are_as_thick_and_as_tilted_as_a_cell_says() -> None:
    layouts = {cell.value: cell.station.layout for cell in CELLS if cell.kind == "hang"}
    assert layouts["4 mm"].hook.peg_radius_m == 0.004
    assert layouts["0 deg"].X_WK[2, 1] == pytest.approx(0.0, abs=1e-12)
    assert layouts["20 deg"].X_WK[2, 1] == pytest.approx(np.sin(np.radians(20.0)))


@pytest.mark.parametrize("model", ["point, lagged", "hydroelastic, sap"])
def test_a_held_mug_stays_in_every_contact_model(model: str, tmp_path: Path) -> None:
    (cell,) = (cell for cell in CELLS if cell.value == model)
    held = run_study_trial(StudyTrial(cell, 0, 0, 0.5, tmp_path))
    assert held.succeeded, held.reason
    assert held.mug == "test_000"
    assert 0.0 < held.figures["penetration_m"] < 0.002
    assert held.figures["slip_m"] < 0.002


def test_slippery_mugs_slip_further(tmp_path: Path) -> None:
    default = next(cell for cell in CELLS if cell.name == "hold: default")
    slippery = replace(default, station=replace(STATION, friction=0.02))
    kept, sliding = (
        run_study_trial(StudyTrial(cell, 0, 3, 0.5, tmp_path)) for cell in (default, slippery)
    )
    assert kept.succeeded
    assert sliding.figures["slip_m"] > 10.0 * kept.figures["slip_m"]


def test_a_study_of_one_trial_a_cell_goes_on_and_reports(tmp_path: Path) -> None:
    options = StudyOptions(tmp_path, trials=1, factors=("mass",), hold_s=0.2, workers=1)
    (mass, *_), default = ([c for c in CELLS if c.factor == f] for f in ("mass", None))
    known = [record(0, "success", cell.name) for cell in (*default, mass)]
    with study_run(tmp_path).claim(study_config(options)):
        pass
    tmp_path.joinpath("trials.jsonl").write_text(
        "".join(json_line(each) + "\n" for each in known) + '{"cell":"ha'
    )
    main(options)
    records = study_run(tmp_path).records()
    assert records[:3] == known
    assert [each.cell for each in records[3:]] == ["hang: mass 0.3 kg", "hang: mass 0.5 kg"]
    assert all(each.outcome != "error" for each in records)
    rows = json.loads((tmp_path / "study.json").read_text())
    page = (tmp_path / "index.html").read_text()
    assert page.count('<tr id="setting-') == len(rows) and "against default" in page
    assert [row["trials"] for row in rows] == [1] * 5
    assert "| mass | 0.5 kg | 1/1" in (tmp_path / "study.md").read_text()
    with pytest.raises(ValueError, match="seed was 0, is 5"):
        main(replace(options, seed=5))


def test_rows_compare_the_same_seeds(tmp_path: Path) -> None:
    other = "hang: friction 0.4"
    records = [record(i, "success") for i in range(12)]
    records += [record(i, "success" if i < 6 else "grasp", other) for i in range(12)]
    rows = {row.cell.name: row for row in study_rows(CELLS, records)}
    assert rows[other].failures == {"grasp": 6}
    assert rows[other].p_paired == pytest.approx(2 * 0.5**6)  # six to nothing, by a fair coin
    assert rows["hang: default"].p_paired is None
    assert rows["hang: friction 1"].p_paired == 1.0
    write_study(tmp_path, list(rows.values()))
    assert "| friction | 0.4 | 6/12" in (tmp_path / "study.md").read_text()


def test_paired_trials_that_agree_tell_nothing() -> None:
    one = {i: record(i, "success") for i in range(3)}
    assert paired_p(one, one) == 1.0


def test_a_crash_is_recorded(tmp_path: Path) -> None:
    crashed = crashed_study_trial(StudyTrial(CELLS[0], 2, 42, 1.0, tmp_path))
    assert (crashed.outcome, crashed.mug, crashed.index) == ("error", "test_002", 2)


@pytest.mark.parametrize("option", [{"trials": 0}, {"seed": -1}, {"hold_s": 0.0}, {"workers": 0}])
def test_bad_options_are_named(option: dict[str, int], tmp_path: Path) -> None:
    (name,) = option
    with pytest.raises(ValueError, match=f"--{name.replace('_', '-')} is "):
        StudyOptions(tmp_path, **option)  # type: ignore[arg-type]
