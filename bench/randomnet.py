"""Weights without training, for comparisons of arithmetic and of speed.

Random weights give blown-up or dead outputs unless each layer is scaled: here every layer's outputs
get unit variance on a real picture, and the last layer a mean and spread inside the transfer
function's useful range. The result is no denoiser, but every weight, layer and pixel counts.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import nn

from export.tza import write_weights
from training import nets


# Mean and deviation of the last layer, per transfer function: wide enough that errors show.
OUTPUTS = {"pu": (0.3, 0.05), "log": (0.1, 0.03), "srgb": (0.5, 0.2), "linear": (0.5, 0.2)}


@torch.no_grad()
def random_model(model: str, codes: torch.Tensor, transfer: str) -> nn.Module:
    """A model of configs/models.json. `codes`: network input of a picture, [1,C,H,W]."""
    torch.manual_seed(1)
    net = nets.build(model, codes.shape[1])
    codes = nets.pad_to(codes)
    last = net.net.layers[-1].name
    for layer in net.net.layers:
        conv = getattr(net, layer.name)
        nn.init.normal_(conv.weight)
        nn.init.zeros_(conv.bias)
        seen = {}
        hook = conv.register_forward_hook(
            lambda module, inputs, output, seen=seen: seen.update(y=output.clone()))
        net(codes)
        hook.remove()
        deviation, mean = seen["y"].std(), seen["y"].mean()
        middle, spread = OUTPUTS[transfer] if layer.name == last else (0.3, 1.0)
        conv.weight.mul_(spread / deviation)
        conv.bias.fill_(middle - mean * spread / deviation)
    return net


def write_random(path: Path, model: str, codes: torch.Tensor, transfer: str = "pu") -> Path:
    """Writes such weights as fp16 TZA."""
    net = random_model(model, codes, transfer)
    write_weights(path, {name: value.numpy() for name, value in net.state_dict().items()})
    return path
