"""A folder belongs to one process at a time, and what happens to it meanwhile is noticed."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import pytest
from rich.console import Console

from split_drake.bad_input import BadInputError
from split_drake.experiments.lock import LOCK, FolderChangedError, FolderInUseError, locked
from split_drake.experiments.run import AnotherRunError, RunFolder, claim_folder
from split_drake.studies import ablate, sampler_study
from split_drake.studies.ablate import AblateConfig
from split_drake.studies.sampler_study import StudyConfig
from split_drake.training.training_folder import TrainingFolder

HOLD = """
import sys, time
from pathlib import Path
from split_drake.experiments.lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60.0)
"""
CONFIG_OF_A_RUN = {"seed": 3}


@dataclass(frozen=True)
class Outcome:
    """What became of a trial."""

    number: int


def run_in(path: Path) -> RunFolder[Outcome]:
    return RunFolder(path, "outcomes.jsonl", lambda fields: Outcome(**fields))


def ways_in(path: Path) -> dict[str, AbstractContextManager[object]]:
    """Return all ways by which commands claim a folder."""
    return {
        "run": run_in(path).claim(CONFIG_OF_A_RUN),
        "folder": claim_folder(path, CONFIG_OF_A_RUN),
        "training": TrainingFolder(path).locked(resume=False),
    }


WAYS = ("run", "folder", "training")


@pytest.fixture
def holder(tmp_path: Path) -> Iterator["subprocess.Popen[str]"]:
    """Return another process that holds `tmp_path`."""
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.mark.parametrize("way", WAYS)
def test_a_folder_in_use_is_refused_until_the_other_process_dies(
    way: str, tmp_path: Path, holder: "subprocess.Popen[str]"
) -> None:
    message = rf"{tmp_path} is in use: another process \({holder.pid}\) runs there"
    with pytest.raises(FolderInUseError, match=message), ways_in(tmp_path)[way]:
        pass
    assert [path.name for path in tmp_path.iterdir()] == [LOCK], "a refused run leaves nothing"
    holder.kill()
    holder.wait()
    with ways_in(tmp_path)[way]:
        assert (tmp_path / LOCK).is_file()


@pytest.mark.parametrize("way", WAYS)
def test_two_runs_of_one_process_do_not_share_a_folder(way: str, tmp_path: Path) -> None:
    with (
        ways_in(tmp_path)[way],
        pytest.raises(FolderInUseError, match="is in use"),
        ways_in(tmp_path)[way],
    ):
        pass
    with ways_in(tmp_path)[way]:
        pass


@pytest.mark.parametrize("way", WAYS)
def test_files_of_no_run_are_left_alone(way: str, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("mine")
    message = rf"{tmp_path} holds 'index.html', but no config.json: it is no folder of an earlier"
    with pytest.raises(AnotherRunError, match=message), ways_in(tmp_path)[way]:
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["index.html"]


def test_records_without_their_config_are_not_taken_up(tmp_path: Path) -> None:
    run = run_in(tmp_path)
    with run.claim(CONFIG_OF_A_RUN):
        run.append(Outcome(0))
    (tmp_path / "config.json").unlink()
    with pytest.raises(AnotherRunError, match=r"holds 'outcomes.jsonl', but no config.json"):
        run.claim({"seed": 4}).__enter__()
    assert run.records() == [Outcome(0)]


def test_studies_lock_the_folder_that_holds_their_runs(
    tmp_path: Path, holder: "subprocess.Popen[str]"
) -> None:
    message = rf"process \({holder.pid}\) runs there"
    with pytest.raises(FolderInUseError, match=message):
        ablate.main(AblateConfig(data=tmp_path, out=tmp_path))
    with pytest.raises(FolderInUseError, match=message):
        sampler_study.main(StudyConfig(out=tmp_path))


def test_what_cannot_be_a_folder_is_named(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(BadInputError, match=rf"{file} cannot be written to \(File exists\)"):
        locked(file).__enter__()
    with pytest.raises(BadInputError, match=r"cannot be written to \(Not a directory\)"):
        locked(file / "run").__enter__()


def test_a_folder_made_for_what_fails_at_once_is_removed_again(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no such task"), locked(tmp_path / "run"):
        raise BadInputError("no such task")
    assert not (tmp_path / "run").exists()


def test_a_folder_that_is_removed_meanwhile_is_noticed(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with (
        pytest.raises(FolderChangedError, match=f"{folder} was removed or replaced while"),
        claim_folder(folder, CONFIG_OF_A_RUN),
    ):
        shutil.rmtree(folder)


def test_a_folder_that_is_replaced_is_noticed_and_what_is_new_there_left_alone(
    tmp_path: Path,
) -> None:
    folder, run = tmp_path / "run", run_in(tmp_path / "run")

    def arriving() -> Iterator[Outcome]:
        yield Outcome(0)
        shutil.rmtree(folder)
        with claim_folder(folder, {"seed": 4}):
            yield Outcome(1)

    with (
        pytest.raises(FolderChangedError, match="was removed or replaced"),
        run.claim(CONFIG_OF_A_RUN),
    ):
        run.collect(arriving(), 2, Console(quiet=True))
    assert not run.log.exists()


def test_a_log_that_lacks_what_was_written_ends_the_run(tmp_path: Path) -> None:
    run = run_in(tmp_path)

    def arriving() -> Iterator[Outcome]:
        yield Outcome(0)
        run.log.unlink()
        yield Outcome(1)

    with (
        pytest.raises(FolderChangedError, match=r"holds 1 records, expected the 2 that were"),
        run.claim(CONFIG_OF_A_RUN),
    ):
        run.collect(arriving(), 2, Console(quiet=True))
