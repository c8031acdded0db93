"""export.cells in PyTorch, differentiable, on tensors [N,C,H,W]; sums in PyTorch's order."""
from __future__ import annotations

from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor

BAND = 128  # rows that are computed at once; whole cells of any side


def cell_means(v: Tensor, side: int) -> Tensor:
    """Means over cells of side x side pixels, of what counts 0 outside the image."""
    h, w = v.shape[-2:]
    return F.avg_pool2d(F.pad(v, (0, -w % side, 0, -h % side)), side)


def means_in_bands(products: Callable[..., Tensor], side: int, *images: Tensor) -> Tensor:
    """cell_means of products(*images), band by band where no gradient wants all of them."""
    h = images[0].shape[-2]
    rows = h if torch.is_grad_enabled() else BAND
    return torch.cat([cell_means(products(*(v[..., y:y + rows, :] for v in images)), side)
                      for y in range(0, h, rows)], -2)


def between(v: Tensor, shape: torch.Size, side: int | tuple[int, int]) -> Tensor:
    """Values of cells at the pixels of an image of this shape, [...,H,W]; side: or (height, width)
    of a cell."""
    v = F.interpolate(v, scale_factor=side, mode="bilinear", align_corners=False)
    return v[..., :shape[-2], :shape[-1]]
