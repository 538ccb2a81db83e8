"""How grasps in clutter follow the sampler: `python -m split_drake.studies.clutter_study`.

Every sampler meets the same scenes, drawn as those that the model is trained on, of other seeds and
of the procedural training objects: what is chosen here is measured elsewhere.  Grasps are judged by
geometry, as `ClutterJudge` does.  DIR gets study.json; a study that was stopped goes on.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
import torch
import trimesh
from rich.console import Console
from rich.table import Table
from scipy.spatial import cKDTree

from split_drake.bad_input import require_numbers
from split_drake.data.clutter.scenes import ClutterRecipe, ClutterScene, ClutterScenes
from split_drake.data.clutter.sizes import clutter_source
from split_drake.data.clutter.views import merged_mesh
from split_drake.experiments.command import run_command
from split_drake.experiments.pages.render import render
from split_drake.experiments.pages.run_page import RunPage
from split_drake.experiments.pages.study_page import made_with, study_page
from split_drake.experiments.provenance import code_version, file_sha256
from split_drake.experiments.run import claim_folder
from split_drake.files import read_json, write_atomically, write_json
from split_drake.grasps.clutter_judge import ClutterJudge
from split_drake.pose_set import Acceptance, ScoredPoses
from split_drake.pose_task import GRASP
from split_drake.poses import Array, transform_points
from split_drake.scene import Scene
from split_drake.split.checkpoint import load_checkpoint
from split_drake.split.detector import EIGHT_EVALUATIONS, ONE_LOOK, SplitDetector
from split_drake.split.inference.network import InferenceNetwork
from split_drake.station.layout import Layout
from split_drake.studies.sampler_study import SHIPPED, SHORT, Sampler

# What is told of a sampler, see `measured`.
Row = dict[str, Any]

LANGEVIN_EVALUATIONS = (25, 16, 12, 10, 8, 6, 5)
SHORT_EVALUATIONS = (8, 6, 5, 4, 3)
MULTISTEP_EVALUATIONS = (12, 10, 8, 6, 5)
TEMPERATURES = (0.0, 0.5, 1.0)
SURFACE_POINTS = 1000
# The paper's, of the sampled points (section V).
NOISE_M = 0.005
# Keeps these scenes apart from those of training and of tuning.
_STREAM = 2

# Figures that are shares, in the order of tables.
SHARES = ("samples_good", "accepted", "accepted_good", "best_good", "objects")


@dataclass(frozen=True)
class ClutterStudyConfig:
    """A study of samplers in clutter.

    Attributes:
        checkpoint: weights of SPLIT.
        library: file of `split_drake.data.clutter.library`, of the training objects.
        out: folder to write to.
        scenes: that every sampler meets.
        seed: of the scenes and all draws.
        samplers: names of those to measure, such as langevin_016; all where none is named.
    """

    checkpoint: Path
    library: Path
    out: Path
    scenes: int = 100
    seed: int = 0
    samplers: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require_numbers(self)
        if self.scenes < 1:
            raise ValueError(f"--scenes is {self.scenes}; expected 1 or more")
        known = [each.name for each in samplers()]
        for name in self.samplers:
            if name not in known:
                raise ValueError(f"--samplers has {name!r}; expected some of {', '.join(known)}")

    def record(self) -> dict[str, Any]:
        """Return what the figures depend on."""
        return {
            "checkpoint": file_sha256(self.checkpoint),
            "library": file_sha256(self.library),
            "scenes": self.scenes,
            "seed": self.seed,
            **code_version(),
        }


@dataclass(frozen=True)
class StudyScene:
    """A scene with what judges grasps in it.

    Attributes:
        seen: with noise.
        drawn: what lies there.
    """

    seen: Scene
    drawn: ClutterScene

    @cached_property
    def judge(self) -> ClutterJudge:
        mesh_W = merged_mesh(self.drawn.objects, self.drawn.X_WOs)
        return ClutterJudge(mesh_W, self.drawn.scene.workspace.p_WCenter[2])

    def objects_of(self, X_WGs: Array) -> Array:
        """Return (N,) which object each grasp (N, 4, 4) is nearest to, by its surface."""
        surfaces = [
            trimesh.sample.sample_surface(each.body.mesh, SURFACE_POINTS, seed=0)[0]
            for each in self.drawn.objects
        ]
        distances = [
            np.asarray(cKDTree(transform_points(X_WO, points)).query(X_WGs[:, :3, 3])[0])
            for points, X_WO in zip(surfaces, self.drawn.X_WOs, strict=True)
        ]
        return np.argmin(np.stack(distances), axis=0)


def samplers() -> list[Sampler]:
    """Return the samplers that are compared."""
    return [
        *(Sampler("langevin", count) for count in LANGEVIN_EVALUATIONS),
        *(Sampler(SHORT, count, SHIPPED.temperature) for count in SHORT_EVALUATIONS),
        *(Sampler("multistep", count) for count in MULTISTEP_EVALUATIONS),
        *(Sampler("langevin", 16, temperature) for temperature in TEMPERATURES),
    ]


def drawn_scenes(config: ClutterStudyConfig, layout: Layout) -> list[StudyScene]:
    """Return the scenes of a study."""
    recipe = ClutterRecipe(clutter_source("train"), config.library, layout, seed=config.seed)
    rng = np.random.default_rng([config.seed, 0, _STREAM])
    drawn = ClutterScenes(recipe, rng).draw_all()
    scenes = (next(drawn) for _ in range(config.scenes))
    return [StudyScene(each.scene.with_noise(NOISE_M, rng), each) for each in scenes]


def figures(scene: StudyScene, sampled: ScoredPoses, acceptance: Acceptance) -> dict[str, float]:
    """Return what samples of one scene are worth.

    samples_good: share of all samples that hold; accepted: share that is accepted; accepted_good:
    share of these that holds; best_good: whether the best of them holds; objects: share of the
    scene's objects with a sample that is accepted and holds.
    """
    good = scene.judge.check(sampled.X_WPs).good
    accepted = acceptance.accepted(sampled.scores)
    reached = scene.objects_of(sampled.X_WPs[good & accepted]) if (good & accepted).any() else ()
    best = int(np.argmax(sampled.scores))
    return {
        "samples_good": float(good.mean()),
        "accepted": float(accepted.mean()),
        "accepted_good": float(good[accepted].mean()) if accepted.any() else float("nan"),
        "best_good": float(good[best]) if accepted.any() else float("nan"),
        "objects": len(set(reached)) / len(scene.drawn.objects),
    }


def measured(detector: SplitDetector, scenes: Sequence[StudyScene]) -> Row:
    """Return the means of `figures` over scenes, where they are defined, and seconds a scene."""
    found, seconds = [], []
    for number, scene in enumerate(scenes):
        began = perf_counter()
        sampled = detector.sample(scene.seen, (GRASP,), np.random.default_rng(number))
        seconds.append(perf_counter() - began)
        found.append(figures(scene, sampled[GRASP.name], detector.acceptance))
    means = {name: float(np.nanmean([each[name] for each in found])) for name in found[0]}
    return {**means, "sample_s": median(seconds)}


def missing(rows: Sequence[Row], names: Sequence[str] = ()) -> Iterator[Sampler]:
    """Yield the samplers of these names, of all where there are none, that have no row yet."""
    known = [(row["integrator"], row["evaluations"], row["temperature"]) for row in rows]
    for sampler in samplers():
        wanted = not names or sampler.name in names
        measured_as = (sampler.integrator, sampler.evaluations, sampler.temperature)
        if wanted and measured_as not in known:
            yield sampler


def table_of(rows: Sequence[Row]) -> Table:
    """Return a line a sampler."""
    titles = [name.replace("_", " ") for name in SHARES]
    table = Table("integrator", "evaluations", "temperature", *titles, "ms")
    for row in rows:
        sampler = (row["integrator"], str(row["evaluations"]), f"{row['temperature']:g}")
        values = [f"{row[name]:.1%}" for name in SHARES]
        table.add_row(*sampler, *values, f"{1e3 * row['sample_s']:.0f}")
    return table


def page_of(rows: Sequence[Row], config: ClutterStudyConfig) -> RunPage:
    """Return the study's page."""
    shown = [
        {
            "integrator": row["integrator"],
            "evaluations": row["evaluations"],
            "temperature": row["temperature"],
            **{f"{name.replace('_', ' ')}, %": round(100.0 * row[name], 1) for name in SHARES},
            "ms": round(1e3 * row["sample_s"]),
        }
        for row in rows
    ]
    facts = {"scenes": config.scenes, "seed": config.seed}
    settings = ("integrator", "evaluations", "temperature")
    return study_page(
        "samplers on clutter", shown, settings, {**facts, **made_with()}, records=rows
    )


def main(config: ClutterStudyConfig) -> None:
    """Measure the samplers that are missing; the file is written after each of them."""
    console, path = Console(soft_wrap=True), config.out / "study.json"
    torch.set_num_threads(1)
    network, info = load_checkpoint(config.checkpoint)
    ready = InferenceNetwork(network.eval())
    with claim_folder(config.out, config.record()):
        rows: list[Row] = read_json(path, "the rows of a study") if path.exists() else []
        scenes = drawn_scenes(config, Layout(workspace=info.workspace))
        for sampler in missing(rows, config.samplers):
            # Samplers are compared, not second looks; images are without noise here.
            shipped = ONE_LOOK if sampler.integrator == SHORT else EIGHT_EVALUATIONS
            detector = SplitDetector(ready, info.workspace, shipped, integrator=sampler.build())
            rows.append({**asdict(sampler), **measured(detector, scenes)})
            write_json(path, rows)
            console.print(table_of(rows[-1:]))
        write_atomically(config.out / "index.html", render(page_of(rows, config)))
        console.print(table_of(rows))


if __name__ == "__main__":
    run_command(main, ClutterStudyConfig, __doc__)
