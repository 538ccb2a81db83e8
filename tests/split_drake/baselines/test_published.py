"""Parameters that other methods' authors published."""

from pathlib import Path

import pytest
import torch

from split_drake.baselines.giga.network import GigaNetwork
from split_drake.baselines.published import PublishedWeightsError, load_published
from split_drake.baselines.vgn.network import VgnNetwork


def test_parameters_are_read_by_their_names(tmp_path: Path) -> None:
    before = VgnNetwork()
    torch.save(before.state_dict(), tmp_path / "vgn.pt")
    after = load_published(VgnNetwork(), tmp_path / "vgn.pt")
    field = torch.rand(1, 40, 40, 40)
    with torch.inference_mode():
        for mine, theirs in zip(before(field), after(field), strict=True):
            torch.testing.assert_close(mine, theirs)


def test_weights_of_another_method_are_refused(tmp_path: Path) -> None:
    torch.save(VgnNetwork().state_dict(), tmp_path / "vgn.pt")
    with pytest.raises(
        PublishedWeightsError, match=r"vgn.pt does not hold .* GigaNetwork: it lacks"
    ):
        load_published(GigaNetwork(), tmp_path / "vgn.pt")


def test_what_is_missing_more_or_of_another_shape_is_named(tmp_path: Path) -> None:
    path, whole = tmp_path / "vgn.pt", VgnNetwork().state_dict()
    torch.save({name: whole[name] for name in whole if name != "conv_rot.bias"}, path)
    with pytest.raises(PublishedWeightsError, match=r"it lacks conv_rot.bias$"):
        load_published(VgnNetwork(), path)
    torch.save({**whole, "more": torch.zeros(1)}, path)
    with pytest.raises(PublishedWeightsError, match=r"it has beside them more$"):
        load_published(VgnNetwork(), path)
    torch.save({**whole, "conv_rot.bias": torch.zeros(3)}, path)
    with pytest.raises(PublishedWeightsError, match=r"bias has shape \(3,\), expected \(4,\)"):
        load_published(VgnNetwork(), path)
    torch.save({**whole, "conv_rot.bias": torch.full((4,), torch.nan)}, path)
    with pytest.raises(PublishedWeightsError, match=r"NaN or infinite numbers in conv_rot.bias"):
        load_published(VgnNetwork(), path)


class _Pickled:
    """Something that a state dictionary never holds."""


def test_what_is_no_state_dictionary_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "vgn.pt"
    with pytest.raises(PublishedWeightsError, match=r"vgn.pt is no PyTorch state dictionary"):
        load_published(VgnNetwork(), path)
    torch.save(VgnNetwork().state_dict(), path)
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], b"", b"not a file of PyTorch's"):
        path.write_bytes(damaged)
        with pytest.raises(PublishedWeightsError, match=r"vgn.pt is no PyTorch state dictionary"):
            load_published(VgnNetwork(), path)
    for other in ([1, 2], {"a": _Pickled()}, {"a": 3}):
        torch.save(other, path)
        with pytest.raises(PublishedWeightsError, match=r"vgn.pt is no .*state dictionary"):
            load_published(VgnNetwork(), path)
