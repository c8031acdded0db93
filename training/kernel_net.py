"""Family K: a network that predicts the weights of a filter (docs/kernel-prediction.md).

Codes are held as value/255 in floating point and rounded to whole codes, so what is trained is what
the integer engine computes up to the rounding inside the trunk.
"""
from __future__ import annotations

import math
from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from export.graph import ALIGN, Head, Net
from training import fused
from training.kernel_filter import EPS, LEVELS, RADIANCE_MAX, Round, apply_filter, planar
from training.trunk import Conv, Trunk, usable

INPUTS = 12
LOG_GAIN, LOG_TOP = 32.0, 128.0   # radiance code: ln(1 + 32 I) / ln(1 + 32 * 128)
LOG_SCALE = 1.0 / math.log1p(LOG_GAIN * LOG_TOP)
HEAD_WIDTHS = (52, 27, 27, 27, 27)


def to_code(x: Tensor) -> Tensor:
    """[0,1] values as codes / 255."""
    return Round.apply(x.clamp(0.0, 1.0) * 255.0) / 255.0


def mixed_input(radiance: Tensor, albedo: Tensor, normal: Tensor, has_albedo: Tensor,
                has_normal: Tensor, clipped: Tensor) -> Tensor:
    """Codes / 255 of the network's input, [N,12,H,W]; radiance exposed, normal in [-1,1]; presence
    planes [N,1,H,W] of 0 or 1."""
    divisor = albedo * has_albedo + (1.0 - EPS) * (1.0 - has_albedo) + EPS
    i = radiance.clamp(0.0, RADIANCE_MAX) / divisor
    log = torch.log1p(LOG_GAIN * i) * LOG_SCALE
    nrm = (normal * 0.5 + 0.5) * has_normal + (128.0 / 255.0) * (1.0 - has_normal)
    x = torch.cat((log, albedo * has_albedo, nrm, has_albedo, has_normal, clipped), 1)
    return to_code(x)


def encode(radiance: Tensor, x: Tensor, kind: torch.dtype = torch.float32) -> Tensor:
    """mixed_input from the planes of kernel_model.planes and their radiance, in the given type."""
    if fused.usable(radiance, x):
        constants = EPS, RADIANCE_MAX, LOG_GAIN, LOG_SCALE
        out = fused.module().encode(planar(radiance), planar(x), constants,
                                    kind == torch.bfloat16 and x.dtype == torch.float32)
    else:
        out = mixed_input(radiance, x[:, 3:6], x[:, 6:9] * 2 - 1, x[:, 9:10], x[:, 10:11],
                          x[:, 11:12])
    return out.to(kind)


def padded_heads(trunk: Callable[[Tensor], list[Tensor]], codes: Tensor) -> list[Tensor]:
    """Heads by level of a trunk, for codes of any height and width; padding is no part of them."""
    h, w = codes.shape[-2:]
    if not (h % ALIGN or w % ALIGN):
        return trunk(codes)
    heads = trunk(F.pad(codes, (0, -w % ALIGN, 0, -h % ALIGN)))
    return [head[..., :-(-h >> s), :-(-w >> s)] for s, head in enumerate(heads)]


class KernelNet(nn.Module):
    """The trunk and heads of a K net; `forward` filters an image with them."""

    def __init__(self, net: Net, heads: list[Head], widths: list[int]):
        super().__init__()
        self.net, self.heads, self.inputs, self.outputs = net, heads, INPUTS, 3
        out = {}
        for layer, (cin, cout) in zip(net.layers, net.channels(INPUTS, widths), strict=True):
            self.add_module(layer.name, nn.Conv2d(cin, cout, 3, padding=1))
            out[layer.name] = cout
        for head in heads:
            conv = nn.Conv2d(out[head.source], HEAD_WIDTHS[head.level], 1)
            with torch.no_grad():
                conv.bias.fill_(8.0)
                conv.weight.mul_(0.3)
            self.add_module(head.name, conv)
        self.convs = [Conv(x.name, x.source, x.skip, x.up, x.pool, 1)
                      for x in net.layers] + [Conv(x.name, x.source, None, False, False, 0)
                                              for x in heads]

    def trunk(self, x: Tensor) -> list[Tensor]:
        """Input codes [N,12,H,W] -> heads by level [N,C,H/2^s,W/2^s], logits before rounding."""
        if usable(x):
            modules = [getattr(self, conv.name) for conv in self.convs]
            found = Trunk.apply(self.convs, x, *(p for m in modules for p in (m.weight, m.bias)))
            levels = [head.level for head in self.heads]
            return [found[levels.index(level)] for level in range(LEVELS)]
        values = {"input": x}
        for layer in self.net.layers:
            y = values[layer.source]
            if layer.up:
                y = F.interpolate(y, scale_factor=2, mode="nearest")
            if layer.skip:
                y = torch.cat((y, values[layer.skip]), 1)
            y = F.relu_(getattr(self, layer.name)(y))
            values[layer.name] = F.max_pool2d(y, 2) if layer.pool else y
        heads = [None] * LEVELS
        for head in self.heads:
            heads[head.level] = getattr(self, head.name)(values[head.source])
        return heads

    def forward(self, codes: Tensor, radiance: Tensor, albedo: Tensor,
                has_albedo: Tensor) -> Tensor:
        """Filtered radiance. radiance (exposed) and albedo [N,3,H,W], has_albedo [N,1,H,W]."""
        heads = self.trunk(codes)
        return apply_filter(heads, radiance, albedo, has_albedo)[0]

    def macs_per_pixel(self) -> float:
        """Multiply-adds of the network per pixel, unfolded."""
        layers = sum(area * getattr(self, layer.name).weight.numel()
                     for layer, area in zip(self.net.layers, self.net.areas(), strict=True))
        return layers + sum(getattr(self, head.name).weight.numel() / 4**head.level
                            for head in self.heads)
