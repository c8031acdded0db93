"""How calm tiles are, in PyTorch: export.calm, without gradients."""
from __future__ import annotations

import torch
from torch import Tensor

from export.calm import (COARSE, DETAIL_EPS, DETAIL_GAIN, LEAST_DETAIL, MOST_DETAIL, NOT_CALM, SIDE,
                         WILD_DETAIL, spacing)

Details = tuple[Tensor, Tensor, Tensor]  # detail of cells, what it is relative to, if it is noise


def cells_of(image: Tensor) -> Tensor:
    """Sums of the channels of images [N,3,H,W] in cells, [N,rows,columns,SIDE+1,SIDE+1]."""
    light = (image[:, 0] + image[:, 1]) + image[:, 2]
    if min(light.shape[1:]) <= SIDE:
        return light.new_empty(len(light), 0, 0, SIDE + 1, SIDE + 1)
    step = spacing(*light.shape[1:])
    return light.unfold(1, SIDE + 1, step).unfold(2, SIDE + 1, step)


def ramp(v: Tensor, of: tuple[float, float]) -> Tensor:
    """export.smooth.ramp."""
    return ((v - float(of[0])) * float(of[1])).clamp(0.0, 1.0)


@torch.no_grad()
def details_of(radiance: Tensor) -> Details:
    """export.calm.details_of of exposed radiance [N,3,H,W]."""
    cells = cells_of(radiance)
    d = cells.diff(dim=3).diff(dim=4)
    rows = d[..., :-2] + d[..., 2:] + 2 * d[..., 1:-1]
    coarse = rows[..., :-2, :] + rows[..., 2:, :] + 2 * rows[..., 1:-1, :]
    detail = d.abs().sum((3, 4))
    noise = coarse.abs().sum((3, 4)) < detail * float(COARSE)
    base = cells[..., :SIDE, :SIDE].sum((3, 4)) + float(DETAIL_EPS)
    return detail * float(DETAIL_GAIN), base, noise


def share_of(part: Tensor, whole: Tensor) -> Tensor:
    """export.calm.share_of of each tile, [N,1,1,1]."""
    dims = tuple(range(1, whole.dim()))
    return (part.sum(dims) / whole.sum(dims).clamp(min=1)).view(-1, 1, 1, 1)


def calm_share(details: Details) -> Tensor:
    """export.calm.calm_share of each tile, [N,1,1,1], of its `details_of`."""
    detail, base, is_noise = details
    counts = detail >= base * float(LEAST_DETAIL)
    calm = counts & (detail < base * float(MOST_DETAIL))
    rough = counts & ~calm & (detail < base * float(WILD_DETAIL))
    noise = ramp(share_of(rough & is_noise, rough), NOT_CALM)
    return (share_of(calm, counts) * noise).to(base.dtype)
