#!/usr/bin/env python3
"""Fine-tune a model as what it will be: integers. Where post-training quantisation loses too much.

    python -m training.quantize_aware IN.tza OUT.tza -D data -t train [--steps 500]

IN.tza is quantised as export.quantize does it, on pictures of the data set; then weights and biases
are trained on the folded graph with every rounding of docs/arithmetic.md in place (gradients pass
roundings as if they were not there). `IntegerNet` computes in double precision exactly what the
integer executors compute, to the bit.
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.quantize_aware", run_name="__main__", alter_sys=True))

import copy
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from export.bounds import Bound, own_groups, pair_groups, word_groups
from export.calibrate import add_kind, middle
from export.quantize import integer_tensors, load_float, write_integer
from export.quantizer import Options, Quantizer, transfer_top
from export.reference import IntLayer, IntModel, Part, check_layer
from training import errors
from training.data import Augment, Batches, from_raw
from training.errors import DATA, STATE, USAGE, ToolError
from training.features import add_layers, parse_layers
from training.kernel_filter import Clamp
from training.loss import LOSSES, Loss, make_loss
from training.scan import scan

TRANSFERS = {"hdr": "pu", "ldr": "srgb", "srgb": "linear", "lightmap-hdr": "log"}
CALIBRATION = 12  # pictures of the data set
SAVE_EVERY = 50  # steps
JUDGES = 16      # batches that choose among the states of those steps
ADAM_EPS = 1e-15  # gradients by one step of a weight are small: 1e-7 and far below


def through(exact: Tensor, smooth: Tensor) -> Tensor:
    """The value of `exact`, the gradient of `smooth`."""
    return smooth + (exact - smooth).detach()


def bounds_of(source: IntLayer) -> list[Bound]:
    """The bounds on rows of the weights of each part: words where the layer keeps them, else
    pairs."""
    parts = list(source.parts())
    words = [Bound(word_groups(p.weight.shape[1:])) for p in parts]
    if all(not p.wide and bound.holds(p.weight.reshape(len(p.weight), -1))
           for bound, p in zip(words, parts, strict=True)):
        return words
    return [Bound((own_groups if p.wide else pair_groups)(p.weight.shape[1:])) for p in parts]


def rounded_weights(weight: Tensor, bound: Bound) -> Tensor:
    """Integers near `weight` [O,C,k,k] within the bound on its rows."""
    whole = bound.kernels(weight.detach().cpu().double().numpy())
    return through(torch.from_numpy(whole).to(weight), weight)


class IntegerLayer(nn.Module):
    """A layer in accumulator units: `weight` and `skip` are integers to be, and so is `bias`."""

    def __init__(self, source: IntLayer):
        super().__init__()
        self.source, self.layer, self.bounds = source, source.layer, bounds_of(source)
        self.weight = nn.Parameter(torch.from_numpy(source.weight.astype(np.float64)))
        self.skip = None
        if source.skip is not None:
            self.skip = nn.Parameter(torch.from_numpy(source.skip.astype(np.float64)))
        self.bias = nn.Parameter(torch.from_numpy(source.bias.astype(np.float64)))
        self.register_buffer("scale", torch.from_numpy(source.scale.astype(np.float64)))
        self.register_buffer("multiplier", torch.from_numpy(source.multiplier()))

    def _weight(self, part: Part) -> Tensor:
        """A part's weights, not yet rounded."""
        whole = self.weight if part.name == self.layer.source else self.skip
        return whole[:, part.channels]

    def _sums(self, x: Tensor, weight: Tensor) -> Tensor:
        """[N,O,H,W] of a 3x3 convolution, or of the phases of an upsampled source."""
        if weight.shape[-1] == 3:
            return F.conv2d(x, weight, padding=1)
        n, _, h, w = x.shape
        o = len(weight) // 4
        y = F.conv2d(F.pad(x, (1, 1, 1, 1)), weight)  # [N,4*O,h+1,w+1]
        phases = [y[:, p * o:(p + 1) * o, p >> 1:h + (p >> 1), p & 1:w + (p & 1)]
                  for p in range(4)]
        y = torch.stack(phases, 2).view(n, o, 2, 2, h, w)
        return y.permute(0, 1, 4, 2, 5, 3).reshape(n, o, 2 * h, 2 * w)

    def forward(self, x: Tensor, skip: Tensor | None) -> Tensor:
        """Codes to codes, [N,C,H,W]."""
        s = self.source
        total = through(self.bias.round(), self.bias).view(1, -1, 1, 1)
        wide = 0.0
        for part, bound in zip(s.parts(), self.bounds, strict=True):
            codes = x if part.name == self.layer.source else skip
            weight = rounded_weights(self._weight(part), bound)
            y = self._sums(codes[:, part.channels], weight)
            if part.wide:
                wide = wide + y
            else:
                total = total + y
        if isinstance(wide, Tensor):
            shifted = (wide.detach() + ((1 << s.shift) >> 1)).div(1 << s.shift).floor()
            total = total + through(shifted, wide / (1 << s.shift))
        return self._codes(total)

    def _codes(self, total: Tensor) -> Tensor:
        """Requantisation and pooling of the accumulators."""
        s = self.source
        smooth = self._clamped(total * self.scale.to(total).view(1, -1, 1, 1))
        a = total.detach().round().long() * self.multiplier.view(1, -1, 1, 1)
        codes = ((a + (1 << 30)) >> 31).clamp(0, s.out_max).to(smooth)
        y = through(codes, smooth)
        return F.max_pool2d(y, 2) if self.layer.pool else y

    def _clamped(self, codes: Tensor) -> Tensor:
        return codes.clamp(0, self.source.out_max)

    @torch.no_grad()
    def rounded(self) -> IntLayer:
        """What the layer is at present, as an integer layer; its sums are kept within bounds."""
        whole: dict[str, list[np.ndarray]] = {}
        for part, bound in zip(self.source.parts(), self.bounds, strict=True):
            w = rounded_weights(self._weight(part), bound)
            whole.setdefault(part.name, []).append(w.cpu().numpy().astype(np.int8))
        joined = [np.concatenate(w, 1) for w in whole.values()]
        return dataclasses.replace(self.source, weight=joined[0],
                                   skip=joined[1] if len(joined) > 1 else None,
                                   bias=self.bias.round().cpu().numpy().astype(np.int32))


class IntegerHead(IntegerLayer):
    """A head of family K: a 1x1 convolution, which models hold as a 3x3 one with zeros around."""

    def __init__(self, source: IntLayer):
        super().__init__(source)
        self.weight = nn.Parameter(self.weight.detach()[:, :, 1:2, 1:2].contiguous())
        self.bounds = bounds_of(dataclasses.replace(source, weight=source.weight[:, :, 1:2, 1:2]))

    def forward(self, x: Tensor, skip: Tensor | None) -> Tensor:
        return self._codes(through(self.bias.round(), self.bias).view(1, -1, 1, 1)
                           + F.conv2d(x, rounded_weights(self.weight, self.bounds[0])))

    def _clamped(self, codes: Tensor) -> Tensor:
        return Clamp.apply(codes, 0.0, float(self.source.out_max))

    @torch.no_grad()
    def rounded(self) -> IntLayer:
        weight = F.pad(rounded_weights(self.weight, self.bounds[0]), (1, 1, 1, 1))
        weight = weight.cpu().numpy().astype(np.int8)
        return dataclasses.replace(self.source, weight=weight,
                                   bias=self.bias.round().cpu().numpy().astype(np.int32))


class IntegerNet(nn.Module):
    """An integer model as a torch module: [N,C,H,W] network values in and out.

    In double precision (the default) the output is bit for bit that of the integer executors; after
    .float() it is the same up to rare roundings, which is enough to train.
    """

    def __init__(self, model: IntModel):
        super().__init__()
        self.net, self.output_scale = model.net, float(model.output_scale)
        self.input_scale, self.aux = model.input_scale, model.aux
        self.input_max = model.input_max
        self.layers = nn.ModuleList(IntegerLayer(x) for x in model.layers)

    def codes(self, x: Tensor) -> Tensor:
        """Input codes; x in single precision, as everywhere."""
        scale, top = (torch.from_numpy(v).to(x.device).view(1, -1, 1, 1)
                      for v in (self.input_scale, self.input_max))
        return (x.float() * scale + 0.5).floor().clamp(min=0).minimum(top.float())

    def forward(self, x: Tensor) -> Tensor:
        maps = {"input": self.codes(x).to(self.layers[0].weight.dtype)}
        for layer in self.layers:
            skip = maps[layer.layer.skip] if layer.layer.skip else None
            maps[layer.layer.name] = layer(maps[layer.layer.source], skip)
        return maps[self.net.last.name] * self.output_scale

    def integer_model(self) -> IntModel:
        """The model as it is now; ModelError if sums could leave 32 bits."""
        model = IntModel(self.net, [x.rounded() for x in self.layers], self.input_scale,
                         self.output_scale, self.aux)
        for x in model.layers:
            check_layer(x, "trained model")
        return model


@dataclasses.dataclass
class Tuned:
    """What came out of fine_tune: the loss on the judging batches before, and the least, with the
    step that it was reached after."""

    before: float
    least: float
    step: int


def held_out(batches: Batches) -> list[tuple[Tensor, Tensor]]:
    """Batches of other tiles than those of a training."""
    other = copy.copy(batches)
    other.seed = batches.seed + 1
    return [other[k] for k in range(JUDGES)]


@torch.no_grad()
def judge(net: nn.Module, held: Sequence[tuple[Tensor, Tensor]], loss: Loss) -> float:
    """Mean loss of batches."""
    return sum(float(loss(net(x), y)) for x, y in held) / len(held)


def fine_tune(net: nn.Module, batches: Batches, held: Sequence[tuple[Tensor, Tensor]], steps: int,
              rate: float, loss: Loss, log=print, state: dict | None = None,
              save=lambda state: None) -> Tuned:
    """Adam on weights in units of their own steps; the rate falls to zero along a cosine. The net
    ends as it was when it did best on the batches `held`, which may be the beginning.

    state: what an earlier run gave to `save`, which gets it now and then and at the end.
    """
    net.float().train()
    groups = [{"params": [p], "base": rate * (10 if name.endswith("bias") else 1)}
              for name, p in net.named_parameters()]
    optimizer = torch.optim.Adam(groups, eps=ADAM_EPS)
    if state:
        net.load_state_dict(state["net"])
        optimizer.load_state_dict(state["optimizer"])
        first, mean, tuned, best = (state[k] for k in ("step", "mean", "tuned", "best"))
        tuned = Tuned(**tuned)
    else:
        first, mean, best = 0, 0.0, copy.deepcopy(net.state_dict())
        loss_before = judge(net, held, loss)
        tuned = Tuned(loss_before, loss_before, 0)
    for step in range(first, steps):
        for group in optimizer.param_groups:
            group["lr"] = group["base"] * (0.5 + 0.5 * math.cos(math.pi * step / steps))
        x, y = batches[step]
        value = loss(net(x), y)
        optimizer.zero_grad()
        value.backward()
        optimizer.step()
        mean += (value.item() - mean) / min(step + 1, 100)
        if (step + 1) % SAVE_EVERY == 0 or step + 1 == steps:
            found = judge(net, held, loss)
            log(f"step {step + 1} of {steps}: loss {mean:.6f}, on tiles held out {found:.6f} "
                f"(at first {tuned.before:.6f})")
            if found < tuned.least:
                tuned.least, tuned.step = found, step + 1
                best = copy.deepcopy(net.state_dict())
            save({"step": step + 1, "mean": mean, "net": net.state_dict(), "best": best,
                  "tuned": dataclasses.asdict(tuned), "optimizer": optimizer.state_dict()})
    net.load_state_dict(best)
    net.double()
    return tuned


def main(argv: list[str]) -> None:
    parser = errors.Parser("python -m training.quantize_aware", description=__doc__)
    add = parser.add_argument
    add("input", type=Path, metavar="IN.tza")
    add("output", type=Path, metavar="OUT.tza")
    add("-D", "--data_dir", type=Path, default=Path("data"))
    add("-t", "--train_data", required=True, help="raw data set below the data folder")
    add("--steps", type=int, default=500)
    add("--rate", type=float, default=0.02, help="of learning, in weight steps (default 0.02)")
    add("-l", "--loss", default="l1", choices=LOSSES)
    add("-b", "--batch_size", type=int, default=8)
    add("--tile_size", "--ts", type=int, default=64)
    add("--seed", type=int, default=1)
    add_layers(parser)
    add_kind(parser)
    args = parser.parse_args(argv)
    if args.content not in TRANSFERS or args.steps < 1 or args.rate <= 0:
        raise ToolError("--lightmap-dir, --steps below 1 and --rate of 0 are not possible", USAGE)
    model = load_float(args.input)
    main_feature = {"albedo": "alb", "normal": "nrm"}.get(
        args.main, "ldr" if args.content in ("ldr", "srgb") else "hdr")
    features = [main_feature, "alb", "nrm"][:model.inputs // 3]
    found = scan(args.data_dir / args.train_data, features)
    transfer = "linear" if main_feature == "nrm" else TRANSFERS[args.content]
    pictures = from_raw(found, features, main_feature, transfer, layers=parse_layers(args.layers),
                        log=print)
    if not pictures:
        raise ToolError(f"{found.root}: no pictures to train on", DATA)
    torch.manual_seed(args.seed)
    some = pictures[::max(len(pictures) // CALIBRATION, 1)][:CALIBRATION]
    inputs = [middle(p.inputs[i % len(p.inputs)]).astype(np.float32) for i, p in enumerate(some)]
    inputs = [np.pad(x, ((0, -x.shape[0] % 16), (0, -x.shape[1] % 16), (0, 0))) for x in inputs]
    top = transfer_top(args.content)
    net = IntegerNet(Quantizer(model, inputs, Options(input_top=top, output_top=top)).run())
    batches = Batches(pictures, features, main_feature, transfer, args.batch_size, args.tile_size,
                      args.seed, Augment(exposure=1.0 if main_feature == "hdr" else 0.0))
    held = held_out(batches)
    loss = make_loss(args.loss, transfer=transfer)
    fine_tune(net, batches, held, args.steps, args.rate, loss)
    try:
        write_integer(args.output, integer_tensors(net.integer_model()))
    except ValueError as e:
        raise ToolError(f"{args.output}: {e}", STATE) from e
    print(f"Saved: {args.output}")


if __name__ == "__main__":
    errors.run(main)
