"""Square cells of pixels, from the upper left of an image on, in numpy, to the bit."""
from __future__ import annotations

import numpy as np

F = np.float32


def cell_sums(v: np.ndarray, side: int) -> np.ndarray:
    """Sums over cells of side x side pixels: of each column, then of columns as a tree.
    [C,H,W] -> [C,ceil(H/side),ceil(W/side)]; side: a power of two."""
    c, h, w = v.shape
    v = np.pad(v, ((0, 0), (0, -h % side), (0, -w % side)))
    rows = v.reshape(c, -(-h // side), side, -1, side)
    sums = rows[:, :, 0]
    for k in range(1, side):
        sums = sums + rows[:, :, k]
    while sums.shape[-1] > 1:
        half = sums.shape[-1] // 2
        sums = sums[..., :half] + sums[..., half:]
    return sums[..., 0]


def between(v: np.ndarray, count: int, side: int, axis: int = -1) -> np.ndarray:
    """Values of stretches of `side` pixels at `count` pixels along an axis, linear between centres,
    the nearest where there is none. [..,ceil(count/side),..] -> [..,count,..]."""
    at = np.arange(count) + side // 2
    near, far = (np.clip(at // side + k, 0, v.shape[axis] - 1) for k in (-1, 0))
    part = ((at % side).astype(F) + F(0.5)) * F(1 / side)
    a, b = v.take(near, axis), v.take(far, axis)
    return a + part.reshape(-1, *(1,) * (-1 - axis)) * (b - a)


def between_cells(v: np.ndarray, shape: tuple[int, int], side: int) -> np.ndarray:
    """The same of cells, first down. [C,ceil(H/side),ceil(W/side)] -> [C,H,W], shape: (H, W)."""
    return between(between(v, shape[0], side, -2), shape[1], side)
