"""Pairs of weights: neighbours along the runs of docs/arithmetic.md, whose sums 8-bit instructions
bound. A run is what lies under one kernel row: columns outer, channels inner."""
from __future__ import annotations

import numpy as np

PAIR_MAX = 128
WEIGHT_MAX = 127


def to_pairs(weight: np.ndarray) -> np.ndarray:
    """[O,C,kh,kw] -> [O,kh,n,2]; an odd run ends with a zero."""
    o, c, kh, kw = weight.shape
    runs = weight.transpose(0, 2, 3, 1).reshape(o, kh, kw * c)
    return np.pad(runs, ((0, 0), (0, 0), (0, kw * c % 2))).reshape(o, kh, -1, 2)


def from_pairs(pairs: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The inverse of to_pairs; `shape` is that of the weights."""
    o, c, kh, kw = shape
    runs = pairs.reshape(o, kh, -1)[:, :, :kw * c]
    return np.ascontiguousarray(runs.reshape(o, kh, kw, c).transpose(0, 3, 1, 2))


def pair_norm(weight: np.ndarray) -> np.ndarray:
    """[O]: the least factor t >= 0 for which weight[o] / t fits both bounds before rounding:
    every |weight| <= 127 and sums of equal signs in a pair <= 128."""
    pairs = to_pairs(np.asarray(weight, np.float64))
    o = len(pairs)
    flat = pairs.reshape(o, -1, 2)
    both = np.maximum(np.maximum(flat, 0).sum(-1), np.maximum(-flat, 0).sum(-1)).max(-1, initial=0)
    single = np.abs(flat).max((1, 2), initial=0)
    return np.maximum(both / PAIR_MAX, single / WEIGHT_MAX)


def safe(weight: np.ndarray, wish: np.ndarray | None = None) -> np.ndarray:
    """int8 weights near integer [O,C,kh,kw] `weight`, clipped to +-127 and pair-safe.

    Where a pair of equal signs sums to more than 128 the excess is taken from both halves equally;
    an odd one from the half that lies further above `wish` (default: the second).
    """
    pairs = to_pairs(np.clip(weight, -WEIGHT_MAX, WEIGHT_MAX).astype(np.int32))
    size = np.abs(pairs)
    excess = np.where(pairs[..., 0] * pairs[..., 1] > 0,
                      np.maximum(size.sum(-1) - PAIR_MAX, 0), 0)
    above = size - np.abs(to_pairs(np.asarray(weight if wish is None else wish, np.float64)))
    first = np.where(above[..., 0] > above[..., 1], (excess + 1) // 2, excess // 2)
    size[..., 0] -= first  # a half is at most 127, so the other one is larger than the excess
    size[..., 1] -= excess - first
    return from_pairs(np.sign(pairs) * size, weight.shape).astype(np.int8)
