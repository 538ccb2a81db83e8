"""Fuzzed files of models and motions: meshes, weights, motion problems."""

from functools import cache
from pathlib import Path

import numpy as np
import torch
import trimesh
import yaml

from scenarios.bench.motions.robometrics_file import read_motion_problems
from split_drake.baselines.vgn.network import VgnNetwork
from split_drake.baselines.weights import BaselineInfo, load_weights, save_weights
from split_drake.objects.meshes.mesh_file import read_mesh
from split_drake.split.checkpoint import load_checkpoint
from tests.fuzz.mutations import damaged, mutated, pick
from tests.fuzz.targets import Rng, Target, require, require_pose
from tests.helpers.checkpoints import save_new_network

MOTIONS = """
shelf:
- start: [0.0, -0.9, 0.0, -2.5, 0.0, 1.6, 0.785]
  goal_pose: {frame: panda_hand, position_xyz: [0.5, 0.1, 0.4], quaternion_wxyz: [0, 1, 0, 0]}
  goal_ik: [[0.1, -0.8, 0.0, -2.4, 0.0, 1.6, 0.785]]
  obstacles:
    cuboid: {board: {dims: [0.4, 0.8, 0.02], pose: [0.6, 0.0, 0.2, 1, 0, 0, 0]}}
    cylinder: {can: {radius: 0.03, height: 0.1, pose: [0.6, 0.1, 0.27, 1, 0, 0, 0]}}
"""


def motion_file(folder: Path, rng: Rng) -> None:
    file = folder / "motions.yaml"
    if rng.random() < 0.7:
        file.write_text(yaml.safe_dump(mutated(yaml.safe_load(MOTIONS), rng)))
    else:
        file.write_bytes(damaged(MOTIONS.encode(), rng))
    for problem in read_motion_problems(file).values():
        require_pose(problem.X_WGoal, "the goal")
        require(np.isfinite(problem.q_start), "the start is not finite")
        require(np.isfinite(problem.q_goals), "a goal is not finite")
        for solid in (*problem.solids.values(), *problem.held.values()):
            require_pose(solid.X_OP, "a solid's pose")
            require(np.array(solid.size) > 0.0, "a solid has no size")


@cache
def _mesh(suffix: str) -> bytes:
    mesh = trimesh.creation.annulus(0.03, 0.035, 0.08, sections=12)
    content = mesh.export(file_type=suffix[1:])
    return content.encode() if isinstance(content, str) else content


def mesh_file(folder: Path, rng: Rng) -> None:
    suffix = pick(rng, (".stl", ".obj", ".ply", ".glb", ".off"))
    file = folder / f"mesh{suffix}"
    file.write_bytes(damaged(_mesh(suffix), rng))
    mesh = read_mesh(file)
    require(np.isfinite(mesh.vertices), "a vertex is not finite")
    require(mesh.extents > 0.0, "the mesh is flat")
    require(mesh.faces < len(mesh.vertices), "a face has no vertex")


@cache
def _weights(folder: Path) -> bytes:
    save_new_network(folder / "good.safetensors")
    return (folder / "good.safetensors").read_bytes()


def weights_file(folder: Path, rng: Rng) -> None:
    file = folder / "weights.safetensors"
    file.write_bytes(damaged(_weights(folder), rng))
    network, info = load_checkpoint(file)
    require(len(info.tasks) > 0, "no task is known")
    for parameter in network.parameters():
        require(bool(torch.isfinite(parameter).all()), "a weight is not finite")


@cache
def _baseline_weights(folder: Path) -> bytes:
    info = BaselineInfo("vgn", "abc", "abc", 0, 1.0, 100, 1.0, 0.5)
    save_weights(folder / "good.safetensors", VgnNetwork().state_dict(), info)
    return (folder / "good.safetensors").read_bytes()


def baseline_weights_file(folder: Path, rng: Rng) -> None:
    file, whole = folder / "weights.safetensors", _baseline_weights(folder)
    file.write_bytes(damaged(whole, rng))
    load_weights(VgnNetwork(), "vgn", file)
    require(file.read_bytes() == whole, "damaged weights were loaded")


MODEL_TARGETS = tuple(
    Target(run.__name__, run)
    for run in (motion_file, mesh_file, weights_file, baseline_weights_file)
)
