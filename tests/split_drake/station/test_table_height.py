"""The table's top is as high as the workspace's centre, and everything stands on it."""

import re

import numpy as np
import pytest

from split_drake.bad_input import BadInputError
from split_drake.data.clutter.labels import clears_table
from split_drake.grasps.judge import feasible
from split_drake.poses import make_pose, rotation_x
from split_drake.scene import Workspace
from split_drake.station.fixtures import hook_primitives, table_primitive
from split_drake.station.layout import Layout, OpenBin
from tests.helpers.stations import raised_layout


def workspace_at(z_m: float) -> Workspace:
    return Workspace(p_WCenter=(0.5, 0.0, z_m))


@pytest.mark.parametrize("z_m", [-0.2, 0.0, 0.1])
def test_table_and_post_meet_at_the_table_s_height(z_m: float) -> None:
    layout = Layout(workspace=workspace_at(z_m))
    table, (_, post) = table_primitive(layout), hook_primitives(layout)
    assert table.X_OP[2, 3] + table.size[2] / 2.0 == pytest.approx(layout.table_z_m)
    X_WPost = layout.X_WK @ post.X_OP
    assert X_WPost[2, 3] - post.size[1] / 2.0 == pytest.approx(z_m)
    np.testing.assert_allclose(X_WPost[:3, 2], (0.0, 0.0, 1.0), atol=1e-9)


def test_a_hook_below_the_table_and_a_table_on_the_floor_are_refused() -> None:
    with pytest.raises(BadInputError, match="expected a hook above the table"):
        Layout(workspace=workspace_at(0.5))
    with pytest.raises(BadInputError, match=re.escape("expected a table above the floor")):
        Layout(workspace=workspace_at(-0.72))


def test_a_hand_is_judged_against_the_table_s_height() -> None:
    down = make_pose(rotation_x(np.pi), (0.5, 0.0, 0.05))[None]
    for table_z_m, clear in ((0.0, True), (0.1, False)):
        assert feasible(np.eye(4), down, np.array([0.08]), table_z_m).tolist() == [clear]
        assert clears_table(down, table_z_m).tolist() == [clear]


def test_the_default_bin_is_level_with_the_table() -> None:
    assert OpenBin.level_with(0.0) == OpenBin()
    assert OpenBin.level_with(raised_layout(0.1).table_z_m).p_WRim[2] == pytest.approx(0.1)
