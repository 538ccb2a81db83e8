"""What commands make of the actuators' desired state, over time and against the force limit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.framework import Diagram

from split_drake.poses import Array
from split_drake.robot.arm_command import COMMAND_PERIOD_S, arm_command_system, check_force
from split_drake.robot.gripper import MAX_FORCE_N
from split_drake.robot.posture import Q_HOME

KP_N_PER_M = 4000.0
V = np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.6, 1.5])
SYSTEM: Diagram = arm_command_system(KP_N_PER_M)
CONTEXT = SYSTEM.CreateDefaultContext()


def desired(
    time_s: float,
    due_s: float = 0.0,
    gripper: tuple[float, float] = (0.04, 40.0),
    fingers_m: tuple[float, float] = (0.02, 0.02),
) -> Array:
    """Return the desired state (18,) where the arm is told Q_HOME and V, due at `due_s`."""
    CONTEXT.SetTime(time_s)
    SYSTEM.GetInputPort("arm").FixValue(CONTEXT, np.array([*Q_HOME, *V, due_s]))
    SYSTEM.GetInputPort("gripper").FixValue(CONTEXT, np.array(gripper))
    measured = np.array([*Q_HOME, *fingers_m, *np.zeros(9)])
    SYSTEM.GetInputPort("measured").FixValue(CONTEXT, measured)
    return np.asarray(SYSTEM.GetOutputPort("desired_state").Eval(CONTEXT))


@given(due_s=st.floats(0.0, 100.0), since_s=st.floats(-0.1, 0.1))
def test_the_arm_moves_on_for_one_period_and_rests(due_s: float, since_s: float) -> None:
    state = desired(due_s + since_s, due_s)
    moved_s = float(np.clip(since_s, 0.0, COMMAND_PERIOD_S))
    np.testing.assert_allclose(state[:7], Q_HOME + moved_s * V, atol=1e-12)
    if abs(since_s - COMMAND_PERIOD_S) > 1e-6:
        np.testing.assert_array_equal(state[9:16], V if since_s < COMMAND_PERIOD_S else 0.0 * V)
    assert not state[16:].any(), "fingers are to rest where they are told to be"


def test_at_the_end_of_its_period_a_command_still_moves() -> None:
    """The next one is due then; sums of steps of 10 ms come close to that, but not exactly."""
    for step in range(1, 200):
        due_s = sum([COMMAND_PERIOD_S] * step)
        np.testing.assert_array_equal(desired(due_s + COMMAND_PERIOD_S, due_s)[9:16], V)


@given(
    opening_m=st.floats(-0.05, 0.08),
    force_n=st.floats(1.0, MAX_FORCE_N),
    fingers_m=st.tuples(st.floats(0.0, 0.04), st.floats(0.0, 0.04)),
)
def test_no_finger_is_pulled_inwards_by_more_than_the_force_limit(
    opening_m: float, force_n: float, fingers_m: tuple[float, float]
) -> None:
    wanted_m = desired(0.0, gripper=(opening_m, force_n), fingers_m=fingers_m)[7:9]
    inwards_n = KP_N_PER_M * (np.array(fingers_m) - wanted_m)
    assert (inwards_n <= force_n + 1e-9).all()
    free = inwards_n < force_n - 1e-9
    np.testing.assert_allclose(wanted_m[free], opening_m / 2.0, atol=1e-12)


def test_forces_beyond_those_of_the_gripper_are_refused() -> None:
    assert check_force(MAX_FORCE_N) == MAX_FORCE_N
    for force_n in (0.0, -1.0, MAX_FORCE_N + 0.1, float("nan")):
        with pytest.raises(ValueError, match=f"force_n is {force_n}; expected more than 0"):
            check_force(force_n)
