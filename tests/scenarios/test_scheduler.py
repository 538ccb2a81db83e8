"""Commands whose work is done by a Dask scheduler's workers."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import trimesh

from scenarios import clutter_removal, mug_hang, planner_bench
from scenarios.clutter_removal import ClutterOptions
from scenarios.mug_hang import MugHangOptions
from scenarios.planner_bench import BenchOptions
from split_drake.bad_input import BadInputError
from split_drake.data import generate
from split_drake.data.randomization import DomainRandomization
from split_drake.grasps import check_grasps
from tests.helpers.cluster import Cluster


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    cluster = Cluster(tmp_path_factory.mktemp("machines"))
    cluster.start_scheduler()
    cluster.start_worker()
    yield cluster
    cluster.end()


def lines_of(path: Path) -> list[dict[str, object]]:
    """Return the records of a log, without what is measured by the clock."""
    found = [json.loads(line) for line in path.read_text().splitlines()]
    for fields in found:
        for name in ("seconds", "memory_bytes", "planning_s", "planning_cpu_s", "wall_s"):
            fields.pop(name, None)
        _without_times(fields)
    return sorted(found, key=lambda fields: json.dumps(fields, sort_keys=True))


def _without_times(value: object) -> None:
    if isinstance(value, dict):
        for name in [name for name in value if name.endswith("planning_s") or name == "seconds"]:
            del value[name]
        for part in value.values():
            _without_times(part)
    elif isinstance(value, list):
        for part in value:
            _without_times(part)


def test_rounds_of_ones_own_objects_are_those_of_this_machine(
    cluster: Cluster, tmp_path: Path
) -> None:
    objects = tmp_path / "objects"
    objects.mkdir()
    for number, height in enumerate((0.06, 0.09, 0.12)):
        trimesh.creation.box((0.04, 0.05, height)).export(objects / f"box_{number}.obj")
    asked = ClutterOptions(
        "packed", 1, 1, 3, "oracle", objects=str(objects), noise="none", record="all", workers=1
    )
    here, there = tmp_path / "here", tmp_path / "there"
    clutter_removal.main(replace(asked, out=here))
    clutter_removal.main(replace(asked, out=there, scheduler=cluster.address))
    assert lines_of(here / "rounds.jsonl") == lines_of(there / "rounds.jsonl")
    written = sorted(path.name for path in (there / "recordings").iterdir())
    assert written == sorted(path.name for path in (here / "recordings").iterdir())


def test_trials_are_those_of_this_machine(cluster: Cluster, tmp_path: Path) -> None:
    asked = MugHangOptions(trials=1, seed=2, detector="oracle", record="all", workers=1)
    here, there = tmp_path / "here", tmp_path / "there"
    mug_hang.main(replace(asked, out=here))
    mug_hang.main(replace(asked, out=there, scheduler=cluster.address))
    assert lines_of(here / "trials.jsonl") == lines_of(there / "trials.jsonl")
    assert (there / "recordings").is_dir()


def test_benches_are_those_of_this_machine(cluster: Cluster, tmp_path: Path) -> None:
    asked = BenchOptions(limit=1)
    here, there = tmp_path / "here", tmp_path / "there"
    planner_bench.main(replace(asked, out=here))
    planner_bench.main(replace(asked, out=there, scheduler=cluster.address))
    outcomes = [
        sorted((each["problem"], each["outcome"]) for each in lines_of(out / "results.jsonl"))
        for out in (here, there)
    ]
    assert outcomes[0] == outcomes[1]


def test_grasps_of_ones_own_mugs_are_those_of_this_machine(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = ("train_003",)
    monkeypatch.setattr(check_grasps.MugSource, "names", lambda source: names)
    found = []
    for scheduler in ("local", cluster.address):
        out = tmp_path / scheduler.partition(":")[0]
        config = check_grasps.CheckConfig("train", 2, out, workers=1, scheduler=scheduler)
        store = tmp_path / f"{out.name}.npz"
        monkeypatch.setattr(check_grasps, "store_path", lambda mugs, store=store: store)
        check_grasps.check_split(config, check_grasps.StationConfig(check_grasps.Layout()))
        found.append(store.read_bytes())
    assert found[0] == found[1]


def test_scenes_are_those_of_this_machine(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(generate.MugSource, "names", lambda source: ("train_003",))
    made = []
    for scheduler in ("local", cluster.address):
        out = tmp_path / scheduler.partition(":")[0]
        generate.main(
            generate.GenerateConfig(
                out, "train", 2, randomization=DomainRandomization(), workers=1, scheduler=scheduler
            )
        )
        made.append((out / "train_003.npz").read_bytes())
    assert made[0] == made[1]


@pytest.mark.parametrize(
    "asked",
    [MugHangOptions(scheduler="nowhere"), MugHangOptions(scheduler="http://head:80")],
)
def test_what_is_no_scheduler_is_refused_before_anything_is_run(
    asked: MugHangOptions, tmp_path: Path
) -> None:
    with pytest.raises(BadInputError, match="expected local, an address such as tcp"):
        mug_hang.main(replace(asked, out=tmp_path / "run"))
    assert not (tmp_path / "run").exists()
