"""Clouds as the network takes them: about their middle, and scaled."""

import torch
from torch import Tensor

from split_drake.baselines.se3dif.network import SCALE


def scaled_cloud(p_WPs: Tensor) -> tuple[Tensor, Tensor]:
    """Return points (N, 3) about their mean and scaled, and that mean (3,), metres in W."""
    middle = p_WPs.mean(0)
    return SCALE * (p_WPs - middle), middle


def drawn_points(p_WPs: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """Return `count` of the points (N, 3), each once where there are as many."""
    if len(p_WPs) >= count:
        return p_WPs[torch.randperm(len(p_WPs), generator=generator)[:count]]
    return p_WPs[torch.randint(len(p_WPs), (count,), generator=generator)]
