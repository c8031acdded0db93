"""Procedural bitmaps, (n, n, 3) or (n, n) float32 in [0, 1], tileable unless said otherwise."""

from __future__ import annotations

import numpy as np


def _grid(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Pixel coordinates x, y in [0, 1)."""
    t = (np.arange(n) + 0.5) / n
    return np.meshgrid(t, t)


def noise(rng: np.random.Generator, n: int, cells: int) -> np.ndarray:
    """Tileable value noise in [0, 1] with the given number of cells per side."""
    g = rng.random((cells, cells))
    t = np.arange(n) / n * cells
    i = t.astype(int)
    f = t - i
    f = f * f * (3 - 2 * f)
    j = (i + 1) % cells
    rows = g[i] * (1 - f)[:, None] + g[j] * f[:, None]
    return (rows[:, i] * (1 - f) + rows[:, j] * f).astype(np.float32)


def fbm(rng: np.random.Generator, n: int, cells: int = 4, octaves: int = 5,
        gain: float = 0.55) -> np.ndarray:
    """Sum of noises of doubling frequency, stretched to [0, 1]."""
    total = sum(noise(rng, n, min(cells << k, n)) * gain ** k for k in range(octaves))
    return (total - total.min()) / max(float(np.ptp(total)), 1e-6)


def _mix(m: np.ndarray, a, b) -> np.ndarray:
    m = m[..., None]
    return (np.asarray(a) * (1 - m) + np.asarray(b) * m).astype(np.float32)


def _checks(rng, n):
    x, y = _grid(n)
    k = int(rng.integers(1, 9)) * 2
    return ((np.floor(x * k) + np.floor(y * k)) % 2)


def _stripes(rng, n):
    x, y = _grid(n)
    a, b = int(rng.integers(0, 13)), int(rng.integers(1, 25))
    s = np.sin(2 * np.pi * (a * x + b * y))
    return s * 0.5 + 0.5 if rng.random() < 0.4 else (s > rng.uniform(-0.8, 0.8)) * 1.0


def _bricks(rng, n):
    x, y = _grid(n)
    rows = int(rng.integers(2, 9)) * 2
    cols = max(1, rows // 2)
    row = np.floor(y * rows)
    bx = x * cols + 0.5 * (row % 2)
    gap = rng.uniform(0.03, 0.12)
    fx, fy = bx % 1, (y * rows) % 1
    mortar = (fx < gap * 0.5) | (fy < gap)
    tone = rng.random((rows, cols))[row.astype(int), np.floor(bx).astype(int) % cols]
    return np.where(mortar, 0.0, 0.35 + 0.65 * tone) * (0.8 + 0.2 * fbm(rng, n, 8, 4))


def _tiles(rng, n):
    x, y = _grid(n)
    k = int(rng.integers(2, 13))
    gap = rng.uniform(0.02, 0.1)
    tone = rng.random((k, k))[(y * k).astype(int), (x * k).astype(int)]
    joint = ((x * k) % 1 < gap) | ((y * k) % 1 < gap)
    return np.where(joint, 0.05, 0.5 + 0.5 * tone * rng.uniform(0, 1))


def _wood(rng, n):
    x, y = _grid(n)
    planks = int(rng.integers(1, 7))
    plank = np.floor(x * planks)
    shift = rng.random(planks)[plank.astype(int) % planks]
    warp = fbm(rng, n, 2, 4)
    rings = np.sin(2 * np.pi * (x * int(rng.integers(6, 20)) + 2 * warp + shift * 7))
    fine = noise(rng, n, n // 2)
    grain = np.roll(fine, 1, 0) * 0.5 + fine * 0.5
    out = 0.45 + 0.25 * rings + 0.2 * grain + 0.25 * (shift - 0.5)
    return np.clip(np.where((x * planks) % 1 < 0.015, 0.05, out), 0, 1)


def _marble(rng, n):
    x, y = _grid(n)
    w = fbm(rng, n, 3, 6, 0.6)
    v = np.abs(np.sin(2 * np.pi * (x * int(rng.integers(0, 3)) + y + 2.5 * w)))
    return np.clip(v ** rng.uniform(0.3, 1.5), 0, 1)


def _dots(rng, n):
    x, y = _grid(n)
    k = int(rng.integers(3, 17))
    jitter = rng.uniform(-0.2, 0.2, (2, k, k)) * (rng.random() < 0.5)
    r = rng.uniform(0.12, 0.3, (k, k))
    iy, ix = (y * k).astype(int), (x * k).astype(int)
    fx, fy = (x * k) % 1 - 0.5 - jitter[0, iy, ix], (y * k) % 1 - 0.5 - jitter[1, iy, ix]
    return (fx * fx + fy * fy < r[iy, ix] ** 2) * 1.0


def _cells(rng, n):
    """Cracked ground or leather: distance to the second nearest of random points, minus nearest."""
    k = int(rng.integers(4, 14))
    x, y = _grid(n)
    p = rng.random((k, k, 2))
    best = np.full((2, n, n), 9.0)
    iy, ix = (y * k).astype(int), (x * k).astype(int)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            q = p[(iy + dy) % k, (ix + dx) % k]
            d = np.hypot(ix + dx + q[..., 0] - x * k, iy + dy + q[..., 1] - y * k)
            best = np.sort(np.concatenate([best, d[None]]), 0)[:2]
    edge = best[1] - best[0]
    return np.clip(edge * 2, 0, 1) if rng.random() < 0.5 else (edge > 0.07) * 1.0


def _text(rng, n):
    """Lines of glyph-like strokes: print, labels, high frequencies."""
    m = np.zeros((n, n), np.float32)
    h = int(rng.choice([6, 9, 14, 22]))
    w = max(3, int(h * 0.6))
    for top in range(h // 2, n - h, int(h * 1.7)):
        left = int(rng.integers(0, 3 * w))
        end = n - int(rng.integers(0, n // 2))
        while left < end - w:
            if rng.random() < 0.17:
                left += w
                continue
            t = max(1, h // 8)
            for _ in range(int(rng.integers(2, 5))):
                a, b = int(rng.integers(0, h - t + 1)), int(rng.integers(0, w - t + 1))
                if rng.random() < 0.5:
                    m[top + a: top + a + t, left: left + w - 1] = 1
                else:
                    m[top: top + h, left + b: left + b + t] = 1
            left += w + max(1, t)
    return m


def _plaid(rng, n):
    x, y = _grid(n)
    k = rng.integers(1, 12, 4)
    a = (np.sin(2 * np.pi * k[0] * x) > 0.3) * 0.5 + (np.sin(2 * np.pi * k[1] * x + 1) > 0.8) * 0.5
    b = (np.sin(2 * np.pi * k[2] * y) > 0.3) * 0.5 + (np.sin(2 * np.pi * k[3] * y + 1) > 0.8) * 0.5
    weave = 0.85 + 0.15 * ((np.floor(x * n / 2) + np.floor(y * n / 2)) % 2)
    return (a + b) * 0.5 * weave


def _speckle(rng, n):
    return np.clip((rng.random((n, n)) ** rng.uniform(1, 6) + 0.3 * fbm(rng, n, 8, 4)) / 1.3, 0, 1)


def _arcs(rng, n):
    """Truchet tiles: quarter circles."""
    k = int(rng.integers(3, 13))
    x, y = _grid(n)
    iy, ix = (y * k).astype(int), (x * k).astype(int)
    flip = rng.random((k, k))[iy, ix] < 0.5
    fx, fy = (x * k) % 1, (y * k) % 1
    fx = np.where(flip, 1 - fx, fx)
    d = np.minimum(np.abs(np.hypot(fx, fy) - 0.5), np.abs(np.hypot(1 - fx, 1 - fy) - 0.5))
    return (d < rng.uniform(0.06, 0.2)) * 1.0


PATTERNS = (_checks, _stripes, _bricks, _tiles, _wood, _marble, _dots, _cells, _text, _plaid,
            _speckle, _arcs)
FLOORS = (_checks, _bricks, _tiles, _wood, _wood, _marble, _cells, _plaid, _speckle)
HEIGHTS = (_bricks, _tiles, _dots, _cells, _marble, _stripes, _plaid, _wood)


def mask(rng: np.random.Generator, n: int, kinds=PATTERNS) -> np.ndarray:
    """A random pattern in [0, 1], (n, n)."""
    return np.asarray(kinds[rng.integers(len(kinds))](rng, n), np.float32)


def picture(rng: np.random.Generator, n: int, colour, kinds=PATTERNS) -> np.ndarray:
    """A random pattern in two or three colours; colour: function giving one colour."""
    img = _mix(mask(rng, n, kinds), colour(rng), colour(rng))
    if rng.random() < 0.25:
        img = _mix(mask(rng, n, kinds) * rng.uniform(0.3, 1), img, colour(rng))
    if rng.random() < 0.5:
        img = img * (1 - rng.uniform(0.1, 0.5) * fbm(rng, n, 4, 6)[..., None])
    return np.clip(img, 0.005, 0.95).astype(np.float32)


def atlas(rng: np.random.Generator, n: int, colour, side: int = 4) -> np.ndarray:
    """side x side different pictures in one bitmap (not tileable)."""
    k = n // side
    rows = [np.concatenate([picture(rng, k, colour) for _ in range(side)], 1)
            for _ in range(side)]
    return np.concatenate(rows, 0)


def leaf_mask(rng: np.random.Generator, n: int) -> np.ndarray:
    """Cut-out: a leaf, a grid, holes, or a ragged cluster; 1 = opaque (not tileable)."""
    x, y = _grid(n)
    kind = rng.integers(4)
    if kind == 0:
        lobes = int(rng.integers(1, 6))
        a = np.arctan2(y - 0.4, x - 0.5)
        r = np.hypot(x - 0.5, (y - 0.45) * 0.9)
        m = r < 0.38 * (0.65 + 0.35 * np.cos(lobes * (a - np.pi / 2)))
        m |= (np.abs(x - 0.5) < 0.02) & (y < 0.5)
    elif kind == 1:
        m = ((x * 9) % 1 < 0.25) | ((y * 9) % 1 < 0.25)
    elif kind == 2:
        m = _dots(rng, n) < 0.5
    else:
        m = fbm(rng, n, 8, 4) * (1.15 - 1.6 * np.hypot(x - 0.5, y - 0.5)) > 0.4
    return m.astype(np.float32)


def normal_map(height: np.ndarray, strength: float) -> np.ndarray:
    """Tangent-space normals of a tileable height field, encoded to [0, 1], (n, n, 3)."""
    n = height.shape[0]
    dx = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * strength * n / 64
    dy = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) * strength * n / 64
    v = np.stack([-dx, -dy, np.ones_like(dx)], -1)
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    return (v * 0.5 + 0.5).astype(np.float32)


def sky(rng: np.random.Generator, n: int = 256) -> np.ndarray:
    """Latitude-longitude radiance (n/2, n, 3), zenith in the first row; unbounded values.

    Kinds: blue sky with sun and clouds, overcast, studio with light boxes, dusk, night with lamps.
    """
    h = n // 2
    el = (0.5 - (np.arange(h) + 0.5) / h) * np.pi
    az = (np.arange(n) + 0.5) / n * 2 * np.pi
    d = np.stack([np.cos(el)[:, None] * np.cos(az), np.cos(el)[:, None] * np.sin(az),
                  np.sin(el)[:, None] + 0 * az], -1)
    up = np.clip(d[..., 2:], 0, 1)
    kind = rng.choice(["clear", "clear", "overcast", "studio", "dusk", "night"])
    tints = {"clear": ((0.25, 0.45, 0.9), (0.8, 0.85, 0.95)),
             "overcast": ((0.8, 0.8, 0.85), (0.5, 0.5, 0.55)),
             "studio": ((0.06, 0.06, 0.07), (0.03, 0.03, 0.03)),
             "dusk": ((0.08, 0.1, 0.3), (0.9, 0.45, 0.2)),
             "night": ((0.005, 0.007, 0.02), (0.02, 0.02, 0.03))}
    zenith, horizon = (np.array(c) * rng.uniform(0.7, 1.3, 3) for c in tints[kind])
    img = zenith * up ** 0.5 + horizon * (1 - up ** 0.5)
    if kind in ("clear", "dusk", "overcast") and rng.random() < 0.6:
        clouds = np.clip(fbm(rng, n, 6, 6)[:h] * 2 - rng.uniform(0.6, 1.2), 0, 1)[..., None]
        img = img * (1 - clouds * (up > 0)) + clouds * (up > 0) * horizon * 1.1
    if kind == "studio":
        for _ in range(int(rng.integers(1, 5))):
            c = rng.uniform((0.1, 0), (0.6, 1))
            s = rng.uniform(0.03, 0.12, 2)
            box = ((np.abs((np.arange(h) / h)[:, None] - c[0] * 0.6) < s[0])
                   & (np.abs((np.arange(n) / n - c[1] + 0.5) % 1 - 0.5)[None] < s[1]))
            img[box] += rng.uniform(2, 12) * rng.uniform(0.7, 1.0, 3)
    suns = {"clear": 1, "dusk": 1, "night": int(rng.integers(2, 8))}.get(kind, 0)
    for _ in range(suns):
        e = rng.uniform(0.03, 0.25) if kind == "dusk" else rng.uniform(0.15, 1.3)
        a = rng.uniform(0, 2 * np.pi)
        s = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        cosine = d @ s
        size = rng.choice([0.012, 0.02, 0.05, 0.12])
        disc = np.clip((cosine - np.cos(size * 1.5)) / (np.cos(size) - np.cos(size * 1.5)), 0, 1)
        if disc.max() < 0.5:
            disc = (cosine == cosine.max()) * 1.0
        warm = np.array([1.0, 0.85, 0.65]) if kind != "dusk" else np.array([1.0, 0.5, 0.2])
        img = img + disc[..., None] * warm * rng.uniform(1.0, 5.0) / size ** 2 * 0.35
        img = img + np.clip(cosine, 0, 1)[..., None] ** 200 * warm * 0.5
    ground = rng.uniform(0.05, 0.4) * np.array([1.0, 0.95, 0.85]) * horizon
    return np.where(d[..., 2:] < 0, ground, img).astype(np.float32)
