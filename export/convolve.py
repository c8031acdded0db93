"""Convolutions of reference.py in numpy: [H,W,C] maps, zero padding, one matrix product per tap.

Products of integers are summed in double precision, where sums below 2^53 are exact in any order;
the bounds of integer models keep them below 2^31.
"""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

BAND = 1 << 18  # pixels computed together: bounds the memory


def _rows(x: np.ndarray, first: int, last: int, dtype) -> np.ndarray:
    """Rows [first, last) of x with zeros outside, and one zero column on both sides."""
    h, w, c = x.shape
    rows = np.zeros((last - first, w + 2, c), dtype)
    top, bottom = max(first, 0), min(last, h)
    rows[top - first:bottom - first, 1:-1] = x[top:bottom]
    return rows


def taps_3x3(out: np.ndarray, x: np.ndarray, weight: np.ndarray, first: int) -> None:
    """Adds rows [first, first + len(out)) of the convolution of x with weight [O,C,3,3] to out."""
    n, w, _ = out.shape
    rows = _rows(x, first - 1, first + n + 1, out.dtype)
    for dy in range(3):
        for dx in range(3):
            out += rows[dy:dy + n, dx:dx + w] @ weight[:, :, dy, dx].T.astype(out.dtype)


def taps_phases(out: np.ndarray, x: np.ndarray, weight: np.ndarray, first: int) -> None:
    """The same on twofold upsampled x, with phase kernels [4*O,C,2,2]; first and len(out) even.

    Output (y, x) of phase p = 2*(y & 1) + (x & 1) sees rows (y+1)//2 - 1 + dy and columns alike.
    """
    n, w, o = out.shape
    rows = _rows(x, first // 2 - 1, (first + n) // 2 + 1, out.dtype)
    for phase in range(4):
        py, px = phase >> 1, phase & 1
        for dy in range(2):
            for dx in range(2):
                tap = weight[phase * o:(phase + 1) * o, :, dy, dx].T.astype(out.dtype)
                out[py::2, px::2] += rows[py + dy:py + dy + n // 2, px + dx:px + dx + w // 2] @ tap


def pooled(q: np.ndarray) -> np.ndarray:
    """2x2 maxima."""
    h, w, c = q.shape
    return q.reshape(h // 2, 2, w // 2, 2, c).max((1, 3))


def by_bands(shape: tuple[int, int], compute: Callable[[int, int], np.ndarray],
             pool: bool) -> np.ndarray:
    """Bands of rows [first, last) from `compute`, pooled or not, one below the other."""
    height, width = shape
    step = max(BAND // max(width, 1) // 2 * 2, 2)
    bands = [compute(y, min(y + step, height)) for y in range(0, height, step)]
    return np.concatenate([pooled(b) for b in bands] if pool else bands)
