"""A noisy picture made by arithmetic: calibration for those who give no pictures of their own.

Spheres over a checkered floor under a sky, lit by a sun and some lamps, with the noise of few
samples: multiplicative, with bright outliers; the albedo and the normals noisy at edges. Made with
integer hashes and elementary functions only, so it is the same everywhere.
"""
from __future__ import annotations

import numpy as np

PLANES = tuple((np.array(n, np.float64), d) for n, d in (  # normal, distance; seen from inside
    ((0, 1, 0), 0.0), ((0, 0, 1), 4.5), ((1, 0, 0), 3.0), ((-1, 0, 0), 3.5)))
GAMMA = np.uint64(0x9E3779B97F4A7C15)


def uniform(seed: int, *shape: int) -> np.ndarray:
    """Numbers in (0,1), a function of seed and index (SplitMix64)."""
    count = int(np.prod(shape))
    with np.errstate(over="ignore"):
        z = (np.arange(1, count + 1, dtype=np.uint64) + np.uint64(seed << 32)) * GAMMA
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return (((z >> np.uint64(11)).astype(np.float64) + 0.5) / 2.0**53).reshape(shape)


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.maximum(np.sqrt((v * v).sum(-1, keepdims=True)), 1e-12)


def _rotation(u: np.ndarray) -> np.ndarray:
    """[3,3] from four numbers in (0,1): the coordinate system that normals are given in."""
    a, b, c, d = _unit(u * 2 - 1)
    return np.array([[a*a + b*b - c*c - d*d, 2 * (b*c - a*d), 2 * (b*d + a*c)],
                     [2 * (b*c + a*d), a*a - b*b + c*c - d*d, 2 * (c*d - a*b)],
                     [2 * (b*d - a*c), 2 * (c*d + a*b), a*a - b*b - c*c + d*d]])


def _texture(point: np.ndarray, kind: float, tint: np.ndarray) -> np.ndarray:
    """Albedo [...,3] at surface points [...,3]: plain, checkered, striped or mottled."""
    x, y, z = (point[..., i] for i in range(3))
    patterns = (np.ones_like(x), (np.floor(2 * x) + np.floor(2 * z) + np.floor(2 * y)) % 2,
                0.5 + 0.5 * np.sin(9 * x + 4 * y), 0.5 + 0.25 * (np.sin(5 * x) + np.sin(7 * z)))
    share = patterns[int(kind * len(patterns))][..., None]
    return np.clip(tint * (0.15 + 0.85 * share), 0.02, 0.98)


def scene(size: int, seed: int) -> dict[str, np.ndarray]:
    """Noise-free color (radiance), albedo and normal, each [size,size,3]."""
    axis = (np.arange(size) + 0.5) / size * 2 - 1
    sx, sy = np.meshgrid(axis, -axis)
    ray = _unit(np.stack([sx, sy - 0.25, np.full_like(sx, -1.6)], -1))
    sun = _unit(uniform(seed, 3) * 2 - 1 + np.array([0, 1.2, 0.6]))
    up = np.clip(ray[..., 1:2], 0, 1)
    color = (np.array([0.5, 0.7, 1.0]) * (0.25 + 0.9 * up)
             + 4 * np.clip(ray @ sun, 0, 1)[..., None] ** 64)
    albedo, normal = np.ones_like(ray), np.zeros_like(ray)
    depth = np.full(sx.shape, np.inf)
    eye = np.array([0.0, 1.0, 4.0])

    def put(t: np.ndarray, n: np.ndarray, kind: float, tint: np.ndarray, glow: float) -> None:
        hit = (t > 1e-3) & (t < depth)
        point = eye + np.where(hit, t, 0)[..., None] * ray
        a = _texture(point, kind, tint)
        light = (2.5 * np.clip(n @ sun, 0, None) + 0.25 * (0.6 + 0.4 * n[..., 1]))[..., None]
        mirror = _unit(ray - 2 * (ray * n).sum(-1, keepdims=True) * n)
        shine = 6 * np.clip(mirror @ sun, 0, 1)[..., None] ** 40
        fog = np.exp(-0.05 * np.where(hit, t, 0))[..., None]
        shaded = (a * light + 0.3 * shine) * fog + glow
        color[hit], albedo[hit], normal[hit] = shaded[hit], a[hit], n[hit]
        depth[hit] = t[hit]

    for i, (n, distance) in enumerate(PLANES[:1 if seed % 2 else None]):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -(eye @ n + distance) / (ray @ n)
        put(np.where((t > 0) & (t < 40), t, np.inf), np.broadcast_to(n, ray.shape),
            uniform(seed + 50, len(PLANES))[i], 0.3 + 0.6 * uniform(seed + 60 + i, 3), 0.0)
    for i in range(14):
        u = uniform(seed + 101 + i, 9)
        center = np.array([u[0] * 5 - 2.5, u[1] * 1.8, u[2] * 5 - 3.5])
        radius = 0.15 + 0.45 * u[3]
        b = (ray * (eye - center)).sum(-1)
        root = b * b - ((eye - center) ** 2).sum() + radius**2
        t = np.where(root > 0, -b - np.sqrt(np.maximum(root, 0)), np.inf)
        n = _unit(eye + np.where(np.isfinite(t), t, 0)[..., None] * ray - center)
        put(t, n, u[4], u[5:8], 30.0 * (u[8] > 0.85) if i % 3 else 0.0)
    shade = 10 ** (-2.5 * np.clip(np.sin(2.1 * sx + seed) * np.sin(1.7 * sy) - 0.2, 0, 1))
    turn = _rotation(uniform(seed + 90, 4))
    return {"color": color * shade[..., None], "albedo": albedo, "normal": normal @ turn}


def _edges(x: np.ndarray, seed: int) -> np.ndarray:
    """Each pixel takes a neighbour's value now and then, as within one pixel's samples."""
    pick = (uniform(seed, *x.shape[:2]) * 4).astype(int)[..., None]
    out = x
    for i, (dy, dx) in enumerate(((0, 1), (1, 0), (1, 1))):
        out = np.where(pick == i, 0.5 * x + 0.5 * np.roll(x, (dy, dx), (0, 1)), out)
    return out


def noisy(size: int, seed: int, samples: int) -> dict[str, np.ndarray]:
    """A render of `samples` samples per pixel: float32 color, albedo, normal, [size,size,3]."""
    clean = scene(size, seed)
    grey = np.ones(3)
    for i in range(samples):  # mean of exponential variables, one per sample, mostly grey
        u = -np.log(uniform(seed + 1000 + i, size, size, 1))
        tint = -np.log(uniform(seed + 2000 + i, size, size, 3))
        grey = grey + 0.8 * u + 0.2 * tint
    color = _edges(clean["color"], seed + 1) * (grey - 1) / samples
    u = uniform(seed + 2, size, size, 1)
    color = color * np.where(u < 0.004 / samples, 0.05 / np.maximum(u * samples, 1e-4), 1.0)
    color = np.where(uniform(seed + 3, size, size, 1) < 0.3 / samples**2, 0.02 * color, color)
    return {"color": color.astype(np.float32),
            "albedo": _edges(clean["albedo"], seed + 4).astype(np.float32),
            "normal": _edges(clean["normal"], seed + 5).astype(np.float32)}
