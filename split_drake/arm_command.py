"""What the arm and the gripper are told, as desired states of the plant's actuators."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from split_drake.gripper import MAX_FORCE_N

# Between two commands the arm's desired state moves on at the commanded velocities, for this long.
# Angles that jumped from one command to the next would make the arm's stiff joints chatter: at
# 1.5 rad/s a jump of 15 mrad asks a wrist joint for 22 N m of its 12.
COMMAND_PERIOD_S = 0.01


class ArmCommandSystem(LeafSystem):
    """Combines arm and gripper commands into the desired state of the Panda's nine actuators.

    Input ports:
        arm: (15,) desired joint angles and velocities, rad and rad/s, and the time in s at which
            the angles are due; for `COMMAND_PERIOD_S` from then on they move at the velocities.
        gripper: (2,) opening in metres, which may be below 0 to squeeze, and force limit of each
            finger in N.
        measured: (18,) the Panda's positions and velocities.
    Output port:
        desired_state: (18,) positions and velocities of arm and fingers.

    The fingers' springs reach no further than the force limit allows: each finger's desired
    position is the larger of opening/2 and measured - force/kp.
    """

    def __init__(self, finger_kp_n_per_m: float) -> None:
        super().__init__()
        self._finger_kp = finger_kp_n_per_m
        self._arm = self.DeclareVectorInputPort("arm", 15)
        self._gripper = self.DeclareVectorInputPort("gripper", 2)
        self._measured = self.DeclareVectorInputPort("measured", 18)
        self.DeclareVectorOutputPort("desired_state", 18, self._calc_desired_state)

    def _calc_desired_state(self, context: Context, output: BasicVector) -> None:
        arm = self._arm.Eval(context)
        opening_m, force_n = self._gripper.Eval(context)
        fingers = self._measured.Eval(context)[7:9]
        since_s = np.clip(context.get_time() - arm[14], 0.0, COMMAND_PERIOD_S)
        desired = np.zeros(18)
        desired[:7] = arm[:7] + since_s * arm[7:14]
        desired[7:9] = np.maximum(opening_m / 2.0, fingers - force_n / self._finger_kp)
        desired[9:16] = arm[7:14]
        output.SetFromVector(desired)


def check_force(force_n: float) -> float:
    """Return `force_n`, or raise ValueError where the gripper cannot exert it."""
    if not 0.0 < force_n <= MAX_FORCE_N:
        raise ValueError(f"force_n is {force_n}; expected more than 0, at most {MAX_FORCE_N}")
    return force_n
