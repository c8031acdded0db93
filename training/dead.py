"""Channels that are dead: their ReLU lets nothing through, so that no gradient reaches them.

A fresh network has some. A learning rate that is too high kills many at once; and steps that are as
long however small the gradient is, as Adam's and Muon's are, kill whole layers slowly, first the
coarsest. By themselves they never come back, while the loss goes on falling with what is left of
the network; `revive` lets them begin anew. (Channels before a layer that is dead as a whole count,
too.)
"""
from __future__ import annotations

import math
import sys

import torch
from torch import Tensor, nn

from training.nets import users

STEPS = 50           # at least so many make a judgement
REVIVED_UNTIL = 0.7  # share of a training after which channels stay as they are
FAINT = 0.1          # weights of what a revived channel feeds, relative to those of a fresh layer


class Channels:
    """Watches the layers with ReLU of a model of nets.py, but for frozen ones."""

    def __init__(self, model: nn.Module):
        net = model.net
        layers = net.layers if net.family == "K" else net.layers[:-1]
        biases = {layer.name: getattr(model, layer.name).bias for layer in layers}
        self.biases = {name: b for name, b in biases.items() if b.requires_grad}
        self.alive, self.steps = None, 0

    def watch(self) -> None:
        """To be called after each step, while the gradients are there."""
        if not self.biases:
            return
        alive = torch.cat([bias.grad for bias in self.biases.values()]) != 0
        self.alive = alive if self.alive is None else self.alive | alive
        self.steps += 1

    def state(self) -> tuple[Tensor | None, int]:
        """What was seen since the last judgement, for `load`."""
        return self.alive, self.steps

    def load(self, state: tuple[Tensor | None, int]) -> None:
        self.alive, self.steps = state

    def dead(self) -> dict[str, Tensor] | None:
        """By layer, which channels had no gradient since the last judgement; None: too early."""
        if self.steps < STEPS:
            return None
        parts = self.alive.split([len(bias) for bias in self.biases.values()])
        self.alive, self.steps = None, 0
        return {name: ~part for name, part in zip(self.biases, parts)}


def report(dead: dict[str, Tensor], board, epoch: int, aloud: bool) -> None:
    """Writes a judgement to the board, and a warning to stderr if that is wanted and some are."""
    counts = {name: int(channels.sum()) for name, channels in dead.items()}
    board.scalars(epoch, dead_channels=sum(counts.values()),
                  **{f"dead_channels/{name}": n for name, n in counts.items() if n})
    if aloud and any(counts.values()):
        channels = sum(map(len, dead.values()))
        text = ", ".join(f"{n} of {len(dead[name])} in {name}"
                         for name, n in counts.items() if n)
        print(f"Warning: {sum(counts.values())} of {channels} channels are dead, without a "
              f"gradient since the last look: {text}; if they become more, start again with a "
              "lower --max_lr", file=sys.stderr)


@torch.no_grad()
def revive(model: nn.Module, dead: dict[str, Tensor], seed: int) -> None:
    """Gives dead channels fresh weights, and faint ones to what they feed."""
    random = torch.Generator().manual_seed(seed)

    def fresh(like: Tensor, size: float) -> Tensor:
        return (torch.randn(like.shape, generator=random) * size).to(like)

    for layer in model.net.layers:
        if layer.name not in dead or not dead[layer.name].any():
            continue
        which, conv = dead[layer.name].nonzero().flatten(), getattr(model, layer.name)
        conv.weight[which] = fresh(conv.weight[which], math.sqrt(2 / conv.weight[0].numel()))
        conv.bias[which] = 0.0
        for name, is_second in users(model, layer.name):
            user = getattr(model, name)
            if not user.weight.requires_grad:  # frozen
                continue
            first = user.in_channels - conv.out_channels if is_second else 0
            size = FAINT / math.sqrt(user.weight[0].numel())
            user.weight[:, first + which] = fresh(user.weight[:, first + which], size)
