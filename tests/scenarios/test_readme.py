"""The README's example runs as it stands."""

import re
from pathlib import Path

from split_drake.data.render import DepthRenderer
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_set import PoseSet
from split_drake.poses import make_pose
from split_drake.station.layout import Layout

ROOT = Path(__file__).parents[2]


def examples(name: str) -> list[str]:
    """Return the blocks of Python in a README, in their order."""
    return re.findall(r"```python\n(.*?)```", (ROOT / name).read_text(), flags=re.DOTALL)


def test_the_planner_is_the_one_that_is_tested() -> None:
    assert examples("planning/README.md")[0] == (ROOT / "tests/helpers/one_bend.py").read_text()


def test_the_example_finds_grasps() -> None:
    example = examples("README.md")[0]
    camera = Layout().cameras[1]
    renderer = DepthRenderer(load_mug("test_004").body.mesh)
    view = renderer.render(make_pose(p=(0.5, 0.0, 0.0)), camera)
    names = {"depth_m": view.depth_m, "X_WC": camera.X_WC}
    exec(example, names)
    grasps = names["grasps"]
    assert isinstance(grasps, PoseSet)
    assert len(grasps) > 0
