"""What the arm and the gripper are told, as desired states of the plant's actuators.

A diagram of Drake's own systems: ones that are written in Python are never freed (Drake 1.51), nor
is any diagram with one of them.
"""

import numpy as np
from pydrake.symbolic import Expression, MakeVectorVariable, Variable, if_then_else
from pydrake.symbolic import max as larger
from pydrake.symbolic import min as smaller
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Multiplexer, SymbolicVectorSystem

from split_drake.poses import Array
from split_drake.robot.gripper import MAX_FORCE_N

# Between two commands the arm's desired state moves on at the commanded velocities, for this long.
# Angles that jumped from one command to the next would make the arm's stiff joints chatter: at
# 1.5 rad/s a jump of 15 mrad asks a wrist joint for 22 N m of its 12.
COMMAND_PERIOD_S = 0.01
# Numbers of steps add up to times only so exactly.
_TIME_SLACK_S = 1e-9


def arm_command_system(finger_kp_n_per_m: float) -> Diagram:
    """Return a system that makes commands the desired state of the Panda's nine actuators.

    Input ports:
        arm: (15,) desired joint angles and velocities, rad and rad/s, and the time in s at which
            the angles are due; for `COMMAND_PERIOD_S` from then on they move at the velocities,
            and then they rest.
        gripper: (2,) opening in metres, which may be below 0 to squeeze, and force limit of each
            finger in N.
        measured: (18,) the Panda's positions and velocities.
    Output port:
        desired_state: (18,) positions and velocities of arm and fingers.

    The fingers' springs reach no further than the force limit allows: each finger's desired
    position is the larger of opening/2 and measured - force/kp.
    """
    time, arm = Variable("t"), MakeVectorVariable(15, "arm")
    gripper, measured = MakeVectorVariable(2, "gripper"), MakeVectorVariable(18, "measured")
    calculation = SymbolicVectorSystem(
        time=time,
        input=np.concatenate([arm, gripper, measured]),
        output=_desired_state(time, arm, gripper, measured, finger_kp_n_per_m),
    )
    builder = DiagramBuilder()
    inputs = builder.AddSystem(Multiplexer([len(arm), len(gripper), len(measured)]))
    builder.AddSystem(calculation)
    builder.Connect(inputs.get_output_port(), calculation.get_input_port())
    for number, name in enumerate(("arm", "gripper", "measured")):
        builder.ExportInput(inputs.get_input_port(number), name)
    builder.ExportOutput(calculation.get_output_port(), "desired_state")
    return builder.Build()


def _desired_state(time: Variable, arm: Array, gripper: Array, measured: Array, kp: float) -> Array:
    """Return the output's expressions (18,)."""
    q, v, due = arm[:7], arm[7:14], arm[14]
    since = smaller(larger(time - due, 0.0), COMMAND_PERIOD_S)
    under_way = time - due < COMMAND_PERIOD_S + _TIME_SLACK_S
    moving = if_then_else(under_way, Expression(1.0), Expression(0.0))
    fingers = [larger(gripper[0] / 2.0, finger - gripper[1] / kp) for finger in measured[7:9]]
    arm_q = [angle + since * speed for angle, speed in zip(q, v, strict=True)]
    arm_v = [moving * speed for speed in v]
    return np.array([*arm_q, *fingers, *arm_v, Expression(0.0), Expression(0.0)])


def check_force(force_n: float) -> float:
    """Return `force_n`, or raise ValueError where the gripper cannot exert it."""
    if not 0.0 < force_n <= MAX_FORCE_N:
        raise ValueError(f"force_n is {force_n}; expected more than 0, at most {MAX_FORCE_N}")
    return force_n
