"""The last steps of family K's filter in numpy, docs/kernel-prediction.md, to the bit: smoothing
along the result, and what it lacks."""
from __future__ import annotations

import numpy as np

F = np.float32
EPS = F(0.02)
NOISE_GAIN = F(128)              # noise codes per unit of relative difference
WIDTH_PER_CODE = F(0.0017361111)  # 2 / (3 channels * 3 pixels * 128)
WIDTH_MAX, WIDTH_MIN = F(0.4), F(0.001)
RESULT_GAIN = F(0.5)
SURFACE_GAIN = F(0.000384)       # of squared differences of the codes of albedo and normal
ALBEDO_CODES = F(240)            # codes per unit of filtered albedo + EPS
OFFSETS = ((-12, 0), (-6, 0), (-2, 0), (2, 0), (6, 0), (12, 0),
           (0, -4), (0, -2), (0, 2), (0, 4))  # (x, y) of the pixels averaged over
CELL = 16                        # pixels a side of what is balanced
BALANCE_EPS = F(0.15)            # three channels of 0.05
NOISE_SHARE = F(0.05)            # of a correction, per noise code
MOST_LACKING, MOST_GAIN = F(200), F(0.5)
SPARK = F(2)
SPARKS_LEAST, SPARKS_SQUARED = F(20), F(0.3)


def to_code(v: np.ndarray) -> np.ndarray:
    """Rounded to uint8, at most 255."""
    return np.minimum(v + F(0.5), F(255)).astype(np.uint8)


def _moved(v: np.ndarray, offset: tuple[int, int]) -> np.ndarray:
    """v(p + offset), or the nearest pixel inside; v [H,W,C], offset (x, y)."""
    y, x = (np.clip(np.arange(n) + k, 0, n - 1) for n, k in zip(v.shape, offset[::-1]))
    return v[y[:, None], x]


def _summed(v: np.ndarray) -> np.ndarray:
    return (v[..., :1] + v[..., 1:2]) + v[..., 2:]


def _width(noise: np.ndarray) -> np.ndarray:
    """Width in units of the result, float32 in [0.001, 0.4], from noise codes uint8 [H,W,1]."""
    sums = sum(_moved(noise, (k, 0)).astype(F) for k in (-1, 0, 1))
    return np.maximum(np.minimum(sums * WIDTH_PER_CODE, WIDTH_MAX), WIDTH_MIN)


def noise_codes(out: np.ndarray, first: np.ndarray) -> np.ndarray:
    """How far the demodulated input is from the result, relative to it, uint8 [H,W,1]."""
    return to_code(NOISE_GAIN * _summed(np.abs(first - out) / (out + EPS)))


def smoothed(out: np.ndarray, smooth: np.ndarray, noise: np.ndarray,
             normal_codes: np.ndarray) -> np.ndarray:
    """The demodulated result, averaged along surfaces whose light is even, [H,W,3].

    out: demodulated result >= 0, smooth: filtered albedo + EPS, both float32 [H,W,3]; noise: of
    noise_codes; normal_codes: 0..255 [H,W,3], 128 where there are no normals.
    """
    gain = (RESULT_GAIN / _width(noise)) / (out + EPS)
    surface = np.concatenate((to_code(ALBEDO_CODES * smooth), normal_codes), -1).astype(np.int32)
    weights, total = np.ones_like(out[..., :1]), np.zeros_like(out)
    for k in OFFSETS:
        change = _moved(out, k) - out
        apart = ((_moved(surface, k) - surface) ** 2).sum(-1, keepdims=True).astype(F)
        x = change * gain
        w = np.maximum(F(1) - (_summed(x * x) + SURFACE_GAIN * apart), F(0))
        w = w * w
        weights = weights + w
        total = total + w * change
    return out + total / weights


def cell_sums(v: np.ndarray) -> np.ndarray:
    """Sums over cells of CELL x CELL pixels: of each column, then of columns as a tree.
    [C,H,W] -> [C,ceil(H/CELL),ceil(W/CELL)]."""
    c, h, w = v.shape
    v = np.pad(v, ((0, 0), (0, -h % CELL), (0, -w % CELL)))
    rows = v.reshape(c, -(-h // CELL), CELL, -1, CELL)
    sums = rows[:, :, 0]
    for k in range(1, CELL):
        sums = sums + rows[:, :, k]
    while sums.shape[-1] > 1:
        half = sums.shape[-1] // 2
        sums = sums[..., :half] + sums[..., half:]
    return sums[..., 0]


def cell_gains(sums: np.ndarray) -> np.ndarray:
    """What the result lacks, relative to it, from cell_sums of q, q q, what may be corrected, and
    sparks. [4,H,W] -> [H,W]."""
    v = np.pad(sums, ((0, 0), (1, 1), (2, 2)))
    v = (v[:, :-2] + v[:, 1:-1]) + v[:, 2:]
    n = v.shape[2] - 4
    total = v[..., :n]
    for k in range(1, 5):
        total = total + v[..., k:k + n]
    q, squares, base, lit = total
    share = np.maximum(F(1) - squares / (q * q + F(1e-6)), F(0))
    q = np.minimum(q, SPARKS_LEAST + SPARKS_SQUARED * lit * lit)
    return np.clip(share * q / (base + F(32)), -MOST_GAIN, MOST_GAIN)


def corrected(out: np.ndarray, smooth: np.ndarray, noise: np.ndarray,
              radiance: np.ndarray) -> np.ndarray:
    """The demodulated result [H,W,3] with what it lacks of the radiance, unless that is chance.

    out: of smoothed; smooth and noise as there; radiance: exposed [H,W,3], <= RADIANCE_MAX.
    """
    v = _summed(out * smooth)[..., 0]
    level = v + BALANCE_EPS
    q = np.minimum((_summed(radiance)[..., 0] - v) / level, MOST_LACKING)
    share = np.minimum(noise[..., 0].astype(F) * NOISE_SHARE, F(1))
    lit = np.clip(q - SPARK, F(0), F(1))
    gain = cell_gains(cell_sums(np.stack((q, q * q, v / level * share, lit))))
    for axis in (0, 1):
        at = np.arange(out.shape[axis]) + CELL // 2
        near, far = (np.clip(at // CELL + k, 0, gain.shape[axis] - 1) for k in (-1, 0))
        part = ((at % CELL).astype(F) + F(0.5)) * F(1 / CELL)
        a, b = gain.take(near, axis), gain.take(far, axis)
        gain = a + (part if axis else part[:, None]) * (b - a)
    return out + out * (gain * share)[..., None]
