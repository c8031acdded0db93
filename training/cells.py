"""export.cells in PyTorch, differentiable, on tensors [N,C,H,W]; sums in PyTorch's order."""
from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor


def cell_means(v: Tensor, side: int) -> Tensor:
    """Means over cells of side x side pixels, of what counts 0 outside the image."""
    h, w = v.shape[-2:]
    return F.avg_pool2d(F.pad(v, (0, -w % side, 0, -h % side)), side)


def between(v: Tensor, shape: torch.Size, side: int | tuple[int, int]) -> Tensor:
    """Values of cells at the pixels of an image of this shape, [...,H,W]; side: or (height, width)
    of a cell."""
    v = F.interpolate(v, scale_factor=side, mode="bilinear", align_corners=False)
    return v[..., :shape[-2], :shape[-1]]
