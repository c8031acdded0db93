"""Family K between network codes, so that it trains, validates and denoises as family U does.

A model of family U maps codes of the features [N,C,H,W] to codes of the result. `KernelModel` does,
too; around the network it decodes the radiance, and encodes the filtered one. Its input always has
the 12 planes that `planes` arranges: radiance code, albedo, normal, and three flags.
"""
from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from export.albedo import counted_albedo
from export.kernel import LAST_STEPS
from training import color
from training.grain import without_grain
from training.kernel_filter import apply_filter, smooth_result
from training.kernel_net import KernelNet, encode, padded_heads
from training.pointwise import from_codes, to_codes
from training.trunk import arithmetic

PLANES = 12     # 0-2 radiance code, 3-5 albedo, 6-8 normal code, 9-11 flags (below)
LOWEST = 1e-6   # radiance below this has no gradient worth following in a transfer function
FEATURES = ("hdr", "ldr", "alb", "nrm")  # that the family knows
LONE = ("alb", "nrm")                    # those that are the main one where they are alone


def planes(codes: np.ndarray, features: list[str], has_albedo: bool = True,
           has_normal: bool = True, clipped: bool = False) -> np.ndarray:
    """Codes [H,W,C] of the features, the main one first -> [H,W,12]; what is absent is 0, and black
    albedo is white. An albedo or normals alone stand in for the radiance, and for normals beside
    it: their codes are linear ones.

    clipped: the radiance ends at 1 (always so unless it is `hdr`).
    """
    out = np.zeros((*codes.shape[:2], PLANES), np.float32)
    out[..., :3] = codes[..., :3]
    for at, flag, feature, wanted in ((3, 9, "alb", has_albedo), (6, 10, "nrm", has_normal)):
        if wanted and feature in features[1:]:
            k = 3 * features.index(feature)
            out[..., at:at + 3] = codes[..., k:k + 3]
            out[..., flag] = 1
    if features[0] in LONE:
        out[..., 6:9], out[..., 10] = codes[..., :3], 1
    if out[..., 9].any():
        out[..., 3:6] = counted_albedo(out[..., 3:6], out[..., :3])
    out[..., 11] = clipped or features[0] != "hdr"
    return out


def run(trunk: Callable[[Tensor], list[Tensor]], transfer: str, x: Tensor,
        kind: torch.dtype = torch.float32, bilateral: int = 0) -> Tensor:
    """Codes [N,12,H,W] -> codes [N,3,H,W] of the filtered radiance, any height and width.

    trunk: network input (codes / 255) in `kind`, sides multiples of ALIGN -> heads by level.
    bilateral: export.kernel.BILATERAL, steps before and after that have no weights; 0 without. A
    model for an albedo or normals alone finds them in x (`planes`).
    """
    radiance = from_codes(transfer, x[:, :3])
    codes = given = encode(radiance, x, kind)
    albedo = x[:, 3:6]
    steps = LAST_STEPS.get(bilateral)
    if steps:
        given = (given.to(x.dtype) * 255.0).round()
    if steps and steps.cleans:
        x = without_grain(x, given[:, 1:2])
        codes = encode(radiance, x, kind)
    heads = padded_heads(trunk, codes)
    out, smooth, noise = apply_filter(heads, radiance, x[:, 3:6], x[:, 9:10])
    if steps:
        normal = (2.0 * x[:, 6:9] - 1.0) * x[:, 10:11]
        out = smooth_result(out, smooth, noise, radiance, given, albedo, normal, heads[0],
                            bilateral)
    return to_codes(transfer, out, LOWEST, color.HDR_MAX)


class KernelModel(KernelNet):
    """A K net that maps the codes of `planes` to those of the result.

    bilateral: that of `run`, in evaluation mode; in training only if `learns_last_steps`."""

    align = 1  # it pads by itself
    bilateral, learns_last_steps = 0, False

    def __init__(self, net, heads, widths: list[int], transfer: str = "pu"):
        super().__init__(net, heads, widths)
        self.transfer = transfer

    def forward(self, x: Tensor) -> Tensor:
        return run(self.trunk, self.transfer, x, arithmetic(x),
                   bilateral=self.bilateral * (self.learns_last_steps or not self.training))
