#!/usr/bin/env python3
"""Quantise a model: from fp16 weights to integer ones (docs/arithmetic.md). Needs numpy only.

    python -m export.quantize IN.tza OUT.tza [--calib NOISY.exr ...] [--report]

Ranges follow from noisy pictures like those the model will see, or from a few built-in synthetic
ones. A picture is a file with layers (color, albedo, normal), or NAME.hdr.exr with NAME.alb.exr and
NAME.nrm.exr beside it. The number of input channels says which features the model takes.
"""
from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from export.accuracy import Sample, compare, layer_table, sample_table
from export.calibrate import (
    Kind,
    add_kind,
    frame_of,
    network_inputs,
    read_picture,
    synthetic_frames,
)
from export.graph import Net, find_net
from export.pixels import CONTENTS
from export.quantizer import RANGES, Options, Quantizer, second_last, transfer_top
from export.reference import (
    NARROW_MAX,
    WIDE_MAX,
    FloatModel,
    IntModel,
    int_model,
    load_model,
)
from export.tza import Writer
from training import errors
from training.errors import STATE, USAGE, ToolError
from training.imageio import read_image, replacing


def integer_tensors(model: IntModel) -> dict[str, np.ndarray]:
    """The tensors of an integer model's file, in the order in which they are written."""
    tensors = {"input.scale": model.input_scale}
    if model.aux:
        tensors["input.max"] = model.input_max
    for x in model.layers:
        name = x.layer.name
        tensors[f"{name}.weight"] = x.weight
        if x.skip is not None:
            tensors[f"{name}.skip.weight"] = x.skip
        tensors[f"{name}.bias"], tensors[f"{name}.scale"] = x.bias, x.scale
        if x.shift:
            tensors[f"{name}.shift"] = np.array([x.shift], np.int32)
        if x.out_max != (WIDE_MAX if name in model.net.wide else NARROW_MAX):
            tensors[f"{name}.max"] = np.array([x.out_max], np.int32)
    tensors["output.scale"] = np.array([model.output_scale], np.float32)
    return tensors


def write_tensors(path: Path, tensors: dict[str, np.ndarray]) -> None:
    """A weights file of the tensors as they are, written anew."""
    with replacing(path) as tmp, Writer(tmp) as w:
        for name, tensor in tensors.items():
            w.write(name, tensor)


def write_integer(path: Path, tensors: dict[str, np.ndarray]) -> None:
    """A model file, checked as a loader would before it gets its name."""
    find_net(tensors, str(path))
    int_model(tensors, str(path))
    write_tensors(path, tensors)


def arguments() -> argparse.ArgumentParser:
    parser = errors.Parser("python -m export.quantize", description=__doc__)
    add = parser.add_argument
    add("input", type=Path, metavar="IN.tza", help="fp16 (or fp32) model")
    add("output", type=Path, metavar="OUT.tza", help="integer model, written anew")
    add("--calib", type=Path, nargs="+", default=[], metavar="IMAGE",
        help="noisy pictures; default: built-in synthetic ones")
    add_kind(parser)
    add("--ranges", choices=RANGES, default=Options.ranges,
        help="ranges of activations: everything seen, a percentile, or least squared error")
    add("--percentile", type=float, default=Options.percentile, metavar="P")
    add("--headroom", type=float, default=Options.headroom, metavar="F",
        help=f"factor on these ranges (default {Options.headroom})")
    add("--equalize", type=float, default=Options.equalize, metavar="E",
        help="0: one range per tensor ... 1: one per channel "
             f"(default {Options.equalize})")
    add("--wide", nargs="*", metavar="LAYER",
        help="layers with 13-bit outputs; default: the third last, without which smooth gradients "
             "show bands; none named: only the compulsory ones, which is fastest")
    add("--wide_aux", "--wide-aux", action="store_true",
        help="albedo and normals in 15 bits, not in 8")
    add("--nearest", action="store_true", help="round weights to nearest, not by their effect")
    add("--report", action="store_true",
        help="print the error by layer and by picture (calibration pictures, or --test)")
    add("--test", nargs="+", default=[], metavar="IMAGE[=REFERENCE]",
        help="pictures for the report, with clean ones to tell what quantisation costs")
    return parser


def wide_tensors(net: Net, names: list[str] | None) -> tuple[str, ...]:
    """Layers with 13-bit outputs beside the compulsory ones: those named, else the usual one."""
    if names is None:
        return second_last(net)
    for layer in net.layers:
        if layer.pool and layer.name in names:
            raise ToolError(f"--wide {layer.name}: a layer that pools is narrow", USAGE)
    unknown = set(names) - {x.name for x in net.layers}
    if unknown:
        raise ToolError(f"--wide {sorted(unknown)[0]}: no such layer in '{net.name}'", USAGE)
    return tuple(names)


def options_of(args: argparse.Namespace, kind: Kind, net: Net) -> Options:
    for name, low, high in (("percentile", 50, 100), ("headroom", 0.1, 10), ("equalize", 0, 1)):
        if not low <= getattr(args, name) <= high:
            raise ToolError(f"--{name} must be from {low} to {high}", USAGE)
    top = transfer_top(kind.content)
    return Options(input_top=top, output_top=top, ranges=args.ranges, percentile=args.percentile,
                   headroom=args.headroom, equalize=args.equalize, refine=not args.nearest,
                   wide=wide_tensors(net, args.wide), wide_aux=args.wide_aux)


def test_samples(names: list[str], kind: Kind) -> list[Sample]:
    samples = []
    for name in names:
        noisy, _, reference = name.partition("=")
        frame = frame_of(read_picture(Path(noisy), kind), kind)
        clean = read_image(Path(reference)) if reference else None
        if clean is not None and clean.shape != (*next(iter(frame.images.values())).shape[:2], 3):
            raise ToolError(f"{reference}: not of the size of {noisy}", errors.DATA)
        parent = Path(noisy).parent.name
        samples.append(Sample(f"{parent}/{Path(noisy).stem}" if parent else noisy, frame, clean))
    return samples


def load_float(path: Path) -> FloatModel:
    try:
        model = load_model(path)
    except ValueError as e:
        raise ToolError(str(e), STATE) from e
    if not isinstance(model, FloatModel):
        raise ToolError(f"{path}: is an integer model already", STATE)
    if model.outputs != 3:
        raise ToolError(f"{path}: {model.outputs} output channels, not 3", STATE)
    return model


def main(argv: list[str]) -> None:
    args = arguments().parse_args(argv)
    model = load_float(args.input)
    kind = Kind.of(model.inputs, args.content, args.main)
    assert kind.content in CONTENTS
    options = options_of(args, kind, model.net)
    if args.calib:
        frames = [frame_of(read_picture(path, kind), kind) for path in args.calib]
        names = [f"{p.parent.name}/{p.stem}" for p in args.calib]
    else:
        frames = synthetic_frames(kind)
        names = [f"synthetic {i + 1}" for i in range(len(frames))]
    samples = test_samples(args.test, kind)
    quantizer = Quantizer(model, network_inputs(frames), options)
    integer = quantizer.run()
    write_integer(args.output, integer_tensors(integer))
    if args.report or args.test:
        print("\n".join(layer_table(quantizer)), end="\n\n")
        pictures = samples or [Sample(n, f) for n, f in zip(names, frames, strict=True)]
        print("\n".join(sample_table(compare(model, integer, s) for s in pictures)))
    print(f"Saved: {args.output}")


if __name__ == "__main__":
    errors.run(main)
