"""export.grain in PyTorch: where albedo or normals are noise from pixel to pixel, means of a wide
window stand for them. Nothing of it is trained."""
from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from export.grain import (AROUND, OF_ALBEDO_LEAST, OF_NORMAL, OF_NORMAL_LEAST, OWN, PAIRS, PER_CODE,
                          REAL, SIDE, STEPS, SUMS, WHITE, WHITER, Least)
from training.cells import between, cell_means
from training.kernel_filter import planar
from training.regression import windows


def products(codes: Tensor, here: Tensor) -> Tensor:
    """export.grain.products of tensors: codes of a feature [N,3,H,W] -> [N,SUMS,H,W]; here: which
    pixels count, 0 or 1, [N,1,H,W]."""
    r, g, b = codes.split(1, 1)
    light = ((r + 2.0 * g + b) / 4.0).floor()
    squares = []
    for dx, dy in STEPS:
        there = F.pad(torch.cat((light, here), 1), (1, 1, 0, 1))
        there = there[..., dy:dy + light.shape[2], 1 + dx:1 + dx + light.shape[3]]
        square = (there[:, :1] - light).square() * there[:, 1:]
        if dx:  # pairs within a cell
            square[..., (SIDE - 1 if dx > 0 else 0)::SIDE] = 0.0
        if dy:
            square[..., SIDE - 1::SIDE, :] = 0.0
        squares.append(square)
    return torch.cat((torch.ones_like(light), light, light.square(), codes, *squares), 1) * here


def light_steps(codes: Tensor, here: Tensor) -> Tensor:
    """export.grain.light_steps of tensors: the light's codes [N,1,H,W] -> squares, alike."""
    steps = F.pad(codes.diff().square() * here[..., 1:], (0, 1)) * here
    steps[..., SIDE - 1::SIDE] = 0.0
    return steps


def shares(sums: Tensor, gain: float, part: Tensor | float,
           least: Least) -> tuple[Tensor, Tensor]:
    """export.grain.shares of tensors, [N,SUMS + 1,H,W] -> [N,1,H,W] and [N,3,H,W];
    part: or [N,1,H,W]."""
    flat, rise = map(float, least)
    m = 1.0 / sums[:, :1].clamp(min=1.0 / SIDE**2)
    mean = sums[:, 1:2] * m
    variance = sums[:, 2:3] * m - mean * mean
    straight, diagonal = (sums[:, k:k + 2].amin(1, keepdim=True) for k in (6, 8))
    steps = torch.minimum(straight * float(PAIRS[0]), diagonal * float(PAIRS[1]))
    white = (steps * m) * (1.0 / variance.clamp(min=flat))
    noise = ((sums[:, SUMS:] * m) * float(PAIRS[0])).clamp(min=1.0)
    ratio = variance / noise * part
    share = ((white - (float(WHITE) + ratio * float(WHITER))) * gain).clamp(0.0, 1.0)
    share = share * ((variance - flat) * rise).clamp(0.0, 1.0)
    share = share * (2.0 - ratio * float(REAL)).clamp(0.0, 1.0)
    return share, ((sums[:, 3:6] * m) * float(PER_CODE)).clamp(max=1.0)


def cell_grain(sums: Tensor, part: Tensor | float, least: Least) -> Tensor:
    """export.grain.cell_grain of tensors, [N,SUMS + 1,H,W] -> [N,4,H,W]."""
    share, mean = shares(windows(sums), float(AROUND), part, least)
    own, own_mean = shares(sums, float(OWN), part, least)
    own = (1.0 - share) * own
    whole = share + own
    return torch.cat((whole, mean + own / whole.clamp(min=1e-12) * (own_mean - mean)), 1)


def _cleaned(feature: Tensor, here: Tensor, light: Tensor, part: Tensor | float,
             least: Least) -> tuple[Tensor, Tensor]:
    """A feature [N,3,H,W] in [0,1] less its grain, and the shares of its cells."""
    feature, here, light = planar(feature), planar(here), planar(light)
    with torch.no_grad():
        codes = (feature.clamp(0.0, 1.0) * 255.0 + 0.5).floor()  # as export.smooth.to_code
        sums = torch.cat((products(codes, here), light_steps(light, here)), 1)
        cells = cell_grain(cell_means(sums, SIDE), part, least)
        share, mean = between(cells, feature.shape, SIDE).split((1, 3), 1)
        share = share * here
    return feature + share * (mean - feature), cells[:, :1]


def without_grain(x: Tensor, light: Tensor) -> Tensor:
    """export.grain.without_grain of the planes of `kernel_model.planes`, [N,12,H,W], and the code
    of the light, number 1 of the input, [N,1,H,W]: where a flag is 0 the feature stays as it is and
    counts for nothing. Gradients pass to features as if shares and means were constants."""
    normal, cells = _cleaned(x[:, 6:9], x[:, 10:11], light, float(OF_NORMAL), OF_NORMAL_LEAST)
    albedo, _ = _cleaned(x[:, 3:6], x[:, 9:10], light, 1.0 - cells, OF_ALBEDO_LEAST)
    return torch.cat((x[:, :3], albedo, normal, x[:, 9:]), 1)
