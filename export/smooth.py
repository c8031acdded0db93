"""The last steps of family K's filter in numpy, docs/kernel-prediction.md, to the bit: smoothing
along the result, what it lacks, and some of the input."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from export.cells import between, between_cells, cell_sums

F = np.float32
ONE = F(1)
EPS = F(0.02)
NOISE_GAIN, NOISE_EPS = F(384), F(0.06)  # noise codes per unit of relative difference
WIDTH_PER_CODE = F(0.0026041667)  # 3 / (3 pixels * 384)
WIDTH_MIN = F(0.001)
RESULT_GAIN = F(0.5)
GUIDE_GAIN = F(0.012288)         # of squared differences of the guide
CELL = 16                        # pixels a side of what is balanced
BALANCE_EPS = F(0.15)            # three channels of 0.05
NOISE_SHARE = F(0.05)            # of a correction, per noise code
MOST_LACKING, MOST_GAIN = F(400), F(0.5)
SPARK = F(2)
SPARKS_LEAST, SPARKS_SQUARED = F(20), F(0.3)
ABOVE, BESIDE, FAR_SPARKS_SQUARED = 4, 6, F(0.1)  # cells of the wide window, and its sparks
RUN, RUNS_BESIDE = 16, 4         # pixels of a row, and how many runs count to either side
NOISY = F(1)                     # mean code of runs that tell how much noise there is
LEAST_NOISE = F(2)               # above it the share of the input is less by this per code,
SHARE_PER_CODE, SHARE_PER_CODE_ALONE = F(0.125), F(0.0625)  # without features by that
SPARK_CODES = F(64), F(0.015625) # of the pixel: from where on the share is less, by which slope
MOST_SHARE = F(0.5)              # of the input
MOST_SHARE_CLEAN = F(0.25)       # where features without noise have shown most of the texture
CALM = F(0.14), F(12.5)          # calm shares, likewise: noise codes count less, by at most ...
LESS_OF_CODES = F(0.75)
CALM_ALONE = F(0.17), F(12.5)    # and without features, where more of the input stays, too, by ...
MORE_SHARE = F(0.2)
CALM_SPARKS = F(8), F(0.25)      # what the input has beyond the result, relative to it


def to_code(v: np.ndarray) -> np.ndarray:
    """Rounded to uint8, at most 255."""
    return np.minimum(v + F(0.5), F(255)).astype(np.uint8)


def ramp(v: np.ndarray, begin: np.float32, slope: np.float32) -> np.ndarray:
    """0 up to begin, 1 where it has grown that far by the slope."""
    return np.clip((v - begin) * slope, F(0), ONE)


def _moved(v: np.ndarray, offset: tuple[int, int]) -> np.ndarray:
    """v(p + offset), or the nearest pixel inside; v [H,W,C], offset (x, y)."""
    y, x = (np.clip(np.arange(n) + k, 0, n - 1) for n, k in zip(v.shape, offset[::-1]))
    return v[y[:, None], x]


class Smoothing(NamedTuple):
    """Which pixels are averaged over, (x, y) away, the weight of the pixel itself, and how far they
    may differ."""

    offsets: tuple[tuple[int, int], ...]
    own: np.float32
    widest: np.float32


NEAR = Smoothing(((-6, 0), (-2, 0), (2, 0), (6, 0), (0, -2), (0, 2)), F(1), F(0.6))
FAR = Smoothing((*((x, 0) for x in (-6, -2, 2, 6, -12, 12, -4, 4)),  # where a correction follows
                 *((0, y) for y in (-2, 2, -4, 4, -6, 6, -12, 12))), F(2.5), F(0.67))


def _summed(v: np.ndarray) -> np.ndarray:
    return (v[..., :1] + v[..., 1:2]) + v[..., 2:]


def _width(noise: np.ndarray, widest: np.float32) -> np.ndarray:
    """Width in units of the result, float32 in [WIDTH_MIN, widest], of noise codes [H,W,1]."""
    sums = sum(_moved(noise, (k, 0)).astype(F) for k in (-1, 0, 1))
    return np.maximum(np.minimum(sums * WIDTH_PER_CODE, widest), WIDTH_MIN)


def shares(v: np.ndarray, top: np.ndarray = ONE, bottom: np.ndarray = ONE) -> np.ndarray:
    """top / (v bottom) by one division a pixel, v [H,W,3]."""
    r, g, b = v[..., :1], v[..., 1:2], v[..., 2:]
    share = top / (((r * g) * b) * bottom)
    return np.concatenate(((g * b) * share, (r * b) * share, (r * g) * share), -1)


def noise_codes(v: np.ndarray, filtered: np.ndarray) -> np.ndarray:
    """How far the demodulated input is from its 5x5 means [H,W,3], relative to them, uint8 [H,W,1].

    v: confidence and, times it, the demodulated input, [H,W,4].
    """
    apart = _summed(np.abs(v[..., 1:] - v[..., :1] * filtered))
    return to_code(NOISE_GAIN * (apart / (v[..., :1] * (_summed(filtered) + NOISE_EPS))))


def guide_of(codes: np.ndarray) -> np.ndarray:
    """What tells surfaces apart, from the network's input codes [H,W,12]: of the normal, without it
    of the albedo, int32 [H,W,2] of 0..127."""
    r, g, b, x, y, z = np.moveaxis(codes[..., 3:9].astype(np.int32), -1, 0)
    normal = (2 * x - y - z + 510) // 8, 7 * (y - z + 255) // 32
    return np.stack(normal if codes[0, 0, 10] else (r // 2, (g + b) // 4), -1)


def smoothed(out: np.ndarray, noise: np.ndarray, guide: np.ndarray,
             is_far: bool) -> np.ndarray:
    """The demodulated result, averaged along surfaces whose light is even, [H,W,3].

    out: demodulated result >= 0, float32 [H,W,3]; noise: of noise_codes; guide: of guide_of;
    is_far: FAR, else NEAR.
    """
    smoothing = FAR if is_far else NEAR
    gain = shares(out + EPS, RESULT_GAIN, _width(noise, smoothing.widest))
    weights, total = np.full_like(out[..., :1], smoothing.own), np.zeros_like(out)
    for k in smoothing.offsets:
        change = _moved(out, k) - out
        apart = ((_moved(guide, k) - guide) ** 2).sum(-1, keepdims=True).astype(F)
        x = change * gain
        w = np.maximum(F(1) - (_summed(x * x) + GUIDE_GAIN * apart), F(0))
        w = w * w
        weights = weights + w
        total = total + w * change
    return out + total * (F(1) / weights)


def _columns_summed(v: np.ndarray, count: int) -> np.ndarray:
    """Sums of each `count` columns, from the left. [C,H,W] -> [C,H,W - count + 1]."""
    n = v.shape[2] - count + 1
    total = v[..., :n]
    for k in range(1, count):
        total = total + v[..., k:k + n]
    return total


def sums_around(v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums of cells around each: of three rows by five columns, and of ABOVE rows above, it and one
    below by BESIDE columns on either side; twice [C,H,W]."""
    h = v.shape[1]
    v = np.pad(v, ((0, 0), (ABOVE, 1), (BESIDE, BESIDE)))
    row = [v[:, k:k + h] for k in range(ABOVE + 2)]
    near = (row[ABOVE - 1] + row[ABOVE]) + row[ABOVE + 1]
    far = near + ((row[0] + row[1]) + row[2])
    return (_columns_summed(near[..., BESIDE - 2:2 - BESIDE], 5),
            _columns_summed(far, 2 * BESIDE + 1))


def _lacking(q: np.ndarray, squares: np.ndarray, base: np.ndarray, lit: np.ndarray,
             sparks_squared: np.float32) -> np.ndarray:
    """What sums over cells say that the result lacks, but for chance and sparks."""
    share = np.maximum(F(1) - squares / (q * q + F(1e-6)), F(0))
    most = SPARKS_LEAST + sparks_squared * lit * lit
    return np.clip(share * np.minimum(q, most) / (base + F(32)), -MOST_GAIN, MOST_GAIN)


def cell_gains(sums: np.ndarray) -> np.ndarray:
    """What the result lacks, relative to it, from cell_sums of q, q q, what may be corrected, and
    sparks: what the wide window says, and what the near one says beyond. [4,H,W] -> [H,W]."""
    (q, squares, base, lit), far = sums_around(sums)
    expected = _lacking(*far, FAR_SPARKS_SQUARED)
    own = _lacking(q - expected * base, squares, base, lit, SPARKS_SQUARED)
    return np.clip(expected + own, -MOST_GAIN, MOST_GAIN)


def corrected(out: np.ndarray, smooth: np.ndarray, noise: np.ndarray,
              radiance: np.ndarray) -> np.ndarray:
    """The demodulated result [H,W,3] with what it lacks of the radiance, unless that is chance.

    out: of smoothed; smooth and noise as there; radiance: exposed [H,W,3], <= RADIANCE_MAX.
    """
    v = _summed(out * smooth)[..., 0]
    inverse = F(1) / (v + BALANCE_EPS)
    q = (_summed(radiance)[..., 0] - v) * inverse
    q = np.minimum(q, np.maximum(F(2) * MOST_LACKING - q, F(0)))
    share = np.minimum(noise[..., 0].astype(F) * NOISE_SHARE, F(1))
    lit = np.clip(q - SPARK, F(0), F(1))
    gain = cell_gains(cell_sums(np.stack((q, q * q, v * inverse * share, lit)), CELL))
    gain, = between_cells(gain[None], out.shape[:2], CELL)
    return out + out * (gain * share)[..., None]


def _runs(v: np.ndarray) -> np.ndarray:
    """Of runs of a row: pixels inside, and sums of v [H,W], whole numbers; float32 [2,H,runs]."""
    h, w = v.shape
    runs = np.pad(np.stack((np.ones(v.shape, F), v)), ((0, 0), (0, 0), (0, -w % RUN)))
    return runs.reshape(2, h, -1, RUN).sum(-1)


def _around(runs: np.ndarray, beside: int) -> np.ndarray:
    """Sums over each run and `beside` on either side."""
    return _columns_summed(np.pad(runs, ((0, 0), (0, 0), (beside, beside))), 2 * beside + 1)


def mixed(result: np.ndarray, noise: np.ndarray, radiance: np.ndarray,
          is_alone: bool, calm: np.float32, is_clean: bool = False) -> np.ndarray:
    """The exposed result [H,W,3] with some of the radiance where noise is little; noise and
    radiance as of corrected, is_alone: without features, calm: of export.calm.calm_share, or below
    0 for none of it, is_clean: the features have no noise."""
    if calm < 0:
        return result
    calm = ramp(calm, *CALM_ALONE if is_alone else CALM)
    most = (MOST_SHARE + MORE_SHARE * calm if is_alone
            else MOST_SHARE_CLEAN if is_clean else MOST_SHARE)
    per_code = SHARE_PER_CODE_ALONE if is_alone else SHARE_PER_CODE
    code = noise[..., 0].astype(F)
    runs = _runs(code)
    runs *= runs[1] >= NOISY * runs[0]
    pixels, codes = _around(runs, RUNS_BESIDE)
    mean = codes * np.divide(ONE, pixels, out=np.zeros_like(pixels), where=pixels > 0)
    mean = mean * (ONE - LESS_OF_CODES * calm)
    share = np.clip(ONE - (mean - LEAST_NOISE) * per_code, F(0), most)
    v = _summed(result)[..., 0]
    q = (_summed(radiance)[..., 0] - v) * (F(1) / (v + BALANCE_EPS))
    own = np.maximum(ONE - ramp(code, *SPARK_CODES), calm * (ONE - ramp(q, *CALM_SPARKS)))
    share = between(share, code.shape[1], RUN) * own
    return result + share[..., None] * (radiance - result)
