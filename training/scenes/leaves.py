"""Draw pictures to train on without a renderer: python -m training.scenes.leaves OUT --seeds 0:1000

Overlapping figures ("dead leaves") or rooms of boxes, with albedo, normals, textures, shadows,
reflections and lamps, and noisy versions as of a path tracer: every sample falls on a point of the
pixel, sees a light or not, and finds indirect light by chance. The target is the expectation of
all that, without noise. A picture takes a fraction of a second, a room some seconds. OUT/NAME/
holds NAME_SSSSspp.{hdr,alb,nrm}.exr, the target under 4096 samples, and manifest.json. Finished
pictures are skipped.
"""

from __future__ import annotations

import argparse
import time
from typing import NamedTuple

import numpy as np

from training import errors
from training.augment import waves

from . import boxes, figures, options, picture, textures
from .files import HALF_MAX
from .options import bit_pair, count_list, size_pair

TARGET = 4096          # samples that the target stands for
BITMAPS, TEXELS = 5, 128


class Style(NamedTuple):
    """What pictures are drawn of. Pairs are ranges; of lamps' powers mean and deviation of the
    logarithm. octaves: indirect light is found in one sample of 2^first to 2^second, with such a
    deviation from figure to figure; None: in more of them."""
    what: str
    side: int = 3                                  # points of a pixel: side x side
    is_room: bool = False                          # of boxes, not figures
    figures: tuple[float, float] = (8, 300)
    least: tuple[float, float] | None = (0.6, 3)   # pixels; None: a twentieth of the width
    textured: float = 0.8                          # most of the figures
    bumpy: float = 0.2                             # shares of the figures
    rounded: float = 0.3
    lamps: tuple[float, ...] = (0, 0.01, 0.1)      # shares of the figures
    lamp_power: tuple[float, float] = (1.5, 1.5)
    lamp_albedo: float = 1.0
    metals: float = 0.2                            # most of the figures
    shine: float = 1.0                             # times that of the others
    octaves: tuple[float, float, float] | None = None
    is_soft: bool = False
    is_sparse: bool = False


STYLES = {
    "any": Style("all kinds of light"),
    "lamps": Style("many bright lamps, most of them black to the albedo",
                   lamps=(0.04, 0.1, 0.2), lamp_power=(2.2, 1.2), lamp_albedo=0.0),
    "sparks": Style("few, large, plain figures; much light found in one sample of 6 to 180",
                    figures=(3, 25), least=None, textured=0.2, octaves=(2.5, 7, 0.3),
                    is_sparse=True),
    "soft": Style("light that changes slowly: soft shadows, even indirect light, hardly a mirror",
                  figures=(3, 100), least=(2, 10), textured=0.6, bumpy=0.03, lamps=(0, 0.01),
                  metals=0.0, shine=0.1, octaves=(0, 6, 0.2), is_soft=True),
    "rooms": Style("interiors of boxes: long straight edges, lines finer than a pixel, glass",
                   side=4, is_room=True, textured=0.5, bumpy=0.05, rounded=0.0, metals=0.1,
                   lamps=(0, 0.003)),
}


def parser() -> argparse.ArgumentParser:
    p = options.parser("training.scenes.leaves", __doc__, 144, "1,2,4,8,16,32,64", 3)
    p.add_argument("--style", choices=STYLES, default="any", help="; ".join(
        f"{name}: {style.what}" for name, style in STYLES.items()))
    return p


def colour(rng: np.random.Generator) -> np.ndarray:
    """A reflectance, [3]: a third of them grey."""
    level = rng.uniform(0.03, 0.95) ** rng.uniform(0.7, 2)
    tint = rng.uniform(0.1, 1, 3) ** rng.choice([0.0, 0.5, 1.5])
    return np.clip(level * tint / tint.max(), 0.005, 0.95)


def blur(a: np.ndarray, r: int) -> np.ndarray:
    """Means over (2 r + 1)^2 points of [h,w,...], edges repeated."""
    for axis in (0, 1) if r else ():
        pad = [(0, 0)] * a.ndim
        pad[axis] = (r + 1, r)
        total = np.cumsum(np.pad(a, pad, mode="edge"), axis, dtype=np.float64)
        n = a.shape[axis]
        a = (total.take(np.arange(2 * r + 1, 2 * r + 1 + n), axis)
             - total.take(np.arange(n), axis)) / (2 * r + 1)
    return a.astype(np.float32)


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9)


class Seen(NamedTuple):
    """What the points show: numbers of surfaces [h,w] int32 (0: behind all) and places u, v on
    them; count: the highest number; whose [count + 1]: colours that they have; base
    [count + 1,3]: their normals, None: any; pane [h / 2,w]: share of the samples that see the
    lower half of h in the place of the upper, None: there is but one half."""
    number: np.ndarray
    u: np.ndarray
    v: np.ndarray
    count: int
    whose: np.ndarray
    base: np.ndarray | None = None
    pane: np.ndarray | None = None


def painted(h: int, w: int, rng: np.random.Generator, style: Style) -> Seen:
    """A picture of h x w pixels in a style: its points."""
    h, w = h * style.side, w * style.side
    if style.is_room:
        room = boxes.paint(h, w, rng)
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0] if rng.random() < 0.5 else np.eye(3)
        return Seen(room.number, room.u, room.v, len(room.axis) - 1, room.body,
                    frame[room.axis] * room.sign[:, None], room.pane)
    count = int(np.exp(rng.uniform(*np.log(style.figures))))
    least = style.side * rng.uniform(*style.least) if style.least else 0.05 * w
    sizes = least, rng.uniform(0.15, 0.6) * w
    return Seen(*figures.paint(h, w, count, sizes, rng), count, np.arange(count + 1))


def surfaces(seen: Seen, rng: np.random.Generator, style: Style):
    """Albedo and normals of the points, [h,w,3] each."""
    number, u, v, n = seen.number, seen.u, seen.v, seen.count + 1
    whose = seen.whose[number]
    bitmaps = np.stack([textures.picture(rng, TEXELS, colour) for _ in range(BITMAPS)])
    which, scale = rng.integers(BITMAPS, size=n), 2.0 ** rng.uniform(-2, 2.5, n)
    at_u, at_v = ((t * scale[whose] + rng.random(n)[whose]) * TEXELS % TEXELS for t in (u, v))
    texel = which[whose], at_v.astype(int) % TEXELS, at_u.astype(int) % TEXELS
    plain = np.stack([colour(rng) for _ in range(n)])
    textured = (rng.random(n) < rng.uniform(0, style.textured)).astype(np.float32)
    depth = (rng.uniform(0.2, 1, n) * textured)[whose][..., None]
    albedo = plain[whose] * (1 - depth) + bitmaps[texel] * depth
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]  # of the room: most planes lie along it
    along = rng.random(n)[:, None] < rng.uniform(0, 0.9)
    base = unit(np.where(along, frame[rng.integers(3, size=n)] * rng.choice([-1, 1], (n, 1)),
                         rng.normal(size=(n, 3))))
    if seen.base is not None:
        base = seen.base
    across = unit(np.cross(base, rng.normal(size=(n, 3))))
    third = np.cross(base, across)
    round_u, round_v = (rng.uniform(0.3, 2, n) * (rng.random(n) < style.rounded)
                        for _ in range(2))
    height = bitmaps.mean(-1)
    bump = rng.uniform(0.5, 6, n) * (rng.random(n) < style.bumpy)
    slope_u, slope_v = ((np.roll(height, -1, axis) - np.roll(height, 1, axis))[texel]
                        for axis in (2, 1))
    tilt_u = round_u[number] * u + bump[whose] * slope_u
    tilt_v = round_v[number] * v + bump[whose] * slope_v
    normal = unit(base[number] + tilt_u[..., None] * across[number]
                  + tilt_v[..., None] * third[number])
    return albedo.astype(np.float32), normal.astype(np.float32)


def shadow(number, count: int, rng: np.random.Generator, style: Style) -> np.ndarray:
    """Share of a light that the points see, [h,w]: figures with sharp or soft edges, moved from
    surface to surface; or very soft ones, the same on all."""
    (h, w), side = number.shape, style.side
    few = int(rng.integers(1, 40))
    mask = (figures.paint(h, w, few, (6, 0.5 * w), rng)[0] == 0).astype(np.float32)
    if rng.random() < 0.5:
        mask = 1 - mask
    if style.is_soft:
        r = int(side * rng.uniform(4, 25))
        return blur(blur(mask, r), r // 2)
    r = int(side * rng.uniform(0, 3) ** 2.5) if rng.random() < 0.8 else 0
    mask = blur(blur(mask, r), r // 2)
    move = rng.integers(0, w // 3, (count + 1, 2))
    y, x = np.indices((h, w))
    return mask[(y + move[number, 0]) % h, (x + move[number, 1]) % w]


class Stage:
    """What the points of a picture send to the camera; `values` [points, columns] as `sample` reads
    them, the rest is common to all points."""

    def __init__(self, h: int, w: int, rng: np.random.Generator, style: Style = STYLES["any"]):
        self.h, self.w, self.side = h * style.side, w * style.side, style.side
        seen = painted(h, w, rng, style)
        number, count, self.pane = seen.number, seen.count, seen.pane
        (h, w), n = number.shape, count + 1
        albedo, normal = surfaces(seen, rng, style)
        gap = rng.random(n).astype(np.float32)[number]  # nearness, for the dark of corners
        corner = np.clip(blur(gap, int(rng.integers(2, 12) * style.side)) - gap, 0, 1)
        open_share = np.exp(-rng.uniform(0, 4) * corner)[..., None]
        self.lights, direct = [], np.zeros((h, w, 3), np.float32)
        for _ in range(int(rng.integers(0, 3)) if rng.random() < 0.7 else 1):
            facing = normal @ unit(rng.normal(size=3)).astype(np.float32)
            falling = np.exp(rng.uniform(0, 1) * waves(h, w, rng)[0] / 2)
            power = np.exp(rng.normal(0, 1)) * (1 - rng.uniform(0, 0.6, 3) * rng.random())
            full = (np.clip(facing, 0, 1) * falling)[..., None] * power * 3
            free = shadow(number, count, rng, style)
            chance = 1.0 if rng.random() < 0.6 else 2.0 ** rng.uniform(-7, 0)
            self.lights.append((full.astype(np.float32), free, chance))
            direct += full * free[..., None]
        long = rng.uniform(40, 600) * style.side
        field = np.mean([np.sin((np.indices((h, w)) * rng.normal(size=(2, 1, 1))).sum(0)
                                * (6.28 / long) + rng.uniform(0, 6.28)) for _ in range(4)], 0)
        level = rng.normal(-0.5, 1) + rng.uniform(0, 1.5) * field
        if style.is_soft:  # by the direction that a surface looks into
            level += rng.uniform(0, 1) * (normal @ unit(rng.normal(size=3)))
        else:  # from figure to figure
            level += rng.normal(0, rng.uniform(0, 0.6), n)[number]
        level = np.exp(level)[..., None]
        ambient = level * (1 - rng.uniform(0, 0.5, 3) * rng.random()) * open_share
        chance = 2.0 ** (0.5 - 7 * rng.random() ** 2 + rng.normal(0, 0.7, n))
        if style.octaves:
            *ends, deviation = style.octaves
            chance = 2.0 ** (-rng.uniform(*ends) + rng.normal(0, deviation, n))
        if style.is_sparse:
            ambient *= 2.0 ** rng.uniform(-1, 2) * max(direct.mean(), 0.05) / ambient.mean()
        chance = np.clip(chance, 2.0**-8, 1)[number]
        view = (albedo * (direct + ambient))[::rng.choice([-1, 1]), ::rng.choice([-1, 1])]
        self.view = np.roll(view, rng.integers(0, w, 2), (0, 1)).reshape(-1, 3)
        shine = (rng.random(n) < rng.uniform(0, 0.4)) * rng.uniform(0.02, 0.5, n) * style.shine
        metal = rng.random(n) < rng.uniform(0, style.metals)
        mirror = np.where(metal[number][..., None], albedo, shine[number][..., None])
        self.rough = int(rng.integers(0, 10) * style.side * (rng.random() < 0.7))
        matt = np.where(metal[number][..., None], 0, albedo)
        emits = (rng.random(n) < rng.choice(style.lamps)) * np.exp(rng.normal(*style.lamp_power, n))
        emission = emits[number][..., None] * (1 - rng.uniform(0, 0.7, (n, 3)) ** 2)[number]
        lit = (emission.max(-1) > 0)[..., None]
        matt, mirror = matt * ~lit, mirror * ~lit
        of_lamps = (np.clip(emission, 0, 1), style.lamp_albedo, 0.0)[rng.integers(3)]
        aux = np.where(lit, of_lamps, albedo)
        if rng.random() < 0.3:  # behind all: a sky
            sky = (number == 0)[..., None]
            matt, mirror, normal = matt * ~sky, mirror * ~sky, normal * ~sky
            aux = np.where(sky, float(rng.random() < 0.5), aux)
            emission = np.where(sky, ambient * rng.uniform(0.2, 3), emission)
        self.defocus = int(rng.integers(1, 8)) if rng.random() < 0.15 else 0
        self.shapes = rng.uniform(0.7, 4), rng.uniform(1, 8)  # gamma distributions of light found
        self.tinted = rng.uniform(1, 6) if rng.random() < 0.5 else 0.0
        expected = matt * (direct + ambient) + emission + mirror * blur(
            self.view.reshape(h, w, 3), self.rough)
        columns = [matt, mirror, aux, normal, emission, ambient, chance[..., None]]
        columns += [x for full, free, _ in self.lights for x in (full, free[..., None])]
        self.values = np.concatenate(columns, -1).astype(np.float32).reshape(h * w, -1)
        self.target = self.means(np.concatenate([expected, aux, normal], -1))

    def means(self, points: np.ndarray) -> np.ndarray:
        """[h,w,c] of points to pixels; where there are panes the lower half is what is on them."""
        side, (_, w, c) = self.side, points.shape
        if self.pane is not None:
            share, points = self.pane[..., None], points.reshape(2, self.h, w, c)
            points = points[0] * (1 - share) + points[1] * share
        points = blur(points, self.defocus)
        return points.reshape(self.h // side, side, w // side, side, c).mean((1, 3))

    def moved(self, y, x, r: int, rng: np.random.Generator) -> np.ndarray:
        """Numbers of points at most r from (y, x) both ways."""
        if r:
            y, x = (t + rng.integers(-r, r + 1, t.shape) for t in (y, x))
        return y.clip(0, self.h - 1) * self.w + x.clip(0, self.w - 1)

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """One sample of every pixel, [h,w,9]: radiance, albedo, normal."""
        side = self.side
        y, x = np.indices((self.h // side, self.w // side)) * side
        y, x = y + rng.integers(0, side, y.shape), x + rng.integers(0, side, x.shape)
        at = self.moved(y, x, self.defocus, rng)
        if self.pane is not None:
            at += self.h * self.w * (rng.random(at.shape) < self.pane.reshape(-1)[at])
        p = self.values[at]
        matt, mirror, aux, normal, emission, ambient = (p[..., i:i + 3] for i in range(0, 18, 3))
        chance = p[..., 18]

        def found(share, scale, k):
            """Light that is found with a probability, 1 in the mean where scale = 1 / share."""
            return ((rng.random(share.shape) < share) * scale
                    * rng.gamma(k, 1 / k, share.shape))[..., None]

        light = ambient * found(chance, 1 / chance, self.shapes[0])
        if self.tinted:
            light = light * rng.gamma(self.tinted, 1 / self.tinted, light.shape)
        for i, (_, _, aimed) in enumerate(self.lights):
            k = 19 + 4 * i
            seen = found(p[..., k + 3] * aimed, 1 / aimed, self.shapes[1])
            light = light + p[..., k:k + 3] * seen
        other = self.moved(at // self.w % self.h, at % self.w, self.rough, rng)
        return np.concatenate([matt * light + mirror * self.view[other] + emission, aux, normal],
                              -1)


def draw_seed(seed: int, args: argparse.Namespace) -> dict:
    """Draws one picture into OUT; returns its manifest."""
    start, name = time.process_time(), f"l{seed:05d}"
    rng = np.random.default_rng([seed, 7])
    stage = Stage(*reversed(size_pair(args.size)), rng, STYLES[args.style])
    counts = count_list(args.spp, "--spp")
    if args.pick:
        counts = sorted(rng.choice(counts, min(args.pick, len(counts)), replace=False).tolist())
    light = stage.target[..., :3].mean(-1)
    bright = light.clip(0, max(np.percentile(light, 97), 1e-6)).mean()
    gain = np.exp(rng.normal(-1.2, 1.2)) / max(bright, 1e-6)

    def versions():
        yield TARGET, stage.target, 1
        for spp in counts:
            yield spp, sum(stage.sample(rng) for _ in range(spp)) / spp, 0

    with picture.folder(args.out, name) as folder:
        for spp, image, which in versions():
            image = image * np.repeat([gain, 1.0], [3, 6])
            image[..., :3] = image[..., :3].clip(0, HALF_MAX)
            picture.write_level(folder, name, spp, image.astype(np.float32),
                                bit_pair(args.bits)[which])
    manifest = {"seed": seed, "size": list(size_pair(args.size)), "noisy": counts,
                "target": TARGET, "options": options.kept(args), "gain": float(gain),
                "cpu_seconds": round(time.process_time() - start, 2)}
    picture.publish(args.out, name, manifest)
    return manifest


def run(args: argparse.Namespace) -> None:
    """Draws the seeds of this shard."""
    seeds = options.check(args, 16)
    options.make_folder(args.out)
    todo = options.unfinished(args.out, seeds, "l", "pictures to draw", options.kept(args))
    for k, seed in enumerate(todo):
        m = draw_seed(seed, args)
        print(f"{k + 1}/{len(todo)} l{seed:05d} {m['noisy']} spp, {m['cpu_seconds']} s",
              flush=True)


def main(argv: list[str] | None = None) -> None:
    run(parser().parse_args(argv))


if __name__ == "__main__":
    errors.run(main)
