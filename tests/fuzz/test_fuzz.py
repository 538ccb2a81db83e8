"""A thousand odd inputs; `python -m tests.fuzz.fuzz` tries more."""

from collections import Counter
from pathlib import Path

from tests.fuzz.fuzz import TARGETS, tried


def test_odd_inputs_are_used_rightly_or_refused_in_a_sentence(tmp_path: Path) -> None:
    outcomes = [tried(number, 1, tmp_path) for number in range(1020)]
    assert [outcome for outcome in outcomes if outcome.fault] == []
    # Each target gets inputs of both kinds: else it would show nothing.
    seen = Counter((outcome.target, outcome.verdict) for outcome in outcomes)
    for target in TARGETS:
        assert seen[target.name, "refused"] > 0
        assert seen[target.name, "used"] > 0
