"""Planners that differ in their motions alone: each solves easy problems; what GCS refuses."""

import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from pydrake.common import RandomGenerator
from pydrake.geometry.optimization import HPolyhedron

import tests.helpers.one_bend  # noqa: F401  (registers "one-bend")
from planning.checking.trajectory_check import TrajectoryChecker
from planning.collision.world import CollisionWorld, Situation
from planning.geometry.perceived import voxel_centroids
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.motion.free import MotionQuery, NoMotion
from planning.motion.gcs import GcsMotion
from planning.motion.regions import Regions, grow_regions, load_regions, save_regions
from planning.planner import make_planner, planner_names
from planning.problem import Plan
from split_drake.files import UnreadableFileError, read_npz
from split_drake.poses import Array, make_pose, transform_points
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.posture import Q_HOME
from split_drake.station.layout import Layout
from tests.helpers.damage import times_told
from tests.helpers.planning import LYING, STANDING, configuration, mug_cloud, mug_problem

LEFT, RIGHT = (0.5, -0.12, 0.25), (0.5, 0.12, 0.25)
CASES = {"hang": (HANG, STANDING), "reorient": (REORIENT, LYING)}


@cache
def world() -> CollisionWorld:
    return CollisionWorld(Layout())


@cache
def gcs() -> GcsMotion:
    return GcsMotion(load_regions())


def boxed(*centers: Array, half_rad: float = 0.5) -> tuple[HPolyhedron, ...]:
    return tuple(HPolyhedron.MakeBox(q - half_rad, q + half_rad) for q in centers)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("name", ["default", "rrt", "gcs", "one-bend"])
def test_every_planner_solves_an_easy_problem(name: str, case: str) -> None:
    subgoal, X_WO = CASES[case]
    plan = make_planner(name).plan(mug_problem(subgoal, X_WO), np.random.default_rng(0))
    assert isinstance(plan, Plan), plan
    points = voxel_centroids(transform_points(X_WO, mug_cloud()), 0.010)
    assert TrajectoryChecker(Layout()).violations(plan, points) == []


def test_planners_are_registered() -> None:
    assert {"default", "rrt", "gcs"} <= set(planner_names())


def test_gcs_joins_its_ends_smoothly_and_draws_nothing() -> None:
    ends = configuration(LEFT), configuration(RIGHT)
    query = MotionQuery(world(), *ends, Situation(0.08))
    first, second = (gcs()(query, np.random.default_rng(seed)) for seed in (0, 1))
    assert isinstance(first, np.ndarray), first
    assert isinstance(second, np.ndarray), second
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(first[[0, -1]], ends)


def test_a_gcs_path_through_the_object_is_refused() -> None:
    ends = configuration(LEFT), configuration(RIGHT)
    path = gcs().path(*ends)
    assert isinstance(path, np.ndarray)
    assert world().path_free(path, Situation(0.08))
    p_GPalm = np.array([[0.0, 0.0, -0.08]])
    half_way = transform_points(gripper_pose(path[len(path) // 2]), p_GPalm)
    in_the_way = Situation(0.08, p_WStanding=half_way)
    refused = gcs()(MotionQuery(world(), *ends, in_the_way), np.random.default_rng(0))
    assert refused == NoMotion("the GCS path collides")


def test_regions_of_another_station_are_refused() -> None:
    regions = load_regions()
    raised = replace(regions.layout, X_WK=regions.layout.X_WK @ make_pose(p=(0.0, 0.0, 0.02)))
    motion = GcsMotion(replace(regions, layout=raised))
    answer = motion(MotionQuery(world(), Q_HOME, Q_HOME, Situation(0.08)), np.random.default_rng(0))
    assert isinstance(answer, NoMotion)
    assert "another station" in answer.reason


def test_ends_that_no_chain_joins_are_refused() -> None:
    apart = Regions(Layout(), boxed(np.zeros(7), np.full(7, 2.0)), ())
    motion = GcsMotion(apart)
    assert motion.path(np.zeros(7), np.full(7, 2.0)) == NoMotion("no chain of GCS regions")
    far = motion.path(np.zeros(7), np.full(7, 9.0))
    assert far == NoMotion("an end is far from all GCS regions")


def test_an_end_beside_the_regions_is_reached_by_a_ramp() -> None:
    motion = GcsMotion(Regions(Layout(), boxed(np.zeros(7)), ()))
    q_goal = np.array([0.8, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    path = motion.path(np.zeros(7), q_goal)
    assert isinstance(path, np.ndarray)
    np.testing.assert_array_equal(path[[0, -1]], [np.zeros(7), q_goal])
    assert np.abs(path[1:-1]).max() <= 0.5 + 1e-6


def test_grown_regions_hold_their_seed_and_are_nearly_free(tmp_path: Path) -> None:
    qs = np.stack([Q_HOME, configuration(LEFT)])
    regions = grow_regions(world(), qs, max_regions=1, seed=0)
    assert len(regions) == 1
    assert regions.covers(qs[:1]).all()
    generator, q, samples = RandomGenerator(0), Q_HOME, []
    for _ in range(300):
        q = regions.polytopes[0].UniformSample(generator, q, mixing_steps=20)
        samples.append(q)
    assert world().free(np.stack(samples), Situation(0.08)).mean() > 0.9
    save_regions(tmp_path / "r.npz", regions)
    again = load_regions(tmp_path / "r.npz")
    np.testing.assert_array_equal(again.polytopes[0].A(), regions.polytopes[0].A())
    np.testing.assert_array_equal(again.polytopes[0].b(), regions.polytopes[0].b())
    assert times_told(tmp_path / "r.npz", load_regions) > 50
    arrays = read_npz(tmp_path / "r.npz", "regions")
    for name, value in (("A", np.zeros((len(arrays["b"]), 6))), ("edges", np.array([[0, 1]]))):
        np.savez(tmp_path / "r.npz", allow_pickle=False, **{**arrays, name: value})
        with pytest.raises(UnreadableFileError, match=r"r.npz is damaged or not a file of regions"):
            load_regions(tmp_path / "r.npz")


def test_a_regions_file_of_another_format_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "r.npz", A=np.zeros((1, 7)))
    with pytest.raises(ValueError, match="format None; expected 1"):
        load_regions(tmp_path / "r.npz")


def test_a_name_is_taken_from_the_start() -> None:
    program = (
        "from planning.planner import register_planner, planner_names\n"
        "try: register_planner('default')(type('Mine', (), {}))\n"
        "except ValueError as error: print(error)\n"
        "print(*planner_names())"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert run.stdout.splitlines() == [
        "a planner named 'default' is registered already, by planning.planners.default; "
        "__main__ needs another name",
        "default gcs rrt",
    ]
