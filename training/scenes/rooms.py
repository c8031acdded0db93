"""Layouts with walls: furnished rooms and halls."""

from __future__ import annotations

import numpy as np

from . import furniture as fu
from . import plants as pl
from . import shapes as sh
from .mesh import Mesh, merge, rotate, scale, translate
from .stage import Ground, Stage, spin, surface


def wall_with_hole(w: float, h: float, hole) -> Mesh:
    """Wall in the x-z plane facing -y, 0..w by 0..h, uv in metres.

    hole: (x0, z0, x1, z1) or None.
    """
    rects = [(0, 0, w, h)]
    if hole:
        a, b, c, d = hole
        rects = [(0, 0, a, h), (c, 0, w, h), (a, 0, c, b), (a, d, c, h)]
    parts = []
    for x0, z0, x1, z1 in rects:
        if x1 - x0 < 1e-3 or z1 - z0 < 1e-3:
            continue
        q = sh.quad(x1 - x0, z1 - z0).mapped((x1 - x0, z1 - z0), (x0, z0))
        parts.append(q.moved(translate((x0 + x1) / 2, 0, (z0 + z1) / 2)
                             @ rotate((1, 0, 0), np.pi / 2)))
    return merge(parts)


def shell(rng: np.random.Generator, stage: Stage, w: float, d: float, h: float) -> None:
    """Floor, ceiling and four walls, centred; some walls with windows, frames, blinds, curtains."""
    floor = surface(rng, w, d)
    stage.add([("floor", floor.coloured(fu.colour(rng)))])
    top = floor.moved(translate(0, 0, h) @ rotate((1, 0, 0), np.pi))
    stage.add([("wall" if rng.random() < 0.5 else "paint",
                top.coloured(rng.uniform(0.5, 0.9) * np.ones(3)))])
    tone = np.clip(fu.colour(rng) * 0.5 + 0.35, 0, 0.92)
    for k in range(4):
        length = w if k % 2 == 0 else d
        place = rotate((0, 0, 1), k * np.pi / 2) @ translate(-length / 2, (d, w)[k % 2] / 2, 0)
        hole = None
        if rng.random() < 0.55:
            a = rng.uniform(0.15, 0.5) * length
            b = rng.choice([0.05, 0.9])
            hole = (a, b, min(a + rng.uniform(0.6, 3.0), length - 0.1), min(b + 1.9, h - 0.15))
        m = wall_with_hole(length, h, hole)
        slot = "wall" if rng.random() < 0.8 else "special"
        stage.add([(slot, m.coloured(tone if rng.random() < 0.7 else fu.colour(rng)))], place)
        if hole:
            window(rng, stage, place, hole)
        elif rng.random() < 0.7:
            for _ in range(int(rng.integers(1, 4))):
                inside = rng.choice(["atlas", "atlas", "special", "gloss", "metal"])
                at = translate(rng.uniform(0.6, length - 0.6), -0.03, rng.uniform(1.2, h - 0.7))
                stage.add(fu.frame(rng, str(inside)), place @ at)
    if rng.random() < 0.4:  # skirting board
        bars = [sh.box(w, 0.02, 0.1).moved(translate(0, s * (d / 2 - 0.01), 0)) for s in (-1, 1)]
        bars += [sh.box(0.02, d, 0.1).moved(translate(s * (w / 2 - 0.01), 0, 0)) for s in (-1, 1)]
        stage.add([("paint", merge(bars).coloured(rng.uniform(0.1, 0.9, 3)))])


def window(rng, stage: Stage, place: np.ndarray, hole) -> None:
    """Glazing bars, pane, blinds or curtains of one window, or a bright panel instead of sky."""
    x0, z0, x1, z1 = hole
    w, h = x1 - x0, z1 - z0
    mid = place @ translate((x0 + x1) / 2, 0, z0)
    bars = []
    for x in np.linspace(-w / 2, w / 2, int(rng.integers(2, 6))):
        bars.append(sh.box(0.04, 0.05, h).moved(translate(x, 0, 0)))
    for z in np.linspace(0, h, int(rng.integers(2, 5))):
        bars.append(sh.box(w, 0.05, 0.04).moved(translate(0, 0, z)))
    stage.add(fu.dress(rng, merge(bars), ("paint", "gloss", "metal")), mid)
    pick = rng.random()
    if pick < 0.2:
        stage.add([("glass", sh.box(w, 0.01, h).coloured((1, 1, 1)))], mid @ translate(0, 0.02, 0))
    elif pick < 0.4:
        stage.add([("paint", pl.blinds(rng, int(h * 12), rng.uniform(0.1, 1.2)))],
                  mid @ translate(0, -0.08, 0) @ scale(w, 1, h))
    elif pick < 0.6:
        for s in (-1, 1):
            stage.add(fu.curtain(rng, w * 0.35, h * 1.1),
                      mid @ translate(s * w * 0.4, -0.12, -0.05 * h))
    if rng.random() < 0.3:
        q = sh.quad(w, h).moved(rotate((1, 0, 0), np.pi / 2))
        stage.add([("panel", q)], mid @ translate(0, 0.15, h / 2))


def room_lights(rng, stage: Stage, w: float, d: float, h: float) -> None:
    """Ceiling panels, pendants, rows of tiny bulbs, spots, points."""
    kinds = rng.choice(["panel", "bulbs", "pendant", "spot", "point", "none", "strip"],
                       size=int(rng.integers(1, 3)), replace=False)
    for kind in kinds:
        x, y = rng.uniform(-0.35, 0.35, 2) * (w, d)
        if kind == "panel":
            q = sh.quad(*rng.uniform(0.2, 1.4, 2)).moved(rotate((1, 0, 0), np.pi))
            stage.add([("panel", q)], translate(x, y, h - 0.02))
        elif kind == "strip":
            stage.add([("panel", sh.box(rng.uniform(1, w * 0.8), 0.03, 0.03))],
                      translate(0, y, h - 0.06))
        elif kind == "bulbs":
            r = rng.uniform(0.008, 0.04)
            ball = sh.sphere(r, 12)
            n = int(rng.integers(3, 30))
            at = rng.uniform((-w / 2, -d / 2, h * 0.5), (w / 2, d / 2, h - 0.05), (n, 3)) * 0.95
            stage.add([("light", merge([ball.moved(translate(*p)) for p in at]))])
        elif kind == "pendant":
            stage.add(fu.lamp(rng, 0.6), translate(x, y, h) @ rotate((1, 0, 0), np.pi))
        elif kind == "spot":
            stage.lamps.append({"type": "spot", "from": (x, y, h - 0.1),
                                "to": tuple(rng.uniform(-0.4, 0.4, 2) * (w, d)) + (0.0,),
                                "angle": rng.uniform(20, 60), "power": rng.uniform(5, 40)})
        elif kind == "point":
            stage.lamps.append({"type": "point", "from": (x, y, h * rng.uniform(0.5, 0.95)),
                                "power": rng.uniform(2, 15)})


def room(rng: np.random.Generator) -> Stage:
    """Furnished room."""
    w, d, h = rng.uniform(3, 8), rng.uniform(3, 8), rng.uniform(2.4, 4.0)
    st = Stage(sky=0.8, closed=True, extent=((-w / 2, -d / 2, 0), (w / 2, d / 2, h)))
    shell(rng, st, w, d, h)
    room_lights(rng, st, w, d, h)
    ground = Ground(rng, (-w / 2 + 0.4, -d / 2 + 0.4), (w / 2 - 0.4, d / 2 - 0.4))
    for k in range(4):  # things along the walls
        depth = (d, w)[k % 2] / 2
        for _ in range(int(rng.integers(0, 3))):
            make = (fu.shelf, fu.sofa, fu.table, fu.stairs)[rng.choice(4, p=[0.5, 0.2, 0.2, 0.1])]
            parts = make(rng)
            lo, hi = fu.bounds(parts)
            x = rng.uniform(-0.4, 0.4) * (w, d)[k % 2]
            a = k * np.pi / 2
            at = rotate((0, 0, 1), a) @ np.array([x, depth - hi[1] - 0.05, 0, 1])
            if ground.put(st, fu.move(parts, rotate((0, 0, 1), a)), at=at[:2], turn=False):
                pass
    for _ in range(int(rng.integers(3, 10))):
        make = (fu.table, fu.chair, fu.potted, fu.chair, fu.sofa)[rng.integers(5)]
        ground.put(st, make(rng))
    if rng.random() < 0.5:
        ground.put(st, fu.lamp(rng, rng.uniform(0.8, 1.8)))
    if rng.random() < 0.5:
        st.add(fu.rug(rng), translate(*rng.uniform(-0.2, 0.2, 2) * (w, d), 0) @ spin(rng))
    for _ in range(int(rng.integers(0, 12))):
        ground.put(st, fu.move(fu.trinket(rng), scale(rng.uniform(0.1, 0.6))))
    if rng.random() < 0.3:
        st.add(fu.dress(rng, merge([fu.cable(rng, *rng.uniform((-w / 2, -d / 2, h * 0.7),
                                                              (w / 2, d / 2, h), (2, 3)), 0.2)
                                    for _ in range(5)])))
    st.eyes = [(((-w * 0.46, -d * 0.46, 0.6), (w * 0.46, d * 0.46, h * 0.75)),
                ((-w * 0.4, -d * 0.4, 0.1), (w * 0.4, d * 0.4, h * 0.5)))]
    return st


def hall(rng: np.random.Generator) -> Stage:
    """Long hall with columns, beams, stairs or lattices."""
    w, d, h = rng.uniform(4, 10), rng.uniform(8, 20), rng.uniform(3, 7)
    st = Stage(sky=0.8, closed=True, extent=((-w / 2, -d / 2, 0), (w / 2, d / 2, h)))
    shell(rng, st, w, d, h)
    room_lights(rng, st, w, d, h)
    col = fu.column(rng, h)
    for y in np.arange(-d / 2 + 1, d / 2, rng.uniform(1.5, 3)):
        for x in (-w * 0.3, w * 0.3):
            st.add(col, translate(x, y, 0))
    ground = Ground(rng, (-w * 0.22, -d * 0.45), (w * 0.22, d * 0.45))
    for _ in range(int(rng.integers(4, 14))):
        make = (fu.table, fu.potted, fu.stairs, fu.trinket, fu.chair)[rng.integers(5)]
        ground.put(st, make(rng))
    if rng.random() < 0.6:
        m = pl.lattice(rng, int(rng.integers(8, 30)), int(rng.integers(3, 20)))
        st.add(fu.dress(rng, m, ("metal", "paint")),
               translate(0, rng.uniform(-0.2, 0.4) * d, 0) @ scale(w, 1, h * rng.uniform(0.3, 1)))
    st.eyes = [(((-w * 0.2, -d * 0.48, 0.8), (w * 0.2, -d * 0.2, h * 0.6)),
                ((-w * 0.3, 0, 0.3), (w * 0.3, d * 0.4, h * 0.5)))]
    return st
