"""Leaves out what a network does not use: channels that are 0 everywhere in all of some pictures.

A training ends with some. They cost time and bytes; the result is the same without them.

    python -m export.prune IN.tza OUT.tza --data DIR --share 0.03

does it to an integer model of family K, of whose other channels no weight changes. With a share,
channels that are above 0 in few pixels go, too: what training makes of the coarsest levels, where
pixels are few, is partly learnt by heart, and the results without are as good.
"""
from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from export.graph import Net
from export.kernel import IntTrunk, check_trunk, load
from export.reference import FloatModel, IntModel, unsafe_pairs
from training import errors
from training.features import add_layers, parse_layers


def active_channels(model: FloatModel | IntModel, inputs: Iterable[np.ndarray],
                    least: float = 0.0) -> dict[str, np.ndarray]:
    """By layer, which of its channels are above 0 in more than a share `least` of the pixels, in
    the mean over the pictures. inputs: as of `model.maps`."""
    shares: dict[str, np.ndarray] = {}
    count = 0
    for x in inputs:
        for name, values in model.maps(x).items():
            shares[name] = shares.get(name, 0.0) + (values > 0).mean((0, 1))
        count += 1
    return {name: total / count > least for name, total in shares.items()}


def kept_channels(active: np.ndarray) -> np.ndarray:
    """Numbers of the channels to keep: the active ones and so many more that vectors stay full,
    multiples of 16 or 8 if the width was one."""
    width = len(active)
    step = next(n for n in (16, 8, 1) if width % n == 0)
    count = max(-(-int(active.sum()) // step) * step, step)
    return np.sort(np.argsort(~active, kind="stable")[:count])


def without_silent(net: Net, tensors: Mapping[str, np.ndarray], active: Mapping[str, np.ndarray],
                   fixed: Iterable[str]) -> dict[str, np.ndarray]:
    """Tensors of the same network with the channels of `kept_channels`.

    tensors: `<layer>.weight` [O,I,k,k] and `<layer>.bias` [O]; fixed: layers that keep all.
    """
    kept = {"input": np.arange(len(active["input"]))}
    out = {}
    for layer in net.layers:
        weight, bias = tensors[f"{layer.name}.weight"], tensors[f"{layer.name}.bias"]
        inputs = kept[layer.source]
        if layer.skip:
            inputs = np.concatenate((inputs, len(active[layer.source]) + kept[layer.skip]))
        kept[layer.name] = np.arange(len(bias)) if layer.name in fixed else kept_channels(
            active[layer.name])
        out[f"{layer.name}.weight"] = weight[kept[layer.name]][:, inputs]
        out[f"{layer.name}.bias"] = bias[kept[layer.name]]
    return out


# ---- Integer models ------------------------------------------------------------------------------

def column_users(model: IntModel) -> dict[str, list[tuple[str, str]]]:
    """By layer, the (layer, "weight" or "skip") whose columns are its channels."""
    users: dict[str, list[tuple[str, str]]] = {}
    for x in model.layers:
        users.setdefault(x.layer.source, []).append((x.layer.name, "weight"))
        if x.skip is not None:
            users.setdefault(x.layer.skip, []).append((x.layer.name, "skip"))
    return users


def paired(kept: np.ndarray, width: int, weights: list[np.ndarray]) -> np.ndarray:
    """Kept channels of `width` in an order in which those that read them, int8 [R,C,k,k], stay
    pair-safe: pairs of before stay together, others are sought among what is left. One that finds
    none gets its partner of before back, silent as it may be."""
    there = set(kept.tolist())
    order = [c for c in sorted(there) if c ^ 1 in there]
    single = [c for c in sorted(there) if c ^ 1 not in there]

    def safe(a: int, b: int) -> bool:
        return not any(unsafe_pairs(w[:, [a, b]]) for w in weights)

    while single:
        a = single.pop(0)
        b = next((b for b in single if safe(a, b)), None)
        if b is not None:
            single.remove(b)
        elif a ^ 1 < width:
            b = a ^ 1
        order += [a] if b is None else [a, b]
    return np.array(order)


def without_silent_codes(model: IntTrunk, active: Mapping[str, np.ndarray]) -> IntTrunk:
    """The same integer model of family K without the channels that are not `active`, but for those
    that keep vectors full and pairs safe. Where they are 0, the result is the same to the bit."""
    layers = {x.layer.name: x for x in model.layers}
    users = column_users(model)
    for name in [x.layer.name for x in model.layers if x.layer.name not in model.net.heads]:
        readers = users[name]
        columns = [getattr(layers[reader], part) for reader, part in readers]
        order = paired(kept_channels(active[name]), len(active[name]), columns)
        if len(order) >= len(active[name]) or any(unsafe_pairs(w[:, order]) for w in columns):
            continue  # with odd widths, pairs reach into the next column of a kernel
        x = layers[name]
        phases = 4 if x.layer.up else 1
        rows = np.concatenate([phase * x.outputs + order for phase in range(phases)])
        layers[name] = replace(x, weight=x.weight[rows], bias=x.bias[order], scale=x.scale[order],
                               skip=None if x.skip is None else x.skip[order])
        for (reader, part), weight in zip(readers, columns):
            layers[reader] = replace(layers[reader], **{part: weight[:, order]})
    return IntTrunk(model.net, list(layers.values()), model.bilateral)


def main(argv: list[str]) -> None:
    from export.quantize_kernel import (calibration_set, check_colour, tensors_of,
                                        write_tensors)
    parser = errors.Parser("python -m export.prune", description="Leaves out of an integer model "
                           "of family K the channels that are 0 in pictures of a data set.")
    parser.add_argument("input", type=Path, metavar="IN.tza")
    parser.add_argument("output", type=Path, metavar="OUT.tza")
    parser.add_argument("--data", type=Path, required=True, help="pictures with hdr, alb and nrm")
    parser.add_argument("--count", type=int, default=100, help="how many of its groups (100)")
    parser.add_argument("--share", type=float, default=0.0, help="of pixels in which a channel may "
                        "be above 0 and yet go (0)")
    add_layers(parser)
    args = parser.parse_args(argv)
    if args.count < 1:
        raise errors.ToolError(f"--count {args.count}: not positive", errors.USAGE)
    if not 0 <= args.share < 1:
        raise errors.ToolError(f"--share {args.share:g}: not from 0 to below 1", errors.USAGE)
    with errors.reading(args.input):
        model = load(args.input)
        check_colour(model.bilateral, str(args.input))
        inputs = calibration_set(args.data, args.count, False, parse_layers(args.layers))
        less = without_silent_codes(model, active_channels(
            model, map(model.codes, inputs), args.share))
        check_trunk(less, str(args.output))
        write_tensors(args.output, tensors_of(less))
    for a, b in zip(model.layers, less.layers):
        if a.outputs != b.outputs:
            print(f"{a.layer.name}: {b.outputs} of {a.outputs} channels")
    print(f"Saved: {args.output}")


if __name__ == "__main__":
    errors.run(main)
