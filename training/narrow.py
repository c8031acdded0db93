"""A narrower network begun with a wider one's weights: the channels that weigh most stay."""
from __future__ import annotations

import torch
from torch import Tensor, nn

from training.nets import convolutions, users


def narrowed(model: nn.Module, tensors: dict[str, Tensor]) -> tuple[dict[str, Tensor], list[str]]:
    """Weights of a wider network of the same topology, cut to the widths of `model`, and what was
    cut, as text. A channel weighs the norm of the weights that make it times the sum of the norms
    of those that use it. Layers that are no wider, or missing, stay as they are.

    tensors: `<layer>.weight` [O,I,k,k] and `<layer>.bias` [O].
    """
    convs, out, cut = convolutions(model), dict(tensors), []
    if any(f"{c.name}.weight" not in out for c in convs):
        return out, cut
    for conv in convs:
        have, want = len(out[f"{conv.name}.bias"]), getattr(model, conv.name).out_channels
        if have <= want:
            continue
        readers = [(f"{name}.weight", out[f"{name}.weight"].shape[1] - have if is_second else 0)
                   for name, is_second in users(model, conv.name)]
        weighs = out[f"{conv.name}.weight"].flatten(1).norm(dim=1) * sum(
            out[name][:, first:first + have].transpose(0, 1).flatten(1).norm(dim=1)
            for name, first in readers)
        kept = weighs.argsort(descending=True)[:want].sort().values
        for part in ("weight", "bias"):
            out[f"{conv.name}.{part}"] = out[f"{conv.name}.{part}"][kept]
        for name, first in readers:
            total = out[name].shape[1]
            out[name] = out[name][:, torch.cat((torch.arange(first), first + kept,
                                                torch.arange(first + have, total)))]
        cut.append(f"{conv.name} {have} to {want}")
    return out, cut
