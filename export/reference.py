"""Reference executor in numpy, written from docs/arithmetic.md: what every port must compute.

Integer models are exact; fp16 models run in fp32. Slow and plain on purpose.
"""
from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from export.convolve import by_bands, taps_3x3, taps_phases
from export.graph import ALIGN, Layer, ModelError, Net, find_net
from export.pixels import Frame
from export.tza import Reader, TzaError

NARROW_MAX, WIDE_MAX = 255, 32767
MIDDLE_MAX = 8191  # of wide codes that may be made in patches
MAIN_CHANNELS = 3  # of the network's input: those of the main image, which are wide
PAIR_MAX = 128   # bound of a pair's positive and of its negative weights
WEIGHT_MAX = 127
SHIFT_MAX = 15
SCALE_MAX = 1e6  # of inputs and output
INT32 = 1 << 31


def padded(x: np.ndarray) -> np.ndarray:
    """[H,W,C] with zeros below and to the right, up to multiples of 16."""
    h, w, _ = x.shape
    return np.pad(x, ((0, -h % ALIGN), (0, -w % ALIGN), (0, 0)))


class FloatModel:
    """fp32 execution of an fp16 (or fp32) model."""

    def __init__(self, net: Net, tensors: Mapping[str, np.ndarray]):
        self.net = net
        self.tensors = {k: np.asarray(v, np.float32) for k, v in tensors.items()}
        self.inputs = self.tensors[f"{net.layers[0].name}.weight"].shape[1]
        self.outputs = self.tensors[f"{net.last.name}.bias"].shape[0]

    def layer(self, layer: Layer, maps: Mapping[str, np.ndarray]) -> np.ndarray:
        """Output [h,w,O] of one layer from its inputs among the maps by name."""
        x, weight = maps[layer.source], self.tensors[f"{layer.name}.weight"]
        bias = self.tensors[f"{layer.name}.bias"]
        if layer.up:
            x = x.repeat(2, 0).repeat(2, 1)
        if layer.skip:
            x = np.concatenate((x, maps[layer.skip]), -1)

        def band(first: int, last: int) -> np.ndarray:
            out = np.empty((last - first, x.shape[1], len(bias)), np.float32)
            out[:] = bias
            taps_3x3(out, x, weight, first)
            return np.maximum(out, 0)

        return by_bands(x.shape[:2], band, layer.pool)

    def maps(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """All tensors of a run by name, `input` included. x: [H,W,C], H and W multiples of 16."""
        maps = {"input": np.asarray(x, np.float32)}
        for layer in self.net.layers:
            maps[layer.name] = self.layer(layer, maps)
        return maps

    def run(self, x: np.ndarray) -> np.ndarray:
        """Network values [H,W,C] to network values [H,W,O] >= 0."""
        return self.maps(x)[self.net.last.name]


def kinds(name: str, channels: int, top: int, aux: int) -> Iterator[tuple[slice, int]]:
    """The channels of a tensor by kind of code, each with its largest: `top`, but of the network's
    input the last `aux` are narrow."""
    split = channels - (aux if name == "input" else 0)
    yield slice(0, split), top
    if split < channels:
        yield slice(split, channels), NARROW_MAX


@dataclass(frozen=True)
class Part:
    """Channels of a layer's source or skip whose codes are of one kind."""

    name: str           # of the tensor they are of
    channels: slice     # of it
    weight: np.ndarray  # on them: int8 [O,C,3,3], or [4*O,C,2,2] if it is upsampled
    top: int            # largest code
    up: bool = False

    @property
    def wide(self) -> bool:
        return self.top > NARROW_MAX


@dataclass(frozen=True)
class IntLayer:
    """What an integer model holds for a layer."""

    layer: Layer
    weight: np.ndarray       # int8 [O,I,3,3], or [4*O,I,2,2] on an upsampled source
    skip: np.ndarray | None  # int8 [O,J,3,3]
    bias: np.ndarray         # int32 [O]
    scale: np.ndarray        # float32 [O]
    shift: int
    source_max: int          # largest code of the source: 255, 8191 or 32767
    skip_max: int
    out_max: int
    aux: int = 0             # channels of the network's input, the last ones, that are narrow

    def parts(self) -> Iterator[Part]:
        """What is summed, in the order of the weights."""
        for name, weight, top, up in (
                (self.layer.source, self.weight, self.source_max, self.layer.up),
                (self.layer.skip, self.skip, self.skip_max, False)):
            if weight is None:
                continue
            for channels, most in kinds(name, weight.shape[1], top, self.aux):
                yield Part(name, channels, weight[:, channels], most, up)

    @property
    def outputs(self) -> int:
        return len(self.bias)

    def multiplier(self) -> np.ndarray:
        """M = floor(s * 2^31 + 0.5), int64 [O]."""
        return np.floor(self.scale.astype(np.float64) * 2.0**31 + 0.5).astype(np.int64)

    def sums(self, wide: bool) -> np.ndarray:
        """Largest sum of |weights| per output channel over the wide or narrow inputs, int64 [O]."""
        total = np.zeros(self.outputs, np.int64)
        for part in self.parts():
            if part.wide == wide:
                w = np.abs(part.weight.astype(np.int64)).sum((1, 2, 3))
                total += w.reshape(-1, self.outputs).max(0)
        return total

    def accumulate(self, maps: Mapping[str, np.ndarray], first: int, last: int) -> np.ndarray:
        """a of rows [first, last), int64 [n,W,O]."""
        up = 2 if self.layer.up else 1
        width = maps[self.layer.source].shape[1] * up
        wide = np.zeros((last - first, width, self.outputs))
        narrow = np.zeros_like(wide)
        for part in self.parts():
            taps = taps_phases if part.up else taps_3x3
            taps(wide if part.wide else narrow, maps[part.name][..., part.channels], part.weight,
                 first)
        shifted = (wide.astype(np.int64) + ((1 << self.shift) >> 1)) >> self.shift
        return shifted + self.bias + narrow.astype(np.int64)

    def run(self, maps: Mapping[str, np.ndarray]) -> np.ndarray:
        """Codes of the layer's output from those of its inputs."""
        multiplier = self.multiplier()
        dtype = np.uint8 if self.out_max == NARROW_MAX else np.uint16

        def band(first: int, last: int) -> np.ndarray:
            a = self.accumulate(maps, first, last)
            return np.clip((a * multiplier + (1 << 30)) >> 31, 0, self.out_max).astype(dtype)

        source = maps[self.layer.source].shape
        up = 2 if self.layer.up else 1
        return by_bands((source[0] * up, source[1] * up), band, self.layer.pool)


def unsafe_pairs(weight: np.ndarray) -> int:
    """Pairs of int8 [O,C,kh,kw] along the runs (a kernel row: columns outer, channels inner) whose
    positive weights sum to more than 128 or negative ones to less than -128."""
    o, c, kh, kw = weight.shape
    runs = weight.astype(np.int32).transpose(0, 2, 3, 1).reshape(o * kh, kw * c)
    runs = np.pad(runs, ((0, 0), (0, runs.shape[1] % 2))).reshape(o * kh, -1, 2)
    high, low = np.maximum(runs, 0).sum(-1), np.minimum(runs, 0).sum(-1)
    return int(((high > PAIR_MAX) | (low < -PAIR_MAX)).sum())


def input_maxima(channels: int, aux: int) -> np.ndarray:
    """Largest codes of the network's input, int32 [channels], of which the last `aux` are narrow.
    """
    top = np.full(channels, WIDE_MAX, np.int32)
    top[channels - aux:] = NARROW_MAX
    return top


class IntModel:
    """Exact execution of an integer model."""

    def __init__(self, net: Net, layers: list[IntLayer], input_scale: np.ndarray,
                 output_scale: float, aux: int = 0):
        """aux: channels of the input, the last ones, that are narrow."""
        self.net, self.layers, self.aux = net, layers, aux
        self.input_scale = np.asarray(input_scale, np.float32)
        self.output_scale = np.float32(output_scale)
        self.inputs = len(self.input_scale)
        self.input_max = input_maxima(self.inputs, aux)

    @property
    def outputs(self) -> int:
        return self.layers[-1].outputs

    def codes(self, x: np.ndarray) -> np.ndarray:
        """Network values >= 0 to input codes, both [H,W,C]."""
        v = np.asarray(x, np.float32) * self.input_scale + np.float32(0.5)
        return np.clip(v, 0, self.input_max).astype(np.uint16)

    def maps(self, codes: np.ndarray) -> dict[str, np.ndarray]:
        """Codes of all tensors of a run by name. H and W are multiples of 16."""
        maps = {"input": codes}
        for layer in self.layers:
            maps[layer.layer.name] = layer.run(maps)
        return maps

    def output_codes(self, x: np.ndarray) -> np.ndarray:
        """Network values [H,W,C] to output codes, uint16 [H,W,O]."""
        return self.maps(self.codes(x))[self.net.last.name]

    def run(self, x: np.ndarray) -> np.ndarray:
        """Network values [H,W,C] to network values [H,W,O] >= 0."""
        return self.output_codes(x).astype(np.float32) * self.output_scale


def _tensor(tensors: Mapping, name: str, dtype, shape: tuple[int, ...], file: str) -> np.ndarray:
    if name not in tensors:
        raise ModelError(f"{file}: tensor '{name}' is missing")
    t = tensors[name]
    if t.dtype != np.dtype(dtype) or t.shape != shape:
        raise ModelError(f"{file}: tensor '{name}' is {t.dtype} {list(t.shape)}, "
                         f"not {np.dtype(dtype)} {list(shape)}")
    return np.array(t)


def check_layer(x: IntLayer, file: str) -> None:
    """Raises unless a layer keeps what docs/arithmetic.md demands."""
    name = x.layer.name
    for part in x.parts():
        tensor = f"{name}.weight" if part.name == x.layer.source else f"{name}.skip.weight"
        if part.weight.size and int(part.weight.min()) < -WEIGHT_MAX:
            raise ModelError(f"{file}: tensor '{tensor}' holds -128")
        if not part.wide and unsafe_pairs(part.weight):
            raise ModelError(f"{file}: tensor '{tensor}' is not pair-safe")
    if not (np.isfinite(x.scale).all() and (x.scale >= 0).all() and (x.scale < 0.5).all()):
        raise ModelError(f"{file}: tensor '{name}.scale' has values outside [0, 0.5)")
    if x.out_max != NARROW_MAX and (x.out_max not in (MIDDLE_MAX, WIDE_MAX) or x.layer.pool):
        raise ModelError(f"{file}: tensor '{name}.max' is {x.out_max}, not {NARROW_MAX}"
                         + ("" if x.layer.pool else f", {MIDDLE_MAX} or {WIDE_MAX}"))
    if not 0 <= x.shift <= SHIFT_MAX:
        raise ModelError(f"{file}: tensor '{name}.shift' is outside 0..{SHIFT_MAX}")
    wide = x.sums(wide=True) * WIDE_MAX + ((1 << x.shift) >> 1)
    both = ((wide >> x.shift) + np.abs(x.bias.astype(np.int64))
            + x.sums(wide=False) * NARROW_MAX)
    if (wide >= INT32).any() or (both >= INT32).any():
        raise ModelError(f"{file}: the sums of layer '{name}' can leave 32 bits")


def int_model(tensors: Mapping[str, np.ndarray], file: str) -> IntModel:
    """An integer model from the tensors of its file, checked as a loader must."""
    net = find_net(tensors, file)
    first = tensors[f"{net.layers[0].name}.weight"]
    channels = {"input": first.shape[1] if first.ndim == 4 else 0}
    layers, tops, aux = [], {"input": WIDE_MAX, None: NARROW_MAX}, 0
    if "input.max" in tensors:
        most = _tensor(tensors, "input.max", np.int32, (channels["input"],), file)
        aux = max(channels["input"] - MAIN_CHANNELS, 0)
        if not np.array_equal(most, input_maxima(channels["input"], aux)):
            raise ModelError(f"{file}: tensor 'input.max' is not {WIDE_MAX} of the main image's "
                             f"channels and {NARROW_MAX} of the others")
    for layer in net.layers:
        name, c = layer.name, channels[layer.source]
        o = tensors[f"{name}.bias"].shape[0]
        rows, k = (4 * o, 2) if layer.up else (o, 3)
        skip, shift = None, np.zeros(1, np.int32)
        if layer.skip:
            skip = _tensor(tensors, f"{name}.skip.weight", np.int8,
                           (o, channels[layer.skip], 3, 3), file)
        if f"{name}.shift" in tensors:
            shift = _tensor(tensors, f"{name}.shift", np.int32, (1,), file)
        tops[name] = WIDE_MAX if name in net.wide else NARROW_MAX
        if f"{name}.max" in tensors:
            tops[name] = int(_tensor(tensors, f"{name}.max", np.int32, (1,), file)[0])
        layers.append(IntLayer(
            layer,
            _tensor(tensors, f"{name}.weight", np.int8, (rows, c, k, k), file), skip,
            _tensor(tensors, f"{name}.bias", np.int32, (o,), file),
            _tensor(tensors, f"{name}.scale", np.float32, (o,), file), int(shift[0]),
            tops[layer.source], tops[layer.skip], tops[name], aux))
        check_layer(layers[-1], file)
        channels[name] = o
    scales = [_tensor(tensors, f"{t}.scale", np.float32, (n,), file)
              for t, n in (("input", channels["input"]), ("output", 1))]
    if not all((s >= 0).all() and (s <= SCALE_MAX).all() for s in scales):
        raise ModelError(f"{file}: input.scale and output.scale must be from 0 to {SCALE_MAX:g}")
    return IntModel(net, layers, scales[0], scales[1][0], aux)


def float_model(tensors: Mapping[str, np.ndarray], file: str) -> FloatModel:
    """An fp16 or fp32 model from the tensors of its file; shapes are checked."""
    net = find_net(tensors, file)
    first = tensors[f"{net.layers[0].name}.weight"]
    channels = {"input": first.shape[1] if first.ndim == 4 else 0}
    for layer in net.layers:
        c = channels[layer.source] + (channels[layer.skip] if layer.skip else 0)
        weight, bias = tensors[f"{layer.name}.weight"], tensors[f"{layer.name}.bias"]
        if weight.dtype.kind != "f" or bias.dtype.kind != "f":
            raise ModelError(f"{file}: layer '{layer.name}' is not floating point")
        if weight.ndim != 4 or bias.ndim != 1 or weight.shape != (len(bias), c, 3, 3):
            raise ModelError(f"{file}: tensor '{layer.name}.weight' is {list(weight.shape)}, "
                             f"not {[len(bias), c, 3, 3]}" if bias.ndim == 1 else
                             f"{file}: tensor '{layer.name}.bias' is not a vector")
        if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise ModelError(f"{file}: layer '{layer.name}' has weights that are not finite")
        channels[layer.name] = len(bias)
    return FloatModel(net, {n: tensors[n] for x in net.layers
                            for n in (f"{x.name}.weight", f"{x.name}.bias")})


def denoise(model: FloatModel | IntModel, frame: Frame, channels: int = 3) -> np.ndarray:
    """The whole way from a frame's images to the output image [H,W,channels]."""
    x = frame.network_input()
    return frame.finished(model.run(padded(x))[:x.shape[0], :x.shape[1]], channels)


def load_model(path: Path | str) -> FloatModel | IntModel:
    """Any model file; ModelError or TzaError (both ValueErrors) say what is wrong with it."""
    try:
        tensors = Reader(path)
    except OSError as e:
        raise TzaError(f"{path}: cannot read ({e.strerror or e})") from e
    integer = any(a.dtype == np.int8 for a in tensors.values())
    return (int_model if integer else float_model)(tensors, str(path))
