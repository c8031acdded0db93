"""export.regression in PyTorch, differentiable; sums in PyTorch's order."""
from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from export.regression import (CHANNELS, EPS, FEATURES, MOST, MOST_REST, RIDGE, RIDGE_OF_NOISE,
                               SIDE)
from training.cells import between, means_in_bands


def features_of(normal: Tensor, smooth: Tensor) -> Tensor:
    """Filtered normal and divisor [N,3,H,W] -> [N,FEATURES,H,W]."""
    return torch.cat((normal, smooth), 1)


def products(out: Tensor, smooth: Tensor, features: Tensor, radiance: Tensor) -> Tensor:
    """[N,SUMS,H,W]; see export.regression.products."""
    p = out * smooth
    e = ((radiance - p) / (p + float(EPS))).clamp(max=float(MOST_REST))
    squares = [features[:, i:i + 1] * features[:, i:] for i in range(FEATURES)]
    mixed = [features[:, i:i + 1] * e for i in range(FEATURES)]
    return torch.cat((torch.ones_like(e[:, :1]), features, e, *squares, *mixed,
                      e.square().sum(1, keepdim=True)), 1)


def windows(sums: Tensor) -> Tensor:
    """Sums of cells and those around them, by weights 1, 2, 1 in both directions, [N,C,H,W]."""
    v = F.pad(sums, (1, 1, 1, 1))
    v = (v[..., :-2, :] + v[..., 2:, :]) + 2.0 * v[..., 1:-1, :]
    return (v[..., :-2] + v[..., 2:]) + 2.0 * v[..., 1:-1]


def coefficients(sums: Tensor) -> Tensor:
    """[N,SUMS,H,W] of `windows` -> [N,COEFFICIENTS,H,W]."""
    n = FEATURES
    f, e, squares, mixed, ee = (sums[:, 1:] / sums[:, :1]).split(
        (n, CHANNELS, n * (n + 1) // 2, n * CHANNELS, 1), 1)
    noise = ee - e.square().sum(1, keepdim=True)
    ridge = float(RIDGE) + float(RIDGE_OF_NOISE) * (noise / 3.0).clamp(min=0.0)
    fs = f.split(1, 1)
    y = [m - x * e for m, x in zip(mixed.split(CHANNELS, 1), fs, strict=True)]
    squares, lower, scaled, k = squares.split(1, 1), {}, {}, 0
    for i in range(n):
        for j in range(i, n):
            a = squares[k] - fs[i] * fs[j]
            a = a + ridge if i == j else a
            for t in range(i):
                a = a - lower[j, t] * scaled[i, t]
            scaled[j, i] = a
            k += 1
        for j in range(i + 1, n):
            lower[j, i] = scaled[j, i] / scaled[i, i]
    b: dict[int, Tensor] = {}
    for i in range(n):
        for t in range(i):
            y[i] = y[i] - lower[i, t] * y[t]
    for i in reversed(range(n)):
        b[i] = y[i] / scaled[i, i]
        for t in range(i + 1, n):
            b[i] = b[i] - lower[t, i] * b[t]
    constant = -sum(fs[i] * b[i] for i in range(n))
    return torch.cat((*(b[i] for i in range(n)), constant), 1)


def regressed(out: Tensor, smooth: Tensor, features: Tensor, radiance: Tensor) -> Tensor:
    """export.regression.regressed of tensors [N,C,H,W]."""
    sums = windows(means_in_bands(products, SIDE, out, smooth, features, radiance))
    *slopes, share = coefficients(sums).split(CHANNELS, 1)
    share = between(share, out.shape, SIDE)
    for f, slope in zip(features.split(1, 1), slopes, strict=True):
        share = share + f * between(slope, out.shape, SIDE)
    return out + out * share.clamp(-float(MOST), float(MOST))
