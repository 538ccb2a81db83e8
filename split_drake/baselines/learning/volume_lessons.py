"""Batches of fields with the palms' poses that are labelled in them, for VGN and GIGA.

Both papers label palms all over a scene: wherever none of six turns holds, the palm is false.
Labels here are those that SPLIT learns from, grasps across antipodal lines.  So that the networks
are told of all other places, too, palms are drawn near whatever surface, and are false where no
true one is near.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from split_drake.bad_input import BadInputError
from split_drake.baselines.learning.fields import SceneFields
from split_drake.baselines.palm_frame import palms_of_grippers
from split_drake.baselines.tsdf import RESOLUTION
from split_drake.data.dataset import SceneDataset
from split_drake.data.labels import PoseState
from split_drake.pose_task import GRASP

# Palms of a scene in a batch.
TRUE, FALSE, ELSEWHERE = 48, 32, 32
# A palm elsewhere lies at most so far from a voxel near a surface, along each axis, and is false
# where no true one is nearer than that.
REACH_VOXELS, FAR_VOXELS = 3.0, 2.5
# False palms nearer to a true one are left out.
DOUBTFUL_VOXELS = 1.0
_TINY = 1e-9
_CHUNK = 500


class LabelledPalms(NamedTuple):
    """Palms' poses in a batch of fields.

    Attributes:
        fields: (B, r, r, r) in [0, 1].
        voxels: (B, N, 3) positions in voxels, in V.
        quaternion_xyzw: (B, N, 4); of those that are not true, anything.
        width_voxels: (B, N) of what is pinched.
        label: (B, N) 1 for true ones, else 0.
        counted: (B, N) 0 for those that lie outside, or of which nobody knows, else 1.
    """

    fields: Tensor
    voxels: Tensor
    quaternion_xyzw: Tensor
    width_voxels: Tensor
    label: Tensor
    counted: Tensor


@dataclass(frozen=True)
class VolumeScenes:
    """All scenes of a dataset with their fields.

    Attributes:
        fields: (S, V, r, r, r) uint8.
        voxels: (S, L, 3) palms' positions in voxels.
        quaternion_xyzw: (S, L, 4).
        width_voxels: (S, L).
        weights: (S, L) how often to learn each true palm.
        false: (S, L) whether a palm is false.
        points: (K, P, 3) places in voxels, the same for all scenes of each of K shards.
        shard_index: (S,) whose points are a scene's.
        occupied: (S, P / 8) uint8: whether they lie within an object, eight to a byte.
    """

    fields: Tensor
    voxels: Tensor
    quaternion_xyzw: Tensor
    width_voxels: Tensor
    weights: Tensor
    false: Tensor
    points: Tensor
    shard_index: Tensor
    occupied: Tensor

    @classmethod
    def of(cls, dataset: SceneDataset, folder: Path | None) -> Self:
        """Return the scenes of a dataset of clutter, whose subjects are scenes.

        Raises BadInputError where it is none, and DatasetError where the fields are not its own.
        """
        if folder is None:
            raise BadInputError(
                "--fields is missing: the method learns from fields; "
                "split_drake.baselines.learning.draw_fields makes them of the dataset"
            )
        if not np.array_equal(dataset.object_index, np.arange(len(dataset))):
            raise BadInputError("the dataset shows mugs; expected one of clutter")
        kept = SceneFields.open(folder, dataset.shard_names, dataset.dataset_hash)
        labels = dataset.labels[GRASP.name]
        true = labels.states == PoseState.TRUE
        X_WTs = palms_of_grippers(labels.X_OPs.astype(float))
        voxel_m = dataset.workspace.edge_m / RESOLUTION
        quaternions = Rotation.from_matrix(X_WTs[..., :3, :3].reshape(-1, 3, 3)).as_quat()
        widths = np.zeros(true.shape, np.float32)
        widths[:, : kept.widths_m.shape[1]] = kept.widths_m
        return cls(
            torch.from_numpy(kept.fields),
            _tensor((X_WTs[..., :3, 3] - dataset.workspace.p_WV) / voxel_m),
            _tensor(quaternions.reshape(*true.shape, 4)),
            _tensor(widths / voxel_m),
            _tensor(np.where(true, labels.weights, 0.0)),
            torch.from_numpy(labels.states == PoseState.FALSE),
            _tensor(kept.p_VPs / voxel_m),
            torch.from_numpy(kept.shard_index),
            torch.from_numpy(kept.occupied),
        ).without_doubtful()

    def __len__(self) -> int:
        return len(self.fields)

    def without_doubtful(self) -> Self:
        """Return the scenes without false palms that true ones are near.

        A voxel has one grasp, and is good where that is.
        """
        false = self.false.clone()
        for start in range(0, len(self), _CHUNK):
            part = slice(start, start + _CHUNK)
            apart = torch.cdist(self.voxels[part], self.voxels[part])
            true = self.weights[part] > 0.0
            false[part] &= ~((apart < DOUBTFUL_VOXELS) & true[:, None]).any(-1)
        return replace(self, false=false)

    def draw(self, chosen: Tensor, generator: torch.Generator) -> LabelledPalms:
        """Return fields of scenes (B,), each with the noise of one of its images, and palms."""
        noise = torch.randint(self.fields.shape[1], (len(chosen),), generator=generator)
        fields = self.fields[chosen, noise].float() / 255.0
        true = torch.multinomial(self.weights[chosen], TRUE, True, generator=generator)
        # Where a scene has none, what is drawn doesn't count.
        likely = self.false[chosen].float() + _TINY
        false = torch.multinomial(likely, FALSE, True, generator=generator)
        drawn = torch.cat([true, false], 1)
        scene = chosen[:, None]
        elsewhere, known = self._elsewhere(fields, chosen, generator)
        empty = elsewhere.new_zeros(elsewhere.shape[:2])
        upright = torch.cat([empty[..., None]] * 3 + [empty[..., None] + 1.0], -1)
        voxels = torch.cat([self.voxels[scene, drawn], elsewhere], 1)
        label = torch.zeros(voxels.shape[:2])
        label[:, :TRUE] = 1.0
        sure = torch.cat([torch.ones(true.shape).bool(), self.false[scene, false], known], 1)
        return LabelledPalms(
            fields,
            voxels,
            torch.cat([self.quaternion_xyzw[scene, drawn], upright], 1),
            torch.cat([self.width_voxels[scene, drawn], empty], 1),
            label,
            sure * inside(voxels),
        )

    def _elsewhere(
        self, fields: Tensor, chosen: Tensor, generator: torch.Generator
    ) -> tuple[Tensor, Tensor]:
        """Return positions (B, E, 3) near surfaces, and (B, E) whether no true palm is near."""
        seen = (fields.flatten(1) > 0.0).float()
        cells = torch.multinomial(seen, ELSEWHERE, True, generator=generator)
        x, rest = cells // RESOLUTION**2, cells % RESOLUTION**2
        corner = torch.stack([x, rest // RESOLUTION, rest % RESOLUTION], -1)
        moved = (2.0 * torch.rand(corner.shape, generator=generator) - 1.0) * REACH_VOXELS
        voxels = (corner + 0.5 + moved).clamp(0.0, RESOLUTION - 1.0)
        apart = torch.cdist(voxels, self.voxels[chosen])
        apart = torch.where(self.weights[chosen][:, None] > 0.0, apart, torch.inf)
        return voxels, apart.amin(-1) > FAR_VOXELS

    def draw_points(
        self, chosen: Tensor, count: int, generator: torch.Generator
    ) -> tuple[Tensor, Tensor]:
        """Return points (B, count, 3), in voxels, and (B, count) 1 within an object, else 0."""
        number = torch.randint(self.points.shape[1], (len(chosen), count), generator=generator)
        points = self.points[self.shard_index[chosen][:, None], number]
        byte = self.occupied[chosen[:, None], number // 8]
        # `numpy.packbits` puts the first of eight into the highest bit.
        return points, ((byte >> (7 - number % 8)) & 1).float()


def inside(voxels: Tensor) -> Tensor:
    """Return (B, N) 1 for positions (B, N, 3) whose nearest corner is that of a voxel, else 0."""
    nearest = voxels.round()
    return ((nearest >= 0.0) & (nearest < RESOLUTION)).all(-1).float()


def _tensor(values: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
