"""Grain of albedo and normals in numpy, docs/kernel-prediction.md, to the bit: where one is noise
from pixel to pixel, means of a wide window stand for it.

At few samples a texture finer than pixels, a surface that now shows one of its lobes and now the
other, or fog before it, is noise that no 5x5 kernel takes away. It has no correlation between
neighbours; edges and textures that pixels resolve have.
"""
from __future__ import annotations

import numpy as np

from export.cells import between_cells, cell_sums
from export.regression import windows

F = np.float32
SIDE = 8                                # pixels of a cell
STEPS = ((1, 0), (0, 1), (1, 1), (-1, 1))  # to a neighbour, (x, y)
SUMS = 6 + len(STEPS)                   # of a cell: 1, L, L^2, r, g, b, squares of these steps
PAIRS = F(4 / 7), F(32 / 49)            # half of a square by pixels, for 7 of 8 pairs, for 49 of 64
WHITE, WHITER = F(0.6), F(1 / 64)       # of steps by the variance: from here on, and more by how
                                        # many times as much as the light the feature varies, ...
AROUND, OWN = F(5), F(4)                # ... to 0.9 of cells around, to 0.95 of one alone
REAL = F(1 / 12)                        # what varies so many times as much as the light is texture
OF_NORMAL = F(1 / 4)                    # of how much more normals vary than the light what counts
PER_CODE = F(1 / 255)
Least = tuple[np.float32, np.float32]   # variance up to which nothing goes, 1 by what is to all
OF_ALBEDO_LEAST, OF_NORMAL_LEAST = (F(16), F(1 / 64)), (F(2), F(1 / 8))


def brightness(codes: np.ndarray) -> np.ndarray:
    """L, int32 [H,W], of a feature's codes [H,W,3]."""
    r, g, b = np.moveaxis(codes.astype(np.int32), -1, 0)
    return (r + 2 * g + b) >> 2


def products(codes: np.ndarray) -> np.ndarray:
    """What every pixel of a feature's codes [H,W,3] adds to the sums of its cell, float32
    [SUMS,H,W]."""
    light = brightness(codes)
    h, w = light.shape
    y, x = np.mgrid[:h, :w]
    squares = []
    for dx, dy in STEPS:
        inside = ((x + dx) // SIDE == x // SIDE) & ((y + dy) // SIDE == y // SIDE)  # of a cell,
        inside &= (x + dx < w) & (y + dy < h)                                      # of the image
        there = light[np.minimum(y + dy, h - 1), np.clip(x + dx, 0, w - 1)]
        squares.append((there - light) ** 2 * inside)
    return np.stack((np.ones_like(light), light, light * light,
                     *np.moveaxis(codes.astype(np.int32), -1, 0), *squares)).astype(F)


def light_steps(codes: np.ndarray) -> np.ndarray:
    """What every pixel adds to the last sum of its cell, float32 [1,H,W]: the square of the step of
    the light, its code [H,W], to the next pixel of the cell."""
    steps = np.zeros((1, *codes.shape), F)
    steps[0, :, :-1] = np.square(np.diff(codes.astype(np.int32)))
    steps[..., SIDE - 1::SIDE] = 0
    return steps


def shares(sums: np.ndarray, gain: np.float32, part: np.ndarray,
           least: Least) -> tuple[np.ndarray, np.ndarray]:
    """Sums [SUMS + 1,H,W], the last that of the light -> how much of the mean stands for the
    feature, [H,W], and it, [3,H,W], in [0, 1]; gain: how fast it grows with whiteness; part: of
    how much more it varies than the light what counts, one number or [H,W]."""
    m = F(1) / sums[0]
    mean = sums[1] * m
    variance = sums[2] * m - mean * mean
    straight, diagonal = np.minimum(sums[6], sums[7]), np.minimum(sums[8], sums[9])
    steps = np.minimum(straight * PAIRS[0], diagonal * PAIRS[1])
    flat, rise = least
    white = (steps * m) * (F(1) / np.maximum(variance, flat))
    noise = np.maximum((sums[SUMS] * m) * PAIRS[0], F(1))
    ratio = (variance * (F(1) / noise)) * part
    share = np.clip((white - (WHITE + ratio * WHITER)) * gain, F(0), F(1))
    share = share * np.clip((variance - flat) * rise, F(0), F(1))
    share = share * np.clip(F(2) - ratio * REAL, F(0), F(1))
    return share, np.minimum((sums[3:6] * m) * PER_CODE, F(1))


def cell_grain(sums: np.ndarray, part: np.ndarray, least: Least) -> np.ndarray:
    """Sums of cells [SUMS + 1,H,W] -> share and mean, [4,H,W]: by the cells around each, and where
    they hold an edge by itself. part, least: of `shares`."""
    share, mean = shares(windows(sums), AROUND, part, least)
    own, own_mean = shares(sums, OWN, part, least)
    own = (F(1) - share) * own
    whole = share + own
    part = own * np.divide(F(1), whole, out=np.zeros_like(whole), where=whole > 0)
    part = np.minimum(part, F(1))
    return np.concatenate((whole[None], mean + part * (own_mean - mean)))


def _found(codes: np.ndarray, light: np.ndarray, part: np.ndarray,
           least: Least) -> tuple[np.ndarray, ...]:
    """Of a feature's codes [H,W,3] and `light_steps`: the shares of its cells, and of each pixel
    the share [H,W,1] and the mean [H,W,3]. part, least: of `shares`."""
    cells = cell_grain(cell_sums(np.concatenate((products(codes), light)), SIDE), part, least)
    share, *mean = between_cells(cells, codes.shape[:2], SIDE)
    return cells[0], share[..., None], np.stack(mean, -1)


def without_grain(albedo: np.ndarray | None, normal: np.ndarray | None,
                  codes: np.ndarray) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Albedo (in [0,1], black is white) and normals (in [-1,1]), [H,W,3] or absent, less their
    grain; codes: of the input with it, [H,W,12]."""
    light, part = light_steps(codes[..., 1]), F(1)
    if normal is not None:
        cells, share, mean = _found(codes[..., 6:9], light, OF_NORMAL, OF_NORMAL_LEAST)
        normal = normal + share * ((mean * F(2) - F(1)) - normal)
        part = F(1) - cells  # before fog, for example, neither shows a texture
    if albedo is not None:
        _, share, mean = _found(codes[..., 3:6], light, part, OF_ALBEDO_LEAST)
        albedo = albedo + share * (mean - albedo)
    return albedo, normal
