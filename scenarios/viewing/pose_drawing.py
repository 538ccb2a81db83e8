"""Poses as coloured line segments, for any viewer."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, HANDLE, UPRIGHT, PoseTask
from split_drake.poses import Array, transform_points
from split_drake.robot.gripper import MAX_OPENING_M, PAD_SIZE_M

_HALF, _TIP, _ROOT = MAX_OPENING_M / 2.0, PAD_SIZE_M[1] / 2.0, -0.045

# Segments (S, 2, 3) in the pose's frame, metres, of tasks with a sketch of their own.  Grasp: the
# fingers, their base and the approach.
_SKETCHES: dict[PoseTask, Array] = {
    GRASP: np.array(
        [
            [[0, _HALF, _ROOT], [0, _HALF, _TIP]],
            [[0, -_HALF, _ROOT], [0, -_HALF, _TIP]],
            [[0, -_HALF, _ROOT], [0, _HALF, _ROOT]],
            [[0, 0, _ROOT - 0.03], [0, 0, _ROOT]],
        ]
    ),
    # Handle: the way of the peg, away from the body, and towards the rim.
    HANDLE: np.array(
        [
            [[0, -0.03, 0], [0, 0.03, 0]],
            [[0, 0, 0], [0.02, 0, 0]],
            [[0, 0, 0], [0, 0, 0.012]],
        ]
    ),
    # Upright: the axis from the base up, and the side of the handle.
    UPRIGHT: np.array(
        [
            [[0, 0, 0], [0, 0, 0.06]],
            [[0, 0, 0], [0.03, 0, 0]],
            [[0, -0.01, 0], [0, 0.01, 0]],
        ]
    ),
}

# Of other tasks: how long axes are drawn, and how wide a ring about the axis of any turn.
_AXIS_M, _RING_M, _RING_CORNERS = 0.04, 0.02, 16

# How far the copies of a thick line lie from it.
_THICKNESS_M = 0.001

# Score 0 to 1: red, amber, green, which stay apart in lightness for the colour-blind.
_COLOR_STOPS = np.array([[0.70, 0.09, 0.17], [0.96, 0.73, 0.26], [0.10, 0.60, 0.31]])


def score_color(score: float) -> tuple[float, float, float]:
    """Return the RGB colour, each in [0, 1], of a score in [0, 1]."""
    stops = np.linspace(0.0, 1.0, len(_COLOR_STOPS))
    red, green, blue = (float(np.interp(score, stops, channel)) for channel in _COLOR_STOPS.T)
    return red, green, blue


def sketch(task: PoseTask) -> Array:
    """Return segments (S, 2, 3), in metres, that show what a task's frame looks like.

    A task without a sketch of its own shows its symmetry: no turn as axes x, y and z of falling
    lengths, a half turn as its axis with a line across, any turn as its axis with a ring.
    """
    if task in _SKETCHES:
        return _SKETCHES[task]
    if task.symmetry.kind == "none":
        ends = _AXIS_M * np.diag([1.0, 0.5, 0.25])
        return np.stack([np.zeros((3, 3)), ends], axis=1)
    along = np.eye(3)[task.symmetry.column]
    across, aside = np.roll(along, 1), np.roll(along, 2)
    axis = np.array([[np.zeros(3), _AXIS_M * along]])
    if task.symmetry.kind == "half turn":
        return np.concatenate([axis, [[-_RING_M * across, _RING_M * across]]])
    angles = np.linspace(0.0, 2.0 * np.pi, _RING_CORNERS + 1)[:, None]
    ring = _RING_M * (np.cos(angles) * across + np.sin(angles) * aside)
    return np.concatenate([axis, np.stack([ring[:-1], ring[1:]], axis=1)])


def pose_segments(task: PoseTask, X_WPs: Array) -> Array:
    """Return the sketches of poses (N, 4, 4) as segments (N * S, 2, 3) in W."""
    points = transform_points(np.reshape(X_WPs, (-1, 4, 4)), sketch(task).reshape(-1, 3))
    return points.reshape(-1, 2, 3)


def thickened(segments_W: Array) -> Array:
    """Return segments (M, 2, 3) with six copies of each around it, (7 * M, 2, 3) in W, metres.

    Browsers draw all lines one pixel wide, and of lines in one place they show either.
    """
    shifts = _THICKNESS_M * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    return (segments_W + shifts[:, None, None]).reshape(-1, 2, 3)


@dataclass(frozen=True)
class ColoredSegments:
    """Segments (M, 2, 3) in W of one RGB colour."""

    segments_W: Array
    color: tuple[float, float, float]


def score_bands(pose_set: PoseSet, bands: int = 5) -> Iterator[ColoredSegments]:
    """Yield the poses grouped into `bands` equal ranges of score, each in its colour."""
    indices = np.minimum((pose_set.scores * bands).astype(int), bands - 1)
    for band in np.unique(indices):
        yield ColoredSegments(
            pose_segments(pose_set.task, pose_set.X_WPs[indices == band]),
            score_color((band + 0.5) / bands),
        )
