"""Fused operations on single pixels: what PyTorch does in a dozen passes over memory."""
from __future__ import annotations

import torch
from torch import Tensor

from training import color, fused


class PuForward(torch.autograd.Function):
    """Codes of radiance, which is clamped to [low, high] first."""

    @staticmethod
    def forward(ctx, y: Tensor, low: float, high: float) -> Tensor:
        ctx.save_for_backward(y)
        ctx.bounds = color.PU_MAX, low, high
        return fused.module().pu_forward(y, *ctx.bounds)

    @staticmethod
    def backward(ctx, g: Tensor):
        return fused.module().pu_backward(*ctx.saved_tensors, g, *ctx.bounds), None, None


class L1Grad(torch.autograd.Function):
    """Half the mean of |a - b|, half that of the differences between neighbours in a - b."""

    @staticmethod
    def forward(ctx, a: Tensor, b: Tensor) -> Tensor:
        loss, derivative = fused.module().l1_grad(a.contiguous(), b.contiguous())
        ctx.save_for_backward(derivative)
        return loss

    @staticmethod
    def backward(ctx, g: Tensor):
        return ctx.saved_tensors[0] * g, None


def from_codes(transfer: str, codes: Tensor) -> Tensor:
    """The radiance of codes in [0,1]."""
    codes = codes.clamp(0, 1)
    if transfer == "pu" and fused.usable(codes):
        return fused.module().pu_inverse(codes, color.PU_MAX)
    return color.TRANSFERS[transfer].inverse(codes)


def to_codes(transfer: str, radiance: Tensor, low: float, high: float) -> Tensor:
    if transfer == "pu" and fused.usable(radiance, gradients=True):
        return PuForward.apply(radiance, low, high)
    return color.TRANSFERS[transfer].forward(radiance.clamp(low, high))
