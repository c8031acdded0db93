"""From a floating-point model and network inputs to an integer model (docs/arithmetic.md)."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from export.bounds import Bound
from export.convolve import pooled, taps_3x3
from export.fit import Fit, evenly, make_fit, second_moments
from export.graph import Layer, Net
from export.reference import (
    INT32,
    MAIN_CHANNELS,
    MIDDLE_MAX,
    NARROW_MAX,
    SHIFT_MAX,
    WIDE_MAX,
    FloatModel,
    IntLayer,
    IntModel,
    input_maxima,
)
from export.rounding import Problem, rounded

SCALE_MAX = 0.499   # of requantisation; the format's bound is 0.5
QUIET = 1 / 64      # channels are scaled as if they reached this share of the tensor's range
BIAS_STEPS = 6
RANGES = ("max", "percentile", "mse")


@dataclass(frozen=True)
class Options:
    """What the quantiser may choose; the defaults are the best of docs/quantisation.md."""

    input_top: float = 1.25    # network value of the main input's largest code
    output_top: float = 1.25   # the same for the output, unless calibration goes further
    ranges: str = "max"        # of narrow tensors from calibration: see `channel_range`
    percentile: float = 99.99
    headroom: float = 1.2      # factor on those ranges
    wide_headroom: float = 2.0  # and on the range of the last layer's source, where bits abound
    wide: tuple[str, ...] | None = None  # layers with 13-bit outputs; None: second_last(net)
    wide_aux: bool = False     # albedo and normals in 15 bits, not in 8
    equalize: float = 0.5      # 0: one range per tensor ... 1: every channel has its own
    words: float = 0.0         # squared error, in code steps^2 / 12, that sums in words may cost
    refine: bool = True        # round weights by their effect (rounding.py) instead of to nearest
    correct_bias: bool = True  # take each layer's error out of its biases
    samples: int = 32768       # pixels per layer for the statistics of its inputs and errors


def transfer_top(content: str) -> float:
    """Network value of the largest code of the main image. 1 is the radiance 65504 times the
    exposure; HDR content may go beyond where the exposure is large, other content does not."""
    return 1.25 if content in ("hdr", "lightmap-hdr") else 1.0


def second_last(net: Net) -> tuple[str, ...]:
    """The source of the last layer's source, whose 8-bit codes would show as bands."""
    last = {x.name: x for x in net.layers}[net.last.source]
    return (last.source,) if last.source != "input" else ()


def channel_range(values: np.ndarray, method: str, percentile: float) -> float:
    """Range [0, r] to be coded, of the values >= 0 that a channel took.

    max: all of them; percentile: that share; mse: least squared error of 8-bit codes.
    """
    values = values[values > 0]
    if not values.size:
        return 0.0
    top = float(values.max())
    if method == "percentile":
        return float(np.percentile(values, percentile))
    if method == "max":
        return top
    def error(r: float) -> float:
        codes = np.clip(np.rint(values * (NARROW_MAX / r)), 0, NARROW_MAX)
        return float(((codes * (r / NARROW_MAX) - values) ** 2).mean())
    return min((top * f for f in np.linspace(1, 0.3, 15)), key=error)


class Quantizer:
    """Quantises a model layer by layer, each on the integer outputs of those before it.

    After `run`: `model`; `steps[t]`, the value of one code for each channel of tensor t; and the
    tensors of all inputs, `floats[i][t]` as they should be and `codes[i][t]` as they came out.
    """

    def __init__(self, model: FloatModel, inputs: Sequence[np.ndarray], options: Options,
                 log: Callable[[str], None] = lambda line: None):
        self.source, self.net, self.options, self.log = model, model.net, options, log
        wide = second_last(self.net) if options.wide is None else options.wide
        self.tops = dict.fromkeys(wide, MIDDLE_MAX) | dict.fromkeys(self.net.wide, WIDE_MAX)
        has_aux = "input" in self.tops and not options.wide_aux  # family K's input is narrow
        self.aux = max(model.inputs - MAIN_CHANNELS, 0) if has_aux else 0
        self.inputs = [np.asarray(x, np.float32) for x in inputs]
        self.floats = [model.maps(x) for x in self.inputs]
        self.codes: list[dict[str, np.ndarray]] = []
        self.steps: dict[str, np.ndarray] = {}

    def run(self) -> IntModel:
        for name, o in (("input", self.source.inputs), *(
                (x.name, len(self.source.tensors[f"{x.name}.bias"])) for x in self.net.layers)):
            self.steps[name] = self._steps(name, o)
        self.model = IntModel(self.net, [], 1 / self.steps["input"], 1.0, self.aux)
        self.steps["input"] = 1 / self.model.input_scale.astype(np.float64)
        self.codes = [{"input": self.model.codes(x)} for x in self.inputs]
        for layer in self.net.layers:
            self.log(f"layer {layer.name}")
            made = self._layer(layer)
            self.model.layers.append(made)
            for maps in self.codes:
                maps[layer.name] = made.run(maps)
        self.model.output_scale = np.float32(self.steps[self.net.last.name][0])
        return self.model

    def _steps(self, name: str, channels: int) -> np.ndarray:
        """Value of one code per channel."""
        o = self.options
        if name == "input":
            tops = np.ones(channels)
            tops[:MAIN_CHANNELS] = o.input_top  # the main image; auxiliary ones lie in [0,1]
            return tops / input_maxima(channels, self.aux)
        if name == self.net.last.name:
            most = max(float(m[name].max(initial=0)) for m in self.floats)
            return np.full(channels, max(o.output_top, most) / WIDE_MAX)
        values = np.concatenate([m[name].reshape(-1, channels) for m in self.floats])
        own = np.array([channel_range(values[:, c], o.ranges, o.percentile)
                        for c in range(channels)])
        most = own.max(initial=0.0) or 1.0  # a tensor that is never active: anything will do
        own = most * np.maximum(own / most, QUIET) ** o.equalize
        if name in self.tops:
            return own * o.wide_headroom / self.tops[name]
        return own * o.headroom / NARROW_MAX

    def _unit(self, fit: Fit, shift: int, bias: np.ndarray, bound: Bound) -> np.ndarray:
        """[O]: value of one accumulator unit, at least what weights, sums and bias need."""
        room = INT32 // 4
        sums = np.zeros(fit.outputs)
        for b in fit.blocks:
            w = np.abs(b.weight).sum((1, 2, 3)).reshape(-1, fit.outputs).max(0)
            sums += w * WIDE_MAX * 2.0**shift if b.wide else w * NARROW_MAX
        return np.maximum.reduce([bound.norm(fit.rows() / fit.counts(shift)), sums / room,
                                  np.abs(bias) / room, np.full(fit.outputs, 1e-30)])

    def _shift(self, fit: Fit, moments: np.ndarray, bias: np.ndarray) -> int:
        """The shift of a mixed layer for which rounding its weights costs least."""
        if not fit.mixed:
            return 0
        pairs = fit.pairs()
        def cost(shift: int) -> float:
            steps = np.diag(moments) * fit.counts(shift) ** 2
            unit = self._unit(fit, shift, bias, pairs)
            return float((unit ** 2).sum() * steps.sum())
        return min(range(SHIFT_MAX + 1), key=cost)

    def _has_one_tap(self, layer: Layer) -> bool:
        """Whether the layer is a 1x1 convolution, held as a 3x3 one with zeros around."""
        return False

    def _layer(self, layer: Layer) -> IntLayer:
        weight = self.source.tensors[f"{layer.name}.weight"]
        bias = self.source.tensors[f"{layer.name}.bias"].astype(np.float64)
        fit = make_fit(layer, weight, self.steps, tuple(self.tops), self._has_one_tap(layer),
                       self.aux)
        moments = second_moments(fit, self.codes, self.options.samples)
        shift = self._shift(fit, moments, bias)
        rows, unit = self._rounded(fit, moments, shift, bias)
        self._fit_output(layer, unit)
        weights = fit.unrows(rows)
        scale = (unit / self.steps[layer.name]).astype(np.float32)

        def made(value: np.ndarray) -> IntLayer:
            return IntLayer(layer, weights[0], weights[1] if layer.skip else None,
                            np.rint(value / unit).astype(np.int32), scale, shift,
                            *(self.tops.get(t, NARROW_MAX)
                              for t in (layer.source, layer.skip, layer.name)), self.aux)

        if self.options.correct_bias:
            return made(bias + self._bias_error(layer, made(bias), unit))
        return made(bias)

    def _rounded(self, fit: Fit, moments: np.ndarray, shift: int,
                 bias: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Integer weights [O,K], and the value [O] of an accumulator unit."""
        o = self.options
        rows, unit, error = self._within(fit.pairs(), fit, moments, shift, bias)
        words = fit.words() if o.words and o.refine else None
        if words is not None:
            other, other_unit, other_error = self._within(words, fit, moments, shift, bias)
            fits = (other_unit <= SCALE_MAX * self.steps[fit.layer.name]).all()
            self.log(f"sums in words: {other_error:.1f}, in dwords: {error:.1f}")
            if fits and other_error <= error + o.words:
                return other, other_unit
        return rows, unit

    def _within(self, bound: Bound, fit: Fit, moments: np.ndarray, shift: int,
                bias: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Weights and units within a bound, and the mean squared error in steps^2 / 12."""
        counts, exact = fit.counts(shift), fit.rows()
        unit, rows = self._unit(fit, shift, bias, bound), np.zeros_like(exact)
        live = exact.any(0).nonzero()[0]  # a head's kernel has one tap: the others stay 0
        bound, wish = bound.of(live), (exact / unit[:, None] / counts)[:, live]
        if not live.size or not self.options.refine:
            rows[:, live] = bound.nearest(wish) if live.size else 0
            return rows, unit, 0.0
        hessian = (moments * counts[:, None] * counts)[np.ix_(live, live)]
        rows[:, live], errors = rounded(wish, Problem(hessian, bound))
        scale = unit / self.steps[fit.layer.name]
        return rows, unit, 12 * float((errors * scale * scale).mean())

    def _fit_output(self, layer: Layer, unit: np.ndarray) -> None:
        """Coarser output codes where an accumulator unit would be half a code or more."""
        least = unit / SCALE_MAX
        if layer == self.net.last:
            least[:] = least.max(initial=0.0)
        self.steps[layer.name] = np.maximum(self.steps[layer.name], least)

    def _bias_error(self, layer: Layer, made: IntLayer, unit: np.ndarray) -> np.ndarray:
        """[O]: what is missing from the biases, by the squared error of the layer's output.

        The mean error before the ReLU alone is no measure: where a channel is far below 0 its error
        may be large and does not show, and a bias that evens it out spoils the rest.
        """
        top = np.float32(made.out_max * self.steps[layer.name])
        wanted, got, total, pixels = [], [], np.zeros(made.outputs), 0
        for floats, codes in zip(self.floats, self.codes, strict=True):
            pair = [self._before_relu(layer, floats)]
            pair.append(made.accumulate(codes, 0, len(pair[0])) * unit)
            total += (pair[0] - pair[1]).sum((0, 1))
            pixels += pair[0].shape[0] * pair[0].shape[1]
            if layer.pool:  # ReLU and a bias may as well come after it
                pair = [pooled(x) for x in pair]
            count = pair[0].shape[0] * pair[0].shape[1]
            some = evenly(count, self.options.samples // len(self.codes))
            for values, x in zip((wanted, got), pair):
                values.append(x.reshape(count, -1)[some].astype(np.float32))
        wanted, got = np.clip(np.concatenate(wanted), 0, top), np.concatenate(got)

        def judge(added: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Mean squared error, and the mean error where wanted or got is not 0."""
            value = np.clip(got + np.float32(added), 0, top)
            active = ((wanted > 0) | (value > 0)).sum(0)
            value -= wanted
            return (value * value).mean(0), -value.sum(0) / np.maximum(active, 1)

        best = np.zeros(made.outputs)
        least, missing = judge(best)
        added = total / max(pixels, 1)
        for _ in range(BIAS_STEPS):
            square, found = judge(added)
            better = square < least
            best, least = np.where(better, added, best), np.where(better, square, least)
            missing = np.where(better, found, missing / 2)
            added = best + missing
        return best

    def _before_relu(self, layer: Layer, maps: dict[str, np.ndarray]) -> np.ndarray:
        """Float output [h,w,O] of a layer before ReLU and pooling."""
        x = maps[layer.source]
        x = x.repeat(2, 0).repeat(2, 1) if layer.up else x
        x = np.concatenate((x, maps[layer.skip]), -1) if layer.skip else x
        bias = self.source.tensors[f"{layer.name}.bias"]
        out = np.empty((*x.shape[:2], len(bias)))
        out[:] = bias
        taps_3x3(out, x, self.source.tensors[f"{layer.name}.weight"], 0)
        return out
