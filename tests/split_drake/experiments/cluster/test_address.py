"""Addresses of schedulers."""

import json
import warnings
from pathlib import Path

import dask
import pytest

from split_drake.bad_input import BadInputError
from split_drake.experiments.cluster.address import (
    OpenSchedulerWarning,
    address_of,
    connect,
    is_open,
    warn_if_open,
)


def test_addresses_are_read(tmp_path: Path) -> None:
    assert address_of("10.0.0.5:8786") == "tcp://10.0.0.5:8786"
    assert address_of("tls://head:8786") == "tls://head:8786"
    file = tmp_path / "scheduler.json"
    file.write_text(json.dumps({"address": "tcp://10.0.0.7:1234", "type": "Scheduler"}))
    assert address_of(str(file)) == "tcp://10.0.0.7:1234"


@pytest.mark.parametrize("text", ["", "head", "head:", ":8786", "http://head:80", "head:99999"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(BadInputError, match="expected local, an address such as tcp"):
        address_of(text)


def test_a_file_without_an_address_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("{}")
    with pytest.raises(BadInputError, match="--scheduler is 'None'"):
        address_of(str(tmp_path / "a.json"))
    with pytest.raises(BadInputError, match="missing"):
        address_of(str(tmp_path / "missing.json"))


def test_schedulers_on_a_network_without_tls_are_warned_of() -> None:
    for address in ("tcp://10.0.0.5:8786", "tcp://no-such-machine.invalid:1"):
        with pytest.warns(OpenSchedulerWarning, match="can run code on its workers"):
            warn_if_open(address)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for address in ("tcp://127.0.0.1:1", "tcp://[::1]:1", "tls://10.0.0.5:1"):
            assert not is_open(address)
            warn_if_open(address)


def test_tls_without_keys_is_refused() -> None:
    with (
        dask.config.set({"distributed.comm.tls.ca-file": None}),
        pytest.raises(BadInputError, match="ca-file names no "),
    ):
        connect("tls://127.0.0.1:1", 0.0)
