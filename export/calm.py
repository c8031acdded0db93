"""How calm a frame is (docs/kernel-prediction.md, step 9), to the bit: the share of its cells whose
finest detail is so little that whatever noise there is must be little, too. Texture is in some
places, noise in nearly all."""
from __future__ import annotations

import numpy as np

F = np.float32
SIDE = 4                   # differences a side of a cell, of one pixel more
LEAST_CELLS = 1000         # as many at least, where the frame has them
DETAIL_GAIN = F(192)       # noise codes of half a difference, relative to the radiance
DETAIL_EPS = F(0.96)       # 0.02 for each channel of a cell's pixels
LEAST_DETAIL = F(1)        # codes; cells with less are sky, lamps or clipped: they say nothing
MOST_DETAIL = F(10)        # calm below it


def spacing(height: int, width: int) -> int:
    """Pixels from cell to cell, a power of two."""
    def count(step: int) -> int:
        return max((height - SIDE - 1) // step + 1, 0) * max((width - SIDE - 1) // step + 1, 0)
    step = SIDE
    while count(2 * step) >= LEAST_CELLS:
        step *= 2
    return step


def calm_share(radiance: np.ndarray) -> np.float32:
    """Share of calm cells of exposed radiance [H,W,3], float32 in [0, 1]."""
    light = (radiance[..., 0] + radiance[..., 1]) + radiance[..., 2]
    h, w = light.shape
    step = spacing(h, w)
    ys, xs = (np.arange(0, n - SIDE, step)[:, None] for n in (h, w))
    ends = np.arange(SIDE + 1)
    cells = light[(ys + ends)[:, None, :, None], (xs + ends)[None, :, None, :]]
    across = cells[..., :-1] - cells[..., 1:]
    detail, base = np.zeros(cells.shape[:2], F), np.zeros(cells.shape[:2], F)
    for y in range(SIDE):
        for x in range(SIDE):
            detail = detail + np.abs(across[..., y, x] - across[..., y + 1, x])
            base = base + cells[..., y, x]
    detail, base = detail * DETAIL_GAIN, base + DETAIL_EPS
    counts = detail >= base * LEAST_DETAIL
    calm = counts & (detail < base * MOST_DETAIL)
    n = F(counts.sum())
    return F(calm.sum()) * (F(1) / n) if n else F(0)
