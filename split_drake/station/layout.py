"""Where cameras, table and hook stand, as plain numbers."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from split_drake.bad_input import BadInputError, require_number, require_numbers
from split_drake.camera import Intrinsics, look_at
from split_drake.poses import Array, make_pose, rotation_x
from split_drake.robot.posture import HIGHEST_Q, LOWEST_Q, Q_HOME
from split_drake.scene import Workspace

# The robot's base stands so high above the floor.
FLOOR_DEPTH_M = 0.75


@dataclass(frozen=True)
class CameraPlacement:
    """A depth camera that does not move.

    Attributes:
        name: of the camera and of the station's port.
        intrinsics: of its images.
        X_WC: (4, 4) pose.
    """

    name: str
    intrinsics: Intrinsics
    X_WC: Array


@dataclass(frozen=True)
class HookShape:
    """A peg that sticks out of a vertical post, in the hook frame K (y along the peg to its tip).

    Attributes:
        peg_radius_m: of the peg.
        post_distance_m: from K back along the peg to the post's axis.
        tip_distance_m: from K on to the peg's tip.
        post_radius_m: of the post.
        post_above_m: how far the post rises above the peg's root.
    """

    peg_radius_m: float = 0.006
    post_distance_m: float = 0.082
    tip_distance_m: float = 0.040
    post_radius_m: float = 0.012
    post_above_m: float = 0.03

    def __post_init__(self) -> None:
        require_numbers(self)
        room_m = self.post_distance_m - self.post_radius_m
        if room_m < 0.06:
            raise ValueError(f"the post is {room_m:.3f} m from K; a mug needs at least 0.06 m")


@dataclass(frozen=True)
class OpenBin:
    """A box without a lid, its edges parallel to those of W.

    Attributes:
        p_WRim: the middle of the opening, at the height of the rim.
        size_m: inner length along x and y, and depth.
        wall_m: thickness of walls and floor.

    Raises ValueError where a length is not positive.
    """

    p_WRim: tuple[float, float, float] = (-0.05, -0.50, 0.0)
    size_m: tuple[float, float, float] = (0.34, 0.34, 0.18)
    wall_m: float = 0.01

    def __post_init__(self) -> None:
        require_numbers(self)
        if not min(*self.size_m, self.wall_m) > 0.0:
            raise ValueError(
                f"a bin's size is {self.size_m} m and its walls are {self.wall_m} m thick; "
                "expected positive lengths"
            )

    @classmethod
    def level_with(cls, table_z_m: float) -> Self:
        """Return the default bin, its rim as high as a table's top."""
        x, y, _ = cls.p_WRim
        return cls(p_WRim=(x, y, table_z_m))

    def contains(self, p_WP: Array) -> bool:
        """Return whether a point (3,) is in the bin, below its rim."""
        p_RimP = np.asarray(p_WP) - self.p_WRim
        x, y, depth = self.size_m
        beside = np.abs(p_RimP[:2]) > (x / 2.0, y / 2.0)
        return bool(not beside.any() and -depth < p_RimP[2] < 0.0)


def two_views(workspace: Workspace, distance_m: float = 0.6) -> tuple[CameraPlacement, ...]:
    """Return the paper's two cameras (section VI-B).

    One is perpendicular to the workspace, the other tilted by 45 degrees; that one stands on the
    side of +y, away from the hook.
    """
    intrinsics = Intrinsics.centered(640, 480, focal_px=540.0)
    center = np.array(workspace.p_WCenter)
    top = center + np.array([0.0, 0.0, distance_m])
    side = center + distance_m * np.array([0.0, np.sin(np.pi / 4), np.cos(np.pi / 4)])
    return (
        CameraPlacement("camera_top", intrinsics, look_at(top, center, down_W=(-1.0, 0.0, 0.0))),
        CameraPlacement("camera_side", intrinsics, look_at(side, center)),
    )


@dataclass(frozen=True)
class Layout:
    """The station's fixed parts.

    Attributes:
        workspace: where objects are perceived; its centre is as high as the table's top.
        cameras: depth cameras; the paper's two views of the workspace where none are given.
        X_WK: (4, 4) pose of the hook.
        hook: its shape.
        bin: what things are dropped into; None for none.
        table_size_m: edges of the table's box, whose top is at `table_z_m`.
        p_WTable: (x, y) of the table's centre.
        q_home: (7,) joint angles at which the arm rests, out of the cameras' sight, rad.

    Raises BadInputError where the table's top is on the floor, the hook's post has no height, or a
    joint of `q_home` is out of its range.
    """

    workspace: Workspace = field(default_factory=Workspace)
    cameras: tuple[CameraPlacement, ...] = ()
    X_WK: Array = field(
        default_factory=lambda: make_pose(rotation_x(np.radians(10.0)), (0.5, -0.38, 0.40))
    )
    hook: HookShape = field(default_factory=HookShape)
    bin: OpenBin | None = None
    table_size_m: tuple[float, float, float] = (0.7, 1.2, 0.05)
    p_WTable: tuple[float, float] = (0.55, 0.0)
    q_home: Array = field(default_factory=lambda: Q_HOME)

    def __post_init__(self) -> None:
        for number, (q, least, most) in enumerate(
            zip(self.q_home, LOWEST_Q, HIGHEST_Q, strict=True)
        ):
            require_number(f"joint {number + 1} of q_home", float(q), least, most, "rad")
        if not self.cameras:
            object.__setattr__(self, "cameras", two_views(self.workspace))
        if not self.table_z_m - self.table_size_m[2] > -FLOOR_DEPTH_M:
            raise BadInputError(
                f"the table's top is at z = {self.table_z_m} m and {self.table_size_m[2]} m thick; "
                f"expected a table above the floor, which is at z = {-FLOOR_DEPTH_M} m"
            )
        if not self.post_height_m > 0.0:
            raise BadInputError(
                f"the hook's post ends {-self.post_height_m:.3f} m below the table's top, which is "
                f"at z = {self.table_z_m} m; expected a hook above the table"
            )

    @property
    def table_z_m(self) -> float:
        """The height in W of the table's top, on which objects stand."""
        return float(self.workspace.p_WCenter[2])

    @property
    def post_height_m(self) -> float:
        """How far the hook's post rises above the table's top."""
        root_z_m = (self.X_WK @ (0.0, -self.hook.post_distance_m, 0.0, 1.0))[2]
        return float(root_z_m + self.hook.post_above_m - self.table_z_m)


def same_fixtures(one: Layout, other: Layout) -> bool:
    """Return whether two layouts have the same table, hook, bin and home, which a world keeps."""
    return (
        np.array_equal(one.X_WK, other.X_WK)
        and np.array_equal(one.q_home, other.q_home)
        and one.hook == other.hook
        and one.bin == other.bin
        and one.table_size_m == other.table_size_m
        and one.p_WTable == other.p_WTable
        and one.table_z_m == other.table_z_m
    )
