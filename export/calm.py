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


def cells_of(image: np.ndarray) -> np.ndarray:
    """Sums of the channels of an image [H,W,3] in cells, [rows,columns,SIDE+1,SIDE+1]."""
    light = (image[..., 0] + image[..., 1]) + image[..., 2]
    step = spacing(*light.shape)
    ys, xs = (np.arange(0, n - SIDE, step)[:, None] for n in light.shape)
    ends = np.arange(SIDE + 1)
    return light[(ys + ends)[:, None, :, None], (xs + ends)[None, :, None, :]]


def details_of(radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Detail of cells of exposed radiance [H,W,3], and what it is relative to."""
    cells = cells_of(radiance)
    across = cells[..., :-1] - cells[..., 1:]
    detail, base = np.zeros(cells.shape[:2], F), np.zeros(cells.shape[:2], F)
    for y in range(SIDE):
        for x in range(SIDE):
            detail = detail + np.abs(across[..., y, x] - across[..., y + 1, x])
            base = base + cells[..., y, x]
    return detail * DETAIL_GAIN, base + DETAIL_EPS


def share_of(part: np.ndarray, whole: np.ndarray) -> np.float32:
    """How many of the whole, of which there may be none, are the part."""
    return F(part.sum()) * (F(1) / F(max(whole.sum(), 1)))


def calm_share(radiance: np.ndarray) -> np.float32:
    """Share of calm cells of exposed radiance [H,W,3], float32 in [0, 1]."""
    detail, base = details_of(radiance)
    counts = detail >= base * LEAST_DETAIL
    return share_of(counts & (detail < base * MOST_DETAIL), counts)
