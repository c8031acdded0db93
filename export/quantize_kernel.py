"""Quantises a K model: `python -m export.quantize_kernel IN.tza OUT.tza --data DIR`.

IN is the fp16 export of a trained model, its state dict (.pt), or an integer model to round anew.
DIR is a data set in the layout of training (docs/training.md); some of its noisy images, with all
features or fewer, fix the ranges of the activations.
"""
from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from export import kernel, pixels
from export.albedo import ALBEDO_MOST, counted_albedo
from export.calibrate import middle
from export.dequantize import as_floats
from export.graph import Layer
from export.quantize import write_tensors
from export.quantizer import SCALE_MAX, Options, Quantizer
from export.reference import NARROW_MAX
from export.tza import Reader
from training import errors
from training.features import add_layers, load, parse_layers
from training.scan import scan


# Most layers lose far less in words (docs/quantisation.md). Some of the coarsest levels, where a
# hundredth of the work is, would lose more and keep pairs.
OPTIONS = Options(words=200.0)


class KernelQuantizer(Quantizer):
    """The trunk's quantiser: input and heads have fixed steps, everything is narrow."""

    def __init__(self, model: kernel.FloatTrunk, inputs: Sequence[np.ndarray], options: Options):
        super().__init__(model, inputs, options)
        self.tops = {}

    def _steps(self, name: str, channels: int) -> np.ndarray:
        if name == "input":
            return np.full(channels, 1 / NARROW_MAX)
        if name in self.net.heads:
            return np.full(channels, kernel.HEAD_STEP)
        return super()._steps(name, channels)

    def _has_one_tap(self, layer: Layer) -> bool:
        return layer.name in self.net.heads

    def _fit_output(self, layer, unit) -> None:
        if layer.name not in self.net.heads:
            super()._fit_output(layer, unit)
        elif unit.max() > SCALE_MAX * kernel.HEAD_STEP:
            raise ValueError(f"{layer.name}: the logits are too large to be quantised; the network "
                             "has not learnt to use this level")

    def run(self) -> kernel.IntTrunk:
        names = [("input", self.net.inputs)] + [
            (x.name, len(self.source.tensors[f"{x.name}.bias"])) for x in self.net.layers]
        self.steps = {name: self._steps(name, o) for name, o in names}
        self.model = kernel.IntTrunk(self.net, [])
        self.codes = [{"input": self.model.codes(x)} for x in self.inputs]
        for layer in self.net.layers:
            made = self._layer(layer)
            self.model.layers.append(made)
            for maps in self.codes:
                maps[layer.name] = made.run(maps)
        return self.model


def tensors_of(model: kernel.IntTrunk) -> dict[str, np.ndarray]:
    """The tensors of a K model's file."""
    out = {}
    for x in model.layers:
        name = x.layer.name
        is_head = name in model.net.heads
        out[f"{name}.weight"] = x.weight[:, :, 1:2, 1:2] if is_head else x.weight
        if x.skip is not None:
            out[f"{name}.skip.weight"] = x.skip
        out[f"{name}.bias"], out[f"{name}.scale"] = x.bias, x.scale
    if model.bilateral:
        out[kernel.BILATERAL] = np.full(1, model.bilateral, np.float32)
    return out


def calibration_input(images: dict[str, np.ndarray], content: str = "hdr") -> np.ndarray:
    """Padded network input (codes / 255) [H,W,12] of a frame's images by feature."""
    frame = pixels.Frame(images, content)
    color = pixels.sanitize(images["color"], frame.input_scale(), 0.0, pixels.MAX)
    albedo, normal = images.get("albedo"), images.get("normal")
    if albedo is not None:
        albedo = counted_albedo(pixels.sanitize(albedo, 1.0, 0.0, ALBEDO_MOST), color)
    if normal is not None:
        normal = pixels.sanitize(normal, 1.0, -1.0, 1.0)
    codes = kernel.encode(color, albedo, normal, not frame.rule().is_hdr)
    h, w, _ = codes.shape
    codes = np.pad(codes, ((0, -h % kernel.ALIGN), (0, -w % kernel.ALIGN), (0, 0)), mode="edge")
    return codes.astype(np.float32) / np.float32(255)


def varied(images: dict[str, np.ndarray], i: int,
           all_features: bool = False) -> tuple[dict[str, np.ndarray], str]:
    """Calibration picture number i and its content: features are left out by turns, some clip.

    all_features: none are, for a model that has seen no others."""
    absent = () if all_features else ((), (), ("normal",), ("albedo", "normal"))[i % 4]
    frame = {f: image for f, image in images.items() if f not in absent}
    if i % 6 == 5:
        return frame | {"color": np.minimum(frame["color"], 1.0)}, "ldr"
    return frame, "hdr"


def calibration_set(folder: Path, count: int, all_features: bool = False,
                    layers: dict[str, str] | None = None) -> list[np.ndarray]:
    """Inputs from `count` groups of a data set, evenly spread, as of `varied`; those that cannot be
    read are named and left out. layers: those of multichannel files, by feature."""
    groups = sorted(scan(folder, ["hdr", "alb", "nrm"]).groups, key=lambda g: g.name)
    if not groups:
        raise errors.ToolError(f"{folder}: no group with hdr alb nrm and a reference", errors.DATA)
    inputs = []
    for i, group in enumerate(groups[::max(len(groups) // count, 1)][:count]):
        version = group.inputs[i % len(group.inputs)]
        try:
            images = load(version, ["hdr", "alb", "nrm"], layers)
        except errors.ToolError as e:
            print(f"left out {version.name}: {e}")
            continue
        frame = {"color": images["hdr"], "albedo": images["alb"], "normal": images["nrm"]}
        inputs.append(middle(calibration_input(*varied(frame, i, all_features))))
    if not inputs:
        raise errors.ToolError(f"{folder}: no picture can be read", errors.DATA)
    return inputs


def read_tensors(path: Path) -> dict[str, np.ndarray]:
    """Float weights by name from a .tza, or from a .pt that holds a state dict."""
    if path.suffix != ".pt":
        tensors = dict(Reader(path))
        same = {k: v.astype(np.float32) for k, v in tensors.items() if k == kernel.BILATERAL}
        return dict(as_floats(tensors, str(path))) | same
    import torch
    try:
        state = torch.load(path, weights_only=True)
        return {k: v.float().numpy().astype(np.float32 if k == kernel.BILATERAL else np.float16)
                for k, v in state.items()}
    except OSError:
        raise
    except Exception as e:  # a damaged file shows as one of many kinds of exception
        raise ValueError(f"{path}: no state dict ({type(e).__name__})") from e


def check_colour(bilateral: int, source: str) -> None:
    """That a model is one for colour, as the inputs of `calibration_set` are."""
    if bilateral == kernel.ALONE:
        raise errors.ToolError(f"{source}: is for an albedo or normals alone, and --data is looked "
                               "at in colour", errors.STATE)


def quantized(args: argparse.Namespace) -> kernel.IntTrunk:
    """The integer model that the arguments ask for."""
    tensors, options = read_tensors(args.input), replace(OPTIONS, words=args.words)
    bilateral = kernel.bilateral_of(tensors, str(args.input))
    check_colour(bilateral, str(args.input))
    model = kernel.FloatTrunk(kernel.find_trunk(tensors, str(args.input)), tensors)
    inputs = calibration_set(args.data, args.count, args.all_features, parse_layers(args.layers))
    made = KernelQuantizer(model, inputs, options).run()
    made.bilateral = bilateral
    return made


def main(argv: list[str]) -> None:
    parser = errors.Parser(prog="python -m export.quantize_kernel",
                           description="Quantises a model of family K.")
    parser.add_argument("input", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--data", type=Path, required=True, help="calibration images")
    parser.add_argument("--count", type=int, default=12, help="how many of its groups (12)")
    parser.add_argument("--all_features", action="store_true",
                        help="leave none of the features out: for models trained so")
    add_layers(parser)
    parser.add_argument("--words", type=float, default=OPTIONS.words, metavar="E", help="squared "
                        "error of codes, in that of their own rounding, that a layer may have more "
                        "for sums in words (%(default)g; 0: no such sums)")
    args = parser.parse_args(argv)
    if args.count < 1:
        raise errors.ToolError(f"--count {args.count}: not positive", errors.USAGE)
    with errors.reading(args.input):
        write_tensors(args.output, tensors_of(quantized(args)))
    print(f"Saved: {args.output}")


if __name__ == "__main__":
    errors.run(main)
