"""Averages along edges in numpy (docs/kernel-prediction.md, step 9), to the bit: where each pixel
saw one place, edges are ragged."""
from __future__ import annotations

import numpy as np

from export.calm import LEAST_DETAIL, WILD_DETAIL, cells_of, details_of, share_of
from export.smooth import ramp

F = np.float32
WILD = F(0.25), F(6.6666667)       # share of wild cells: from where on, by which slope
FLAT, STEP = F(0.03), F(0.3)       # of the sum of the albedo's channels: beside an edge, across it
FEW = 16                           # edges that tell nothing
SHARP = F(0.3), F(5)               # share of sharp ones, as WILD

LINES = (((0, -1), (0, 1)), ((-1, 0), (1, 0)), ((-1, -1), (1, 1)), ((-1, 1), (1, -1)))  # (y, x)
EDGE_EPS = F(0.18)                 # three channels of 0.06
CONTRAST = F(0.2), F(5)            # of the line that changes most, relative to the light
EVENNESS = F(0), F(3.3333333)      # of the one that changes least, relative to that
TINY = F(1e-6)
SHARE = F(0.16666667)              # half of a third


def ragged(radiance: np.ndarray, albedo: np.ndarray | None) -> np.float32:
    """How ragged edges are, in [0, 1]: of exposed radiance, which has to be full of noise, and
    albedo in [0,1], whose edges have to be sharp, both [H,W,3]."""
    if albedo is None:
        return F(0)
    detail, base, _ = details_of(radiance)
    counts = detail >= base * LEAST_DETAIL
    wild = share_of(counts & (detail >= base * WILD_DETAIL), counts)
    cells = cells_of(albedo)
    runs = np.concatenate((cells, cells.swapaxes(2, 3)), 2)
    beside, far = np.abs(runs[..., :-1] - runs[..., 1:]), np.abs(runs[..., 1] - runs[..., 3])
    edges = (beside[..., 0] <= FLAT) & (beside[..., 3] <= FLAT) & (far >= STEP)
    sharp = edges & (np.minimum(beside[..., 1], beside[..., 2]) <= FLAT)
    of_sharp = ramp(share_of(sharp, edges), *SHARP) if edges.sum() >= FEW else F(1)
    return ramp(wild, *WILD) * of_sharp


def averaged(result: np.ndarray, raggedness: np.float32) -> np.ndarray:
    """The exposed result [H,W,3], each pixel moved towards the mean of it and its neighbours on the
    line along which light changes least; raggedness: of `ragged`."""
    strength = raggedness * SHARE
    if strength == 0 or min(result.shape[:2]) < 3:
        return result
    h, w = result.shape[:2]
    light = (result[..., 0] + result[..., 1]) + result[..., 2]

    def beside(v: np.ndarray, k: tuple[int, int]) -> np.ndarray:
        return v[1 + k[0]:h - 1 + k[0], 1 + k[1]:w - 1 + k[1]]

    here, v = beside(light, (0, 0)), beside(result, (0, 0))
    least = most = sums = None
    for a, b in LINES:
        change = np.abs(beside(light, a) - here) + np.abs(beside(light, b) - here)
        ends = beside(result, a) + beside(result, b)
        if sums is None:
            least, most, sums = change, change, ends
            continue
        sums = np.where((change < least)[..., None], ends, sums)
        least, most = np.minimum(least, change), np.maximum(most, change)
    contrast = ramp(most * (F(1) / (here + EDGE_EPS)), *CONTRAST)
    evenness = ramp((most - least) * (F(1) / (most + TINY)), *EVENNESS)
    share = ((contrast * evenness) * strength)[..., None]
    out = result.copy()
    out[1:-1, 1:-1] = v + share * (sums - (v + v))
    return out
