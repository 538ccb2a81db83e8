"""Damaged weights are not loaded, and older files can be given a checksum."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from split_drake.experiments.provenance import file_sha256
from split_drake.split.checkpoint import (
    CHECKSUM,
    CheckpointError,
    content_sha256,
    default_weights,
    load_checkpoint,
    read_content,
)
from split_drake.split.stamp import STAMPED_FROM, StampOptions, known_hashes, main, stamp
from tests.helpers.checkpoints import save_new_network
from tests.helpers.damage import times_told

SHIPPED = tuple(
    default_weights().with_name(f"split_{name}.safetensors") for name in ("mugs", "clutter")
)

# Of the bytes of all tensors, as they were before the file had a checksum.
MUGS_TENSORS_SHA256 = "10f86d2571f8bde7946cd475280d01b96c28bc5daf42e695e883895fc97cdc1d"


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    path = tmp_path / "split.safetensors"
    save_new_network(path)
    return path


def metadata_of(path: Path) -> dict[str, str]:
    with safe_open(path, framework="pt") as file:
        return dict(file.metadata())


def unstamped(path: Path) -> None:
    """Write a checkpoint back as older code wrote it."""
    metadata = metadata_of(path)
    save_file(load_file(path), path, {key: metadata[key] for key in metadata if key != CHECKSUM})


def test_every_flipped_bit_is_told(checkpoint: Path) -> None:
    content, rng = checkpoint.read_bytes(), np.random.default_rng(0)
    for at in rng.integers(len(content), size=60):
        damaged = bytearray(content)
        damaged[at] ^= 1 << int(rng.integers(8))
        checkpoint.write_bytes(damaged)
        with pytest.raises(CheckpointError, match=str(checkpoint)):
            load_checkpoint(checkpoint)
    checkpoint.write_bytes(content)
    assert times_told(checkpoint, load_checkpoint, tries=40) == 40


@pytest.mark.parametrize("factor", [0.0, 1.001])
def test_other_finite_weights_are_told(checkpoint: Path, factor: float) -> None:
    weights = {
        name: tensor * factor if tensor.is_floating_point() else tensor
        for name, tensor in load_file(checkpoint).items()
    }
    save_file(weights, checkpoint, metadata_of(checkpoint))
    with pytest.raises(
        CheckpointError, match=r"is damaged: its content has the SHA-256 .*expected"
    ):
        load_checkpoint(checkpoint)


def test_another_info_is_told(checkpoint: Path) -> None:
    metadata = metadata_of(checkpoint)
    changed = metadata | {"info": metadata["info"].replace('"sigma_max": ', '"sigma_max": 1')}
    assert changed != metadata
    save_file(load_file(checkpoint), checkpoint, changed)
    with pytest.raises(CheckpointError, match="is damaged"):
        load_checkpoint(checkpoint)


def test_a_file_without_a_checksum_is_refused_and_can_be_stamped(
    checkpoint: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unstamped(checkpoint)
    before, metadata, tensors = file_sha256(checkpoint), *read_content(checkpoint)
    command = f"python -m split_drake.split.stamp {checkpoint} adds one"
    with pytest.raises(CheckpointError, match=f"has no checksum, .*{command}"):
        load_checkpoint(checkpoint)
    main(StampOptions((checkpoint,)))
    load_checkpoint(checkpoint)
    stamped, same = read_content(checkpoint)
    assert {key: stamped[key] for key in metadata} == metadata
    assert stamped.keys() - metadata.keys() == {CHECKSUM, STAMPED_FROM}
    assert same.keys() == tensors.keys()
    assert all(same[name].dtype == tensors[name].dtype for name in tensors)
    assert all(torch.equal(same[name], tensors[name]) for name in tensors)
    assert known_hashes(checkpoint) == {before, file_sha256(checkpoint)}
    content = checkpoint.read_bytes()
    assert not stamp(checkpoint)
    assert checkpoint.read_bytes() == content
    assert "checksum added" in capsys.readouterr().out


def test_what_is_damaged_or_no_checkpoint_is_not_stamped(checkpoint: Path) -> None:
    weights = load_file(checkpoint)
    weights["score_head.output.bias"][0] += 1.0
    save_file(weights, checkpoint, metadata_of(checkpoint))
    with pytest.raises(CheckpointError, match=f"{checkpoint} is damaged"):
        stamp(checkpoint)
    save_file(weights, checkpoint, {"format": "pt"})
    content = checkpoint.read_bytes()
    with pytest.raises(CheckpointError, match="format 'pt'"):
        stamp(checkpoint)
    assert checkpoint.read_bytes() == content


def test_the_checksum_does_not_depend_on_the_order_of_tensors() -> None:
    tensors = {"a": torch.zeros(()), "b": torch.ones(2, 3)}
    turned = {"b": tensors["b"], "a": tensors["a"]}
    assert content_sha256({}, tensors) == content_sha256({}, turned)
    flat = {"a": tensors["a"], "b": tensors["b"].reshape(3, 2)}
    assert content_sha256({}, tensors) != content_sha256({}, flat)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_the_weights_that_ship_have_a_checksum(path: Path) -> None:
    metadata, tensors = read_content(path)
    assert metadata[CHECKSUM] == content_sha256(metadata, tensors)


def test_the_weights_for_mugs_are_to_the_bit_those_that_were_measured() -> None:
    content = default_weights().read_bytes()
    header = int.from_bytes(content[:8], "little")
    assert hashlib.sha256(content[8 + header :]).hexdigest() == MUGS_TENSORS_SHA256
