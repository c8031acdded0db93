"""Where things stand: rooms, halls, gardens, streets, table tops and abstract arrangements.

Each layout fills a Stage; lengths are about metres, z is up.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from . import furniture as fu
from . import plants as pl
from . import shapes as sh
from .mesh import Mesh, grid_mesh, merge, rotate, scale, translate
from .plants import Parts


@dataclass
class Stage:
    """What a layout makes. eyes: pairs of boxes (lo, hi) for the camera and for its target."""

    parts: Parts = field(default_factory=list)
    lamps: list[dict] = field(default_factory=list)   # Mitsuba emitters without a shape
    eyes: list[tuple] = field(default_factory=list)
    sky: float = 0.0                                  # chance of an environment
    closed: bool = False
    extent: tuple = ((-5, -5, 0), (5, 5, 3))          # where fog may be

    def add(self, parts: Parts, m: np.ndarray | None = None) -> None:
        self.parts += parts if m is None else fu.move(parts, m)


def spin(rng: np.random.Generator) -> np.ndarray:
    return rotate((0, 0, 1), rng.uniform(0, sh.TAU))


class Ground:
    """Places things on a floor without overlap; remembers discs."""

    def __init__(self, rng: np.random.Generator, lo, hi):
        self.rng, self.lo, self.hi = rng, np.asarray(lo, float), np.asarray(hi, float)
        self.discs: list[tuple[float, float, float]] = []

    def put(self, stage: Stage, parts: Parts, tries: int = 12, at=None, turn: bool = True,
            height=None) -> bool:
        """Stands parts somewhere free; height: function (x, y) -> z. False when nothing fits."""
        lo, hi = fu.bounds(parts)
        r = 0.5 * float(np.hypot(*(hi - lo)[:2])) * 0.9
        for _ in range(tries):
            x, y = self.rng.uniform(self.lo, self.hi) if at is None else at
            if all(np.hypot(x - a, y - b) > r + s for a, b, s in self.discs):
                self.discs.append((x, y, r))
                z = height(x, y) if height else 0.0
                stage.add(parts, translate(x, y, z) @ (spin(self.rng) if turn else np.eye(4)))
                return True
            if at is not None:
                return False
        return False


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
    floor = sh.quad(w, d).mapped((w, d))
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
        q = sh.quad(20, 20).moved(translate(0, 0, rng.uniform(-0.1, 0.1)))
        st.add([("special", q.mapped((20, 20)).coloured((0.2, 0.3, 0.35)))])
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
        from .mesh import faceted
        parts += fu.move(fu.dress(rng, faceted(grid_mesh(p)), ("atlas", "paint", "gloss")),
                         translate(0, 0, h))
    return parts


def street(rng: np.random.Generator) -> Stage:
    """Houses along a road with lamps, cables, trees, fences, people-sized clutter."""
    st = Stage(sky=1.0, extent=((-9, -9, 0), (9, 9, 3)))
    st.add([("floor", sh.quad(60, 60).mapped((60, 60)).coloured(fu.colour(rng)))])
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


def still(rng: np.random.Generator) -> Stage:
    """Close-up: things on a table or a curved backdrop."""
    st = Stage(sky=0.75, extent=((-2, -2, 0), (2, 2, 1.5)))
    if rng.random() < 0.5:
        t = np.linspace(0, np.pi / 2, 14)
        y = np.concatenate([[-3], 1.2 + 0.8 * np.sin(t), [2.0]])
        z = np.concatenate([[0], 0.8 - 0.8 * np.cos(t), [3.0]])
        x = np.array([-3.0, 3.0])
        p = np.stack([np.stack([x, y[k] + 0 * x, z[k] + 0 * x], 1) for k in range(len(y))])
        st.add([("floor", grid_mesh(p).mapped((4, 4)).coloured(fu.colour(rng)))])
    else:
        st.add([("floor", sh.quad(8, 8).mapped((8, 8)).coloured(fu.colour(rng)))])
    ground = Ground(rng, (-0.8, -0.8), (0.8, 0.8))
    for _ in range(int(rng.integers(4, 40))):
        ground.put(st, fu.move(fu.trinket(rng), scale(rng.uniform(0.08, 0.5))))
    if rng.random() < 0.35:
        heap = sh.pile(rng, lambda: sh.bevel_box(1, 1, 1, 0.1) if rng.random() < 0.5
                       else sh.displaced(rng, 20), int(rng.integers(20, 150)), 0.3, 0.09)
        tones = pl.vary(rng, fu.colour(rng), len(heap.v) // 8 + 1, 0.4)
        heap.c = np.repeat(tones, 8, 0)[:len(heap.v)]
        st.add([(str(rng.choice(["paint", "gloss", "metal", "glass"])), heap)],
               translate(*rng.uniform(-0.5, 0.5, 2), 0))
    if rng.random() < 0.3:
        st.add(pl.hair_patch(rng), translate(*rng.uniform(-0.4, 0.4, 2), 0) @ scale(0.6))
    still_lights(rng, st)
    st.eyes = [(((-1.8, -2.2, 0.15), (1.8, -0.8, 1.4)), ((-0.3, -0.3, 0.05), (0.3, 0.3, 0.3)))]
    return st


def still_lights(rng, st: Stage) -> None:
    """Soft boxes, tiny bulbs, spots."""
    for _ in range(int(rng.integers(1, 4))):
        k = rng.integers(4)
        p = rng.uniform((-1.8, -1.8, 0.8), (1.8, 0.8, 2.2))
        if k == 0:
            q = sh.quad(*rng.uniform(0.1, 0.9, 2)).moved(rotate((1, 0, 0), np.pi))
            st.add([("panel", q)], translate(*p) @ rotate((1, 0, 0), rng.uniform(-0.7, 0.7)))
        elif k == 1:
            st.add([("light", sh.sphere(rng.uniform(0.008, 0.06), 14))], translate(*p))
        else:
            st.lamps.append({"type": "spot" if k == 2 else "point", "from": tuple(p),
                             "to": tuple(rng.uniform(-0.3, 0.3, 3)), "angle": rng.uniform(15, 50),
                             "power": rng.uniform(1, 8)})


def abstract(rng: np.random.Generator) -> Stage:
    """Grids, towers, spirals and clouds of simple shapes; in the open or inside a box."""
    st = Stage(sky=0.7, extent=((-3, -3, 0), (3, 3, 3)))
    if rng.random() < 0.35:
        st.closed = True
        shell(rng, st, 6, 6, 4)
        room_lights(rng, st, 6, 6, 4)
    else:
        st.add([("floor", sh.quad(30, 30).mapped((30, 30)).coloured(fu.colour(rng)))])
        still_lights(rng, st)
    kind = rng.choice(["grid", "spiral", "cloud", "city", "lattice"])
    if kind == "city":
        n = int(rng.integers(8, 26))
        s = 4.0 / n
        for slot in ("paint", "gloss", "metal", "atlas"):
            blocks = []
            for _ in range(n * n // 5):
                x, y = (rng.integers(0, n, 2) + 0.5) * s - 2
                b = sh.box(s * 0.92, s * 0.92, rng.exponential(0.35) + 0.03)
                blocks.append(b.moved(translate(x, y, 0)).coloured(fu.colour(rng)))
            m = merge(blocks)
            st.add([(slot, fu.tile(rng, m) if slot == "atlas" else m)])
    elif kind == "lattice":
        for _ in range(int(rng.integers(1, 5))):
            m = pl.lattice(rng, int(rng.integers(5, 26)), int(rng.integers(5, 26)),
                           rng.uniform(0.004, 0.02))
            st.add(fu.dress(rng, m, ("metal", "paint", "gloss")),
                   translate(*rng.uniform(-1, 1, 2), 0) @ spin(rng) @ scale(2.5, 1, 2.2))
    else:
        proto = [fu.trinket(rng) for _ in range(int(rng.integers(2, 6)))]
        n = int(rng.integers(12, 70))
        for k in range(n):
            t = k / n
            if kind == "grid":
                side = int(np.ceil(np.sqrt(n)))
                p = np.array([k % side, k // side, 0]) * 0.55 - (side * 0.27, side * 0.27, 0)
            elif kind == "spiral":
                p = np.array([np.cos(t * 20) * (0.4 + t), np.sin(t * 20) * (0.4 + t), t * 2.2])
            else:
                p = rng.uniform((-1.5, -1.5, 0), (1.5, 1.5, 2.2))
            m = translate(*p) @ spin(rng) @ scale(rng.uniform(0.15, 0.5))
            st.add(proto[k % len(proto)], m)
    st.eyes = [(((-2.8, -2.8, 0.3), (2.8, 2.8, 2.8)), ((-0.6, -0.6, 0.1), (0.6, 0.6, 1.0)))]
    return st


LAYOUTS = (("room", room, 0.36), ("hall", hall, 0.1), ("garden", garden, 0.18),
           ("street", street, 0.1), ("still", still, 0.16), ("abstract", abstract, 0.1))


def make(rng: np.random.Generator) -> tuple[str, Stage]:
    """A random layout: its name and the stage."""
    k = rng.choice(len(LAYOUTS), p=[p for _, _, p in LAYOUTS])
    return LAYOUTS[k][0], LAYOUTS[k][1](rng)
