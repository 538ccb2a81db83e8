"""How threads wait for each other is set before PyTorch is loaded, unless a user sets it."""

import os
import subprocess
import sys

import pytest

TELL = "import split_drake, os, sys; print(os.environ['GOMP_SPINCOUNT'], 'torch' in sys.modules)"


@pytest.mark.parametrize("given", [None, "7"])
def test_how_long_threads_spin_is_set_unless_given(given: str | None) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "GOMP_SPINCOUNT"}
    if given is not None:
        environment["GOMP_SPINCOUNT"] = given
    told = subprocess.run(
        [sys.executable, "-c", TELL], env=environment, capture_output=True, text=True, check=True
    )
    assert told.stdout.split() == [given or "5000", "False"]
