"""Trials in physics that go wrong at first."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from planning.problem import SegmentName, Stage
from scenarios.mug_hang import MugHangOptions, specs_of
from scenarios.trials.perception import Perceiver
from scenarios.trials.records import TrialRecord
from scenarios.trials.spec import TrialSpec
from scenarios.trials.trial import run_trial
from split_drake.pose_set import PoseSet
from split_drake.pose_task import PoseTask
from split_drake.poses import make_pose
from split_drake.scene import Scene


def spec_of(folder: Path, seed: int) -> TrialSpec:
    options = MugHangOptions(
        trials=1, seed=seed, detector="oracle", mugs="train", record="none", workers=1
    )
    return specs_of(options, folder, ())[0]


def without_wall_times(record: TrialRecord) -> TrialRecord:
    attempts = tuple({**attempt, "planning_s": 0.0} for attempt in record.attempts)
    return replace(record, seconds={}, memory_bytes=0, attempts=attempts)


def test_a_mug_that_turns_in_the_hand_hangs_by_a_new_plan_and_twice_the_same(
    tmp_path: Path,
) -> None:
    spec = spec_of(tmp_path, seed=8)
    # By these steps that mug comes to lie as it turns in the hand.
    spec = replace(spec, station=replace(spec.station, time_step_s=0.002))
    one, two = (run_trial(spec) for _ in range(2))
    assert one.succeeded, one.reason
    lifted, placed = one.attempts
    assert lifted["recovery"] == "planned anew from how it lay in the hand"
    assert lifted["held"]["rejected"] == "" and lifted["held"]["turn_rad"] > np.radians(5.0)
    assert [log["name"] for log in placed["segments"]][:2] == ["transfer", "insert"]
    assert without_wall_times(one) == without_wall_times(two)


def test_a_mug_that_was_missed_is_taken_at_the_second_attempt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    look, looks = Perceiver.look, count(1)

    def high_at_first(
        perceiver: Perceiver, tasks: Sequence[PoseTask], again: bool = False
    ) -> tuple[Scene, dict[str, PoseSet]]:
        """See everything 10 cm too high, once, so that the fingers close on nothing."""
        scene, found = look(perceiver, tasks, again)
        if next(looks) > 1:
            return scene, found
        up_m = np.array([0.0, 0.0, 0.10])
        high = replace(scene, p_WPs=scene.p_WPs + up_m, p_WSs=scene.p_WSs + up_m)
        return high, {name: poses.moved(make_pose(p=up_m)) for name, poses in found.items()}

    monkeypatch.setattr(Perceiver, "look", high_at_first)
    record = run_trial(spec_of(tmp_path, seed=1))
    assert record.attempts[0]["stage"] == Stage.GRASP
    assert "empty after close" in record.attempts[0]["reason"]
    assert record.attempts[0]["recovery"] == "drew back"
    # What becomes of it afterwards is up to the last bits of a processor's sums.
    assert record.attempts[1]["stage"] in (Stage.PLACEMENT, "success")
    assert SegmentName.LIFT in [each["name"] for each in record.attempts[1]["segments"]]
