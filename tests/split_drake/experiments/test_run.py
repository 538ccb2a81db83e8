"""Run folders: whose they are, and a log that an interruption leaves whole."""

import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from split_drake.experiments.run import (
    CONFIG,
    AnotherRunError,
    NoResultsError,
    RunFolder,
    claim_folder,
    json_line,
    read_json_lines,
    require_results,
)
from split_drake.files import UnreadableFileError

CONFIG_OF_A_RUN = {"seed": 3, "mugs": "test", "workers": 2}


@dataclass(frozen=True)
class Outcome:
    """What became of a trial."""

    number: int
    reason: str = ""


def run_in(path: Path) -> RunFolder[Outcome]:
    return RunFolder(path, "outcomes.jsonl", lambda fields: Outcome(**fields))


@pytest.fixture
def run(tmp_path: Path) -> RunFolder[Outcome]:
    """Return a run in a new folder that was claimed for it."""
    run = run_in(tmp_path / "run")
    with run.claim(CONFIG_OF_A_RUN):
        return run


@pytest.fixture
def console() -> Console:
    """Return a console that keeps what is printed, without breaking lines."""
    return Console(file=io.StringIO(), width=1000)


def claim(folder: Path, config: dict[str, Any]) -> None:
    """Claim a folder and leave it to the next."""
    with claim_folder(folder, config):
        pass


def printed(console: Console) -> list[str]:
    assert isinstance(console.file, io.StringIO)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]


def test_a_claim_keeps_what_was_asked_as_json_gives_it_back(tmp_path: Path) -> None:
    config = {"out": Path("a/b"), "pair": (1, 2), "pose": np.eye(2)}
    expected = {"out": "a/b", "pair": [1, 2], "pose": [[1.0, 0.0], [0.0, 1.0]]}
    with claim_folder(tmp_path / "new" / "run", config) as kept:
        assert kept == expected
    assert json.loads((tmp_path / "new" / "run" / CONFIG).read_text()) == expected
    with claim_folder(tmp_path / "new" / "run", config) as kept:
        assert kept == expected


def test_another_run_is_refused_and_what_differs_is_named(tmp_path: Path) -> None:
    claim(tmp_path, CONFIG_OF_A_RUN)
    other: dict[str, Any] = {"seed": 4, "mugs": "test", "noise_m": 0.1}
    with pytest.raises(AnotherRunError) as caught:
        claim(tmp_path, other)
    differing = "noise_m was None, is 0.1; seed was 3, is 4; workers was 2, is None"
    assert f"{tmp_path} holds another run ({differing})" in str(caught.value)
    assert json.loads((tmp_path / CONFIG).read_text()) == CONFIG_OF_A_RUN


def test_long_values_are_cut_in_the_message(tmp_path: Path) -> None:
    claim(tmp_path, {"names": ["a"] * 1000})
    with pytest.raises(AnotherRunError, match=r"names was .*\.\.\., is \[\]") as caught:
        claim(tmp_path, {"names": []})
    assert len(str(caught.value)) < len(str(tmp_path)) + 200


def test_free_keys_may_differ(tmp_path: Path) -> None:
    claim(tmp_path, CONFIG_OF_A_RUN)
    faster = CONFIG_OF_A_RUN | {"workers": 8}
    with claim_folder(tmp_path, faster, free_keys=("workers",)) as kept:
        assert kept == faster
    assert json.loads((tmp_path / CONFIG).read_text()) == faster


def test_a_new_run_has_no_records(tmp_path: Path, run: RunFolder[Outcome]) -> None:
    assert run.records() == []
    assert run_in(tmp_path / "nowhere").records() == []


def test_records_are_lines_of_json(run: RunFolder[Outcome]) -> None:
    outcomes = [Outcome(0), Outcome(1, "the mug\nfell")]
    for outcome in outcomes:
        run.append(outcome)
    assert run.records() == outcomes
    lines = run.log.read_text().splitlines()
    assert lines == [json_line(outcome) for outcome in outcomes]
    assert lines[0] == '{"number":0,"reason":""}'


def test_a_line_that_a_kill_cut_off_is_left_out_and_mended(run: RunFolder[Outcome]) -> None:
    run.append(Outcome(0))
    with run.log.open("a") as log:
        log.write('{"number":1,"rea')
    assert run.records() == [Outcome(0)]
    with run.claim(CONFIG_OF_A_RUN):
        run.append(Outcome(1))
    assert run.records() == [Outcome(0), Outcome(1)]


def test_other_bad_lines_are_named(run: RunFolder[Outcome]) -> None:
    run.append(Outcome(0))
    with run.log.open("a") as log:
        log.write("oops\n")
    run.append(Outcome(1))
    with pytest.raises(ValueError, match=rf"{run.log.name}:2 is not JSON"):
        run.records()


def test_a_refused_claim_leaves_the_log_as_it_is(run: RunFolder[Outcome]) -> None:
    run.log.write_text('{"number":0,"rea')
    with (
        pytest.raises(AnotherRunError, match="seed was 3, is 4"),
        run.claim(CONFIG_OF_A_RUN | {"seed": 4}),
    ):
        pass
    assert run.log.read_text() == '{"number":0,"rea'
    assert read_json_lines(run.log) == []


def arriving(count: int, end: BaseException | None = None) -> Iterator[Outcome]:
    """Yield so many outcomes, then raise what ends it."""
    yield from map(Outcome, range(count))
    if end is not None:
        raise end


def test_collected_records_are_in_the_log_and_described_together(
    run: RunFolder[Outcome], console: Console
) -> None:
    seen: list[list[int]] = []

    def describe(records: Sequence[Outcome]) -> str:
        seen.append([record.number for record in records])
        return f"{len(records)} there"

    run.append(Outcome(9))
    run.collect(arriving(2), 2, console, describe)
    assert run.records() == [Outcome(9), Outcome(0), Outcome(1)]
    assert seen == [[9, 0], [9, 0, 1]]
    assert "3/3" in printed(console)[-1]
    assert "3 there" in printed(console)[-1]


def test_ctrl_c_keeps_what_has_arisen_and_says_how_to_go_on(
    run: RunFolder[Outcome], console: Console
) -> None:
    run.collect(arriving(2, KeyboardInterrupt()), 5, console)
    assert run.records() == [Outcome(0), Outcome(1)]
    assert printed(console)[-1] == f"interrupted; --out {run.path} goes on from here"


def test_other_errors_end_it_and_keep_what_has_arisen(
    run: RunFolder[Outcome], console: Console
) -> None:
    with pytest.raises(RuntimeError, match="no more"):
        run.collect(arriving(2, RuntimeError("no more")), 5, console)
    assert run.records() == [Outcome(0), Outcome(1)]


def test_only_what_is_worth_it_has_a_line(run: RunFolder[Outcome], console: Console) -> None:
    outcomes = [Outcome(0), Outcome(1, "the mug fell"), Outcome(2)]
    run.collect(outcomes, 3, console, remark=lambda record: record.reason)
    assert printed(console).count("the mug fell") == 1
    assert len([line for line in printed(console) if "/" not in line]) == 1


def test_nothing_is_asked_for_or_shown_where_nothing_is_expected(
    run: RunFolder[Outcome], console: Console
) -> None:
    run.collect(arriving(0, AssertionError("nobody asked")), 0, console)
    assert printed(console) == []
    assert run.records() == []


@pytest.mark.parametrize("line", ['{"number":"1","size":2}', '{"reason":"none"}', "[1]", "7"])
def test_lines_that_are_no_records_are_named(line: str, run: RunFolder[Outcome]) -> None:
    run.append(Outcome(0))
    with run.log.open("a") as log:
        log.write(line + "\n")
    with pytest.raises(UnreadableFileError, match=f"{run.log}:2"):
        run.records()


@pytest.mark.parametrize("content", ["", "{", "[]", "\x00"])
def test_a_damaged_config_is_named(content: str, run: RunFolder[Outcome]) -> None:
    path = run.path / CONFIG
    path.write_text(content)
    with pytest.raises(UnreadableFileError, match=f"^{path} .*expected|^{path} is damaged or not"):
        claim(run.path, CONFIG_OF_A_RUN)
    assert path.read_text() == content


def test_records_that_are_to_be_made_again_are_taken_out_of_the_log(
    run: RunFolder[Outcome],
) -> None:
    for outcome in (Outcome(0), Outcome(1, "error"), Outcome(2)):
        run.append(outcome)
    with run.claim(CONFIG_OF_A_RUN):
        assert len(run.records()) == 3
    with run.claim(CONFIG_OF_A_RUN, again=lambda record: record.reason == "error"):
        assert run.records() == [Outcome(0), Outcome(2)]


def test_errors_alone_are_no_result(tmp_path: Path) -> None:
    require_results([], 0, tmp_path)
    require_results(["one"], 2, tmp_path)
    message = f"^{tmp_path} holds no result: all 2 ended in an error, the first in: KeyError: 'a'$"
    with pytest.raises(NoResultsError, match=message):
        require_results(["Traceback\nKeyError: 'a'\n", "two"], 2, tmp_path)
