"""Shapes made in numpy. All stand on z = 0 unless said otherwise, z up, about one unit large."""

from __future__ import annotations

import numpy as np

from .mesh import (Mesh, align_z, faceted, grid_mesh, merge, random_rotation, rotate, scale,
                   smooth_normals, translate)

TAU = 2 * np.pi


def quad(sx: float = 1.0, sy: float = 1.0) -> Mesh:
    """Rectangle in z = 0, centred, normal +z."""
    v = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * (sx / 2, sy / 2, 1)
    return Mesh(v, np.array([[0, 1, 2], [0, 2, 3]]), np.tile((0.0, 0.0, 1.0), (4, 1)),
                np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]))


def box(sx: float = 1.0, sy: float = 1.0, sz: float = 1.0) -> Mesh:
    """Box on z = 0 centred in x and y; every side has the whole texture."""
    q = quad().moved(translate(0, 0, 0.5))
    sides = [rotate((0, 0, 1), 0), rotate((1, 0, 0), np.pi)]
    sides += [rotate((0, 0, 1), a) @ rotate((1, 0, 0), np.pi / 2) for a in np.arange(4) * TAU / 4]
    m = merge([q.moved(s) for s in sides])
    m.c = None
    return m.moved(scale(sx, sy, sz) @ translate(0, 0, 0.5))


def bevel_box(sx: float, sy: float, sz: float, r: float, k: int = 3) -> Mesh:
    """Box with rounded edges of radius r; k: segments per quarter turn."""
    n = 2 * k + 2
    t = np.repeat([-1.0, 1.0], k + 1)
    ang = np.concatenate([np.linspace(-np.pi / 4, 0, k + 1), np.linspace(0, np.pi / 4, k + 1)])
    faces = []
    half = np.array([sx, sy, sz]) / 2
    r = min(r, half.min() * 0.95)
    for axis in range(3):
        for sign in (-1, 1):
            u, w = (axis + 1) % 3, (axis + 2) % 3
            core = np.zeros((n, n, 3))
            out = np.zeros((n, n, 3))
            core[..., axis] = sign
            core[..., u], core[..., w] = t[:, None], t[None, :]
            out[..., axis] = sign
            out[..., u], out[..., w] = np.tan(ang)[:, None], np.tan(ang)[None, :]
            out /= np.linalg.norm(out, axis=-1, keepdims=True)
            p = core * (half - r) + out * r
            g = grid_mesh(p if sign < 0 else p.transpose(1, 0, 2))
            nrm = out if sign < 0 else out.transpose(1, 0, 2)
            faces.append(Mesh(g.v, g.f, nrm.reshape(-1, 3).copy(), g.uv))
    m = merge(faces)
    m.c = None
    return m.moved(translate(0, 0, sz / 2))


def sphere(r: float = 0.5, seg: int = 32) -> Mesh:
    """UV sphere resting on z = 0."""
    a = np.linspace(0, TAU, seg + 1)
    b = np.linspace(1e-3, np.pi - 1e-3, seg // 2 + 1)
    d = np.stack([np.sin(b)[:, None] * np.cos(a), np.sin(b)[:, None] * np.sin(a),
                  np.cos(b)[:, None] * np.ones_like(a)], -1)
    g = grid_mesh(d[::-1] * r)
    return Mesh(g.v + (0, 0, r), g.f, d[::-1].reshape(-1, 3).copy(), g.uv)


def lathe(profile: np.ndarray, seg: int = 36) -> Mesh:
    """Surface of revolution of a profile (n,2) of (radius, z), outside listed bottom to top."""
    a = np.linspace(0, TAU, seg + 1)
    p = np.stack([profile[:, :1] * np.cos(a), profile[:, :1] * np.sin(a),
                  profile[:, 1:] * np.ones_like(a)], -1)
    return grid_mesh(p, close_u=True)


def cylinder(r: float = 0.5, h: float = 1.0, seg: int = 28, r_top: float | None = None) -> Mesh:
    """Closed cylinder or cone frustum with flat caps."""
    t = r if r_top is None else r_top
    side = lathe(np.array([[r, 0.0], [t, h]]), seg)
    parts = [side]
    if r > 1e-6:
        parts.append(disk(r, seg).moved(rotate((1, 0, 0), np.pi)))
    if t > 1e-6:
        parts.append(disk(t, seg).moved(translate(0, 0, h)))
    m = merge(parts)
    m.c = None
    return m


def disk(r: float = 0.5, seg: int = 28) -> Mesh:
    """Disk in z = 0 facing +z."""
    a = np.linspace(0, TAU, seg + 1)[:-1]
    v = np.concatenate([[[0, 0, 0]], np.stack([r * np.cos(a), r * np.sin(a), 0 * a], 1)])
    i = np.arange(seg)
    f = np.stack([0 * i, 1 + i, 1 + (i + 1) % seg], 1)
    return Mesh(v, f, np.tile((0.0, 0.0, 1.0), (seg + 1, 1)), v[:, :2] / (2 * r) + 0.5)


def tube(path: np.ndarray, radius, seg: int = 8, closed: bool = False) -> Mesh:
    """Tube along a polyline (n,3); radius: number or (n,)."""
    p = np.asarray(path, float)
    t = np.gradient(p, axis=0)
    if closed:
        t[0] = t[-1] = p[1] - p[-2]
    t /= np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1e-12)
    frames = np.zeros((len(p), 2, 3))
    x = np.cross(t[0], (0, 0, 1.0) if abs(t[0, 2]) < 0.9 else (1.0, 0, 0))
    for k in range(len(p)):
        x = x - t[k] * (x @ t[k])
        x /= max(np.linalg.norm(x), 1e-12)
        frames[k] = x, np.cross(t[k], x)
    if closed:  # spread the twist so that the ends meet
        c = np.clip(frames[0, 0] @ frames[-1, 0], -1, 1)
        s = np.dot(np.cross(frames[-1, 0], frames[0, 0]), t[0])
        twist = np.linspace(0, np.arctan2(s, c), len(p))
        fx = frames[:, 0] * np.cos(twist)[:, None] + frames[:, 1] * np.sin(twist)[:, None]
        frames = np.stack([fx, np.cross(t, fx)], 1)
    a = np.linspace(0, TAU, seg + 1)
    r = np.broadcast_to(radius, (len(p),))[:, None, None]
    ring = frames[:, :1] * np.cos(a)[None, :, None] + frames[:, 1:] * np.sin(a)[None, :, None]
    m = grid_mesh(p[:, None] + ring * r, close_u=True)
    n = ring / np.linalg.norm(ring, axis=-1, keepdims=True)
    return Mesh(m.v, m.f, n.reshape(-1, 3).copy(), m.uv)


def knot(p: int = 2, q: int = 3, r: float = 0.09, steps: int = 160, seg: int = 14) -> Mesh:
    """Torus knot, standing."""
    t = np.linspace(0, TAU, steps)
    w = 0.3 + 0.13 * np.cos(q * t)
    path = np.stack([w * np.cos(p * t), 0.16 * np.sin(q * t), w * np.sin(p * t)], 1)
    m = tube(path, r, seg, closed=True)
    return m.moved(translate(0, 0, -m.v[:, 2].min()))


def torus(major: float = 0.38, minor: float = 0.12) -> Mesh:
    """Torus lying on z = 0."""
    t = np.linspace(0, TAU, 49)
    path = np.stack([major * np.cos(t), major * np.sin(t), 0 * t + minor], 1)
    return tube(path, minor, 18, closed=True)


def bumps(d: np.ndarray, rng: np.random.Generator, waves: int, freq: float) -> np.ndarray:
    """Smooth random field on points (n,3): a sum of sines, about -1..1."""
    k = rng.normal(size=(waves, 3)) * freq
    phase = rng.uniform(0, TAU, waves)
    amp = 1.0 / np.sqrt(1 + np.linalg.norm(k, axis=1))
    return (np.sin(d @ k.T + phase) * amp).sum(1) / amp.sum() * 1.6


def displaced(rng: np.random.Generator, seg: int = 56, amount: float = 0.25,
              freq: float = 4.0) -> Mesh:
    """Sphere with a random displacement: pebbles, blobs, crumpled things."""
    s = sphere(0.5, seg)
    d = (s.v - (0, 0, 0.5)) * 2
    r = 1 + amount * bumps(d, rng, 12, freq) + 0.3 * amount * bumps(d, rng, 16, freq * 4)
    v = d * (0.5 * r)[:, None]
    v[:, 2] -= v[:, 2].min()
    g = grid_mesh(v.reshape(seg // 2 + 1, seg + 1, 3), close_u=True)
    return Mesh(g.v, g.f, g.n, g.uv)


def superquadric(rng: np.random.Generator, seg: int = 40) -> Mesh:
    """Cushions, rounded bricks, stars: powers of a sphere's coordinates."""
    e1, e2 = rng.uniform(0.15, 1.6, 2)
    s = sphere(0.5, seg)
    a = np.arctan2(s.n[:, 1], s.n[:, 0])
    b = np.arcsin(np.clip(s.n[:, 2], -1, 1))

    def power(x, e):
        return np.sign(x) * np.abs(x) ** e

    v = np.stack([power(np.cos(b), e1) * power(np.cos(a), e2),
                  power(np.cos(b), e1) * power(np.sin(a), e2), power(np.sin(b), e1)], 1) * 0.5
    v = v + (0, 0, 0.5)
    return Mesh(v, s.f, smooth_normals(v, s.f), s.uv)


def gear(teeth: int, h: float = 0.2) -> Mesh:
    """Flat-shaded toothed wheel."""
    a = np.linspace(0, TAU, teeth * 4 + 1)
    r = np.where((np.arange(teeth * 4 + 1) % 4) < 2, 0.5, 0.38)
    ring = np.stack([r * np.cos(a), r * np.sin(a)], 1)
    rows = [(0.3, 0.0), (1.0, 0.0), (1.0, h), (0.3, h), (0.3, 0.0)]
    p = np.stack([np.concatenate([ring * k, np.full((len(a), 1), z)], 1) for k, z in rows])
    return faceted(grid_mesh(p))


def twisted_prism(rng: np.random.Generator) -> Mesh:
    """Polygonal column twisted along its height."""
    sides = int(rng.integers(3, 8))
    a = np.linspace(0, TAU, sides + 1)
    z = np.linspace(0, 1, 25)
    turn, taper = rng.uniform(-2.5, 2.5), rng.uniform(0.2, 1.0)
    ang = a[None] + turn * z[:, None]
    r = 0.4 * (1 + (taper - 1) * z)[:, None]
    p = np.stack([r * np.cos(ang), r * np.sin(ang), z[:, None] + 0 * ang], -1)
    cap = np.zeros((1, sides + 1, 3))
    return faceted(grid_mesh(np.concatenate([cap, p, cap + (0, 0, 1)])))


def pile(rng: np.random.Generator, make, count: int, spread: float, size: float) -> Mesh:
    """Scattered random copies in a heap."""
    parts = []
    for _ in range(count):
        x, y = rng.normal(size=2) * spread
        s = size * rng.uniform(0.5, 1.3)
        z = max(0.0, spread * 0.8 - np.hypot(x, y) * 0.6) * rng.uniform(0, 1)
        parts.append(make().moved(translate(x, y, z) @ random_rotation(rng) @ scale(s)))
    m = merge(parts)
    return m.moved(translate(0, 0, -np.percentile(m.v[:, 2], 2)))


def between(a, b, r: float, seg: int = 6) -> Mesh:
    """Open cylinder from point a to point b."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    d = b - a
    m = lathe(np.array([[r, 0.0], [r, float(np.linalg.norm(d))]]), seg)
    return m.moved(translate(*a) @ align_z(d))
