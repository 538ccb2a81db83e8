"""Commands say in one sentence what cannot be used."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from split_drake.bad_input import BadInputError
from split_drake.experiments.command import run_command
from split_drake.experiments.run import AnotherRunError, claim_folder
from split_drake.split.checkpoint import CheckpointError


@dataclass(frozen=True)
class CountOptions:
    """Counting.

    Attributes:
        count: to count to.
    """

    count: int = 3


def test_the_command_has_its_options(monkeypatch: pytest.MonkeyPatch) -> None:
    counted: list[int] = []
    monkeypatch.setattr(sys, "argv", ["count", "--count", "5"])
    run_command(lambda options: counted.append(options.count), CountOptions)
    assert counted == [5]


def test_bad_input_ends_in_its_message(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(options: CountOptions) -> None:
        raise CheckpointError("weights.bin is no checkpoint")

    monkeypatch.setattr(sys, "argv", ["count"])
    with pytest.raises(SystemExit) as stopped:
        run_command(fail, CountOptions)
    assert stopped.value.code == "weights.bin is no checkpoint"


def test_what_is_a_bug_stays_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(options: CountOptions) -> None:
        raise ValueError("a bug")

    monkeypatch.setattr(sys, "argv", ["count"])
    with pytest.raises(ValueError, match="a bug"):
        run_command(fail, CountOptions)


def test_errors_of_input_are_of_one_kind() -> None:
    assert issubclass(AnotherRunError, BadInputError)
    assert issubclass(BadInputError, ValueError)


@pytest.mark.parametrize(
    "arguments",
    [
        ["scenarios.clutter_removal", "--scene", "pile", "--detector", "oracle"],
        ["scenarios.mug_hang", "--detector", "oracle", "--trials", "1"],
    ],
    ids=lambda arguments: str(arguments[0]),
)
def test_a_folder_of_another_run_is_named_without_a_traceback(
    arguments: list[str], tmp_path: Path
) -> None:
    with claim_folder(tmp_path, {"seed": "another"}):
        pass
    run = subprocess.run(
        [sys.executable, "-m", *arguments, "--out", str(tmp_path)], capture_output=True, text=True
    )
    assert run.returncode == 1
    assert "Traceback" not in run.stderr
    assert str(tmp_path) in run.stderr.replace("\n", "")
