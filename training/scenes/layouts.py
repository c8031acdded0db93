"""The layouts of scenes, with table tops and abstract arrangements."""

from __future__ import annotations

import numpy as np

from . import furniture as fu
from . import plants as pl
from . import shapes as sh
from .mesh import grid_mesh, merge, rotate, scale, translate
from .outdoors import garden, street
from .rooms import hall, room, room_lights, shell
from .stage import Ground, Stage, spin, surface


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
        st.add([("floor", surface(rng, 8, 8).coloured(fu.colour(rng)))])
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
        st.add([("floor", surface(rng, 30, 30).coloured(fu.colour(rng)))])
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
