"""Leaves out what a network does not use: channels that are 0 everywhere in all of some pictures.

A training ends with some. They cost time and bytes; the result is the same without them.
"""
from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from export.graph import Net
from export.reference import FloatModel


def active_channels(model: FloatModel, inputs: Iterable[np.ndarray]) -> dict[str, np.ndarray]:
    """By layer, which of its channels are above 0 anywhere. inputs: as of `FloatModel.maps`."""
    active: dict[str, np.ndarray] = {}
    for x in inputs:
        for name, values in model.maps(x).items():
            active[name] = active.get(name, False) | (values > 0).any((0, 1))
    return active


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
