"""Layouts under the sky: gardens and streets."""

from __future__ import annotations

import numpy as np

from . import furniture as fu
from . import plants as pl
from . import shapes as sh
from .mesh import faceted, grid_mesh, merge, rotate, scale, translate
from .plants import Parts
from .stage import Ground, Stage, surface


def _terrain(rng, size: float, rough: float):
    """Height field and its mesh (uv in metres)."""
    k = rng.normal(size=(10, 2)) * np.exp(rng.uniform(-1.5, 0.8, (10, 1)))
    ph = rng.uniform(0, sh.TAU, 10)
    amp = rough * 0.3 / (0.3 + np.linalg.norm(k, axis=1))

    def height(x, y):
        return float(np.sum(np.sin(x * k[:, 0] + y * k[:, 1] + ph) * amp))

    t = np.linspace(-size, size, 120)
    x, y = np.meshgrid(t, t)
    z = (np.sin(x[..., None] * k[:, 0] + y[..., None] * k[:, 1] + ph) * amp).sum(-1)
    m = grid_mesh(np.stack([x, y, z], -1))
    return height, m.mapped((2 * size, 2 * size))


def garden(rng: np.random.Generator) -> Stage:
    """Terrain with trees, bushes, grass, stones, fences."""
    st = Stage(sky=1.0, extent=((-8, -8, -1), (8, 8, 3)))
    height, m = _terrain(rng, 14, rng.uniform(0, 0.5))
    st.add([("floor", m.coloured(fu.colour(rng)))])
    ground = Ground(rng, (-5, -5), (5, 5))
    kinds = [lambda: fu.move(pl.tree(rng, int(rng.integers(4, 6)), rng.random() < 0.85),
                             scale(rng.uniform(2, 5))),
             lambda: fu.move(pl.conifer(rng), scale(rng.uniform(1.5, 5))),
             lambda: fu.move(pl.bush(rng), scale(rng.uniform(0.5, 1.8))),
             lambda: fu.move(pl.fern(rng, 20), scale(rng.uniform(0.5, 1.5))),
             lambda: fu.move(pl.hedge_cards(rng), scale(rng.uniform(0.8, 2))),
             lambda: fu.dress(rng, sh.displaced(rng, 48, 0.3)
                              .moved(scale(*rng.uniform(0.3, 1.2, 3)))),
             lambda: fu.dress(rng, pl.fence(rng, int(rng.integers(6, 30)))
                              .moved(scale(rng.uniform(1, 3), 1.5, 2)), ("paint", "atlas")),
             lambda: fu.move(fu.trinket(rng), scale(rng.uniform(0.3, 1)))]
    weights = rng.random(len(kinds)) ** 2 + 0.05
    for _ in range(int(rng.integers(6, 24))):
        ground.put(st, kinds[rng.choice(len(kinds), p=weights / weights.sum())](), height=height)
    if rng.random() < 0.6:
        n = int(rng.integers(500, 9000))
        xy = rng.uniform(-4.5, 4.5, (n, 2))
        root = np.array([(x, y, height(x, y)) for x, y in xy])
        st.add([("leaf", pl.blades(rng, root, rng.uniform(0.1, 0.5), rng.uniform(0.008, 0.03),
                                   rng.uniform(0.1, 0.8), pl.leaf_colour(rng)))])
    if rng.random() < 0.2:
        q = surface(rng, 20, 20).moved(translate(0, 0, rng.uniform(-0.1, 0.1)))
        st.add([("special", q.coloured((0.2, 0.3, 0.35)))])
    st.eyes = [(((-5, -5, 0.3), (5, 5, 2.5)), ((-1.5, -1.5, 0.1), (1.5, 1.5, 1.2)))]
    return st


def house(rng, floors: int) -> Parts:
    """Block with window grid, sills, roof or parapet, door."""
    w, d, fh = rng.uniform(2, 5), rng.uniform(2, 5), rng.uniform(0.8, 1.2)
    h = floors * fh
    body = fu.dress(rng, sh.box(w, d, h).mapped((w, h)), ("wall", "atlas", "paint", "wall"))
    panes, sills = [], []
    n = int(rng.integers(2, 7))
    for side in range(4):
        turn = rotate((0, 0, 1), side * np.pi / 2)
        length, depth = ((w, d), (d, w))[side % 2]
        for z in (np.arange(floors) + 0.3) * fh:
            for x in (np.arange(n) + 0.5) / n * length - length / 2:
                at = turn @ translate(x, -depth / 2 - 0.004, z)
                ww = length / n * 0.55
                panes.append(sh.quad(ww, fh * 0.5).moved(at @ translate(0, 0, fh * 0.25)
                                                         @ rotate((1, 0, 0), np.pi / 2)))
                sills.append(sh.box(ww * 1.2, 0.08, 0.03).moved(at))
                sills.append(sh.box(0.02, 0.02, fh * 0.5).moved(at))
    parts = body + [(str(rng.choice(["metal", "gloss", "special"])),
                     merge(panes).coloured((0.1, 0.12, 0.15)))]
    parts += fu.dress(rng, merge(sills), ("paint", "gloss"))
    if rng.random() < 0.6:
        roof = np.array([[-w, -d, 0], [w, -d, 0], [w, d, 0], [-w, d, 0]]) * 0.55
        top = np.array([[-w * 0.4, 0, 1], [w * 0.4, 0, 1], [w * 0.4, 0, 1], [-w * 0.4, 0, 1.0]])
        p = np.stack([roof[[0, 1, 2, 3, 0]], (top * (1, 1, d * 0.4))[[0, 1, 2, 3, 0]]])
        parts += fu.move(fu.dress(rng, faceted(grid_mesh(p)), ("atlas", "paint", "gloss")),
                         translate(0, 0, h))
    return parts


def street(rng: np.random.Generator) -> Stage:
    """Houses along a road with lamps, cables, trees, fences, people-sized clutter."""
    st = Stage(sky=1.0, extent=((-9, -9, 0), (9, 9, 3)))
    st.add([("floor", surface(rng, 60, 60).coloured(fu.colour(rng)))])
    for y in np.arange(-12, 13, rng.uniform(4.5, 6)):
        for x in (-5.5, 5.5):
            if rng.random() < 0.85:
                st.add(house(rng, int(rng.integers(1, 5))), translate(x, y, 0))
    ground = Ground(rng, (-2.6, -6), (2.6, 6))
    for _ in range(int(rng.integers(5, 20))):
        k = rng.integers(5)
        parts = (fu.move(pl.tree(rng, 4), scale(2.5)) if k == 0 else
                 fu.move(pl.bush(rng), scale(0.8)) if k == 1 else
                 fu.lamp(rng, 2.2) if k == 2 else
                 fu.dress(rng, pl.fence(rng), ("paint", "metal")) if k == 3 else
                 fu.move(fu.trinket(rng), scale(rng.uniform(0.3, 0.9))))
        ground.put(st, parts)
    if rng.random() < 0.5:
        wires = [fu.cable(rng, (-4, y, 3.5), (4, y + rng.normal(), 3.5), 0.4, 0.015)
                 for y in np.arange(-8, 9, 2.0)]
        st.add([("paint", merge(wires).coloured((0.03, 0.03, 0.03)))])
    st.eyes = [(((-2.5, -7, 0.8), (2.5, -2, 3.0)), ((-4, 0, 0.3), (4, 7, 2.0)))]
    return st
