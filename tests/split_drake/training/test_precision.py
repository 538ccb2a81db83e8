"""Which type of numbers training computes in."""

import pytest
import torch

from split_drake.training import precision
from split_drake.training.precision import uses_bfloat16

CPU = torch.device("cpu")


def test_what_is_asked_for_is_used() -> None:
    assert uses_bfloat16("bfloat16", CPU)
    assert not uses_bfloat16("float32", CPU)


@pytest.mark.parametrize(("bfloat16_s", "expected"), [(0.001, True), (0.03, False)])
def test_the_faster_type_is_used_otherwise(
    bfloat16_s: float, expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    seconds = {torch.bfloat16: bfloat16_s, torch.float32: 0.01}
    monkeypatch.setattr(precision, "_seconds", lambda kind, device: seconds[kind])
    assert uses_bfloat16("auto", CPU) is expected


def test_products_are_timed() -> None:
    assert 0.0 < precision._seconds(torch.float32, CPU) < 60.0
