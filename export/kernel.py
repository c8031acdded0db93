"""Family K in numpy, from docs/kernel-prediction.md: integer trunk, fp32 filter, to the bit.

The trunk is an integer model like those of family U, all of its tensors narrow; its heads are 1x1
convolutions, held here as 3x3 ones with zeros around the tap.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from export import pixels
from export.albedo import ALBEDO_MOST, counted_albedo
from export.calm import frame_calm
from export.edges import averaged, ragged
from export.grain import without_grain
from export.graph import ALIGN, Layer, ModelError, Net, read_heads, read_nets
from export.reference import NARROW_MAX, FloatModel, IntLayer, IntModel, _tensor, check_layer
from export.regression import features_of, regressed
from export.smooth import (EPS, corrected, guide_of, mixed, noise_codes, shares, smoothed,
                           to_code)
from export.tza import Reader

F = np.float32
INPUTS, LEVELS, TAPS = 12, 5, 25
RADIANCE_MAX = F(65504)
LOG_GAIN, CODES_PER_OCTAVE = F(32), F(21.2493764)
PER_CODE = F(0.0901684401)  # log2(e) / 16
CONFIDENCE, BLEND, ALBEDO = 25, 26, 27
HEAD_STEP = 1 / 16          # logit of one code
NO_NORMAL = 128             # code of the normal where there is none

BILATERAL = "bilateral.scale"    # a tensor of one value: the last steps, a key of LAST_STEPS
SMOOTH_AND_CORRECT, SMOOTH, ALL_STEPS = 1, 2, 3
ALONE = 4  # or: none, and the model is for an albedo or normals alone, which stand for normals, too
CLEAN_AND_SMOOTH = 5
LOG_TERMS = F(30.6365147), F(-15.4037612), F(10.996752), F(-7.00442797)


@dataclass(frozen=True)
class LastSteps:
    """Steps after the filter (export.smooth, export.regression): smoothing, these, and mixing; and
    one before the network (export.grain)."""

    cleans: bool
    regresses: bool
    corrects: bool


LAST_STEPS = {SMOOTH_AND_CORRECT: LastSteps(False, False, True),
              SMOOTH: LastSteps(False, False, False), ALL_STEPS: LastSteps(True, True, True),
              CLEAN_AND_SMOOTH: LastSteps(True, False, False)}


@dataclass(frozen=True)
class Trunk(Net):
    """A K net's layers with its heads behind them; `heads[s]` is the name of level s's."""

    heads: tuple[str, ...] = ()

    @property
    def inputs(self) -> int:
        return INPUTS

    @property
    def wide(self) -> frozenset[str]:
        return frozenset()


def read_trunks() -> list[Trunk]:
    """The K nets of nets.def."""
    trunks = []
    for net in read_nets():
        if net.family != "K":
            continue
        heads = sorted(read_heads(net.name), key=lambda head: head.level)
        layers = tuple(Layer(head.name, head.source, False, None, False) for head in heads)
        trunks.append(Trunk(net.name, net.family, net.key, net.layers + layers,
                            tuple(head.name for head in heads)))
    return trunks


def find_net(tensors: Mapping[str, np.ndarray]) -> Trunk | None:
    """The K net whose weights are among these."""
    return next((net for net in read_trunks() if f"{net.key}.weight" in tensors), None)


def find_trunk(tensors: Mapping[str, np.ndarray], file: str) -> Trunk:
    """The K net whose weights these are."""
    if (trunk := find_net(tensors)) is None:
        raise ModelError(f"{file}: the tensors belong to no known network of family K")
    return trunk


def widened(weight: np.ndarray) -> np.ndarray:
    """[O,I,1,1] -> [O,I,3,3] with zeros around the tap."""
    return np.pad(weight, ((0, 0), (0, 0), (1, 1), (1, 1)))


class FloatTrunk(FloatModel):
    """fp32 execution of a K model's fp16 weights; inputs are codes / 255."""

    def __init__(self, trunk: Trunk, tensors: Mapping[str, np.ndarray]):
        names = {x.name for x in trunk.layers}
        tensors = {k: np.asarray(v, F) for k, v in tensors.items() if k.partition(".")[0] in names}
        for head in trunk.heads:
            tensors[f"{head}.weight"] = widened(tensors[f"{head}.weight"])
        super().__init__(trunk, tensors)


class IntTrunk(IntModel):
    """Exact execution of a K model: codes [H,W,12] in, head codes out."""

    def __init__(self, trunk: Trunk, layers: list[IntLayer], bilateral: int = 0):
        super().__init__(trunk, layers, np.full(trunk.inputs, 255.0), 1.0)
        self.bilateral = bilateral  # 0 or a value of BILATERAL

    @property
    def is_alone(self) -> bool:
        """Whether it is for an albedo or normals alone."""
        return self.bilateral == ALONE

    def codes(self, x: np.ndarray) -> np.ndarray:
        """Codes / 255 to codes."""
        return np.rint(np.asarray(x) * 255).astype(np.uint8)


def check_trunk(model: IntTrunk, file: str) -> None:
    """Raises unless all layers keep what docs/arithmetic.md demands; runs of heads have one tap."""
    for x in model.layers:
        if x.layer.name in model.net.heads:
            x = replace(x, weight=x.weight[:, :, 1:2, 1:2])
        check_layer(x, file)


def int_trunk(tensors: Mapping[str, np.ndarray], file: str) -> IntTrunk:
    """A K model from the tensors of its file, checked as a loader must."""
    model = IntTrunk(*_layers(find_trunk(tensors, file), tensors, file),
                     bilateral_of(tensors, file))
    check_trunk(model, file)
    return model


def _layers(trunk: Trunk, tensors: Mapping[str, np.ndarray],
            file: str) -> tuple[Trunk, list[IntLayer]]:
    channels, layers = {"input": trunk.inputs}, []
    for layer in trunk.layers:
        name, c, is_head = layer.name, channels[layer.source], layer.name in trunk.heads
        o = tensors[f"{name}.bias"].shape[0]
        rows, k = (4 * o, 2) if layer.up else (o, 1 if is_head else 3)
        weight = _tensor(tensors, f"{name}.weight", np.int8, (rows, c, k, k), file)
        skip = None
        if layer.skip:
            skip = _tensor(tensors, f"{name}.skip.weight", np.int8,
                           (o, channels[layer.skip], 3, 3), file)
        layers.append(IntLayer(layer, widened(weight) if is_head else weight, skip,
                               _tensor(tensors, f"{name}.bias", np.int32, (o,), file),
                               _tensor(tensors, f"{name}.scale", F, (o,), file), 0,
                               NARROW_MAX, NARROW_MAX, NARROW_MAX))
        channels[name] = o
    return trunk, layers


def bilateral_of(tensors: Mapping[str, np.ndarray], file: str) -> int:
    """What a file's BILATERAL asks for; 0 if it has none."""
    if BILATERAL not in tensors:
        return 0
    value = _tensor(tensors, BILATERAL, F, (1,), file)[0]
    if value not in LAST_STEPS and value != ALONE:
        raise ModelError(f"{file}: {BILATERAL}: {value:g}, known are 1 to {max(LAST_STEPS)}")
    return int(value)


# ---- Input and filter ----------------------------------------------------------------------------

def log_codes(u: np.ndarray) -> np.ndarray:
    """Logarithm of u >= 1 in codes, not yet rounded."""
    m, e = pixels.mantissa(u)
    t = m - F(1)
    a, b, c, d = LOG_TERMS
    return e * CODES_PER_OCTAVE + t * ((b * t + a) + (t * t) * (d * t + c))


def encode(radiance: np.ndarray, albedo: np.ndarray | None, normal: np.ndarray | None,
           clipped: bool) -> np.ndarray:
    """Network codes [H,W,12] of exposed radiance, albedo in [0,1], normals in [-1,1], sanitised."""
    a = np.full_like(radiance, F(1) - EPS) if albedo is None else albedo
    v = np.minimum(radiance, RADIANCE_MAX) * shares(a + EPS)
    log = to_code(log_codes(F(1) + LOG_GAIN * v))
    alb = np.zeros_like(log) if albedo is None else to_code(albedo * F(255))
    nrm = np.full_like(log, NO_NORMAL) if normal is None else to_code(normal * F(127.5) + F(127.5))
    flags = np.zeros_like(log)
    flags[:] = [255 * (albedo is not None), 255 * (normal is not None), 255 * clipped]
    return np.concatenate((log, alb, nrm, flags), -1)


def weight_table() -> np.ndarray:
    """E(q), float32 [256]: products of two tables of 16."""
    sixteenths, ones = np.arange(-240, 1, 16).astype(F), np.arange(-15, 1).astype(F)
    return np.outer(pixels.exp2(sixteenths * PER_CODE), pixels.exp2(ones * PER_CODE)).ravel()


def blend_table() -> np.ndarray:
    """beta(q), float32 [256]."""
    return F(1) / (F(1) + pixels.exp2(np.arange(128, -128, -1).astype(F) * PER_CODE))


def sums_5x5(weights: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Sum over the taps k of weights[h,w,k] * v(p + k), in their order; zeros outside."""
    h, w, _ = v.shape
    around = np.pad(v, ((2, 2), (2, 2), (0, 0)))
    out = np.zeros_like(v)
    for k in range(TAPS):
        out = out + weights[..., k:k + 1] * around[k // 5:k // 5 + h, k % 5:k % 5 + w]
    return out


def _quotient(sums: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(sums[..., :1] > 0, sums[..., 1:] * (F(1) / sums[..., :1]), F(0))


def _upsampled(x: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Bilinear by 2, edges repeated, cut to shape; rows first."""
    for axis in (0, 1):
        n = x.shape[axis]
        fine = np.arange(shape[axis])
        near = np.minimum(fine // 2, n - 1)
        far = np.clip(fine // 2 + np.where(fine & 1, 1, -1), 0, n - 1)
        x = F(0.75) * x.take(near, axis) + F(0.25) * x.take(far, axis)
    return x


def feature_means(head: np.ndarray, image: np.ndarray) -> np.ndarray:
    """5x5 means of the albedo or the normal [H,W,3] by the kernel that level 0's head has for
    them."""
    v = np.concatenate((np.ones_like(image[..., :1]), image), -1)
    sums = sums_5x5(weight_table()[head[:v.shape[0], :v.shape[1], ALBEDO:ALBEDO + TAPS]], v)
    return sums[..., 1:] * (F(1) / sums[..., :1])


def padded(codes: np.ndarray) -> np.ndarray:
    """Codes [H,W,C] with zeros below and to the right, as networks want them."""
    h, w, _ = codes.shape
    return np.pad(codes, ((0, -h % ALIGN), (0, -w % ALIGN), (0, 0)))


def apply_filter(heads: list[np.ndarray], radiance: np.ndarray, albedo: np.ndarray | None,
                 normal: np.ndarray | None = None, guide: np.ndarray | None = None,
                 bilateral: int = 0, clipped: bool = False,
                 raggedness: float = 0.0, calm: float = 0.0,
                 is_clean: bool = False) -> np.ndarray:
    """Filtered radiance [H,W,3]. heads: codes by level, of the padded size; bilateral: a value of
    BILATERAL or 0; guide: of guide_of, if it is not 0; clipped: the radiance was, so that it lacks
    light itself; raggedness: of export.edges; calm, is_clean: of export.smooth.mixed."""
    table = weight_table()
    smooth = np.ones_like(radiance)
    if albedo is not None:
        smooth = feature_means(heads[0], albedo) + EPS
    radiance = np.minimum(radiance, RADIANCE_MAX)
    i, confident, filtered, blends = radiance * shares(smooth), [], [], []
    for level in range(LEVELS):
        head = heads[level][:i.shape[0], :i.shape[1]]
        c = table[head[..., CONFIDENCE:CONFIDENCE + 1]]
        v = np.concatenate((c, c * i), -1)
        confident.append(v)
        filtered.append(_quotient(sums_5x5(table[head[..., :TAPS]], v)))
        blends.append(blend_table()[head[..., BLEND:BLEND + 1]])
        even = np.pad(v, ((0, v.shape[0] % 2), (0, v.shape[1] % 2), (0, 0)))
        pooled = ((even[::2, ::2] + even[::2, 1::2]) + even[1::2, ::2]) + even[1::2, 1::2]
        i = _quotient(pooled)
    out = filtered[-1]
    for level in range(LEVELS - 2, -1, -1):
        f = filtered[level]
        out = f + blends[level] * (_upsampled(out, f.shape) - f)
    if steps := LAST_STEPS.get(bilateral):
        noise = noise_codes(confident[0], filtered[0])
        out = smoothed(out, noise, guide, steps.corrects)
        if steps.regresses and (albedo is not None or normal is not None):
            even = np.zeros_like(out) if normal is None else feature_means(heads[0], normal)
            out = regressed(out, smooth, features_of(even, smooth), radiance)
        if steps.corrects and not clipped:
            out = corrected(out, smooth, noise, radiance)
        result = averaged(np.fmax(out * smooth, F(0)), F(raggedness))
        result = pixels.sanitize(result, 1.0, 0.0, pixels.MAX)
        return mixed(result, noise, radiance, albedo is None and normal is None, F(calm), is_clean)
    return out * smooth


def known_calm(content: str, main: str) -> float | None:
    """How calm frames are that are no pictures; None: to be measured."""
    if content.startswith("lightmap"):
        return -1.0
    return None if main == "color" else 0.0


def run_frame(model: IntTrunk, frame: pixels.Frame, channels: int = 3) -> np.ndarray:
    """A whole image through a K model, [H,W,channels]."""
    rule, images = frame.rule(), dict(frame.images)
    main = next(f for f in pixels.FEATURES if f in images)
    scale = frame.input_scale()
    r = pixels.sanitize(pixels.three_channels(images[main]), scale,
                        -1.0 if rule.is_signed else 0.0, pixels.MAX if rule.is_hdr else 1.0)
    r = r * F(0.5) + F(0.5) if rule.is_signed else r
    r = pixels.srgb_inverse(r) if frame.content == "srgb" and not rule.is_signed else r
    aux = {f: None for f in ("albedo", "normal")}
    for f in aux:
        if f in images and f != main:
            v = pixels.sanitize(pixels.three_channels(images[f]), 1.0,
                                *((-1.0, 1.0) if f == "normal" else (0.0, ALBEDO_MOST)))
            aux[f] = counted_albedo(v, r, frame.clean_aux) if f == "albedo" else v
    if model.is_alone:
        if len(images) > 1 or main == "color":
            raise ModelError("the model is for an albedo or normals alone")
        aux["normal"] = F(2) * r - F(1)
    codes = encode(r, aux["albedo"], aux["normal"], not rule.is_hdr)
    guide = guide_of(codes)
    light, calm = np.minimum(r, RADIANCE_MAX), known_calm(frame.content, main)
    raggedness = ragged(light, aux["albedo"])
    calm = frame_calm(light, aux["albedo"]) if calm is None else calm
    steps = LAST_STEPS.get(model.bilateral)
    if steps and steps.cleans and not frame.clean_aux:
        aux["albedo"], aux["normal"] = without_grain(aux["albedo"], aux["normal"], codes)
        codes = encode(r, aux["albedo"], aux["normal"], not rule.is_hdr)
    maps = model.maps(padded(codes))
    v = apply_filter([maps[n] for n in model.net.heads], r, aux["albedo"], aux["normal"], guide,
                     model.bilateral, not rule.is_hdr, raggedness, calm, frame.clean_aux)
    v = pixels.sanitize(v, 1.0, 0.0, pixels.MAX)
    v = pixels.srgb_forward(v) if frame.content == "srgb" and not rule.is_signed else v
    return frame.stored(v, channels)


def load(path: Path | str) -> IntTrunk:
    return int_trunk(Reader(path), str(path))
