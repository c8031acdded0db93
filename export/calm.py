"""How calm a frame is (docs/kernel-prediction.md, step 9), to the bit: the share of its cells whose
finest detail is so little that whatever noise there is must be little, too. Texture is in some
places, noise in nearly all; unless the detail of the others is noise by its looks, halved in means
of 2x2 pixels."""
from __future__ import annotations

import numpy as np

from export.smooth import EPS, ramp, shares

F = np.float32
SIDE = 4                   # differences a side of a cell, of one pixel more
LEAST_CELLS = 1000         # as many at least, where the frame has them
DETAIL_GAIN = F(192)       # noise codes of half a difference, relative to the radiance
DETAIL_EPS = F(0.96)       # 0.02 for each channel of a cell's pixels
LEAST_DETAIL = F(1)        # codes; cells with less are sky, lamps or clipped: they say nothing
MOST_DETAIL = F(10)        # calm below it
WILD_DETAIL = F(160)       # rough below it, wild from it on
COARSE = F(0.6)            # of a rough cell's detail: noise where means of 2x2 pixels have less
NOT_CALM = F(0.42), F(-12.5)  # share of rough cells that are noise: up to where a frame may be calm


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


def differences_of(cells: np.ndarray) -> np.ndarray:
    """Mixed second differences of cells, [rows,columns,SIDE,SIDE]."""
    across = cells[..., :-1] - cells[..., 1:]
    return across[..., :-1, :] - across[..., 1:, :]


def sum_of(v: np.ndarray) -> np.ndarray:
    """Of the sizes of numbers [...,H,W], row by row."""
    out = np.zeros(v.shape[:-2], F)
    for y in range(v.shape[-2]):
        for x in range(v.shape[-1]):
            out = out + np.abs(v[..., y, x])
    return out


def details_of(radiance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Detail of cells of exposed radiance [H,W,3], what it is relative to, and whether it is noise,
    for there is less of it between means of 2x2 pixels than of a texture."""
    cells = cells_of(radiance)
    d = differences_of(cells)
    rows = (d[..., :-2] + d[..., 2:]) + (d[..., 1:-1] + d[..., 1:-1])
    coarse = (rows[..., :-2, :] + rows[..., 2:, :]) + (rows[..., 1:-1, :] + rows[..., 1:-1, :])
    detail, base = sum_of(d), sum_of(cells[..., :SIDE, :SIDE])
    return detail * DETAIL_GAIN, base + DETAIL_EPS, sum_of(coarse) < detail * COARSE


def share_of(part: np.ndarray, whole: np.ndarray) -> np.float32:
    """How many of the whole, of which there may be none, are the part."""
    return F(part.sum()) * (F(1) / F(max(whole.sum(), 1)))


def calm_share(radiance: np.ndarray) -> np.float32:
    """Share of calm cells of exposed radiance [H,W,3], demodulated where there is an albedo (its
    texture is no detail then), float32 in [0, 1]; less, or 0, if many of the rough ones are
    noise."""
    detail, base, is_noise = details_of(radiance)
    counts = detail >= base * LEAST_DETAIL
    calm = counts & (detail < base * MOST_DETAIL)
    rough = counts & ~calm & (detail < base * WILD_DETAIL)
    return share_of(calm, counts) * ramp(share_of(rough & is_noise, rough), *NOT_CALM)


def frame_calm(radiance: np.ndarray, albedo: np.ndarray | None) -> np.float32:
    """How calm a picture is, by its exposed radiance and the albedo as it came, [H,W,3]."""
    return calm_share(radiance if albedo is None else radiance * shares(albedo + EPS))
