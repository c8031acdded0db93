"""A network begun with the weights of a wider or narrower one of the same topology."""
from __future__ import annotations

import torch
from torch import Tensor, nn

from training.nets import convolutions, users


def fitted(model: nn.Module,
           tensors: dict[str, Tensor]) -> tuple[dict[str, Tensor], list[str], list[str]]:
    """Weights of a network of the same topology in the widths of `model`, and what was cut and
    added, as text. Of channels beyond those of a layer the ones that weigh most stay: the norm of
    the weights that make one times the sum of the norms of those that use it. Channels that are
    missing get the model's own weights, as long as the others' in the mean, and nothing uses them
    yet: the result computes what it did. Where layers are missing all stay as they are.

    tensors: `<layer>.weight` [O,I,k,k] and `<layer>.bias` [O].
    """
    convs, out, cut, added = convolutions(model), dict(tensors), [], []
    if any(f"{c.name}.weight" not in out for c in convs):
        return out, cut, added
    for conv in convs:
        module, (weight, bias) = getattr(model, conv.name), (f"{conv.name}.weight",
                                                             f"{conv.name}.bias")
        have, want = len(out[bias]), module.out_channels
        readers = [(f"{name}.weight", out[f"{name}.weight"].shape[1] - have if is_second else 0)
                   for name, is_second in users(model, conv.name)]
        if have == want or not readers:
            continue
        if have > want:
            weighs = norms(out[weight]) * sum(
                norms(out[name][:, first:first + have].transpose(0, 1)) for name, first in readers)
            kept = weighs.argsort(descending=True)[:want].sort().values
            out[weight], out[bias] = out[weight][kept], out[bias][kept]
            cut.append(f"{conv.name} {have} to {want}")
        else:
            kept = torch.arange(want)  # those from `have` on are zeros in what uses them
            fresh = module.weight.detach()[have:].to(out[weight])
            if fresh.shape[1:] != out[weight].shape[1:]:  # another topology; refused elsewhere
                return dict(tensors), [], []
            fresh = fresh * (norms(out[weight]).mean() / norms(fresh).mean())
            out[weight] = torch.cat((out[weight], fresh))
            out[bias] = torch.cat((out[bias], out[bias].new_zeros(want - have)))
            added.append(f"{conv.name} {have} to {want}")
        for name, first in readers:
            before, used, after = out[name].tensor_split((first, first + have), 1)
            more = used.new_zeros(len(used), max(0, want - have), *used.shape[2:])
            out[name] = torch.cat((before, torch.cat((used, more), 1)[:, kept], after), 1)
    return out, cut, added


def norms(weights: Tensor) -> Tensor:
    """Of each first index."""
    return weights.flatten(1).norm(dim=1)
