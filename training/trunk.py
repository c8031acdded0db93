"""The trunk and heads of a family K net as one operation: PyTorch's convolutions, and fused passes
between them (ReLU, pooling, upsampling, concatenation, sums of gradients)."""
from __future__ import annotations

import functools
from collections import defaultdict
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from training import fused

KINDS = torch.float32, torch.float64, torch.bfloat16


@dataclass(frozen=True)
class Conv:
    """A layer, or a head if `pad` is 0; its parameters are weight, bias in this order."""

    name: str
    source: str
    skip: str | None
    up: bool
    pool: bool
    pad: int


def arithmetic(x: Tensor) -> torch.dtype:
    """The type in which convolutions of x are computed here."""
    on = torch.is_autocast_enabled(x.device.type)
    return torch.get_autocast_dtype(x.device.type) if on else x.dtype


def usable(x: Tensor) -> bool:
    return arithmetic(x) in KINDS and fused.usable(x, gradients=True)


@functools.cache
def relu_comes_along(kind: torch.dtype) -> bool:
    """Whether PyTorch has convolutions with ReLU in them here."""
    if kind == torch.float64 or not torch.backends.mkldnn.is_available():
        return False
    return kind != torch.bfloat16 or torch.ops.mkldnn._is_mkldnn_bf16_supported()


def on_tiles(kind: torch.dtype, parameters: tuple[Tensor, ...]) -> bool:
    """Whether the convolutions of csrc/amx.h serve."""
    return (kind == torch.bfloat16 and all(p.dtype == torch.float32 for p in parameters)
            and fused.module().has_tiles())


def convolve(x: Tensor, weight: Tensor, bias: Tensor, pad: int) -> Tensor:
    """With ReLU behind 3x3 kernels."""
    if not relu_comes_along(x.dtype):
        y = F.conv2d(x, weight, bias, padding=pad)
        return F.relu_(y) if pad else y
    return torch.ops.mkldnn._convolution_pointwise(
        x, weight, bias, [pad] * 2, [1, 1], [1, 1], 1, "relu" if pad else "none", [], "")


class Trunk(torch.autograd.Function):
    """(convolutions, input, their parameters) -> the heads."""

    @staticmethod
    def forward(ctx, convs: list[Conv], x: Tensor, *parameters: Tensor):
        kind, ops = arithmetic(x), fused.module()
        tiles = on_tiles(kind, parameters)
        kept = [p.detach() for p in parameters]
        kept = kept if tiles else ops.cast(kept, kind)
        values = {"input": x.to(kind).contiguous(memory_format=torch.channels_last)}
        inputs, results = [], []
        for i, conv in enumerate(convs):
            y = values[conv.source]
            if conv.skip:
                y = ops.join(y, values[conv.skip])
            elif conv.up:
                y = F.interpolate(y, scale_factor=2, mode="nearest")
            inputs.append(y)
            weight, bias = kept[2 * i:2 * i + 2]
            y = (ops.convolve(y, weight, bias, conv.pad > 0) if tiles
                 else convolve(y, weight, bias, conv.pad))
            results.append(y.contiguous(memory_format=torch.channels_last))
            values[conv.name] = ops.pool(results[-1]) if conv.pool else results[-1]
        ctx.convs, ctx.kind, ctx.tiles = convs, x.dtype, tiles
        ctx.channels = {name: value.shape[1] for name, value in values.items()}
        ctx.save_for_backward(*inputs, *results, *kept)
        return tuple(y for y, conv in zip(results, convs) if not conv.pad)

    @staticmethod
    def backward(ctx, *heads: Tensor):
        ops, n, saved = fused.module(), len(ctx.convs), ctx.saved_tensors
        heads, uses, grads = list(heads), defaultdict(list), [None] * 2 * n
        for i in reversed(range(n)):
            conv, x, y, weight = ctx.convs[i], saved[i], saved[n + i], saved[2 * n + 2 * i]
            if conv.pad:
                g = ops.relu_backward(y, conv.pool, *map(list, zip(*uses.pop(conv.name))))
            else:
                g = heads.pop().to(y.dtype).contiguous(memory_format=torch.channels_last)
            wanted = conv.source != "input" or ctx.needs_input_grad[1]
            gx, *grads[2 * i:2 * i + 2] = (
                ops.convolve_backward(g, x, weight, wanted) if ctx.tiles
                else torch.ops.aten.convolution_backward(
                    g, x, weight, [len(weight)], [1, 1], [conv.pad] * 2, [1, 1], False, [0, 0], 1,
                    [wanted, True, True]))
            if wanted:
                gx = gx.contiguous(memory_format=torch.channels_last)
                uses[conv.source].append((gx, 0))
                if conv.skip:
                    uses[conv.skip].append((gx, ctx.channels[conv.source]))
        gx = uses["input"][0][0].to(ctx.kind) if uses["input"] else None
        return None, gx, *ops.cast(grads, ctx.kind)
