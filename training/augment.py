"""Augmentation in radiance: what a few hundred scenes do not show is made from what they do.

A collage lays one scene over another through a random figure, noise of the edges included: the
sharp, thin and irregular edges of foliage and lattices. A texture multiplies radiance and albedo
alike, as the reflectance of a surface does, or radiance alone, as a shadow does. Fireflies and hits
are noise that the renderer of the data does not make. Wide pixel filters make neighbours' noise
alike. Out of focus or in motion, each sample of a pixel sees another place, so that features are
noise as well. Minified, a picture shows more in each pixel than it was rendered with: textures and
edges finer than a pixel, which are noise in features of few samples.
"""
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from export.accuracy import through_window
from training import color

WAVELENGTHS = (3.0, 160.0)  # pixels, of the waves that figures are made of
LINE_WIDTHS = (0.7, 5.0)    # pixels, of figures of lines
DARKEST = 0.03              # least factor of a texture
FINE_P = 0.35               # textures of waves that are finer than a pixel
SHADOW_P = 0.25             # textures that multiply the radiance alone
ALIASED_SPP = 16            # samples that tell an aliased edge from noise
ALIASED_P = 0.1, 0.5        # figures whose edges fall between pixels: of fewer samples, of more
TINTED_P = 0.5              # noise of light found by chance whose hits have colours of their own
ZOOMS = (1.5, 6.0)          # of enlarged tiles
MINIFIED = 4                # most pixels across of the original in one of a minified tile
NEAR = 3                    # pixels of the original around one from which its noise may come
FADED_P, FADED = 0.4, 0.01  # enlarged tiles with less noise than the original, down to this share
BLUR_REACH = 2              # pixels, of a wide pixel filter
BLURS = (0.35, 0.9)         # pixels, standard deviations of Gaussian ones
DEFOCUS_SPP = 16            # most samples per pixel of inputs that get out of focus
DEFOCUS = (1.0, 12.0)       # pixels, largest radius of a tile's circles of confusion
DEFOCUS_TAPS = 48           # places that stand for such a circle
MOTION_P = 0.25             # tiles that are in motion along a line instead


@dataclass(frozen=True)
class Augment:
    """Probabilities and ranges of the augmentation; PLAIN is Open Image Denoise's."""

    exposure: float = 0.0   # stops of random exposure, +- (hdr only)
    average: float = 0.0    # share of inputs replaced by the mean of all versions of the group
    blend: float = 0.0      # share of inputs moved towards the target by a random amount
    clean_aux: float = 0.0  # share of inputs that get the reference's aux features
    signs: float = 0.0      # share of tiles whose normals get random axis signs
    fireflies: float = 0.0  # share of hdr tiles in which single pixels become very bright
    hits: float = 0.0       # share of hdr tiles with the noise of light that is found by chance
    collage: float = 0.0    # share of hdr tiles that show two pictures
    texture: float = 0.0    # share of hdr tiles multiplied by a texture
    zoom: float = 0.0       # share of hdr tiles enlarged, their noise drawn anew
    minify: float = 0.0     # share of hdr tiles minified, of pictures large enough for it
    blur: float = 0.0       # share of hdr tiles seen through a wide pixel filter
    defocus: float = 0.0    # share of hdr tiles of few samples out of focus or in motion
    drop: float = 0.0       # family K: share of tiles that lose auxiliary features
    clip: float = 0.0       # family K: share of tiles clipped at a random white (hdr only)

    @classmethod
    def of(cls, s) -> Augment:
        """What the settings of a training ask for."""
        return cls(s.exposure_jitter, s.average_inputs, s.blend_target, s.mix_clean_aux,
                   s.normal_signs, s.fireflies, s.hits, s.collage, s.texture, s.zoom,
                   s.minify, s.pixel_filter, s.defocus, s.drop_features, s.clip)


def add_fireflies(radiance: np.ndarray, rng: np.random.Generator) -> None:
    """Makes one of 300 to 10000 pixels of [h,w,3], in place, up to 10^5 times as bright, in a
    colour of its own: paths that found a light by luck."""
    h, w, channels = radiance.shape
    n = rng.poisson(h * w / 10 ** rng.uniform(2.5, 4))
    y, x = rng.integers(0, h, n), rng.integers(0, w, n)
    gain = 10 ** (rng.uniform(1, 5, (n, 1)) * rng.uniform(0.3, 1, (n, 1)))
    gain = gain * rng.uniform(0.3, 1, (n, channels))
    radiance[y, x] = np.minimum((radiance[y, x] + 0.01) * gain, color.HDR_MAX)


def hits_by_chance(target: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """An input of mean `target`, [h,w,3], as of a renderer that does not aim at its lights: of the
    samples of a pixel few reach one, and those carry all the light, or all but a steady share."""
    h, w, _ = target.shape
    f, _ = waves(h, w, rng)
    chance = np.clip(2.0 ** (rng.uniform(-8, 0) + rng.uniform(0, 2) * f), 2.0**-9, 0.9)
    spp = 2 ** int(rng.integers(0, 5))
    spread = rng.uniform(0.5, 4)  # of the light of a hit: a gamma distribution's shape
    gain = rng.gamma(spread * rng.binomial(spp, chance)) / (spp * chance * spread)
    gain = np.repeat(gain[..., None], 3, 2)
    if rng.random() < TINTED_P:  # light that met a coloured surface on its way
        purity = 2.0 ** rng.uniform(-1, 3)
        gain *= rng.gamma(purity, 1 / purity, gain.shape)
    steady = rng.uniform(0, 0.7) * (rng.random() < 0.5)
    light = target * (steady + (1 - steady) * gain).astype(np.float32)
    return np.minimum(light, np.float32(color.HDR_MAX))


def waves(h: int, w: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A sum of one to six random plane waves, variance 1, [h,w], and the length of its gradient
    per pixel."""
    n = int(rng.integers(1, 7))
    longest = math.exp(rng.uniform(*map(math.log, WAVELENGTHS)))
    k = 2 * np.pi / (longest * 2.0 ** -rng.uniform(0, 1.5, n))
    angle, phase = rng.uniform(0, 2 * np.pi, (2, n))
    kx, ky = (k * np.cos(angle))[:, None], (k * np.sin(angle))[:, None]
    x = (kx * np.arange(w)).astype(np.float32)
    y = (ky * np.arange(h) + phase[:, None]).astype(np.float32)
    cx, sx, cy, sy = np.cos(x), np.sin(x), np.cos(y).T, np.sin(y).T
    scale = np.float32(math.sqrt(2.0 / n))
    f = scale * (cy @ cx - sy @ sx)  # the sum of cos(x + y)
    kx, ky = kx.astype(np.float32), ky.astype(np.float32)
    slope = scale * np.hypot(sy @ (kx * cx) + cy @ (kx * sx), sy @ (ky * cx) + cy @ (ky * sx))
    return f, slope


def figure(h: int, w: int, rng: np.random.Generator, spp: float = 1.0) -> np.ndarray:
    """Coverage in [0,1] of the pixels of a random figure, [h,w]: areas or lines, edges one pixel
    wide, or none, as where pixels are seen at their centres only. spp: samples of the input."""
    f, slope = waves(h, w, rng)
    slope = np.maximum(slope, 1e-3)
    if rng.random() < 0.4:  # within half a width of the curve f = 0
        distance = 0.5 * rng.uniform(*LINE_WIDTHS) - np.abs(f) / slope
    else:
        distance = (f - rng.normal(0, 0.7)) / slope
    if rng.random() < ALIASED_P[spp >= ALIASED_SPP]:
        return (distance > 0).astype(np.float64)
    return np.clip(0.5 + distance, 0.0, 1.0)


def texture(h: int, w: int, spp: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Factors in [DARKEST,1], [h,w,3], as `spp` samples see them and in truth: two colours, blended
    along waves, hard or soft. One in three is finer than a pixel: each sample sees either colour.
    """
    f, _ = waves(h, w, rng)
    share = np.clip(0.5 + f * 2.0 ** rng.uniform(-2, 4), 0.0, 1.0)
    seen = share
    if rng.random() < FINE_P:
        share = 0.1 + 0.8 * np.clip(0.5 + f * rng.uniform(0, 0.5), 0.0, 1.0)
        seen = rng.binomial(max(1, round(spp)), share) / max(1, round(spp))
    a, b = DARKEST + (1 - DARKEST) * rng.random((2, 3)) ** 0.7
    if rng.random() < 0.4:  # grey
        a, b = np.full(3, a[0]), np.full(3, b[0])
    return tuple((a + s[..., None] * (b - a)).astype(np.float32) for s in (seen, share))


def between(n: int, zoom: float, first: float, sharpness: float) -> tuple[np.ndarray, np.ndarray]:
    """Where n pixels enlarged by `zoom` lie, in pixels of the original, and a matrix [n, pixels of
    the original] that makes them: linear, or sharper, to hard edges at a sharpness of `zoom`."""
    at = first + (np.arange(n) + 0.5) / zoom - 0.5
    low = np.floor(at).astype(int)
    share = np.clip((at - low - 0.5) * sharpness + 0.5, 0.0, 1.0)
    count = min(math.ceil(n / zoom) + 1, n)
    make = np.zeros((n, count), np.float32)
    rows = np.arange(n)
    np.add.at(make, (rows, np.clip(low, 0, count - 1)), 1 - share)
    np.add.at(make, (rows, np.clip(low + 1, 0, count - 1)), share)
    return at, make


def enlarge(make: tuple[np.ndarray, np.ndarray], image: np.ndarray) -> np.ndarray:
    """[h,w,C] of the first rows and columns of an image, by the matrices of both directions."""
    rows, columns = make
    part = image[:rows.shape[1], :columns.shape[1]]
    part = np.tensordot(rows, part, (1, 0))                  # [h, w0, C]
    return np.ascontiguousarray(np.tensordot(part, columns, (1, 1)).transpose(0, 2, 1))


def zoomed(x: np.ndarray, aux: np.ndarray, y: np.ndarray,
           rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radiance, features and target [h,w,C] as if their first pixels had been rendered larger: what
    is broad and smooth, as walls of large pictures are. Each pixel of the input gets the noise of
    one of the original near it: input by target there, times the target here.
    """
    h, w, _ = y.shape
    zoom = math.exp(rng.uniform(*map(math.log, ZOOMS)))
    sharpness = rng.uniform(1, zoom)
    (at_y, rows), (at_x, columns) = (between(n, zoom, rng.random(), sharpness) for n in (h, w))
    make = rows, columns
    h0, w0 = rows.shape[1], columns.shape[1]
    small = np.float32(1e-3)
    fade = FADED ** rng.random() if rng.random() < FADED_P else 1.0
    noise = (x[:h0, :w0] + small) / (y[:h0, :w0] + small)
    around = [(np.abs(np.subtract.outer(*[np.arange(n)] * 2)) <= NEAR).astype(np.float32)
              for n in (h0, w0)]
    around = [m / m.sum(1, keepdims=True) for m in around]
    noise /= np.clip(enlarge(around, noise), 0.3, 3.0)  # of mean 1 around each pixel

    def nearby(away) -> list[np.ndarray]:
        """Rows and columns of the original's pixels, each moved by a draw of away()."""
        return [np.clip(np.rint(at + away()).astype(int), 0, n - 1)
                for at, n in ((at_y[:, None], h0), (at_x[None, :], w0))]

    iy, ix = nearby(lambda: rng.integers(-NEAR, NEAR + 1, (h, w)))
    target = enlarge(make, y)
    light = target + (target + small) * (np.float32(fade) * (noise[iy, ix] - 1))
    if rng.random() < 0.5:
        features = enlarge(make, aux.astype(np.float32))
    else:  # edges as samples see them
        iy, ix = nearby(lambda: rng.normal(0, 0.4, (h, w)))
        features = aux[iy, ix]
    return np.clip(light, 0.0, np.float32(color.HDR_MAX)), features, target


def minified(x: np.ndarray, aux: np.ndarray, y: np.ndarray, factor: int, count: int, clean: bool,
             rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radiance, features and target [h,w,C] of pixels `factor` times as large: the target is the
    mean over the factor x factor pixels of each, the input that of `count` of them, features
    included unless `clean`. Of a picture with box-filtered pixels and samples independent of each
    other that is what a renderer makes at that size, of `count` times the samples.
    """
    h, w = (n // factor for n in y.shape[:2])
    cells = [image.reshape(h, factor, w, factor, -1).transpose(0, 2, 1, 3, 4)
             .reshape(h, w, factor * factor, -1) for image in (x, aux, y)]
    which = rng.random((h, w, factor * factor, 1)).argsort(2)[:, :, :count]

    def some(cell: np.ndarray) -> np.ndarray:
        return np.take_along_axis(cell, which, 2).mean(2, dtype=np.float32)

    x, aux, y = cells
    return some(x), aux.mean(2, dtype=np.float32) if clean else some(aux), \
        y.mean(2, dtype=np.float32)


def blurred(images: list[np.ndarray], rng: np.random.Generator) -> list[np.ndarray]:
    """Images [h,w,C] of box-filtered pixels as a renderer's wide filter makes them, the same for
    all: a Gaussian of BLURS, or a tent. Pixels at the border count for those beyond."""
    away = np.abs(np.arange(-BLUR_REACH, BLUR_REACH + 1, dtype=np.float64))
    if rng.random() < 0.5:
        taps = np.exp(-0.5 * (away / rng.uniform(*BLURS)) ** 2)
    else:
        taps = np.maximum(1.0 - away / rng.uniform(1.1, BLUR_REACH), 0.0)
    taps = (taps / taps.sum()).astype(np.float32)
    sides = ((BLUR_REACH,) * 2, (BLUR_REACH,) * 2, (0, 0))
    return [through_window(np.pad(image, sides, "edge"), taps) for image in images]


def defocused(x: np.ndarray, aux: np.ndarray, y: np.ndarray, spp: float, clean: bool,
              rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radiance, features and target [h,w,C] out of focus, by radii that change over the tile, or in
    motion: the target is the mean over the circle (or line) around each pixel, the input that of
    `spp` random places in it, features included unless `clean`. At 1 sample that is what a
    renderer does; with more, light has less noise than features. Pixels at the border count for
    those beyond.
    """
    h, w = y.shape[:2]
    f, _ = waves(h, w, rng)
    radius = math.exp(rng.uniform(*map(math.log, DEFOCUS)))
    radius = radius * np.clip(0.5 + f * 2.0 ** rng.uniform(-3, 1), 0.0, 1.0)
    k = (np.arange(DEFOCUS_TAPS) + 0.5) / DEFOCUS_TAPS
    if rng.random() < MOTION_P:
        angle, away = rng.uniform(0, np.pi), 2 * k - 1
    else:  # a sunflower's seeds are spread evenly
        angle, away = np.pi * (3 - math.sqrt(5)) * np.arange(DEFOCUS_TAPS), np.sqrt(k)
    dy, dx = (away * np.sin(angle)).astype(np.float32), (away * np.cos(angle)).astype(np.float32)
    rows, columns = np.arange(h)[:, None], np.arange(w)[None, :]

    def places(tap) -> np.ndarray:
        at = ((rows, dy[tap], h), (columns, dx[tap], w))
        y, x = (np.clip(np.rint(i + radius * d).astype(int), 0, n - 1) for i, d, n in at)
        return y * w + x

    def mean(image: np.ndarray, where: list) -> np.ndarray:
        flat, total = image.reshape(h * w, -1), np.zeros(image.shape, np.float32)
        for at in where:
            total += flat.take(at, 0)
        return total / np.float32(len(where))

    draws = [rng.integers(0, DEFOCUS_TAPS, (h, w)) for _ in range(max(1, round(spp)))]
    seen, circle = ([places(tap) for tap in taps] for taps in (draws, range(DEFOCUS_TAPS)))
    return mean(x, seen), mean(aux, circle if clean else seen), mean(y, circle)


PLAIN = Augment()
