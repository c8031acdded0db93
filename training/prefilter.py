"""Family P: a small network that filters the albedo before a network of family K sees it
(docs/kernel-prediction.md, step 0).

It is trained by itself, on albedo alone (`python -m training.train alb -m prefilter`, `export
--int8`), and given to the training of a K model with --prefilter, which does not change it.
"""
from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from export.kernel import PICKED, TAPS, without_black
from training.errors import USAGE, ToolError
from training.kernel_filter import RADIUS, SIDE, logits_of
from training.kernel_net import HeadedNet, to_code
from training.trunk import arithmetic

ALIGN = 16  # as the network behind it


class PrefilterModel(HeadedNet):
    """Albedo [N,3,H,W] in [0,1] to the filtered one, any height and width. Black counts as outside
    of the image: `lit` makes it white."""

    align = 1  # it pads by itself

    def __init__(self, net, heads, widths: list[int]):
        super().__init__(net, heads, widths, len(PICKED), (TAPS,))
        with torch.no_grad():
            getattr(self, heads[0].name).bias[TAPS // 2] += 1.0  # begins with less than a mean

    def forward(self, x: Tensor) -> Tensor:
        x = x.clamp(0.0, 1.0)
        present = (x > 0).any(1, keepdim=True).to(x.dtype)
        return self.filtered(x, torch.cat((to_code(x), present), 1), present)

    def filtered(self, albedo: Tensor, codes: Tensor, present: Tensor) -> Tensor:
        """codes / 255 [N,4,H,W]: those channels PICKED of a K model's; present: 0 or 1."""
        h, w = codes.shape[-2:]
        codes = F.pad(codes.to(arithmetic(codes)), (0, -w % ALIGN, 0, -h % ALIGN))
        return means(self.trunk(codes)[0][..., :h, :w], albedo, present)


def means(q: Tensor, albedo: Tensor, present: Tensor) -> Tensor:
    """5x5 means of albedo [N,3,H,W] by the logits q [N,25,H,W], of what is present; 0 elsewhere."""
    weights = logits_of(q.to(albedo.dtype)).exp()
    values = torch.cat((present, present * albedo), 1)
    taps = [(k % SIDE - RADIUS, k // SIDE - RADIUS) for k in range(TAPS)]
    padded = F.pad(values, (RADIUS,) * 4)
    h, w = values.shape[-2:]
    total = sum(weights[:, k:k + 1] * padded[..., y + RADIUS:y + RADIUS + h,
                                             x + RADIUS:x + RADIUS + w]
                for k, (x, y) in enumerate(taps))
    return total[:, 1:] / total[:, :1].clamp(min=1e-12) * present


def lit(albedo: np.ndarray) -> np.ndarray:
    """Albedo [H,W,3] as the filter counts it: black is white."""
    return without_black(albedo).astype(np.float32)


def read_prefilter(path: str) -> PrefilterModel:
    """That of an integer model's file, alone or before a K model, in floating point."""
    from training.nets import prefilter_of
    from training.result import read_weights
    model = prefilter_of(read_weights(Path(path))) if path.endswith(".tza") else None
    if model is None:
        raise ToolError(f"--prefilter {path}: not an integer model (.tza) with a prefilter", USAGE)
    return model
