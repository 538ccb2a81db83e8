"""Files of cameras, and what these cameras see."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

from split_drake.bad_input import BadInputError
from split_drake.camera import Intrinsics, look_at
from split_drake.sensing.camera_file import CameraFile, read_cameras
from split_drake.sensing.lens import Calibration, Lens

NUMBERS = {"width": 64, "height": 48, "fx": 54.0, "fy": 54.0, "cx": 31.5, "cy": 23.5}
POSITION, TARGET = [0.5, 0.42, 0.42], [0.5, 0.0, 0.0]
X_WC = look_at(POSITION, TARGET)
LOOK_AT = {"position": POSITION, "target": TARGET}
# Half a turn about x: from above, with y of the image towards -y of W.
FROM_ABOVE = {"position": [0.5, 0.0, 0.6], "quaternion_wxyz": [0.0, 1.0, 0.0, 0.0]}


def camera(**changed: Any) -> dict[str, Any]:
    """Return a camera's fields; those that are None are left out."""
    fields = {"name": "side", "intrinsics": NUMBERS, "look_at": LOOK_AT, **changed}
    return {key: value for key, value in fields.items() if value is not None}


def read(folder: Path, *cameras: object, **others: object) -> CameraFile:
    file = folder / "cameras.yaml"
    file.write_text(yaml.safe_dump({"cameras": list(cameras), **others}))
    return read_cameras(file)


def test_poses_can_be_given_in_three_ways(tmp_path: Path) -> None:
    (tmp_path / "info.yaml").write_text(yaml.safe_dump({**NUMBERS, "distortion": [0.1, 0.0]}))
    file = read(
        tmp_path,
        camera(),
        camera(look_at=None, X_WC=X_WC.tolist(), unit_m=0.0001),
        camera(look_at=None, pose=FROM_ABOVE, intrinsics="info.yaml"),
        workspace={"center": [0.4, 0.1, 0.2]},
    )
    side, same, above = file.cameras
    assert side.calibration == Calibration(Intrinsics(64, 48, 54.0, 54.0, 31.5, 23.5))
    assert above.calibration.lens == Lens(k1=0.1)
    np.testing.assert_allclose(side.X_WC, X_WC)
    np.testing.assert_allclose(same.X_WC, X_WC, atol=1e-12)
    np.testing.assert_allclose(above.X_WC[:3, :3], np.diag([1.0, -1.0, -1.0]), atol=1e-12)
    assert (side.unit_m, same.unit_m) == (0.001, 0.0001)
    assert file.workspace is not None
    assert file.workspace.p_WCenter == (0.4, 0.1, 0.2)
    assert read(tmp_path, camera()).workspace is None


def test_a_camera_sees_what_its_image_shows_but_for_the_mask(tmp_path: Path) -> None:
    user_camera = read(tmp_path, camera(look_at=None, pose=FROM_ABOVE)).cameras[0]
    Image.fromarray(np.full((48, 64), 600, np.uint16)).save(tmp_path / "depth.png")
    view = user_camera.view(tmp_path / "depth.png")
    np.testing.assert_allclose(view.points()[:, 2], 0.0, atol=1e-6)
    hidden = np.zeros((48, 64), np.uint8)
    hidden[:, :32] = 255
    Image.fromarray(hidden).save(tmp_path / "mask.png")
    seen = user_camera.view(tmp_path / "depth.png", tmp_path / "mask.png").points()
    assert len(seen) == 48 * 32
    assert seen[:, 0].min() > 0.5
    Image.fromarray(hidden[:, :9]).save(tmp_path / "small.png")
    with pytest.raises(BadInputError, match=r"small\.png has shape \(48, 9\); expected \(48, 64\)"):
        user_camera.view(tmp_path / "depth.png", tmp_path / "small.png")


def test_images_that_do_not_fit_are_told_with_the_camera(tmp_path: Path) -> None:
    user_camera = read(tmp_path, camera()).cameras[0]
    file = tmp_path / "depth.png"
    Image.fromarray(np.full((64, 48), 600, np.uint16)).save(file)
    with pytest.raises(BadInputError, match=r"depth\.png, of the camera side: .*says \(48, 64\)"):
        user_camera.view(file)
    np.save(tmp_path / "depth.npy", np.full((48, 64), 600.0))
    with pytest.raises(BadInputError, match=r"camera side: .* looks like millimetres"):
        user_camera.view(tmp_path / "depth.npy")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (camera(look_at=None), "camera 0 has no pose; expected one of look_at, pose, X_WC"),
        (camera(pose=FROM_ABOVE), "camera 0 has look_at and pose; expected one of"),
        (camera(lens="wide"), "camera 0 has 'lens'; expected name, intrinsics"),
        (camera(intrinsics=None), "camera 0 has no 'intrinsics'"),
        (camera(intrinsics="none.yaml"), r"there is no file .*none\.yaml"),
        (camera(intrinsics=[1]), r"intrinsics is \[1\]"),
        (camera(intrinsics={**NUMBERS, "fx": -1.0}), "fx=-1.0"),
        (camera(look_at={**LOOK_AT, "target": POSITION}), "is parallel to the view"),
        (camera(look_at={**LOOK_AT, "up": [0, 0, 1]}), "look_at has 'up'; expected position"),
        (camera(look_at={"position": [1, 2]}), "look_at has no 'target'"),
        (camera(look_at={**LOOK_AT, "position": [1, 2]}), "expected 3 numbers"),
        (
            camera(look_at=None, pose={**FROM_ABOVE, "quaternion_wxyz": [1, 1, 0, 0]}),
            "expected a length of 1",
        ),
        (camera(look_at=None, X_WC=[[1, 0], [0, 1]]), "expected four rows of four numbers"),
        (camera(look_at=None, X_WC=np.diag([1, 1, -1.0, 1]).tolist()), "is a reflection"),
        (camera(look_at=None, X_WC=np.full((4, 4), np.nan).tolist()), "expected 4 numbers"),
        (camera(unit_m="mm"), "unit_m is 'mm'; expected 1 numbers"),
        ("camera", "camera 0 is 'camera'; expected name, intrinsics"),
    ],
)
def test_what_cannot_be_used_is_told_with_its_place(
    tmp_path: Path, wrong: object, said: str
) -> None:
    with pytest.raises(BadInputError, match=said) as caught:
        read(tmp_path, wrong)
    assert "cameras.yaml" in str(caught.value)


def test_the_file_as_a_whole_is_checked(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"cameras is \[\]; expected a list of cameras"):
        read(tmp_path)
    with pytest.raises(BadInputError, match="has 'lights'; expected cameras, workspace"):
        read(tmp_path, camera(), lights=3)
    with pytest.raises(BadInputError, match="workspace: center is 'here'; expected 3 numbers"):
        read(tmp_path, camera(), workspace={"center": "here"})
