"""Motions by Drake's GcsTrajectoryOptimization through regions of the static station.

T. Marcucci, M. Petersen, D. von Wrangel and R. Tedrake, "Motion Planning around Obstacles with
Convex Optimization", 2023.  The regions know table, hook and the robot itself; the object, whether
it stands or is held, is checked afterwards, and a path that touches it is refused.
"""

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry.optimization import GraphOfConvexSetsOptions, HPolyhedron, Point
from pydrake.planning import GcsTrajectoryOptimization
from pydrake.solvers import ClarabelSolver
from pydrake.trajectories import CompositeTrajectory
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from planning.motion.free import MotionQuery, NoMotion
from planning.motion.regions import Regions
from split_drake.poses import Array
from split_drake.station.layout import same_fixtures

# Paths are Bezier curves of this order in every region, with a continuous direction between them.
ORDER = 3
# The whole graph, of the 40 regions that ship, costs minutes a query; those of the shortest chain,
# and of the ones that hold its ends as many as make this number, cost at most tenths of a second.
MAX_REGIONS = 6
ROUNDED_PATHS = 3
PATH_SAMPLES = 40
# An end beside the regions is joined to them by a straight motion of at most this length.
MAX_RAMP_RAD = 0.8
# It ends this share of the way from the region's face to its center: solvers fail on the face.
INWARDS = 0.02


class GcsMotion:
    """Joins configurations by the shortest smooth path through a graph of regions.

    Args:
        regions: of the station that motions are asked for.
    """

    def __init__(self, regions: Regions) -> None:
        self._regions = regions
        self._centers = np.stack([p.ChebyshevCenter() for p in regions.polytopes])
        self._graph = self._weighted(regions.edges)

    def __call__(self, query: MotionQuery, rng: np.random.Generator) -> Array | NoMotion:
        """Return a path (N, 7) that is free throughout, or why there is none; draws nothing."""
        del rng
        if not same_fixtures(self._regions.layout, query.world.layout):
            return NoMotion("the GCS regions are of another station")
        path = self.path(query.q_start, query.q_goal)
        if isinstance(path, NoMotion) or query.is_free(path):
            return path
        return NoMotion("the GCS path collides")

    def path(self, q_start: Array, q_goal: Array) -> Array | NoMotion:
        """Return a path (N, 7) through the regions, checked against nothing, or why none."""
        entry, leave = (_nearest(q, self._regions.polytopes) for q in (q_start, q_goal))
        for q, q_inside in ((q_start, entry), (q_goal, leave)):
            if np.abs(q - q_inside).max() > MAX_RAMP_RAD:
                return NoMotion("an end is far from all GCS regions")
        chosen = self._chain(entry, leave)
        if not chosen:
            return NoMotion("no chain of GCS regions")
        inner = self._solve(chosen, entry, leave)
        if inner is None:
            return NoMotion("GCS found no path")
        return np.concatenate([q_start[None], inner, q_goal[None]])

    def _weighted(self, edges: tuple[tuple[int, int], ...]) -> coo_array:
        pairs = np.array(edges, dtype=int).reshape(-1, 2)
        lengths = np.linalg.norm(self._centers[pairs[:, 0]] - self._centers[pairs[:, 1]], axis=1)
        count = len(self._centers)
        # An entry of 0 would be no edge at all.
        return coo_array((lengths + 1e-6, (pairs[:, 0], pairs[:, 1])), shape=(count, count))

    def _chain(self, q_start: Array, q_goal: Array) -> list[int]:
        """Return the regions to search: the shortest chain's first; none where there is none.

        A chain's length is measured from the start over the regions' centers to the goal.
        """
        first, last = (self._containing(q) for q in (q_start, q_goal))
        lengths, before = dijkstra(self._graph, indices=first, return_predecessors=True)
        lengths = lengths + self._distances(q_start)[first, None] + self._distances(q_goal)
        row, column = np.unravel_index(np.argmin(lengths[:, last]), (len(first), len(last)))
        if not np.isfinite(lengths[row, last[column]]):
            return []
        chain = [int(last[column])]
        while chain[-1] != first[row]:
            chain.append(int(before[row, chain[-1]]))
        others = [int(i) for i in (*first, *last) if i not in chain]
        return chain + list(dict.fromkeys(others))[: max(0, MAX_REGIONS - len(chain))]

    def _containing(self, q: Array) -> NDArray[np.intp]:
        inside = [p.PointInSet(q, 1e-6) for p in self._regions.polytopes]
        return np.flatnonzero(inside)

    def _distances(self, q: Array) -> Array:
        return np.linalg.norm(self._centers - q, axis=1)

    def _solve(self, chosen: list[int], q_start: Array, q_goal: Array) -> Array | None:
        """Return (PATH_SAMPLES, 7) from start to goal through the chosen regions, or None."""
        gcs = GcsTrajectoryOptimization(7)
        number = {region: i for i, region in enumerate(chosen)}
        edges = [
            (number[i], number[j]) for i, j in self._regions.edges if i in number and j in number
        ]
        middle = gcs.AddRegions([self._regions.polytopes[i] for i in chosen], edges, ORDER)
        source, target = (gcs.AddRegions([Point(q)], 0, h_min=0.0) for q in (q_start, q_goal))
        gcs.AddEdges(source, middle)
        gcs.AddEdges(middle, target)
        gcs.AddPathLengthCost(1.0)
        gcs.AddPathContinuityConstraints(1)
        trajectory, result = gcs.SolvePath(source, target, _options())
        return _sampled(trajectory, q_start, q_goal) if result.is_success() else None


def _options() -> GraphOfConvexSetsOptions:
    options = GraphOfConvexSetsOptions()
    options.convex_relaxation = True
    options.preprocessing = False
    options.max_rounded_paths = ROUNDED_PATHS
    options.rounding_seed = 0
    options.solver = options.restriction_solver = ClarabelSolver()
    return options


def _sampled(trajectory: CompositeTrajectory, q_start: Array, q_goal: Array) -> Array:
    times = np.linspace(trajectory.start_time(), trajectory.end_time(), PATH_SAMPLES)
    path = np.asarray(trajectory.vector_values(times).T)
    path[0], path[-1] = q_start, q_goal
    return path


def _nearest(q: Array, polytopes: tuple[HPolyhedron, ...]) -> Array:
    """Return `q` (7,) where a polytope holds it, else the nearest that is well within one."""
    if any(p.PointInSet(q) for p in polytopes):
        return q
    found = []
    for polytope in polytopes:
        projection = polytope.Projection(q)
        if projection is not None:
            on_face = projection[1][:, 0]
            found.append(on_face + INWARDS * (polytope.ChebyshevCenter() - on_face))
    return min(found, key=lambda inside: float(np.linalg.norm(inside - q)))
