"""Objects of rooms and tables as lists of (material slot, mesh); metres, standing on z = 0."""

from __future__ import annotations

import numpy as np

from .mesh import Mesh, grid_mesh, merge, rotate, scale, translate
from .plants import Parts, bush, fern, vary, wires
from .shapes import (TAU, bevel_box, between, box, cylinder, disk, displaced, gear, knot, lathe,
                     quad, sphere, superquadric, torus, tube, twisted_prism)

SOLID = ("paint", "gloss", "atlas", "metal", "special")


def move(parts: Parts, m: np.ndarray) -> Parts:
    return [(slot, mesh.moved(m)) for slot, mesh in parts]


def bounds(parts: Parts) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner of all parts."""
    lo = np.min([m.v.min(0) for _, m in parts], 0)
    hi = np.max([m.v.max(0) for _, m in parts], 0)
    return lo, hi


def colour(rng: np.random.Generator) -> np.ndarray:
    """A random albedo: grey, saturated, pastel or dark."""
    h = rng.uniform(0, 1)
    s = rng.choice([0.05, 0.35, 0.85])
    v = rng.choice([0.08, 0.3, 0.55, 0.85])
    k = np.abs((h * 6 + np.array([0, 4, 2])) % 6 - 3) - 1
    return np.clip(v * (1 - s + s * np.clip(k, 0, 1)), 0.02, 0.9)


def tile(rng: np.random.Generator, m: Mesh) -> Mesh:
    """Texture coordinates moved into one of the 4x4 tiles of the atlas."""
    uv = m.uv % 1.0000001
    at = rng.integers(0, 4, 2) / 4
    return Mesh(m.v, m.f, m.n, uv * 0.23 + 0.01 + at, m.c)


def dress(rng: np.random.Generator, m: Mesh, slots=SOLID) -> Parts:
    """One mesh with a random slot and colour."""
    slot = slots[rng.integers(len(slots))]
    m = m.coloured(colour(rng))
    return [(slot, tile(rng, m) if slot == "atlas" else m)]


def vessel(rng: np.random.Generator) -> Parts:
    """Vase, bottle, bowl or goblet: a lathed thin wall with thickness."""
    z = np.linspace(0, 1, 22)
    base, belly, neck = rng.uniform(0.12, 0.3), rng.uniform(0.2, 0.45), rng.uniform(0.06, 0.3)
    kind = rng.integers(4)
    if kind == 0:    # bottle
        r = base + (neck * 0.5 - base) / (1 + np.exp(-(z - 0.62) * 22))
    elif kind == 1:  # vase
        r = base + (belly - base) * np.sin(np.pi * z ** 0.8) + (neck - base) * z ** 3
    elif kind == 2:  # bowl
        r = 0.12 + 0.5 * z ** 0.5
        z = z * 0.5
    else:            # goblet
        cup = 0.05 + 0.3 * np.maximum(z - 0.4, 0) ** 0.5
        r = np.where(z < 0.05, 0.22, np.where(z < 0.45, 0.03, cup))
    r = np.maximum(r, 0.02)
    t = 0.018
    outer = np.stack([r, z], 1)
    inner = np.stack([np.maximum(r - t, 0.004), np.maximum(z, t)], 1)[::-1]
    profile = np.concatenate([[[0.001, 0.0]], outer, inner[:-1], [[0.001, t]]])
    m = lathe(profile, 40)
    slot = rng.choice(["glass", "glass", "gloss", "paint", "metal", "atlas", "special"])
    m = m.coloured(colour(rng))
    parts: Parts = [(slot, tile(rng, m) if slot == "atlas" else m)]
    if slot == "glass" and rng.random() < 0.4:  # filled, with a gap so that surfaces do not touch
        fill = np.stack([np.maximum(r - t * 1.3, 0.003), z + t * 0.5], 1)[1:12]
        fill = np.concatenate([[[0.001, fill[0, 1]]], fill, [[0.001, fill[-1, 1]]]])
        parts.append(("gloss", lathe(fill, 32).coloured(colour(rng))))
    return parts


def trinket(rng: np.random.Generator) -> Parts:
    """A small random object about one unit large."""
    pick = rng.integers(16)
    if pick < 4:
        return vessel(rng)
    if pick == 4:
        parts = bush(rng, 500)
        return parts
    if pick == 5:
        return fern(rng)
    if pick == 6:
        return dress(rng, wires(rng), ("metal", "paint", "gloss"))
    make = {7: lambda: sphere(0.5, 44), 8: lambda: displaced(rng, 56, rng.uniform(0.05, 0.4),
                                                             rng.uniform(1.5, 6)),
            9: lambda: superquadric(rng), 10: lambda: knot(*((2, 3), (3, 2), (2, 5), (3, 4))
                                                           [rng.integers(4)]),
            11: lambda: torus(), 12: lambda: twisted_prism(rng),
            13: lambda: gear(int(rng.integers(8, 24))),
            14: lambda: bevel_box(*rng.uniform(0.4, 1, 3), rng.uniform(0.02, 0.15)),
            15: lambda: box(*rng.uniform(0.3, 1, 3))}[int(pick)]
    slots = SOLID + (("glass",) if pick in (7, 9, 10, 11, 14) else ())
    return dress(rng, make(), slots)


def books(rng: np.random.Generator, width: float, height: float, depth: float) -> Parts:
    """Row of books along x filling a width."""
    x, parts = 0.0, []
    while x < width:
        w = rng.uniform(0.012, 0.05)
        if rng.random() < 0.08:
            x += rng.uniform(0.03, 0.15)
            continue
        b = box(w, depth * rng.uniform(0.6, 0.95), height * rng.uniform(0.55, 0.92))
        b = b.moved(translate(x + w / 2, 0, 0) @ rotate((0, 1, 0), rng.normal() * 0.02))
        slot = "atlas" if rng.random() < 0.4 else "paint"
        b = b.coloured(colour(rng))
        parts.append((slot, tile(rng, b) if slot == "atlas" else b))
        x += w + 0.002
    return parts


def shelf(rng: np.random.Generator) -> Parts:
    """Book case with books and trinkets, back at y = 0, opening to -y."""
    w, d, h, n = rng.uniform(0.7, 1.8), 0.3, rng.uniform(0.9, 2.1), int(rng.integers(2, 6))
    slot = rng.choice(["atlas", "paint", "gloss"])
    c = colour(rng)
    boards = [box(0.03, d, h).moved(translate(x, -d / 2, 0)) for x in (-w / 2, w / 2)]
    boards += [box(w, d, 0.025).moved(translate(0, -d / 2, z)) for z in np.linspace(0, h, n + 1)]
    boards.append(quad(w, h).moved(translate(0, -0.01, h / 2) @ rotate((1, 0, 0), np.pi / 2)))
    body = merge(boards).coloured(c)
    parts: Parts = [(slot, tile(rng, body) if slot == "atlas" else body)]
    gap = h / n
    for k in range(n):
        at = translate(-w / 2 + 0.04, -d / 2, k * gap + 0.026)
        if rng.random() < 0.7:
            parts += move(books(rng, (w - 0.1) * rng.uniform(0.4, 1), gap * 0.95, d), at)
        else:
            for x in np.arange(0.1, w - 0.15, 0.22):
                s = min(0.2, gap * 0.8) * rng.uniform(0.6, 1)
                parts += move(trinket(rng), at @ translate(x, 0, 0) @ scale(s))
    return parts


def table(rng: np.random.Generator, laid: bool = True) -> Parts:
    """Table with things on it."""
    w, d, h = rng.uniform(0.7, 1.8), rng.uniform(0.6, 1.0), rng.uniform(0.4, 0.78)
    top = (cylinder(d / 2, 0.035, 48) if rng.random() < 0.3
           else bevel_box(w, d, 0.04, 0.01)).moved(translate(0, 0, h))
    if rng.random() < 0.15:
        parts: Parts = [("glass", top)]
    else:
        parts = dress(rng, top, ("atlas", "gloss", "paint", "special"))
    r = rng.uniform(0.012, 0.035)
    sx, sy = (0.25, 0.25) if top.v[:, 0].max() < w / 2 - 0.01 else (w / 2 - 0.06, d / 2 - 0.06)
    legs = [between((sx * a * 0.9, sy * b * 0.9, 0), (sx * a * 0.8, sy * b * 0.8, h), r, 10)
            for a in (-1, 1) for b in (-1, 1)]
    parts += dress(rng, merge(legs), ("metal", "paint", "gloss"))
    if laid:
        for _ in range(int(rng.integers(3, 10))):
            s = rng.uniform(0.06, 0.25)
            x, y = rng.uniform(-0.8, 0.8, 2) * (sx, sy)
            m = translate(x, y, h + 0.041) @ rotate((0, 0, 1), rng.uniform(0, TAU)) @ scale(s)
            parts += move(trinket(rng), m)
    return parts


def chair(rng: np.random.Generator) -> Parts:
    """Chair with a slatted or plain back."""
    s, h, back = 0.45, 0.45, rng.uniform(0.35, 0.6)
    legs = [between((a, b, 0), (a * 0.9, b * 0.9, h), 0.018, 8)
            for a in (-0.2, 0.2) for b in (-0.2, 0.2)]
    legs += [between((a, 0.19, h), (a, 0.24, h + back), 0.016, 8) for a in (-0.19, 0.19)]
    n = int(rng.integers(2, 7))
    for z in np.linspace(h + 0.12, h + back - 0.02, n):
        legs.append(box(0.38, 0.015, 0.5 * back / n).moved(translate(0, 0.22, z)))
    frame = merge(legs)
    seat = bevel_box(s, s, 0.05, 0.02).moved(translate(0, 0, h))
    return dress(rng, frame, ("metal", "paint", "gloss", "atlas")) + dress(rng, seat)


def sofa(rng: np.random.Generator) -> Parts:
    """Sofa of rounded blocks with cushions."""
    w, c = rng.uniform(0.8, 2.0), colour(rng)
    blocks = [bevel_box(w, 0.8, 0.25, 0.06).moved(translate(0, 0, 0.15)),
              bevel_box(w, 0.22, 0.55, 0.08).moved(translate(0, 0.35, 0.3))]
    blocks += [bevel_box(0.2, 0.8, 0.45, 0.08).moved(translate(x, 0, 0.15))
               for x in (-w / 2, w / 2)]
    parts: Parts = [("paint", merge(blocks).coloured(c))]
    for _ in range(int(rng.integers(0, 4))):
        m = translate(rng.uniform(-0.4, 0.4) * w, 0.15, 0.4) @ rotate((1, 0, 0), 1.1)
        parts += dress(rng, bevel_box(0.4, 0.4, 0.14, 0.07).moved(m), ("atlas", "paint"))
    return parts


def lamp(rng: np.random.Generator, height: float) -> Parts:
    """Floor or desk lamp; slot 'light' is the bulb."""
    r = rng.uniform(0.1, 0.2)
    parts = dress(rng, merge([cylinder(r * 0.8, 0.02), between((0, 0, 0), (0, 0, height), 0.012)]),
                  ("metal", "paint", "gloss"))
    shade = lathe(np.array([[r, 0.0], [r * rng.uniform(0.4, 1.0), r * 1.4]]), 36)
    parts.append(("paint", shade.moved(translate(0, 0, height - r)).coloured(colour(rng))))
    bulb = sphere(rng.uniform(0.015, 0.05), 16)
    return parts + [("light", bulb.moved(translate(0, 0, height - 0.3 * r)))]


def frame(rng: np.random.Generator, inside: str) -> Parts:
    """Picture, mirror or window pane in the x-z plane facing -y; inside: a material slot."""
    w, h, t = rng.uniform(0.3, 1.2), rng.uniform(0.3, 1.2), rng.uniform(0.015, 0.06)
    stand = rotate((1, 0, 0), np.pi / 2)
    bars = [box(w + t, 0.03, t).moved(translate(0, 0, z - t / 2)) for z in (-h / 2, h / 2)]
    bars += [box(t, 0.03, h).moved(translate(x, 0, -h / 2)) for x in (-w / 2, w / 2)]
    pane = quad(w, h).moved(stand).coloured(colour(rng))
    parts: Parts = dress(rng, merge(bars), ("metal", "paint", "gloss"))
    return parts + [(inside, tile(rng, pane) if inside == "atlas" else pane)]


def stairs(rng: np.random.Generator) -> Parts:
    """Flight of steps with a railing, rising along +y."""
    n, w = int(rng.integers(5, 14)), rng.uniform(0.8, 1.4)
    rise, run = 0.17, 0.27
    c = colour(rng)
    if rng.random() < 0.5:
        steps = [box(w, run, rise * (k + 1)).moved(translate(0, k * run, 0)) for k in range(n)]
    else:
        steps = [box(w, run, 0.04).moved(translate(0, k * run, rise * (k + 1))) for k in range(n)]
    parts: Parts = dress(rng, merge(steps).coloured(c), ("atlas", "paint", "gloss"))
    side = w / 2 - 0.03
    bars = []
    for k in range(n):
        for o in (-0.3, 0.2):
            z = rise * (k + 1)
            bars.append(between((side, (k + o) * run, z), (side, (k + o) * run, z + 0.9), 0.01))
    bars.append(between((side, -0.3 * run, rise + 0.9), (side, (n - 0.8) * run, rise * n + 0.9),
                        0.025, 10))
    return parts + dress(rng, merge(bars), ("metal", "paint", "gloss"))


def column(rng: np.random.Generator, height: float) -> Parts:
    """Fluted or plain column with base and capital."""
    r = height * rng.uniform(0.04, 0.09)
    seg, flutes = 72, int(rng.integers(0, 2)) * 12
    a = np.linspace(0, TAU, seg + 1)
    k = 1 - 0.06 * np.abs(np.sin(a * flutes / 2)) if flutes else np.ones_like(a)
    pts = np.stack([r * k * np.cos(a), r * k * np.sin(a), 0 * a], 1)
    z = np.linspace(0, height, 8)
    side = np.stack([pts * (1 - 0.15 * t / height) + (0, 0, t) for t in z])
    parts = [grid_mesh(side, close_u=True), box(2.6 * r, 2.6 * r, 0.8 * r),
             box(2.4 * r, 2.4 * r, 0.6 * r).moved(translate(0, 0, height - 0.6 * r))]
    return dress(rng, merge(parts), ("paint", "atlas", "gloss"))


def curtain(rng: np.random.Generator, w: float, h: float) -> Parts:
    """Folded cloth in the x-z plane."""
    x = np.linspace(-w / 2, w / 2, 90)
    fold = np.sin(x * rng.uniform(20, 60)) * 0.04 + np.sin(x * 9 + 1) * 0.03
    rows = [np.stack([x * (1 - 0.1 * t), fold * (0.4 + t), h * (1 - t) + 0 * x], 1)
            for t in np.linspace(0, 1, 6)]
    return dress(rng, grid_mesh(np.stack(rows)), ("paint", "atlas"))


def cable(rng: np.random.Generator, a, b, sag: float, r: float = 0.01) -> Mesh:
    """Hanging cable between two points."""
    t = np.linspace(0, 1, 20)[:, None]
    p = np.asarray(a) * (1 - t) + np.asarray(b) * t
    p[:, 2] -= sag * 4 * (t * (1 - t))[:, 0]
    return tube(p, r, 6)


def potted(rng: np.random.Generator) -> Parts:
    """Plant in a pot."""
    pot = cylinder(0.16, 0.3, 28, 0.22)
    plant = fern(rng, 20) if rng.random() < 0.6 else bush(rng, 700)
    return dress(rng, pot) + move(plant, translate(0, 0, 0.28) @ scale(0.8))


def rug(rng: np.random.Generator) -> Parts:
    """Flat textured cloth."""
    m = quad(rng.uniform(1, 2.5), rng.uniform(0.8, 1.8)).moved(translate(0, 0, 0.004))
    if rng.random() < 0.3:
        m = disk(rng.uniform(0.5, 1.2), 40).moved(translate(0, 0, 0.004))
    return [("atlas", tile(rng, m.coloured(vary(rng, (0.5, 0.4, 0.4), 1)[0])))]
