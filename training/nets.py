"""Networks: torch modules built from lib/nets.def, the only description of topologies.

A model is a topology of nets.def plus channel widths (configs/models.json): one width per layer,
in family U except the last, whose width is the number of output channels. Tensors are named as in a
weights file, `<layer>.weight` and `<layer>.bias`, so a state dict is the content of a TZA.
"""
from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from export.graph import ALIGN, Net, read_heads, read_nets
from export.kernel import BILATERAL
from training.kernel_model import KernelModel

ROOT = Path(__file__).resolve().parent.parent
MODELS_JSON = Path(__file__).resolve().parent / "configs" / "models.json"


def identify(names: list[str]) -> Net:
    """The topology of a weights file that holds the tensors `names`."""
    for net in read_nets():
        if f"{net.key}.weight" in names:
            return net
    raise ValueError("the tensors belong to no known network")


class DirectNet(nn.Module):
    """Family U: predicts the pixel in transfer space. [N,Cin,H,W] -> [N,Cout,H,W], H, W % 16 == 0.

    The output layer has no ReLU here (training wants its gradient); whoever runs the network clamps
    its output at 0.
    """

    def __init__(self, net: Net, inputs: int, widths: list[int]):
        super().__init__()
        self.net, self.inputs, self.outputs = net, inputs, widths[-1]
        for layer, (cin, cout) in zip(net.layers, net.channels(inputs, widths), strict=True):
            self.add_module(layer.name, nn.Conv2d(cin, cout, 3, padding=1))

    def forward(self, x: Tensor) -> Tensor:
        values = {"input": x}
        last = self.net.layers[-1].name
        for layer in self.net.layers:
            y = values[layer.source]
            if layer.up:
                y = F.interpolate(y, scale_factor=2, mode="nearest")
            if layer.skip:
                y = torch.cat((y, values[layer.skip]), 1)
            y = getattr(self, layer.name)(y)
            if layer.name != last:
                y = F.relu_(y)
            if layer.pool:
                y = F.max_pool2d(y, 2)
            values[layer.name] = y
        return y

    def macs_per_pixel(self) -> float:
        """Multiply-adds per full-resolution pixel of one run."""
        return sum(area * getattr(self, layer.name).weight.numel()
                   for layer, area in zip(self.net.layers, self.net.areas(), strict=True))


def model_table() -> dict[str, dict]:
    """configs/models.json: model name -> {"net": topology, "widths": [...]}."""
    return json.loads(MODELS_JSON.read_text())


def find_model(model: str) -> tuple[Net, list[int]]:
    """Topology and widths of a model by name, or of `<topology>:width,width,...`."""
    if ":" in model:
        name, text = model.split(":", 1)
        try:
            spec = {"net": name, "widths": [int(w) for w in text.split(",")]}
        except ValueError:
            raise ValueError(f"model '{model}': widths are whole numbers") from None
    else:
        table = model_table()
        if model not in table:
            raise ValueError(f"unknown model '{model}' (known: {', '.join(table)})")
        spec = table[model]
    nets = {net.name: net for net in read_nets()}
    if spec["net"] not in nets:
        raise ValueError(f"unknown topology '{spec['net']}' (known: {', '.join(nets)})")
    net = nets[spec["net"]]
    count = len(net.layers) - (net.family == "U")
    if len(spec["widths"]) != count or min(spec["widths"]) < 1:
        raise ValueError(f"model '{model}' needs {count} widths")
    return net, spec["widths"]


def build(model: str, inputs: int, outputs: int = 3) -> nn.Module:
    """A fresh model; `inputs` and `outputs` are those of family U, family K has its own."""
    net, widths = find_model(model)
    return _module(net, inputs, widths if net.family == "K" else [*widths, outputs])


def _module(net: Net, inputs: int, widths: list[int]) -> nn.Module:
    if net.family == "K":
        return KernelModel(net, read_heads(net.name), widths)
    return DirectNet(net, inputs, widths)


def from_tensors(tensors: dict) -> nn.Module:
    """The module of a weights file's tensors (arrays by name); channel widths are their shapes."""
    net = identify(list(tensors))
    widths = [int(tensors[f"{layer.name}.bias"].shape[0]) for layer in net.layers]
    model = _module(net, int(tensors[f"{net.layers[0].name}.weight"].shape[1]), widths)
    wanted = model.state_dict()
    model.load_state_dict({k: _tensor(tensors[k]) for k in wanted})
    if BILATERAL in tensors:
        model.bilateral = int(tensors[BILATERAL][0])
    return model


def convolutions(model: nn.Module) -> list:
    """Layers, then heads, in order of execution; each has name and source, layers a skip."""
    return [*model.net.layers, *getattr(model, "heads", [])]


def users(model: nn.Module, name: str) -> list[tuple[str, bool]]:
    """The convolutions that read a layer, and whether it is their second source (its channels are
    then their last ones)."""
    return [(conv.name, bool(is_second)) for conv in convolutions(model)
            for is_second, source in enumerate((conv.source, getattr(conv, "skip", None)))
            if source == name]


def _tensor(value) -> Tensor:
    """fp32 copy of a tensor or of an array (which may be a read-only map of a file)."""
    return value.float() if isinstance(value, Tensor) else torch.from_numpy(np.array(value)).float()


def pad_to(x: Tensor, align: int = ALIGN) -> Tensor:
    """[N,C,H,W] zero padded at the bottom and right to multiples of `align`."""
    h, w = x.shape[-2:]
    return F.pad(x, (0, -w % align, 0, -h % align))
