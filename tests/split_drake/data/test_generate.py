"""Scene generation: contents of a shard, resuming, determinism, and reading back."""

import json
import pickle
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh

from split_drake.data import scene_generator
from split_drake.data.dataset import (
    CELLS,
    LABEL_ARRAYS,
    MANIFEST,
    SCENE_ARRAYS,
    DatasetError,
    SceneDataset,
    decode_points,
    encode_points,
    read_shard,
    write_shard,
)
from split_drake.data.generate import (
    DatasetRecipe,
    GenerateConfig,
    generate,
    generate_shard,
    geometric_labels,
)
from split_drake.data.grasp_candidates import GraspCandidates
from split_drake.data.labels import FixedPoses, PoseLabels, PoseState
from split_drake.data.object_scenes import NO_FEATURE
from split_drake.data.randomization import DomainRandomization
from split_drake.data.rests import Rests, load_rests
from split_drake.experiments.run import AnotherRunError
from split_drake.files import UnreadableFileError
from split_drake.grasps.store import load_checked_grasps
from split_drake.objects.mugs.split import load_mug
from split_drake.objects.rigid import Primitive, RigidObject
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.objects.task_object import TaskObject
from split_drake.pose_task import (
    GRASP,
    HANDLE,
    MUG_TASKS,
    UPRIGHT,
    PoseTask,
    Symmetry,
    UnknownTaskError,
)
from split_drake.poses import check_poses, make_pose
from split_drake.scene import Workspace
from split_drake.station.config import StationConfig
from split_drake.station.file.station_file import read_station
from split_drake.station.layout import Layout, same_fixtures
from split_drake.station.layout_file import layout_to_fields
from tests.helpers.data import make_checked, make_rests

HIGH_TABLE = Path("models/stations/high_table.yaml")
NAMES = ("test_002", "test_007")
SCENES = 4
# The second mug has fewer grasps.
GRASPS = dict(zip(NAMES, (60, 40), strict=True))


@dataclass(frozen=True)
class TwoMugs:
    """Two mugs of the fixed split."""

    def names(self) -> tuple[str, ...]:
        return NAMES

    def load(self, name: str) -> TaskObject:
        return load_mug(name)

    def sha256(self) -> str:
        return "two mugs"


def labels_by_hand(
    counts: dict[str, int], subject: TaskObject, task: PoseTask, rng: np.random.Generator
) -> PoseLabels:
    """Return a mug's labels without physics, from so many grasps of each."""
    if task == GRASP:
        checked = make_checked(subject, counts[subject.name])
        return GraspCandidates.from_checked(subject, checked, rng)
    return FixedPoses(subject.poses_of(task))


RECIPE = DatasetRecipe(
    source=TwoMugs(),
    tasks=MUG_TASKS,
    layout=Layout(),
    make_rests=make_rests,
    make_labels=partial(labels_by_hand, GRASPS),
    scenes_per_object=SCENES,
    made_from={"grasps": "by hand"},
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("dataset")
    generate(RECIPE, path, workers=1)
    return path


@pytest.fixture(scope="module")
def dataset(folder: Path) -> SceneDataset:
    return SceneDataset.open(folder)


def test_dataset_has_all_scenes(dataset: SceneDataset) -> None:
    scenes, grasps = SCENES * len(NAMES), dataset.labels["grasp"]
    candidates = grasps.X_OPs.shape[1]
    assert len(dataset) == scenes
    assert dataset.shard_names == NAMES
    assert dataset.object_index.tolist() == [0] * SCENES + [1] * SCENES
    expected = {
        "clouds": ((scenes, 2000, 3), np.float32),
        "X_WOs": ((scenes, 4, 4), np.float32),
        "feature_points": ((scenes,), np.int32),
        "views": ((scenes,), np.uint8),
    }
    arrays = {name: getattr(dataset, name) for name in expected}
    assert {name: (array.shape, array.dtype) for name, array in arrays.items()} == expected
    for task, count in (("grasp", candidates), ("handle", 1), ("upright", 1)):
        labels = dataset.labels[task]
        assert (labels.X_OPs.shape, labels.X_OPs.dtype) == ((2, count, 4, 4), np.float32)
        assert (labels.weights.shape, labels.weights.dtype) == ((2, count), np.float32)
        assert (labels.states.shape, labels.states.dtype) == ((scenes, count), np.uint8)
        check_poses(labels.X_OPs, task)
    check_poses(dataset.X_WOs, "X_WOs")


def test_dataset_says_whose_poses_are_labelled_and_where(dataset: SceneDataset) -> None:
    assert dataset.tasks == MUG_TASKS
    assert list(dataset.labels) == [task.name for task in MUG_TASKS]
    assert dataset.workspace == RECIPE.layout.workspace


def test_candidates_of_mugs_with_fewer_are_padded(dataset: SceneDataset) -> None:
    grasps, second = dataset.labels["grasp"], dataset.object_index == 1
    padded = grasps.states[second] == PoseState.PADDING
    assert padded.any()
    assert (padded == padded[0]).all()
    assert np.array_equal(grasps.X_OPs[1][padded[0]][0], np.eye(4))
    assert not grasps.weights[1][padded[0]].any()
    assert not (grasps.states[~second] == PoseState.PADDING).any()
    weights = grasps.weights[dataset.object_index]
    true = grasps.states == PoseState.TRUE
    assert (true.sum(axis=1) >= 8).all()
    assert (weights[true] > 0.0).all()
    assert weights.max() <= 1.0
    assert (grasps.states == PoseState.FALSE).any(axis=1).all()


def test_clouds_lie_on_the_mug_where_it_stands(dataset: SceneDataset) -> None:
    for index, X_WO, cloud in zip(dataset.object_index, dataset.X_WOs, dataset.clouds, strict=True):
        mug = load_mug(NAMES[index])
        p_OPs = (cloud - X_WO[:3, 3]) @ X_WO[:3, :3]
        lower, upper = mug.body.mesh.bounds
        near = np.all((p_OPs > lower - 0.01) & (p_OPs < upper + 0.01), axis=1)
        assert near.mean() > 0.15  # Where the table sticks out, it takes most of the points.
    assert np.median([np.ptp(cloud, axis=0).max() for cloud in dataset.clouds]) < 0.2


@pytest.mark.parametrize("task", [HANDLE, UPRIGHT], ids=str)
def test_handles_and_uprights_follow_from_the_pose(dataset: SceneDataset, task: PoseTask) -> None:
    labels = dataset.labels[task.name]
    assert (labels.states == PoseState.TRUE).all()
    assert (labels.weights == 1.0).all()
    for scene in (0, SCENES):
        index = dataset.object_index[scene]
        X_WO = dataset.X_WOs[scene].astype(float)
        X_WPs = X_WO @ labels.X_OPs[index]
        true = load_mug(NAMES[index]).true_poses(task, X_WO)
        # Of poses that mean the same the first is kept.
        assert np.allclose(X_WPs, true[: len(X_WPs)], atol=1e-6)


def test_points_are_kept_to_a_few_micrometres() -> None:
    workspace = Workspace()
    p_WPs = workspace.p_WV + np.random.default_rng(0).uniform(0.0, workspace.edge_m, (500, 3))
    p_WPs[0] = workspace.p_WV
    p_WPs[1] = workspace.p_WV + workspace.edge_m * (1.0 - 1e-12)
    decoded = decode_points(encode_points(p_WPs, workspace), workspace)
    assert decoded.dtype == np.float32
    assert np.abs(decoded - p_WPs).max() <= workspace.edge_m / CELLS / 2.0 + 1e-7
    with pytest.raises(ValueError, match="outside the workspace"):
        encode_points(p_WPs + 0.01, workspace)


def test_shards_are_small(folder: Path) -> None:
    path = folder / f"{NAMES[0]}.npz"
    shard = read_shard(path, MUG_TASKS)
    each_scene = ("points", "X_WOs", "feature_points", "views", *(f"{t}/states" for t in MUG_TASKS))
    assert sum(shard[name].nbytes for name in each_scene) / SCENES < 16_000
    expected = {*SCENE_ARRAYS, *(f"{task}/{array}" for task in MUG_TASKS for array in LABEL_ARRAYS)}
    with np.load(path) as archive:
        assert set(archive.files) == set(shard) == expected


def test_the_manifest_says_what_the_scenes_are_like(folder: Path, dataset: SceneDataset) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    assert manifest["scenes"] == len(dataset)
    assert manifest["single_view_share"] == pytest.approx((dataset.views == 1).mean())
    hidden = (dataset.feature_points < 30).mean()
    assert manifest["hidden_feature_share"] == pytest.approx(hidden)
    true = (dataset.labels["grasp"].states == PoseState.TRUE).sum(axis=1)
    expected = {"grasp": np.median(true), "handle": 1.0, "upright": 1.0}
    assert manifest["median_true_poses"] == expected
    shards = [read_shard(folder / f"{name}.npz", MUG_TASKS) for name in NAMES]
    assert manifest["redraws"] == sum(int(shard["redraws"]) for shard in shards)
    assert manifest["config"]["made_from"] == {"grasps": "by hand"}
    assert manifest["config"]["tasks"] == [asdict(task) for task in MUG_TASKS]


def test_finished_shards_are_kept_and_missing_ones_come_out_the_same(
    folder: Path, dataset: SceneDataset
) -> None:
    kept, lost = (folder / f"{name}.npz" for name in NAMES)
    before = kept.stat().st_mtime_ns
    lost.unlink()
    (folder / MANIFEST).unlink()
    generate(RECIPE, folder, workers=1)
    assert kept.stat().st_mtime_ns == before
    assert SceneDataset.open(folder).dataset_hash == dataset.dataset_hash


def test_a_shard_depends_on_seed_and_mug_only(folder: Path, tmp_path: Path) -> None:
    one_scene = replace(RECIPE, scenes_per_object=1)
    generate_shard(one_scene, tmp_path, NAMES[1])
    generate_shard(replace(one_scene, seed=1), tmp_path, NAMES[0])
    full, one, seed_0, seed_1 = (
        read_shard(path / f"{name}.npz", MUG_TASKS)
        for name in NAMES[::-1]
        for path in (folder, tmp_path)
    )
    assert np.array_equal(full["points"][:1], one["points"])
    assert np.array_equal(full["grasp/X_OPs"], one["grasp/X_OPs"])
    assert not np.array_equal(seed_0["X_WOs"][:1], seed_1["X_WOs"])


def test_scenes_with_too_few_true_grasps_are_drawn_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Of the few that hold, a scene seldom shows eight.
    few = replace(RECIPE, make_labels=partial(labels_by_hand, {NAMES[0]: 16, NAMES[1]: 3}))
    generate_shard(few, tmp_path, NAMES[0])
    shard = read_shard(tmp_path / f"{NAMES[0]}.npz", MUG_TASKS)
    assert shard["redraws"] > 0
    assert ((shard["grasp/states"] == PoseState.TRUE).sum(axis=1) >= 8).all()
    monkeypatch.setattr(scene_generator, "MAX_REDRAWS", 20)
    with pytest.raises(
        DatasetError, match=r"none of 20 scenes of test_007 leaves 8 of its \d grasp poses true"
    ):
        generate_shard(few, tmp_path, NAMES[1])
    assert [path.name for path in tmp_path.iterdir()] == [f"{NAMES[0]}.npz"]


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (replace(RECIPE, seed=5), "seed was 0, is 5"),
        (
            replace(RECIPE, randomization=DomainRandomization(table_height_m=0.1)),
            "randomization was",
        ),
        (
            replace(RECIPE, made_from={"grasps": "new"}),
            "made_from was {'grasps': 'by hand'}, is {'grasps': 'new'}",
        ),
        (replace(RECIPE, tasks=MUG_TASKS[:2]), "tasks was"),
    ],
    ids=["seed", "randomization", "sources", "tasks"],
)
def test_another_recipe_is_refused(folder: Path, other: DatasetRecipe, message: str) -> None:
    with pytest.raises(AnotherRunError, match=f"holds another run.*{message}"):
        generate(other, folder, workers=1)


def test_workers_do_not_change_a_byte(folder: Path, tmp_path: Path) -> None:
    generate(RECIPE, tmp_path, workers=2)
    for name in (*(f"{name}.npz" for name in NAMES), MANIFEST):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_impossible_options_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="scenes_per_mug is 0; expected at least 1"):
        GenerateConfig(tmp_path, scenes_per_mug=0)


def test_the_command_s_mugs_have_the_rests_and_grasps_that_ship(tmp_path: Path) -> None:
    config = GenerateConfig(tmp_path, "test", scenes_per_mug=3, seed=7)
    recipe = pickle.loads(pickle.dumps(config.recipe()))
    assert recipe.source == MugSource("test")
    assert (recipe.tasks, recipe.scenes_per_object, recipe.seed) == (MUG_TASKS, 3, 7)
    assert set(recipe.made_from) == {"mugs", "grasps", "rests"}
    mug, rng = load_mug(NAMES[0]), np.random.default_rng(0)
    shipped = load_rests("test", NAMES[0])
    assert np.array_equal(recipe.make_rests(mug, Layout()).X_TOs, shipped.X_TOs)
    checked = load_checked_grasps("test", NAMES[0])
    grasps, handles = (recipe.make_labels(mug, task, rng) for task in (GRASP, HANDLE))
    assert np.array_equal(grasps.X_OPs[: len(checked)], checked.X_OGs)
    assert np.array_equal(handles.X_OPs, mug.X_OH[None])


# Which way a cylinder's top points; how it is turned about its axis says nothing.
AXIS = PoseTask("axis", Symmetry.any_turn("z"), "a cylinder: origin in its middle, z along it")


def cylinder() -> TaskObject:
    """Return a cylinder that fits between the pads, which is no mug."""
    radius_m, height_m, mass_kg = 0.02, 0.1, 0.2
    mesh = trimesh.creation.cylinder(radius=radius_m, height=height_m)
    body = RigidObject(
        name="cylinder",
        mesh=mesh,
        mass_kg=mass_kg,
        p_OCom=np.zeros(3),
        inertia_kg_m2=mesh.moment_inertia * mass_kg / mesh.volume,
        collision=(Primitive("cylinder", (radius_m, height_m), np.eye(4)),),
    )
    return TaskObject(body=body, X_OPs={AXIS: make_pose()[None]})


@dataclass(frozen=True)
class OneCylinder:
    """A cylinder alone."""

    def names(self) -> tuple[str, ...]:
        return ("cylinder",)

    def load(self, name: str) -> TaskObject:
        return cylinder()

    def sha256(self) -> str:
        return "one cylinder"


def test_an_object_with_a_task_of_its_own_has_scenes_too(tmp_path: Path) -> None:
    tasks = (GRASP, AXIS)
    recipe = DatasetRecipe(OneCylinder(), tasks, Layout(), make_rests, scenes_per_object=2)
    generate(recipe, tmp_path, workers=1)
    dataset = SceneDataset.open(tmp_path)
    assert dataset.tasks == tasks
    assert dataset.shard_names == ("cylinder",)
    assert dataset.feature_points.tolist() == [NO_FEATURE] * 2
    assert json.loads((tmp_path / MANIFEST).read_text())["hidden_feature_share"] == 0.0
    assert np.array_equal(dataset.labels["axis"].X_OPs[0, 0], np.eye(4))
    assert ((dataset.labels["grasp"].states == PoseState.TRUE).sum(axis=1) >= 8).all()


def test_tasks_that_an_object_has_no_poses_of_are_named() -> None:
    with pytest.raises(UnknownTaskError, match=r"cylinder has no poses of .*it has those of axis"):
        geometric_labels(cylinder(), HANDLE, np.random.default_rng(0))


def test_damaged_datasets_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=f"has no {MANIFEST}"):
        SceneDataset.open(tmp_path)
    manifest = json.loads((folder / MANIFEST).read_text())
    (tmp_path / MANIFEST).write_text(json.dumps(manifest | {"format_version": 1}))
    with pytest.raises(DatasetError, match="is of format 1; expected 3"):
        SceneDataset.open(tmp_path)
    (tmp_path / MANIFEST).write_text(json.dumps(manifest))
    with pytest.raises(DatasetError, match=r"test_00\d\.npz is missing"):
        SceneDataset.open(tmp_path)
    for name in NAMES:
        (tmp_path / f"{name}.npz").write_bytes((folder / f"{name}.npz").read_bytes()[:-1000])
    with pytest.raises(DatasetError, match="has changed: SHA-256"):
        SceneDataset.open(tmp_path)
    with pytest.raises(UnreadableFileError, match=r"test_00\d\.npz is damaged or not a shard"):
        SceneDataset.open(tmp_path, verify=False)
    for content in ("{", json.dumps({"format_version": 3}), json.dumps(manifest | {"config": {}})):
        (tmp_path / MANIFEST).write_text(content)
        with pytest.raises(UnreadableFileError, match=f"^{tmp_path / MANIFEST} is damaged or not"):
            SceneDataset.open(tmp_path)


def test_a_shard_lacks_no_array(folder: Path, tmp_path: Path) -> None:
    shard = read_shard(folder / f"{NAMES[0]}.npz", MUG_TASKS)
    del shard["grasp/states"]
    write_shard(tmp_path / "s.npz", shard)
    with pytest.raises(UnreadableFileError, match=r"s\.npz holds .*, but no 'grasp/states'"):
        read_shard(tmp_path / "s.npz", MUG_TASKS)


def test_a_dataset_says_where_table_hook_and_cameras_stand(tmp_path: Path) -> None:
    layout = replace(Layout(), X_WK=make_pose(p=(0.4, -0.3, 0.5)), p_WTable=(0.6, 0.01))
    asked: list[Layout] = []

    def rests(subject: TaskObject, on: Layout) -> Rests:
        asked.append(on)
        return make_rests(subject)

    recipe = DatasetRecipe(OneCylinder(), (AXIS,), layout, rests, scenes_per_object=1)
    generate(recipe, tmp_path, workers=1)
    read = SceneDataset.open(tmp_path).layout
    assert same_fixtures(read, layout)
    assert read.workspace == layout.workspace
    for camera, expected in zip(read.cameras, layout.cameras, strict=True):
        assert (camera.name, camera.intrinsics) == (expected.name, expected.intrinsics)
        assert np.array_equal(camera.X_WC, expected.X_WC)
    assert asked == [layout]


def test_scenes_of_other_functions_are_not_mixed(tmp_path: Path) -> None:
    def other_rests(subject: TaskObject, layout: Layout) -> Rests:
        return make_rests(subject, layout)

    recipe = DatasetRecipe(OneCylinder(), (AXIS,), Layout(), make_rests, scenes_per_object=1)
    generate(recipe, tmp_path, workers=1)
    with pytest.raises(AnotherRunError, match="make_rests"):
        generate(replace(recipe, make_rests=other_rests), tmp_path, workers=1)


def test_scenes_are_seen_by_the_cameras_of_a_station_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = GenerateConfig(tmp_path, "test", scenes_per_mug=4, station=HIGH_TABLE)
    recipe = config.recipe()
    layout = read_station(HIGH_TABLE, StationConfig(Layout())).layout
    assert layout_to_fields(recipe.layout) == layout_to_fields(layout)
    assert recipe.config() != GenerateConfig(tmp_path, "test", scenes_per_mug=4).recipe().config()
    assert not capsys.readouterr().out
    generate_shard(recipe, tmp_path, NAMES[0])
    shard = read_shard(tmp_path / f"{NAMES[0]}.npz", MUG_TASKS)
    table_z_m, workspace = layout.table_z_m, layout.workspace
    assert table_z_m == 0.1
    assert np.all(np.abs(shard["X_WOs"][:, :2, 3] - workspace.p_WCenter[:2]) < 0.15)
    p_WOs = shard["X_WOs"][:, 2, 3]
    assert np.all((p_WOs > table_z_m - 0.02) & (p_WOs < table_z_m + 0.1))


def test_what_a_station_file_says_in_vain_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "station.yaml"
    file.write_text("depth_noise: middle\n")
    layout = GenerateConfig(tmp_path, "test", station=file).layout()
    assert layout_to_fields(layout) == layout_to_fields(Layout())
    assert "depth noise do not change a dataset" in " ".join(capsys.readouterr().out.split())
