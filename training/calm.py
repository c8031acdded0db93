"""How calm tiles are, in PyTorch: export.calm, without gradients."""
from __future__ import annotations

import torch
from torch import Tensor

from export.calm import DETAIL_EPS, DETAIL_GAIN, LEAST_DETAIL, MOST_DETAIL, SIDE, spacing


def cells_of(image: Tensor) -> Tensor:
    """Sums of the channels of images [N,3,H,W] in cells, [N,rows,columns,SIDE+1,SIDE+1]."""
    light = (image[:, 0] + image[:, 1]) + image[:, 2]
    if min(light.shape[1:]) <= SIDE:
        return light.new_empty(len(light), 0, 0, SIDE + 1, SIDE + 1)
    step = spacing(*light.shape[1:])
    return light.unfold(1, SIDE + 1, step).unfold(2, SIDE + 1, step)


@torch.no_grad()
def details_of(radiance: Tensor) -> tuple[Tensor, Tensor]:
    """Detail of cells of exposed radiance [N,3,H,W], and what it is relative to."""
    cells = cells_of(radiance)
    detail = cells.diff(dim=3).diff(dim=4).abs().sum((3, 4)) * float(DETAIL_GAIN)
    return detail, cells[..., :SIDE, :SIDE].sum((3, 4)) + float(DETAIL_EPS)


def share_of(part: Tensor, whole: Tensor) -> Tensor:
    """export.calm.share_of of each tile, [N,1,1,1]."""
    dims = tuple(range(1, whole.dim()))
    return (part.sum(dims) / whole.sum(dims).clamp(min=1)).view(-1, 1, 1, 1)


def calm_share(details: tuple[Tensor, Tensor]) -> Tensor:
    """Shares of calm cells, [N,1,1,1], of the `details_of` images."""
    detail, base = details
    counts = detail >= base * float(LEAST_DETAIL)
    calm = counts & (detail < base * float(MOST_DETAIL))
    return share_of(calm, counts).to(base.dtype)
