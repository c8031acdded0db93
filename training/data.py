"""Training data: pictures in memory (or mapped), and batches as a pure function of (seed, step).

Because batch k depends on nothing but the seed and k, training resumes exactly, any number of
loader processes gives the same order, and n processes with 1/n of the batch each see together what
one process sees.
"""
from __future__ import annotations

import math
from dataclasses import dataclass, field
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from training import color, kernel_model
from training.augment import DARKEST, DEFOCUS_SPP, MINIFIED, PLAIN, SHADOW_P, Augment, \
    add_fireflies, blurred, defocused, figure, hits_by_chance, minified, texture, zoomed
from training.errors import DATA, ToolError
from training.features import check_beside, encode, holds, load
from training.scan import CHANNELS, FEATURES, Group, Scan

BORDER_P, BORDER_MAX = 0.1, 15  # tiles that are cut short and zero padded, as at image borders
WHITES = (-0.5, 2.0)            # stops by which a tile is brighter before it is clipped
CLEANER = 16                    # samples of a target that inputs are blended towards, per theirs
CLEAN_SPP = 256                 # samples of a target that hardly shows its own noise
LEAST_NOISE = 0.2, 0.03         # that blending leaves: of targets with fewer samples, of clean ones
ON_LIGHT = ("fireflies", "hits", "collage", "texture", "zoom", "blur", "defocus")  # of Augment,
#   tile by tile; "minify" is drawn before the tile is cut
ON_ALBEDO = ON_LIGHT[2:]        # those that an albedo alone takes, too; normals alone not textures
BLACK_P = 0.01                  # tiles made black: aux features alone are no light


@dataclass
class Picture:
    """A group: network codes as half floats, [H,W,C]; targets may lack the aux channels."""

    name: str
    inputs: list[np.ndarray]
    weights: list[float]  # samples per pixel of the inputs, to average them
    target: np.ndarray
    names: list[str] = field(default_factory=list)
    target_spp: float = math.inf  # unknown: converged


def from_raw(found: Scan, features: list[str], main: str, transfer: str, clean_aux: bool = False,
             layers: dict[str, str] | None = None,
             log: Callable[[str], None] | None = None) -> list[Picture]:
    """Decode a raw data set; what cannot be read is reported through `log` and left out."""
    pictures = []
    for group in found.groups:
        try:
            pictures.append(load_group(group, features, main, transfer, clean_aux, layers, log))
        except ToolError as e:
            if log:
                log(f"left out {group.name}: {e}")
    return pictures


def load_group(group: Group, features: list[str], main: str, transfer: str,
               clean_aux: bool = False, layers: dict[str, str] | None = None,
               log: Callable[[str], None] | None = None) -> Picture:
    """One group exposed by its reference; the target keeps its aux features if it has them. Inputs
    that cannot be read are reported through `log` and left out, unless all are."""
    assert group.target is not None
    opened: dict = {}
    with_aux = clean_aux or holds(group.target, features, layers, opened)
    target = load(group.target, features if with_aux else [main], layers, opened)
    opened.clear()
    exposure = color.autoexposure(target[main]) if main == "hdr" else 1.0

    def half(images: dict[str, np.ndarray]) -> np.ndarray:
        return np.clip(encode(images, main, transfer, exposure), 0.0, 1.0).astype(np.float16)

    inputs, versions, last = [], [], None
    for version in group.inputs:
        try:
            images = load(version, [main] if clean_aux else features, layers)
            check_beside(version, images, target)
        except ToolError as e:
            last = e
            if log and len(group.inputs) > 1:
                log(f"left out {version.name}: {e}")
            continue
        inputs.append(half(images))
        versions.append(version)
    if last and not inputs:
        raise last
    return Picture(group.name, inputs, [float(v.spp or 1) for v in versions], half(target),
                   [v.name for v in versions], float(group.target.spp or math.inf))


class Batches:
    """Map-style data set of batches: `self[step]` is (input [N,C,t,t], target [N,Cm,t,t]) in fp32.

    An epoch visits every (input, target) pair once, one random tile of each; the last batch of an
    epoch is filled from its beginning. rank of world takes its share of each batch. For family K
    the inputs are `kernel_model.planes`.
    """

    def __init__(self, pictures: list[Picture], features: list[str], main: str, transfer: str,
                 batch_size: int, tile: int, seed: int, augment: Augment = PLAIN,
                 clean_aux: bool = False, rank: int = 0, world: int = 1, family: str = "U"):
        self.pictures, self.main, self.seed, self.augment = pictures, main, seed, augment
        self.family = family
        self.tile, self.clean_aux, self.batch_size = tile, clean_aux, batch_size
        self.rank, self.world = rank, world
        self.features = [f for f in FEATURES if f in features]
        self.table = color.HalfTable(transfer)
        self.main_channels = CHANNELS[main]
        self.on = {"hdr": ON_LIGHT, "alb": ON_ALBEDO,
                   "nrm": [k for k in ON_ALBEDO if k != "texture"]}.get(main, ())
        self.pairs = [(i, k) for i, p in enumerate(pictures) for k in range(len(p.inputs))]
        if not self.pairs:
            raise ToolError("no training images", DATA)
        smallest = min(pictures, key=lambda p: min(p.target.shape[:2]))
        small = min(smallest.target.shape[:2])
        if small < tile:
            fits = small // 16 * 16
            advice = f"choose --tile_size {fits} or less" if fits else "leave it out"
            raise ToolError(f"{smallest.name}: an image is smaller than the tile size ({small} < "
                            f"{tile}): {advice}", 2)
        self.steps_per_epoch = -(-len(self.pairs) // batch_size)

    def __len__(self) -> int:
        return 1 << 62

    def __getitem__(self, step: int) -> tuple[Tensor, Tensor]:
        epoch, index = divmod(step, self.steps_per_epoch)
        order = np.random.default_rng([self.seed, 0, epoch]).permutation(len(self.pairs))
        share = self.batch_size // self.world
        first = index * self.batch_size + self.rank * share
        xs, ys = [], []
        for slot in range(first, first + share):
            rng = np.random.default_rng([self.seed, 1, epoch, slot])
            x, y = self.sample(self.pairs[order[slot % len(order)]], rng)
            xs.append(x)
            ys.append(y)
        return torch.from_numpy(np.stack(xs)), torch.from_numpy(np.stack(ys))

    def sample(self, pair: tuple[int, int],
               rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """One augmented tile, [C,t,t] fp32 input and [Cm,t,t] target."""
        picture = self.pictures[pair[0]]
        t = self.tile
        short = [int(rng.integers(0, BORDER_MAX + 1)) if rng.random() < BORDER_P else 0
                 for _ in range(2)]
        th, tw = t - short[0], t - short[1]
        factor = self.factor(picture, rng)
        cut = random_cut(picture.target, th * factor, tw * factor, rng)
        x, y, clipped = self.light(picture, pair[1], cut, rng, factor)
        x, y = shuffle(x, y, self.features, self.main, rng, self.augment.signs)
        if x.shape[-1] > y.shape[-1] and rng.random() < BLACK_P:
            x[..., :y.shape[-1]] = 0.0
            y[:] = 0.0
        if self.family == "K":
            x = kernel_model.planes(x, self.features, *self.presence(rng), clipped)
        tiles = [np.zeros((a.shape[-1], t, t), np.float32) for a in (x, y)]
        for tile, a in zip(tiles, (x, y)):
            tile[:, :a.shape[0], :a.shape[1]] = a.transpose(2, 0, 1)
        return tuple(tiles)

    def presence(self, rng: np.random.Generator) -> tuple[bool, bool]:
        """Whether a tile keeps its albedo and its normals."""
        u, drop = rng.random(), self.augment.drop
        return not (u < 0.5 * drop or 0.8 * drop <= u < drop), not u < 0.8 * drop

    def factor(self, picture: Picture, rng: np.random.Generator) -> int:
        """Pixels across of the picture in one of a tile's."""
        most = min(MINIFIED, min(picture.target.shape[:2]) // self.tile)
        share = self.augment.minify if self.main in ("hdr", *kernel_model.LONE) else 0.0
        if not share or most < 2 or rng.random() >= share:
            return 1
        return int(rng.integers(2, most + 1))

    def light(self, picture: Picture, k: int, cut, rng,
              factor: int = 1) -> tuple[np.ndarray, np.ndarray, bool]:
        """Input and target tile, [h,w,C] fp32, after the augmentations that touch radiance, and
        whether they were clipped at 1. cut: of the picture, `factor` times as large as the tile."""
        m, a, hdr = self.main_channels, self.augment, self.main == "hdr"
        x, y = picture.inputs[k][cut], picture.target[cut]
        aux = x[..., m:]
        stops = rng.uniform(-a.exposure, a.exposure) if hdr and a.exposure else 0.0
        average = rng.random() < a.average and len(picture.inputs) > 1
        spp = sum(picture.weights) if average else picture.weights[k]
        # Never towards a target of like noise: it would teach to keep noise.
        blend = rng.random() < a.blend and picture.target_spp >= CLEANER * spp
        clean = rng.random() < a.clean_aux and y.shape[-1] > m or self.clean_aux
        clip = self.family == "K" and hdr and rng.random() < a.clip
        if clean:
            aux = y[..., m:]
        elif average:
            aux = np.average([v[cut][..., m:].astype(np.float32) for v in picture.inputs], 0,
                             picture.weights)
        xm, ym = x[..., :m], y[..., :m]
        on = {k: bool(k in self.on and getattr(a, k) > 0 and rng.random() < getattr(a, k))
              for k in ON_LIGHT}
        on["zoom"] &= picture.target_spp >= CLEANER * spp and factor == 1
        count = round(factor ** (2 * rng.random() ** 2)) if factor > 1 else 1
        spp *= count
        on["defocus"] &= spp <= DEFOCUS_SPP
        noise = LEAST_NOISE[picture.target_spp >= CLEAN_SPP] ** rng.random() if blend else 1.0
        if factor > 1 or stops or average or blend or clip or any(on.values()):
            xr, yr = self.table.decode(xm), self.table.decode(ym)
            if average:
                xr = np.average([self.table.decode(v[cut][..., :m]) for v in picture.inputs], 0,
                                picture.weights).astype(np.float32)
            if blend:
                xr = yr + np.float32(noise) * (xr - yr)
            if factor > 1:
                xr, aux, yr = minified(xr, aux, yr, factor, count, clean, rng)
            if on["zoom"]:
                xr, aux, yr = zoomed(xr, aux, yr, rng)
            if on["hits"]:
                xr = hits_by_chance(yr, rng)
            if on["collage"]:
                xr, aux, yr = self.collage(xr, aux, yr, spp, clean, noise, rng)
            if on["texture"]:
                xr, aux, yr = self.textured(xr, aux, yr, spp, rng)
            if on["defocus"]:
                xr, aux, yr = defocused(xr, aux, yr, spp, clean, rng)
            scale, top = np.float32(2.0**stops), np.float32(color.HDR_MAX if hdr else 1.0)
            xr, yr = xr * scale, yr * scale
            if on["fireflies"]:
                add_fireflies(xr, rng)
            if on["blur"]:
                xr, aux, yr = blurred([xr, aux.astype(np.float32), yr], rng)
            if clip:
                scale, top = np.float32(2.0**rng.uniform(*WHITES)), np.float32(1)
                xr, yr = xr * scale, yr * scale
            xm, ym = (self.table.encode(np.minimum(v, top)) for v in (xr, yr))
        x = np.concatenate([xm, aux], -1).astype(np.float32)
        return x, ym.astype(np.float32), clip

    def collage(self, x, aux, y, spp: float, clean: bool, noise: float, rng):
        """Radiance, features and target, [h,w,C], with another picture seen through a figure.

        In the input the samples of a pixel on the edge fall to either side at random. noise: share
        of its own that x still has."""
        h, w, m = *y.shape[:2], self.main_channels
        i, k = self.pairs[int(rng.integers(len(self.pairs)))]
        other = self.pictures[i]
        cut = random_cut(other.target, h, w, rng)
        codes, target = other.inputs[k][cut], other.target[cut]
        features = target if clean and target.shape[-1] > m else codes
        gain = np.float32(2.0 ** rng.uniform(-3, 3) if self.main == "hdr" else 1.0)
        share = figure(h, w, rng, spp / noise**2)
        edge = (share > 0) & (share < 1)
        drawn = share.copy()
        count = max(1, round(min(spp, other.weights[k])))
        drawn[edge] = rng.binomial(count, share[edge]) / count
        share, drawn = share[..., None], drawn[..., None]
        aux_share = share if features is target else drawn
        return ((1 - drawn) * x + drawn * (gain * self.table.decode(codes[..., :m])),
                (1 - aux_share) * aux + aux_share * features[..., m:],
                (1 - share) * y + share * (gain * self.table.decode(target[..., :m])))

    def textured(self, x, aux, y, spp: float, rng):
        """Radiance, features and target times a texture, of waves or of another picture's albedo;
        the albedo too, unless it is a shadow."""
        h, w, m = *y.shape[:2], self.main_channels
        f, seen, true = self.features, None, None
        at = 3 * f.index("alb") if "alb" in f else 0
        if at and rng.random() < 0.4:
            other = self.pictures[int(rng.integers(len(self.pictures)))].target
            if other.shape[-1] > at:
                albedo = other[random_cut(other, h, w, rng)][..., at:at + 3]
                seen = true = np.maximum(albedo.astype(np.float32), DARKEST)
        if true is None:
            seen, true = texture(h, w, spp, rng)
        if rng.random() < SHADOW_P:
            seen = true = true.mean(-1, keepdims=True)
        elif at:
            aux = aux.astype(np.float32)
            aux[..., at - m:at - m + 3] *= seen
        return x * seen, aux, y * true


class Alternating:
    """Batches, but every n-th of them from `large`, whose tiles have another size."""

    def __init__(self, batches: Batches, large: Batches, every: int):
        self.batches, self.large, self.every = batches, large, every
        self.pairs, self.steps_per_epoch = batches.pairs, batches.steps_per_epoch

    def __len__(self) -> int:
        return 1 << 62

    def __getitem__(self, step: int) -> tuple[Tensor, Tensor]:
        turn, place = divmod(step, self.every)
        return self.large[turn] if place == self.every - 1 else self.batches[step]


def random_cut(image: np.ndarray, h: int, w: int, rng: np.random.Generator) -> tuple[slice, slice]:
    """Where h x w pixels of an image [H,W,C] lie."""
    y, x = (int(rng.integers(0, n - t + 1)) for n, t in zip(image.shape, (h, w)))
    return np.s_[y:y + h, x:x + w]


def shuffle(x: np.ndarray, y: np.ndarray, features: list[str], main: str, rng: np.random.Generator,
            signs: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Random channel permutations, flips and transposition of a tile and its target, [h,w,C], whose
    memory the results may share.

    RGB of colour and albedo are permuted together, normals on their own (they may be in any space);
    sh1 keeps three random channels of its nine.
    """
    rgb, xyz = rng.permutation(3), rng.permutation(3)
    nine = rng.permutation(9)[:3]
    parts, at = [], 0
    for feature in features:
        part = x[..., at:at + CHANNELS[feature]]
        at += CHANNELS[feature]
        if feature == "sh1":
            part = part[..., nine]
        elif feature in ("hdr", "ldr", "alb"):
            part = part[..., rgb]
        elif feature == "nrm":
            part = part[..., xyz]
            if feature != main and rng.random() < signs:
                flip = rng.random(3) < 0.5
                part = np.where(flip, 1.0 - part, part).astype(np.float32)
        parts.append(part)
    x = np.concatenate(parts, -1)
    y = y[..., {"sh1": nine, "nrm": xyz, "z": [0]}.get(main, rgb)]
    if rng.random() < 0.5:
        x, y = x[::-1], y[::-1]
    if rng.random() < 0.5:
        x, y = x[:, ::-1], y[:, ::-1]
    if rng.random() < 0.5:
        x, y = x.transpose(1, 0, 2), y.transpose(1, 0, 2)
    return x, y
