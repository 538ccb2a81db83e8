"""A robot that does exactly what it is told, for tests of execution that need no simulator."""

from dataclasses import dataclass, field

import numpy as np

from split_drake.camera import DepthView
from split_drake.poses import Array
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.panda import gripper_jacobian
from split_drake.robot.posture import Q_HOME


@dataclass
class PerfectRobot:
    """Goes where it is told; its fingers stop at `object_m`, a floor at `floor_m` pushes back.

    The object is lost at `lost_s`.
    The floor acts on the gripper's origin, as a spring of 20 N/mm along `normal_W`, from where it
    begins along that direction.
    """

    object_m: float = 0.004
    lost_s: float = np.inf
    floor_m: float = -np.inf
    normal_W: tuple[float, float, float] = (0.0, 0.0, 1.0)
    q: Array = field(default_factory=Q_HOME.copy)
    opening_m: float = 0.08
    time_s: float = 0.0
    _v: Array = field(default_factory=lambda: np.zeros(7))

    @property
    def joint_torques_nm(self) -> Array:
        normal = np.array(self.normal_W)
        depth = max(0.0, self.floor_m - float(normal @ gripper_pose(self.q)[:3, 3]))
        return gripper_jacobian(self.q).T @ (-20e3 * depth * normal)

    def command(self, q: Array, v: Array, opening_m: float, force_n: float) -> None:
        assert q.shape == v.shape == (7,)
        assert force_n > 0.0
        self.q, self._v = q.copy(), v.copy()
        held_m = self.object_m if self.time_s < self.lost_s else 0.0
        self.opening_m = max(opening_m, held_m)

    def advance(self, duration_s: float) -> None:
        self.time_s += duration_s
        self.q = self.q + duration_s * self._v

    def capture(self) -> tuple[DepthView, ...]:
        return ()
