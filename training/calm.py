"""How calm tiles are, in PyTorch: export.calm, without gradients."""
from __future__ import annotations

import torch
from torch import Tensor

from export.calm import DETAIL_EPS, DETAIL_GAIN, LEAST_DETAIL, MOST_DETAIL, SIDE, spacing


@torch.no_grad()
def calm_share(radiance: Tensor) -> Tensor:
    """Shares of calm cells, [N,1,1,1], of exposed radiance [N,3,H,W]."""
    light = (radiance[:, 0] + radiance[:, 1]) + radiance[:, 2]
    if min(light.shape[1:]) <= SIDE:
        return light.new_zeros(light.shape[0], 1, 1, 1)
    step = spacing(*light.shape[1:])
    cells = light.unfold(1, SIDE + 1, step).unfold(2, SIDE + 1, step)
    detail = cells.diff(dim=3).diff(dim=4).abs().sum((3, 4)) * float(DETAIL_GAIN)
    base = cells[..., :SIDE, :SIDE].sum((3, 4)) + float(DETAIL_EPS)
    counts = detail >= base * float(LEAST_DETAIL)
    calm = counts & (detail < base * float(MOST_DETAIL))
    share = calm.sum((1, 2)) / counts.sum((1, 2)).clamp(min=1)
    return share.view(-1, 1, 1, 1).to(radiance.dtype)
