"""How calm tiles are, in PyTorch: export.calm, without gradients."""
from __future__ import annotations

import torch
from torch import Tensor

from export.calm import DETAIL_EPS, DETAIL_GAIN, LEAST_DETAIL, MOST_DETAIL, SIDE, spacing


def cells_of(image: Tensor) -> Tensor:
    """Sums of the channels of images [N,3,H,W] in cells, [N,rows,columns,SIDE+1,SIDE+1]."""
    light = (image[:, 0] + image[:, 1]) + image[:, 2]
    step = spacing(*light.shape[1:])
    return light.unfold(1, SIDE + 1, step).unfold(2, SIDE + 1, step)


def details_of(radiance: Tensor) -> tuple[Tensor, Tensor]:
    """Detail of cells of exposed radiance [N,3,H,W], and what it is relative to."""
    cells = cells_of(radiance)
    detail = cells.diff(dim=3).diff(dim=4).abs().sum((3, 4)) * float(DETAIL_GAIN)
    return detail, cells[..., :SIDE, :SIDE].sum((3, 4)) + float(DETAIL_EPS)


def share_of(part: Tensor, whole: Tensor) -> Tensor:
    """export.calm.share_of of each tile, [N,1,1,1]."""
    dims = tuple(range(1, whole.dim()))
    return (part.sum(dims) / whole.sum(dims).clamp(min=1)).view(-1, 1, 1, 1)


@torch.no_grad()
def calm_share(radiance: Tensor) -> Tensor:
    """Shares of calm cells, [N,1,1,1], of exposed radiance [N,3,H,W]."""
    if min(radiance.shape[-2:]) <= SIDE:
        return radiance.new_zeros(radiance.shape[0], 1, 1, 1)
    detail, base = details_of(radiance)
    counts = detail >= base * float(LEAST_DETAIL)
    calm = counts & (detail < base * float(MOST_DETAIL))
    return share_of(calm, counts).to(radiance.dtype)
