"""Recordings as small pages that share a script."""

import base64
import json
import re
import zlib
from pathlib import Path

import numpy as np
import pytest

from scenarios.viewing.narration import Narration
from scenarios.viewing.recording import Recorder
from scenarios.viewing.replay_page import UnknownPageError, write_replay
from split_drake.poses import make_pose


def recorded(folder: Path, name: str = "000.html") -> tuple[Path, str]:
    """Return a recording with two attempts, and Meshcat's own page of it."""
    recorder = Recorder(title="trial 0 <hang>")
    recorder.start(2.0)
    recorder.show_grasp(make_pose(p=(0.5, 0.0, 0.1)))
    for step in range(40):
        time_s = 2.0 + 0.1 * step
        recorder.tell(time_s, 1 + step // 20, "close" if step % 20 > 10 else "transit", step > 10)
        recorder.feel(time_s, np.array([0.5 * step, 30.0]))
        recorder.meshcat.SetProperty("/drake/visualizer", "visible", True, time_s)
    path = folder / name
    recorder.save(path, "failed: it <slipped>", False)
    return path, recorder.meshcat.StaticHtml()


def test_a_recording_is_small_and_draws_what_meshcat_draws(tmp_path: Path) -> None:
    path, whole = recorded(tmp_path)
    page = path.read_text()
    assert len(page) < 0.1 * len(whole)
    scripts = list(tmp_path.glob("meshcat-*.js"))
    assert len(scripts) == 1 and scripts[0].stat().st_size > 1e6
    assert f'<script src="{scripts[0].name}"></script>' in page
    packed = re.search(r'const PACKED = "([^"]+)"', page)
    assert packed is not None
    content = zlib.decompress(base64.b64decode(packed[1]))
    commands = re.findall(r"octet-binary;base64,([A-Za-z0-9+/=]+)", whole)
    lengths = [len(base64.b64decode(each)) for each in commands]
    assert len(content) == sum(lengths) + 4 * len(lengths)
    at = 0
    for each in commands:
        length = int.from_bytes(content[at : at + 4], "little")
        assert content[at + 4 : at + 4 + length] == base64.b64decode(each)
        at += 4 + length


def test_recordings_of_a_folder_share_the_script(tmp_path: Path) -> None:
    for name in ("000.html", "001.html"):
        recorded(tmp_path, name)
    assert len(list(tmp_path.iterdir())) == 3


def test_a_recording_tells_what_happens(tmp_path: Path) -> None:
    page = recorded(tmp_path)[0].read_text()
    told = re.search(r"const NARRATION = (.*);\n", page)
    assert told is not None and "<" not in told[1]
    found = json.loads(told[1])
    assert found["outcome"] == "failed: it <slipped>" and found["good"] is False
    assert [(each["attempt"], each["name"]) for each in found["captions"]] == [
        (1, "transit"),
        (1, "close"),
        (2, "transit"),
        (2, "close"),
    ]
    assert found["captions"][1]["start_s"] == pytest.approx(1.1)
    assert found["forces"][0] == [0.0, 0.0, 30.0]
    assert found["forces"][-1] == pytest.approx([3.9, 19.5, 30.0])


def test_forces_are_kept_ten_times_a_second() -> None:
    narration = Narration("title")
    kept = [narration.feel(0.01 * step, 1.0, 2.0) for step in range(100)]
    assert sum(kept) == 10


def test_a_page_of_another_kind_is_refused(tmp_path: Path) -> None:
    for page in ("", '<script type="text/javascript">x</script>', "<html></html>"):
        with pytest.raises(UnknownPageError, match=r"has 0 commands and .* script; expected some"):
            write_replay(tmp_path / "r.html", page, Narration("title"))
    assert list(tmp_path.iterdir()) == []
