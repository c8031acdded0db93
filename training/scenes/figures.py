"""Overlapping figures ("dead leaves"), drawn without a renderer: disks, boxes, polygons, rings,
bars, and cut-out leaves of all sizes."""

from __future__ import annotations

import numpy as np

from . import textures


def inside(kind: int, u: np.ndarray, v: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Which points (u, v) of [-1,1]^2 belong to a figure of a kind."""
    box = np.maximum(np.abs(u), np.abs(v)) < 1
    if kind == 0:
        return u * u + v * v < 1
    if kind == 1:
        return box
    if kind == 2:  # convex polygon
        angles = rng.uniform(0, 2 * np.pi, int(rng.integers(3, 8)))
        return box & (np.max([u * np.cos(a) + v * np.sin(a) for a in angles], 0)
                      < rng.uniform(0.3, 0.8))
    if kind == 3:
        return np.abs(np.hypot(u, v) - 0.8) < rng.uniform(0.02, 0.2)
    if kind == 4:  # bars, or a lattice
        k, duty = rng.integers(3, 24, 2), rng.uniform(0.15, 0.6)
        bars = (u * k[0]) % 1 < duty
        return box & (bars | ((v * k[1]) % 1 < duty) if rng.random() < 0.4 else bars)
    cut = textures.leaf_mask(rng, 64)
    at = ((np.stack([v, u]) * 0.5 + 0.5) * 64).astype(int).clip(0, 63)
    return box & (cut[at[0], at[1]] > 0.5)


def paint(h: int, w: int, count: int, sizes: tuple[float, float], rng: np.random.Generator):
    """Numbers of the figures seen at the points of [h,w] (0: behind all), and their own u, v."""
    number = np.zeros((h, w), np.int32)
    v, u = (np.broadcast_to(t, (h, w)).astype(np.float32) for t in
            (np.linspace(-1, 1, h)[:, None], np.linspace(-1, 1, w)))
    u, v = u.copy(), v.copy()
    power = rng.uniform(-2.5, -0.5)
    a, b = sizes[0] ** power, sizes[1] ** power
    radii = (a + rng.random(count) * (b - a)) ** (1 / power)
    if rng.random() < 0.6:
        radii = np.sort(radii)[::-1]
    large = int(rng.integers(0, 9))  # behind the others
    radii[:large] = rng.uniform(0.15, 0.8, len(radii[:large])) * w
    for i, r in enumerate(radii):
        aspect = np.exp(rng.normal(0, 0.5)) if rng.random() < 0.8 else rng.uniform(0.02, 0.15)
        x, y, turn = rng.uniform(0, w), rng.uniform(0, h), rng.uniform(0, 2 * np.pi)
        if rng.random() < 0.4:
            turn = rng.normal(0, 0.03)
        ru, rv = r * np.sqrt(aspect), max(r / np.sqrt(aspect), 0.5)
        reach = np.hypot(ru, rv)
        ys = slice(max(0, int(y - reach)), max(0, min(h, int(y + reach) + 1)))
        xs = slice(max(0, int(x - reach)), max(0, min(w, int(x + reach) + 1)))
        dy = (np.arange(ys.start, ys.stop) - y)[:, None].astype(np.float32)
        dx = (np.arange(xs.start, xs.stop) - x).astype(np.float32)
        c, s = np.float32(np.cos(turn)), np.float32(np.sin(turn))
        uu, vv = (c * dx + s * dy) / np.float32(ru), (c * dy - s * dx) / np.float32(rv)
        kind = int(rng.choice(6, p=[0.25, 0.3, 0.2, 0.08, 0.09, 0.08]))
        m = inside(kind, uu, vv, rng)
        number[ys, xs][m] = i + 1
        u[ys, xs][m] = uu[m]
        v[ys, xs][m] = vv[m]
    return number, u, v
