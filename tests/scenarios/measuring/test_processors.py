"""Plans compared between processors' code."""

from pathlib import Path

import pytest

from scenarios.measuring.processors import SETTINGS, ProcessorOptions, main, same_plan
from split_drake.files import write_json

PLAN = {"seed": 3, "X_WGrasp": [[1.0, 0.0]], "duration_s": [1.0, 2.0], "q": [[0.1], [0.2]]}


def test_plans_are_the_same_up_to_a_millionth() -> None:
    assert same_plan(PLAN, {**PLAN, "duration_s": [1.0, 2.0 + 1e-8]})
    assert not same_plan(PLAN, {**PLAN, "duration_s": [1.0, 2.0001]})
    assert not same_plan(PLAN, {**PLAN, "duration_s": [1.0]})
    assert not same_plan(PLAN, {"seed": 3, "reason": "no grasp"})
    assert same_plan({"seed": 3, "reason": "no grasp"}, {"seed": 3, "reason": "no grasp"})
    assert not same_plan({"seed": 3, "reason": "no grasp"}, {"seed": 3, "reason": "no way"})


def test_plans_that_are_there_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = {**PLAN, "q": [[0.1], [0.3]]}
    second = {"as_it_is": PLAN, "AVX2": PLAN, "SSE41": other}
    for name, plan in second.items():
        write_json(tmp_path / f"hang_3_2_{name}.json", {"plans": [PLAN, plan]})
    main(ProcessorOptions(tmp_path, trials=2, seed=3))
    printed = capsys.readouterr().out
    assert "AVX2: 2 of 2 plans" in printed
    assert "SSE4.1: 1 of 2 plans" in printed
    assert "the same with every setting: 1 of 2" in printed


def test_a_process_of_its_own_plans_with_each_setting(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(ProcessorOptions(tmp_path, trials=1))
    assert len(list(tmp_path.iterdir())) == len(SETTINGS)
    assert "the same with every setting: 1 of 1" in capsys.readouterr().out


def test_what_is_no_setting_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--setting is 'AVX'; expected one of as it is, AVX2"):
        ProcessorOptions(tmp_path, setting="AVX")
    with pytest.raises(ValueError, match="--trials is 0; expected at least 1"):
        ProcessorOptions(tmp_path, trials=0)
