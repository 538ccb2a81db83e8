"""What gantry and fingers are told, as desired states of the plant's actuators.

Drake's own systems, as in `split_drake.robot.arm_command`: ones written in Python are never freed.
"""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.symbolic import Expression, MakeVectorVariable, Variable, if_then_else
from pydrake.symbolic import max as larger
from pydrake.symbolic import min as smaller
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Multiplexer, SymbolicVectorSystem

from split_drake.poses import Array
from split_drake.robot.arm_command import COMMAND_PERIOD_S
from split_drake.robot.panda import FINGER_JOINTS
from split_drake.station.hand.hand_model import HandModel

# Of a hand that moves, at both ends of its way.
ACCELERATION_M_S2 = 2.0
# Numbers of steps add up to times only so exactly.
_TIME_SLACK_S = 1e-9


def add_hand_command(
    builder: DiagramBuilder, plant: MultibodyPlant, model: HandModel, finger_kp_n_per_m: float
) -> None:
    """Add the systems that make commands desired states of a finalized plant; export their inputs.

    Input ports of the diagram:
        gantry: (7,) p_WG in m, its velocity in m/s, and the time in s at which the position is due;
            for `COMMAND_PERIOD_S` from then on it moves at the velocity, and then it rests.
        gripper: (2,) opening in m, which may be below 0 to squeeze, and force limit of each finger
            in N.  A finger's desired position is the larger of opening/2 and measured - force/kp.
    """
    gantry = builder.AddSystem(_gantry_system())
    builder.ExportInput(gantry.get_input_port(), "gantry")
    builder.Connect(gantry.get_output_port(), plant.get_desired_state_input_port(model.gantry))
    state = plant.get_state_output_port(model.hand)
    fingers = builder.AddSystem(
        _finger_system(state.size(), _fingers_in_state(plant, model), finger_kp_n_per_m)
    )
    inputs = builder.AddSystem(Multiplexer([2, state.size()]))
    builder.ExportInput(inputs.get_input_port(0), "gripper")
    builder.Connect(state, inputs.get_input_port(1))
    builder.Connect(inputs.get_output_port(), fingers.get_input_port())
    builder.Connect(fingers.get_output_port(), plant.get_desired_state_input_port(model.hand))


def shares_of_way(length_m: float, speed_m_s: float) -> Array:
    """Return which share of a way is done after each `COMMAND_PERIOD_S` (N,), the last being 1.

    The speed rises by `ACCELERATION_M_S2` up to what is given, and falls as fast in the end.
    """
    if length_m == 0.0:
        return np.zeros(0)
    top_m_s = min(speed_m_s, np.sqrt(ACCELERATION_M_S2 * length_m))
    duration_s = length_m / top_m_s + top_m_s / ACCELERATION_M_S2
    count = int(np.ceil(duration_s / COMMAND_PERIOD_S))
    middles = (np.arange(count) + 0.5) * duration_s / count
    nearer_end = np.minimum(middles, duration_s - middles)
    done = np.cumsum(np.minimum(top_m_s, ACCELERATION_M_S2 * nearer_end))
    return done / done[-1]


def _gantry_system() -> SymbolicVectorSystem:
    time, command = Variable("t"), MakeVectorVariable(7, "gantry")
    p, v, due = command[:3], command[3:6], command[6]
    since = smaller(larger(time - due, 0.0), COMMAND_PERIOD_S)
    under_way = time - due < COMMAND_PERIOD_S + _TIME_SLACK_S
    moving = if_then_else(under_way, Expression(1.0), Expression(0.0))
    output = [at + since * speed for at, speed in zip(p, v, strict=True)]
    output += [moving * speed for speed in v]
    return SymbolicVectorSystem(time=time, input=command, output=np.array(output))


def _fingers_in_state(plant: MultibodyPlant, model: HandModel) -> list[int]:
    """Return where the fingers' positions stand in the hand's state, which the wrist's begin."""
    joints = [plant.GetJointByName(name, model.hand) for name in FINGER_JOINTS]
    return [joint.position_start() - model.wrist.position_start() for joint in joints]


def _finger_system(states: int, fingers: list[int], kp: float) -> SymbolicVectorSystem:
    """Return the system for a hand of so many states, the fingers' positions at `fingers`."""
    gripper, measured = MakeVectorVariable(2, "gripper"), MakeVectorVariable(states, "measured")
    desired = [larger(gripper[0] / 2.0, measured[at] - gripper[1] / kp) for at in fingers]
    output = np.array([*desired, Expression(0.0), Expression(0.0)])
    return SymbolicVectorSystem(input=np.concatenate([gripper, measured]), output=output)
