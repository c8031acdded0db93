"""The regression of family K's filter in numpy, docs/kernel-prediction.md, to the bit: what the
input has and the result has not, where normals and albedo explain it.

Its sums are those of cells, its coefficients those of cells and those around them: a linear
function of the filtered normal and the filtered albedo, for each channel.
"""
from __future__ import annotations

import numpy as np

from export.cells import between_cells, cell_sums

F = np.float32
SIDE = 8                # pixels of a cell
FEATURES, CHANNELS = 6, 3
SUMS = 50               # 1, f, e, f f (upper triangle), f e, e e
COEFFICIENTS = CHANNELS * (FEATURES + 1)
EPS = F(0.03)           # added to the result that the rest is divided by
MOST_REST = F(4)        # of one pixel: single sparks are chance
THIRD = F(1 / 3)
RIDGE, RIDGE_OF_NOISE = F(0.001), F(0.005)
MOST = F(0.5)           # of a correction


def features_of(normal: np.ndarray, smooth: np.ndarray) -> np.ndarray:
    """Filtered normal [H,W,3] and divisor [H,W,3] -> [H,W,FEATURES]."""
    return np.concatenate((normal, smooth), -1)


def products(out: np.ndarray, smooth: np.ndarray, features: np.ndarray,
             radiance: np.ndarray) -> np.ndarray:
    """What every pixel adds to the sums of its cell, [SUMS,H,W].

    out: demodulated result; smooth: divisor; radiance: exposed, <= RADIANCE_MAX; all [H,W,3].
    """
    p = out * smooth
    e = np.minimum((radiance - p) * (F(1) / (p + EPS)), MOST_REST)
    f, e = np.moveaxis(features, -1, 0), np.moveaxis(e, -1, 0)
    squares = [f[i] * f[j] for i in range(FEATURES) for j in range(i, FEATURES)]
    mixed = [f[i] * c for i in range(FEATURES) for c in e]
    return np.stack((np.ones_like(f[0]), *f, *e, *squares, *mixed,
                     (e[0] * e[0] + e[1] * e[1]) + e[2] * e[2]))


def windows(sums: np.ndarray) -> np.ndarray:
    """Sums of cells and those around them, by weights 1, 2, 1, first down; [C,H,W]."""
    v = np.pad(sums, ((0, 0), (1, 1), (1, 1)))
    v = (v[:, :-2] + v[:, 2:]) + F(2) * v[:, 1:-1]
    return (v[..., :-2] + v[..., 2:]) + F(2) * v[..., 1:-1]


def coefficients(sums: np.ndarray) -> np.ndarray:
    """[SUMS,H,W] of `windows` -> [COEFFICIENTS,H,W]: for each feature, then the constant, that of
    each channel; by square-root-free Cholesky factors of the features' covariance."""
    n = FEATURES
    m = F(1) / sums[0]
    f, e, squares, mixed, ee = np.split(sums[1:], np.cumsum((n, CHANNELS, n * (n + 1) // 2,
                                                             n * CHANNELS)))
    f, e = f * m, e * m
    v = ee[0] * m - ((e[0] * e[0] + e[1] * e[1]) + e[2] * e[2])
    ridge = RIDGE + RIDGE_OF_NOISE * np.maximum(v * THIRD, F(0))
    y = [[mixed[i * CHANNELS + c] * m - f[i] * e[c] for c in range(CHANNELS)] for i in range(n)]
    lower, scaled = np.zeros((2, n, n, *m.shape), F)   # L, and L times the diagonal
    inverse, k = [], 0
    for i in range(n):
        for j in range(i, n):         # row i of the upper triangle is column i of the lower one
            a = squares[k] * m - f[i] * f[j]
            a = a + ridge if i == j else a
            for t in range(i):
                a = a - lower[j, t] * scaled[i, t]
            scaled[j, i] = a
            k += 1
        inverse.append(F(1) / scaled[i, i])
        for j in range(i + 1, n):
            lower[j, i] = scaled[j, i] * inverse[i]
    b = np.zeros((n, CHANNELS, *m.shape), F)
    for c in range(CHANNELS):
        for i in range(n):
            for t in range(i):
                y[i][c] = y[i][c] - lower[i, t] * y[t][c]
        for i in reversed(range(n)):
            b[i, c] = y[i][c] * inverse[i]
            for t in range(i + 1, n):
                b[i, c] = b[i, c] - lower[t, i] * b[t, c]
    constant = -summed(f[:, None] * b)
    return np.concatenate((b.reshape(n * CHANNELS, *m.shape), constant))


def summed(v: np.ndarray) -> np.ndarray:
    """Over the first axis, one by one."""
    total = v[0]
    for k in v[1:]:
        total = total + k
    return total


def regressed(out: np.ndarray, smooth: np.ndarray, features: np.ndarray,
              radiance: np.ndarray) -> np.ndarray:
    """The demodulated result [H,W,3] with what the features explain of the rest."""
    sums = windows(cell_sums(products(out, smooth, features, radiance), SIDE))
    k = between_cells(coefficients(sums), out.shape[:2], SIDE)
    k = k.reshape(FEATURES + 1, CHANNELS, *out.shape[:2])
    f = np.moveaxis(features, -1, 0)[:, None]
    share = k[FEATURES] + summed(f * k[:FEATURES])
    return out + out * np.moveaxis(np.clip(share, -MOST, MOST), 0, -1)
