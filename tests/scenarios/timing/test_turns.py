"""Calls in turns, and detections timed so."""

import torch

from scenarios.speed import detection_table
from scenarios.timing.detection_speed import (
    MUG_GRASPS,
    VGN,
    DetectionSpeed,
    detection_speeds,
    example_scene,
)
from scenarios.timing.turns import WARM_UP, medians_in_turns


def test_calls_have_their_turns() -> None:
    called: list[str] = []
    calls = {name: (lambda name=name: called.append(name)) for name in ("one", "two")}
    found = medians_in_turns(calls, rounds=3)
    assert called == ["one", "two"] * (WARM_UP + 3)
    assert found.keys() == calls.keys() and min(found.values()) > 0.0


def test_ratios_are_to_vgn() -> None:
    speed = DetectionSpeed(1, {VGN: 0.2, MUG_GRASPS: 0.1})
    assert speed.ratio(MUG_GRASPS) == 0.5
    table = detection_table([speed, DetectionSpeed(2, {VGN: 0.1, MUG_GRASPS: 0.08})])
    cells = [list(column.cells) for column in table.columns]
    assert cells == [
        [VGN, MUG_GRASPS],
        ["200", "100"],
        ["100", "80"],
        ["", "0.50, 0.80"],
        ["2.00", "1.25"],
    ]


def test_detections_are_timed_on_the_shipped_scene() -> None:
    before = torch.get_num_threads()
    (speed,) = detection_speeds([1], rounds=1)
    assert len(speed.seconds) == 4 and min(speed.seconds.values()) > 0.0
    assert torch.get_num_threads() == before
    assert len(example_scene().p_WPs) > 2000
