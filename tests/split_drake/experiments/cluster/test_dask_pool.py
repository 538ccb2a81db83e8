"""The pool of a Dask scheduler, with real schedulers and workers of this machine."""

import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from split_drake.bad_input import BadInputError
from split_drake.experiments.cluster import dask_pool
from split_drake.experiments.cluster.address import NoSchedulerError
from split_drake.experiments.cluster.dask_pool import DaskPool
from split_drake.experiments.cluster.plugin import Code
from split_drake.experiments.pool import WORKER_DIED, WorkerDiedError, too_long
from tests.helpers import farmed
from tests.helpers.cluster import ROOT, Cluster, free_port, wait_until


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    (tmp_path / "machines").mkdir()
    cluster = Cluster(tmp_path / "machines")
    cluster.start_scheduler()
    yield cluster
    cluster.end()


def test_results_are_those_of_this_machine(
    cluster: Cluster, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    cluster.start_worker()
    cluster.start_worker()
    results = list(DaskPool(cluster.address, farmed.square).run(range(20)))
    assert sorted(results) == [number * number for number in range(20)]
    assert list(DaskPool(cluster.address, farmed.square).run([])) == []
    assert capfd.readouterr().err.count("workers on ") == 1

    # One that crashes or takes too long costs its item alone; what raises ends the run.
    pool = DaskPool(cluster.address, farmed.troubled, farmed.crashed, limit_s=8.0)
    found = {str(result) for result in pool.run([0, 1, 2, 4])}
    assert found == {"0", "4", f"1: {WORKER_DIED}", f"2: {too_long(8.0)}"}
    with pytest.raises(ValueError, match="three is no item") as raised:
        list(DaskPool(cluster.address, farmed.troubled).run([0, 3]))
    assert any("in troubled" in note for note in raised.value.__notes__)
    with pytest.raises(WorkerDiedError, match=f"{WORKER_DIED} at 1"):
        list(DaskPool(cluster.address, farmed.troubled).run([1]))

    # A process begins once, and goes on to the next item.
    begun = DaskPool(cluster.address, farmed.began, start_worker=farmed.begin)
    processes = dict(begun.run(range(12)))
    assert 1 <= len(processes) <= 2 and set(processes.values()) == {1}

    # Files go there, and come back.
    run, folder, file = (tmp_path / name for name in ("run", "folder", "file"))
    run.mkdir()
    folder.mkdir()
    file.write_text("of a file")
    (folder / "inside").write_text("inside")
    (run / "kept").mkdir()
    (run / "kept" / "before").write_text("")
    files = DaskPool(cluster.address, farmed.read_and_write, run=run, kept=("kept",))
    read = list(files.run([(file, run), (folder, run)]))
    assert (run / "written" / "file.txt").read_text() == "of a file"
    assert (run / "written" / "folder.txt").read_text() == "inside"
    assert (run / "kept" / "file").is_file()
    for before, path in read:
        assert before.startswith("before")
        assert not path.startswith((str(file), str(folder)))
    # Nothing of it stays on the workers.
    assert not list((tmp_path / "machines").rglob("split-*"))


def test_a_thousand_items_survive_workers_that_are_killed(cluster: Cluster) -> None:
    for _ in range(2):
        cluster.start_worker()
    ended, killed = threading.Event(), []

    def kill_now_and_then() -> None:
        while not ended.wait(10.0):
            cluster.start_worker()
            cluster.kill_worker()
            killed.append(time.monotonic())

    killer = threading.Thread(target=kill_now_and_then)
    killer.start()
    try:
        results = Counter(DaskPool(cluster.address, farmed.square).run(range(1000)))
    finally:
        ended.set()
        killer.join()
    assert results == Counter(number * number for number in range(1000))
    assert len(killed) >= 2


def test_a_scheduler_that_comes_back_goes_on(
    cluster: Cluster, capfd: pytest.CaptureFixture[str]
) -> None:
    cluster.start_worker()
    results: list[int] = []
    pool = DaskPool(cluster.address, farmed.slow_square, patience_s=60.0)
    for result in pool.run(range(12)):
        results.append(result)
        if len(results) == 3:
            cluster.kill_scheduler()
            cluster.kill_worker()
            cluster.start_scheduler()
            cluster.start_worker()
    assert sorted(results) == [number * number for number in range(12)]
    assert "went away; waiting for it to come back" in capfd.readouterr().err


def test_a_scheduler_that_stays_away_ends_the_run(cluster: Cluster) -> None:
    cluster.start_worker()
    pool = DaskPool(cluster.address, farmed.slow_square, patience_s=3.0)
    arriving = pool.run(range(5))
    assert next(arriving) in (0, 1, 4, 9, 16)
    cluster.kill_scheduler()
    with pytest.raises(NoSchedulerError, match="no scheduler answers at tcp://127"):
        list(arriving)


def test_a_worker_with_other_code_is_refused(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster.start_worker()
    here = Code.here()

    @dataclass(frozen=True)
    class Other(Code):
        @classmethod
        def here(cls) -> Code:
            return Code("0" * 64, here.weights, here.versions)

    monkeypatch.setattr(dask_pool, "Code", Other)
    with pytest.raises(BadInputError, match=r"has code .*, expected 000000000000; a run needs"):
        list(DaskPool(cluster.address, farmed.square).run([1]))


def test_where_nobody_answers_a_sentence_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_pool, "FIRST_S", 1.0)
    with pytest.raises(NoSchedulerError, match="expected one that was started by dask scheduler"):
        list(DaskPool(f"tcp://127.0.0.1:{free_port()}", farmed.square).run([1]))


def test_a_command_that_is_asked_to_end_leaves_nothing(cluster: Cluster, tmp_path: Path) -> None:
    cluster.start_worker()
    program = (
        "from tests.helpers import farmed; import sys; "
        "from split_drake.experiments.cluster.dask_pool import DaskPool; "
        "[print(r, flush=True) for r in DaskPool(sys.argv[1], farmed.slow_square).run(range(99))]"
    )
    command = subprocess.Popen(
        [sys.executable, "-c", program, cluster.address],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert command.stdout is not None and command.stdout.readline().strip().isdecimal()
    command.send_signal(signal.SIGTERM)
    _, told = command.communicate(timeout=60.0)
    assert "KeyboardInterrupt" in told
    wait_until(lambda: not list((tmp_path / "machines").rglob("split-*")))


def test_a_lost_connection_is_made_anew(
    cluster: Cluster, capfd: pytest.CaptureFixture[str]
) -> None:
    cluster.start_worker()
    arriving = DaskPool(cluster.address, farmed.slow_square, patience_s=60.0).run(range(8))
    results = [next(arriving)]
    # While nobody looks, everything goes and comes back.
    cluster.kill_scheduler()
    cluster.kill_worker()
    cluster.start_scheduler()
    cluster.start_worker()
    time.sleep(8.0)
    results += list(arriving)
    assert sorted(results) == [number * number for number in range(8)]
    assert "went away" in capfd.readouterr().err


def test_a_worker_without_room_is_told(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster.start_worker()
    monkeypatch.setattr(dask_pool, "RunPlugin", farmed.PluginWithoutRoom)
    with pytest.raises(BadInputError, match=r"has no place for the run: OSError: .* no room"):
        list(DaskPool(cluster.address, farmed.square, limit_s=3e9).run([1]))


def test_a_run_that_is_left_stops_its_workers(cluster: Cluster, tmp_path: Path) -> None:
    cluster.start_worker()
    arriving = DaskPool(cluster.address, farmed.slow_square).run(range(99))
    next(arriving)
    arriving.close()  # type: ignore[attr-defined]
    wait_until(lambda: not list((tmp_path / "machines").rglob("split-*")))
