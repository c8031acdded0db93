"""Vegetation and other thin things: leaves, bushes, trees, grass, ferns, wires, lattices."""

from __future__ import annotations

import numpy as np

from .mesh import Mesh, align_z, merge, rotate, scale, smooth_normals, translate
from .shapes import TAU, between, lathe, quad, tube

Parts = list[tuple[str, Mesh]]  # (material slot, mesh)


def vary(rng: np.random.Generator, rgb, n: int, amount: float = 0.15) -> np.ndarray:
    """n colours around rgb."""
    c = np.asarray(rgb) * np.exp(rng.normal(size=(n, 1)) * amount)
    return np.clip(c + rng.normal(size=(n, 3)) * amount * 0.25, 0.01, 0.95)


def leaf_colour(rng: np.random.Generator) -> np.ndarray:
    base = np.array([[0.10, 0.28, 0.05], [0.22, 0.38, 0.07], [0.45, 0.35, 0.06],
                     [0.42, 0.12, 0.05], [0.05, 0.18, 0.08], [0.35, 0.42, 0.30]])
    return base[rng.integers(len(base))] * rng.uniform(0.7, 1.5)


def blades(rng: np.random.Generator, root: np.ndarray, height: float, width: float,
           bend: float, rgb) -> Mesh:
    """Grass: one bent tapering blade (5 rows of 2 points) for each root (n,3)."""
    n, rows = len(root), 5
    t = np.linspace(0, 1, rows)
    yaw = rng.uniform(0, TAU, n)
    h = height * rng.uniform(0.5, 1.2, n)
    lean = bend * rng.uniform(0.2, 1.3, n)
    side = np.stack([-np.sin(yaw), np.cos(yaw), 0 * yaw], 1) * width / 2
    fwd = np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], 1)
    mid = (root[:, None] + fwd[:, None] * (h * lean)[:, None, None] * (t * t)[None, :, None])
    mid[..., 2] += h[:, None] * t * (1 - 0.35 * lean[:, None] * t)
    w = (1 - t ** 1.5)[None, :, None] + 0.02
    p = np.stack([mid - side[:, None] * w, mid + side[:, None] * w], 2)  # (n, rows, 2, 3)
    return ribbons(p, vary(rng, rgb, n))


def ribbons(p: np.ndarray, colours: np.ndarray) -> Mesh:
    """Strips of quads; p: (n, rows, 2, 3), colours: (n, 3)."""
    n, rows = p.shape[:2]
    v = p.reshape(-1, 3)
    base = (np.arange(n) * rows * 2)[:, None] + (np.arange(rows - 1) * 2)[None]
    a = base.reshape(-1, 1)
    f = np.concatenate([a + (0, 1, 3), a + (0, 3, 2)])
    uv = np.stack(np.broadcast_arrays(np.array([0.0, 1.0])[None, None],
                                      np.linspace(0, 1, rows)[None, :, None]), -1)
    uv = np.broadcast_to(uv, (n, rows, 2, 2)).reshape(-1, 2)
    return Mesh(v, f, smooth_normals(v, f), uv, np.repeat(colours, rows * 2, 0))


def cards(rng: np.random.Generator, pos: np.ndarray, size: float, rgb, up: float = 0.3,
          fold: bool = True) -> Mesh:
    """Leaves: one randomly turned (folded) card for each position (n,3)."""
    n = len(pos)
    d = rng.normal(size=(n, 3)) + (0, 0, up)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    s = np.cross(d, rng.normal(size=(n, 3)))
    s /= np.maximum(np.linalg.norm(s, axis=1, keepdims=True), 1e-9)
    up_n = np.cross(d, s)
    k = (size * rng.uniform(0.5, 1.3, (n, 1)))[:, None]
    if not fold:  # a textured square for cut-out masks
        p = np.stack([np.stack([-s, s], 1), np.stack([-s, s], 1)], 1) * 0.5
        p = p + np.stack([np.zeros_like(d), d], 1)[:, :, None]
        return ribbons(pos[:, None, None] + p * k[:, :, None], vary(rng, rgb, n))
    rows = [(0.0, 0.02), (0.35, 0.30), (0.75, 0.22), (1.0, 0.01)]
    p = np.stack([np.stack([d * t - s * w + up_n * w * 0.4, d * t + s * w - up_n * w * 0.4], 1)
                  for t, w in rows], 1)
    return ribbons(pos[:, None, None] + p * k[:, :, None], vary(rng, rgb, n))


def bush(rng: np.random.Generator, leaves: int = 900) -> Parts:
    """Ball of leaves with a few stems."""
    d = rng.normal(size=(leaves, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    lump = 0.75 + 0.25 * np.sin(d @ rng.normal(size=3) * 4)
    pos = d * (0.45 * lump * rng.uniform(0.3, 1, leaves) ** 0.4)[:, None]
    pos = pos * (1, 1, rng.uniform(0.7, 1.2)) + (0, 0, 0.5)
    stems = merge([between((0, 0, 0), p, 0.008) for p in pos[:8]]).coloured((0.2, 0.13, 0.08))
    return [("leaf", cards(rng, pos, rng.uniform(0.05, 0.14), leaf_colour(rng))),
            ("paint", stems)]


def tree(rng: np.random.Generator, depth: int = 5, leaves: bool = True) -> Parts:
    """Recursive branches with leaf cards at the twigs, about 1 unit high."""
    segs, tips = [], []
    todo = [(np.zeros(3), np.array([0, 0, 1.0]), 0.3, 0.035, depth)]
    spread = rng.uniform(0.4, 0.8)
    while todo:
        a, d, length, r, level = todo.pop()
        b = a + d * length
        segs.append(lathe(np.array([[r, 0.0], [r * 0.75, length]]), 3 + level)
                    .moved(translate(*a) @ align_z(d)))
        if level <= 2:
            tips.append(a + d * length * rng.uniform(0.2, 1))
        if level == 0:
            tips.append(b)
            continue
        for _ in range(int(rng.integers(2, 4))):
            e = d + rng.normal(size=3) * spread + (0, 0, 0.1)
            todo.append((b, e / np.linalg.norm(e), length * rng.uniform(0.6, 0.85), r * 0.65,
                         level - 1))
    bark = merge(segs).coloured(vary(rng, (0.22, 0.15, 0.1), 1)[0])
    parts: Parts = [("paint", bark)]
    if leaves:
        t = np.array(tips)
        t = np.repeat(t, max(1, 2500 // len(t)), 0)
        t = t + rng.normal(size=t.shape) * 0.04
        parts.append(("leaf", cards(rng, t, rng.uniform(0.03, 0.07), leaf_colour(rng))))
    return parts


def conifer(rng: np.random.Generator) -> Parts:
    """Stem with whorls of drooping needle ribbons."""
    n = 2200
    z = rng.uniform(0.12, 1.0, n)
    yaw = rng.uniform(0, TAU, n)
    r = (1.02 - z) * 0.33 * rng.uniform(0.3, 1, n)
    pos = np.stack([np.cos(yaw) * r, np.sin(yaw) * r, z - r * 0.35], 1)
    return [("leaf", cards(rng, pos, 0.06, leaf_colour(rng) * (0.6, 0.8, 0.8), up=-0.4)),
            ("paint", lathe(np.array([[0.03, 0.0], [0.004, 1.0]]), 7).coloured((0.2, 0.13, 0.08)))]


def fern(rng: np.random.Generator, fronds: int = 14) -> Parts:
    """Arching fronds with rows of leaflets, or plain long leaves."""
    rgb = leaf_colour(rng)
    pos, plain = [], rng.random() < 0.4
    t = np.linspace(0.05, 1, 16)
    strips = []
    for _ in range(fronds):
        yaw, lean = rng.uniform(0, TAU), rng.uniform(0.4, 1.2)
        mid = np.stack([np.cos(yaw) * t * lean * 0.6, np.sin(yaw) * t * lean * 0.6,
                        0.75 * t * (1.5 - lean * t * 0.9)], 1)
        side = np.array([-np.sin(yaw), np.cos(yaw), 0])
        w = (0.07 * np.sin(np.pi * t ** 0.7) + 0.002)[:, None]
        if plain:
            strips.append(np.stack([mid - side * w, mid + side * w], 1))
        else:
            pos += [mid + side * w * k for k in (-1.6, -0.8, 0, 0.8, 1.6)]
    if plain:
        return [("leaf", ribbons(np.stack(strips), vary(rng, rgb, fronds)))]
    return [("leaf", cards(rng, np.concatenate(pos), 0.06, rgb))]


def hedge_cards(rng: np.random.Generator, count: int = 350) -> Parts:
    """Cut-out cards (slot 'mask') filling a block: foliage by alpha masks."""
    pos = rng.uniform((-0.5, -0.5, 0.0), (0.5, 0.5, 0.9), (count, 3))
    return [("mask", cards(rng, pos, 0.3, leaf_colour(rng), fold=False))]


def lattice(rng: np.random.Generator, nx: int, nz: int, r: float = 0.012) -> Mesh:
    """Bars in the x-z plane, 1 x 1; straight or diagonal; square or round."""
    parts = []
    tilt = rng.choice([0.0, 0.5])
    for k in np.linspace(-0.5, 0.5, nx):
        parts.append(between((k, 0, 0), (np.clip(k + tilt, -0.5, 0.5), 0.006, 1), r))
    for k in np.linspace(0.02, 0.98, nz):
        parts.append(between((-0.5, 0.006, k), (0.5, 0.006, np.clip(k + tilt * 0.5, 0, 1)), r))
    return merge(parts)


def wires(rng: np.random.Generator, count: int = 14, r: float = 0.006) -> Mesh:
    """Loose curved wires in a unit box."""
    parts = []
    t = np.linspace(0, 1, 24)
    for _ in range(count):
        c = rng.normal(size=(4, 3)) * (0.5, 0.5, 0.4)
        p = ((1 - t) ** 3)[:, None] * c[0] + (3 * t * (1 - t) ** 2)[:, None] * c[1]
        p = p + (3 * t * t * (1 - t))[:, None] * c[2] + (t ** 3)[:, None] * c[3]
        parts.append(tube(p, r * rng.uniform(0.5, 2), 6))
    m = merge(parts)
    return m.moved(translate(0, 0, -m.v[:, 2].min()))


def hair_patch(rng: np.random.Generator, count: int = 1200) -> Parts:
    """Tuft of thin fibres on a ball: fur, dandelions, brushes."""
    d = rng.normal(size=(count, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    tip = d * rng.uniform(0.42, 0.55, (count, 1)) + rng.normal(size=(count, 3)) * 0.03
    root = d * 0.25
    s = np.cross(d, rng.normal(size=(count, 3)))
    s = 0.004 * s / np.linalg.norm(s, axis=1, keepdims=True)
    p = np.stack([np.stack([root - s, root + s], 1),
                  np.stack([tip - s * 0.3, tip + s * 0.3], 1)], 1)
    m = ribbons(p + (0, 0, 0.55), vary(rng, rng.uniform(0.1, 0.8, 3), count, 0.3))
    return [("leaf", m)]


def blinds(rng: np.random.Generator, slats: int = 18, angle: float = 0.6) -> Mesh:
    """Horizontal slats in the x-z plane, 1 x 1."""
    one = quad(1.0, 0.9 / slats).moved(rotate((1, 0, 0), angle))
    m = merge([one.moved(translate(0, 0, z)) for z in np.linspace(0.03, 0.97, slats)])
    return m.coloured(rng.uniform(0.3, 0.9, 3))


def fence(rng: np.random.Generator, posts: int = 12) -> Mesh:
    """Picket fence along x, 1 long, 0.4 high."""
    w = rng.uniform(0.2, 0.7) / posts
    one = quad(w, 0.4).moved(translate(0, 0, 0.2) @ rotate((1, 0, 0), np.pi / 2))
    parts = [one.moved(translate(x, 0, 0) @ scale(1, 1, rng.uniform(0.9, 1.1)))
             for x in np.linspace(-0.5, 0.5, posts)]
    parts += [between((-0.5, 0.01, z), (0.5, 0.01, z), 0.012) for z in (0.1, 0.3)]
    return merge(parts)
