"""Family P: a small network that filters the albedo before a network of family K sees it
(docs/kernel-prediction.md, Prefilter).

It is trained by itself, on albedo alone (`python -m training.train alb -m prefilter`, `export
--int8`), and given to the training of a K model with --prefilter, which does not change it.
"""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from export.kernel import PICKED, TAPS, without_black
from export.smooth import RUN, STEADY_BESIDE, STEADY_CODES
from training.cells import between
from training.errors import USAGE, ToolError
from training.kernel_filter import weighted_sums
from training.kernel_net import HeadedNet, padded_heads, to_code
from training.trunk import arithmetic


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
        codes = torch.cat((to_code(x), present), 1)
        return filtered(self.trunk, x, codes.to(arithmetic(x)), present)


def filtered(trunk: Callable[[Tensor], list[Tensor]], albedo: Tensor, codes: Tensor,
             present: Tensor) -> Tensor:
    """Albedo [N,3,H,W] by the kernels of a prefilter's trunk. codes / 255 [N,4,H,W]: those channels
    PICKED of a K model's; present: 0 or 1, [N,1,H,W]."""
    return means(padded_heads(trunk, codes)[0], albedo, present)


def means(q: Tensor, albedo: Tensor, present: Tensor) -> Tensor:
    """5x5 means of albedo [N,3,H,W] by the logits q [N,25,H,W], of what is present; 0 elsewhere."""
    sums = weighted_sums(q, torch.cat((present, present * albedo), 1), True)
    return sums[:, 1:] / sums[:, :1].clamp(min=1e-12) * present


def unsteady(light: Tensor) -> Tensor:
    """How much of the prefiltered albedo is taken, [N,1,H,W] in [0,1]: none where light is steady
    along rows (export.smooth.unsteady). light: codes of a K model's input, 0..255, [N,1,H,W]."""
    before, here, after = F.pad(light, (1, 1)).unfold(3, 3, 1).unbind(-1)
    steady = (2 * here - before - after).abs() <= STEADY_CODES
    steady = (steady & (before * here * after > 0)).to(light.dtype)
    counts = torch.cat((torch.ones_like(steady), steady), 1)
    counts = F.pad(counts, (0, -light.shape[3] % RUN)).unflatten(3, (-1, RUN)).sum(-1)
    runs = F.pad(counts, (STEADY_BESIDE, STEADY_BESIDE)).unfold(3, 2 * STEADY_BESIDE + 1, 1)
    pixels, steadily = runs.sum(-1).chunk(2, 1)
    share = (2.0 - steadily / pixels * 5.0).clamp(0.0, 1.0)
    return between(share, light.shape, (1, RUN))


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
