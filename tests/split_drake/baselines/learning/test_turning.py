"""Fields and palms that are turned and raised together."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from split_drake.baselines.learning.grasp_loss import grasp_losses, rotation_error
from split_drake.baselines.learning.turning import (
    quaternion_product,
    raised,
    turned,
    turned_points,
)
from split_drake.baselines.learning.volume_lessons import LabelledPalms


def marked(count: int = 6) -> LabelledPalms:
    """Fields with one voxel set each, and a palm in the middle of that voxel."""
    generator = torch.Generator().manual_seed(3)
    cells = torch.randint(8, 32, (count, 3), generator=generator)
    fields = torch.zeros(count, 40, 40, 40)
    fields[torch.arange(count), cells[:, 0], cells[:, 1], cells[:, 2]] = 1.0
    q = torch.randn(count, 1, 4, generator=generator)
    return LabelledPalms(
        fields,
        cells[:, None] + 0.5,
        q / q.norm(dim=-1, keepdim=True),
        torch.full((count, 1), 4.0),
        torch.ones(count, 1),
        torch.ones(count, 1),
    )


@pytest.mark.parametrize("change", [turned, raised])
def test_palms_stay_with_what_they_are_beside(change: object) -> None:
    before = marked()
    assert callable(change)
    after = change(before, torch.Generator().manual_seed(0))
    assert not torch.equal(before.fields, after.fields)
    for field, voxels in zip(after.fields, after.voxels, strict=True):
        assert torch.equal(torch.nonzero(field)[0] + 0.5, voxels[0])


def test_orientations_turn_as_positions_do() -> None:
    before = marked()
    after = turned(before, torch.Generator().manual_seed(0))
    old = Rotation.from_quat(before.quaternion_xyzw[:, 0].numpy()).as_matrix()
    new = Rotation.from_quat(after.quaternion_xyzw[:, 0].numpy()).as_matrix()
    about_z = Rotation.from_matrix(new @ np.swapaxes(old, 1, 2))
    middle = np.array([20.0, 20.0, 0.0])
    moved = about_z.apply(before.voxels[:, 0].numpy() - middle) + middle
    assert np.allclose(moved, after.voxels[:, 0], atol=1e-4)
    assert len(np.unique(np.round(np.degrees(about_z.magnitude())))) > 1


def test_what_leaves_the_cube_does_not_count() -> None:
    palms = marked()
    voxels = torch.cat([palms.voxels, palms.voxels + torch.tensor([0.0, 0.0, 30.0])], 1)
    twice = LabelledPalms(palms.fields, voxels, *(torch.cat([each, each], 1) for each in palms[2:]))
    after = raised(twice, torch.Generator().manual_seed(0))
    inside = ((after.voxels.round() >= 0) & (after.voxels.round() < 40)).all(-1)
    assert torch.equal(after.counted.bool(), inside) and not inside.all()


def test_quaternions_multiply_as_rotations_do() -> None:
    first, second = Rotation.random(5, rng=0), Rotation.random(5, rng=1)
    found = quaternion_product(torch.tensor(first.as_quat()), torch.tensor(second.as_quat()))
    same = Rotation.from_quat(found.numpy()) * (first * second).inv()
    assert same.magnitude().max() < 1e-9
    quarter = turned_points(torch.tensor([[[30.0, 20.0, 1.0]]]), torch.tensor([1]))
    assert torch.equal(quarter, torch.tensor([[[20.0, 30.0, 1.0]]]))


def test_half_turns_about_the_approach_are_no_error() -> None:
    wanted = Rotation.random(9, rng=2)
    half = wanted * Rotation.from_euler("z", np.pi)
    for same in (wanted, half):
        error = rotation_error(torch.tensor(same.as_quat()), torch.tensor(wanted.as_quat()))
        assert error.abs().max() < 1e-9
    off = wanted * Rotation.from_euler("x", 0.4)
    error = rotation_error(torch.tensor(off.as_quat()), torch.tensor(wanted.as_quat()))
    assert torch.allclose(error, torch.full_like(error, 1.0 - np.cos(0.2)))


def test_only_what_counts_is_lost() -> None:
    palms = marked(2)._replace(
        label=torch.tensor([[1.0], [0.0]]), counted=torch.tensor([[1.0], [0.0]])
    )
    q = palms.quaternion_xyzw
    perfect = grasp_losses(torch.tensor([[1.0], [1.0]]), q, torch.full((2, 1), 4.0), palms)
    assert sum(perfect.values()) == pytest.approx(0.0, abs=1e-6)
    wider = grasp_losses(torch.tensor([[0.5], [1.0]]), q, torch.full((2, 1), 6.0), palms)
    assert wider["width"] == pytest.approx(0.01 * 4.0)
    assert wider["quality"] == pytest.approx(np.log(2.0))
