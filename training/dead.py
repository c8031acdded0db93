"""Channels that are dead: their ReLU lets nothing through, so that no gradient reaches them.

A fresh network has some. A learning rate that is too high kills many at once, and they never come
back, while the loss goes on falling with what is left of the network. (Channels before a layer that
is dead as a whole count, too.)
"""
from __future__ import annotations

import sys

import torch
from torch import nn

STEPS = 50  # at least so many make a judgement


class Channels:
    """Watches the layers with ReLU of a model of nets.py."""

    def __init__(self, model: nn.Module):
        net = model.net
        layers = net.layers if net.family == "K" else net.layers[:-1]
        self.biases = {layer.name: getattr(model, layer.name).bias for layer in layers}
        self.alive, self.steps = None, 0

    def watch(self) -> None:
        """To be called after each step, while the gradients are there."""
        alive = torch.cat([bias.grad for bias in self.biases.values()]) != 0
        self.alive = alive if self.alive is None else self.alive | alive
        self.steps += 1

    def dead(self) -> dict[str, int] | None:
        """By layer, the channels that had no gradient since the last judgement; None: too early."""
        if self.steps < STEPS:
            return None
        parts = self.alive.split([len(bias) for bias in self.biases.values()])
        self.alive, self.steps = None, 0
        return {name: int((~part).sum()) for name, part in zip(self.biases, parts)}

    def report(self, board, epoch: int) -> None:
        """Writes a judgement to the board, and a warning to stderr if there are dead channels."""
        steps, counts = self.steps, self.dead()
        if counts is None:
            return
        board.scalars(epoch, dead_channels=sum(counts.values()),
                      **{f"dead_channels/{name}": n for name, n in counts.items() if n})
        if any(counts.values()):
            channels = sum(map(len, self.biases.values()))
            text = ", ".join(f"{n} of {len(self.biases[name])} in {name}"
                             for name, n in counts.items() if n)
            print(f"Warning: {sum(counts.values())} of {channels} channels are dead, without a "
                  f"gradient in {steps} steps: {text}; if they become more, start again with a "
                  "lower --max_lr", file=sys.stderr)
