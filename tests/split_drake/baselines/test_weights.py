"""Weights that were trained here: whose they are, and whether they are whole."""

from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from split_drake.baselines.giga.network import GigaNetwork
from split_drake.baselines.published import PublishedWeightsError
from split_drake.baselines.vgn.network import VgnNetwork
from split_drake.baselines.weights import (
    BaselineInfo,
    BaselineWeightsError,
    load_weights,
    read_weights,
    save_weights,
)

INFO = BaselineInfo("vgn", "abc", "0ff2a45", 3, 1.5, 1200, 2.5, 0.25)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    save_weights(tmp_path / "vgn.safetensors", VgnNetwork().state_dict(), INFO)
    return tmp_path / "vgn.safetensors"


def test_what_is_written_is_read(tmp_path: Path) -> None:
    network = VgnNetwork()
    save_weights(tmp_path / "w.safetensors", network.state_dict(), INFO)
    assert read_weights(tmp_path / "w.safetensors")[1] == INFO
    again = load_weights(VgnNetwork(), "vgn", tmp_path / "w.safetensors").state_dict()
    assert all(torch.equal(value, again[name]) for name, value in network.state_dict().items())


def test_weights_of_another_method_are_refused(path: Path) -> None:
    with pytest.raises(BaselineWeightsError, match=r"holds weights of vgn; expected giga's"):
        load_weights(GigaNetwork(), "giga", path)
    tensors, _ = read_weights(path)
    save_weights(path, {**tensors, "more": torch.zeros(1)}, INFO)
    with pytest.raises(PublishedWeightsError, match=r"it has beside them more"):
        load_weights(VgnNetwork(), "vgn", path)


def test_damage_is_noticed(path: Path) -> None:
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[-5] ^= 1
    for damaged in (bytes(flipped), whole[:-100], b"no weights", b""):
        path.write_bytes(damaged)
        with pytest.raises(BaselineWeightsError, match=r"vgn.safetensors is damaged"):
            read_weights(path)


def test_files_of_others_are_refused(path: Path) -> None:
    save_file(load_file(path), path, {"format": "pt"})
    with pytest.raises(BaselineWeightsError, match=r"is of format \('pt', None\); expected"):
        read_weights(path)
    with pytest.raises(BaselineWeightsError, match=r"nowhere.safetensors is damaged or no"):
        read_weights(path.with_name("nowhere.safetensors"))
