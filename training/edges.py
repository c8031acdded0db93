"""Averages along edges in PyTorch: export.edges, gradients by the result."""
from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from export.calm import LEAST_DETAIL, WILD_DETAIL
from export.edges import (CONTRAST, EDGE_EPS, EVENNESS, FEW, FLAT, LINES, SHARE, SHARP, STEP, TINY,
                          WILD)
from training.calm import Details, cells_of, ramp, share_of


@torch.no_grad()
def ragged(details: Details, albedo: Tensor, has_albedo: Tensor) -> Tensor:
    """How ragged edges are, [N,1,1,1], as export.edges.ragged: of the `details_of` exposed radiance
    and albedo [N,3,H,W], 0 where has_albedo [N,1,1,1] is."""
    detail, base, _ = details
    counts = detail >= base * float(LEAST_DETAIL)
    wild = share_of(counts & (detail >= base * float(WILD_DETAIL)), counts)
    cells = cells_of(albedo)
    runs = torch.cat((cells, cells.transpose(3, 4)), 3)
    beside, far = runs.diff(dim=4).abs(), (runs[..., 1] - runs[..., 3]).abs()
    flat = float(FLAT)
    edges = (beside[..., 0] <= flat) & (beside[..., 3] <= flat) & (far >= float(STEP))
    sharp = edges & (torch.minimum(beside[..., 1], beside[..., 2]) <= flat)
    of_sharp = ramp(share_of(sharp, edges), SHARP)
    of_sharp = torch.where(edges.sum((1, 2, 3)).view(-1, 1, 1, 1) >= FEW, of_sharp, 1.0)
    return ramp(wild, WILD) * of_sharp * (has_albedo > 0)


def averaged(result: Tensor, raggedness: Tensor) -> Tensor:
    """export.edges.averaged of tensors [N,3,H,W]; raggedness: [N,1,1,1]."""
    h, w = result.shape[-2:]
    strength = raggedness * float(SHARE)
    if min(h, w) < 3 or not strength.any():
        return result

    def beside(v: Tensor, k: tuple[int, int]) -> Tensor:
        return v[..., 1 + k[0]:h - 1 + k[0], 1 + k[1]:w - 1 + k[1]]

    with torch.no_grad():
        light = (result[:, :1] + result[:, 1:2]) + result[:, 2:]
        here = beside(light, (0, 0))
        changes = torch.cat([(beside(light, a) - here).abs() + (beside(light, b) - here).abs()
                             for a, b in LINES], 1)
        least, line = changes.min(1, keepdim=True)
        most = changes.amax(1, keepdim=True)
        contrast = ramp(most / (here + float(EDGE_EPS)), CONTRAST)
        share = contrast * ramp((most - least) / (most + float(TINY)), EVENNESS) * strength
    v = beside(result, (0, 0))
    sums = torch.zeros_like(v)
    for i, (a, b) in enumerate(LINES):
        sums = torch.where(line == i, beside(result, a) + beside(result, b), sums)
    return result + F.pad(share * (sums - (v + v)), (1, 1, 1, 1))
