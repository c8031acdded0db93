"""The slow operations of family K, differentiable: the 5x5 kernel filter

    out[c](p) = sum over the 5x5 taps k, row by row, of exp(logits[k](p)) * v[c](p + k)

with zeros outside, and the split of a head's channels into planar tensors of whole codes.

Fused C++ operations on the CPU where a compiler is found (about 12 times faster), plain PyTorch
elsewhere. Set LULL_FUSED=0 to force the latter.
"""
from __future__ import annotations

import functools
import os
import shutil
import zlib
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

SIDE, RADIUS, TAPS = 5, 2, 25
SOURCE = Path(__file__).resolve().parent / "csrc" / "kernel_filter.cpp"


@functools.cache
def fused_module():
    """The compiled operation, or None where it cannot be built."""
    if os.environ.get("LULL_FUSED") == "0" or not (shutil.which("c++") or shutil.which("g++")):
        return None
    from torch.utils.cpp_extension import load
    try:
        # PyTorch caches modules by name: checkouts with different sources must not share one.
        name = f"lull_kernel_filter_{zlib.crc32(SOURCE.read_bytes()):08x}"
        return load(name, [str(SOURCE)], verbose=False,
                    extra_cflags=["-O3", "-march=native", "-ffast-math", "-fopenmp"])
    except (RuntimeError, OSError, ImportError) as e:
        print(f"the fused kernel filter could not be built, PyTorch's operations serve: {e}")
        return None


class _Fused(torch.autograd.Function):
    @staticmethod
    def forward(ctx, logits: Tensor, v: Tensor) -> Tensor:
        logits, v = logits.contiguous(), v.contiguous()
        ctx.save_for_backward(logits, v)
        return fused_module().forward(logits, v)

    @staticmethod
    def backward(ctx, g: Tensor):
        logits, v = ctx.saved_tensors
        return tuple(fused_module().backward(logits, v, g))


class _Split(torch.autograd.Function):
    @staticmethod
    def forward(ctx, q: Tensor, counts: list[int], step: float):
        q = q.contiguous(memory_format=torch.channels_last)
        ctx.save_for_backward(q)
        ctx.step = step
        return tuple(fused_module().split(q, counts, step))

    @staticmethod
    def backward(ctx, *grads: Tensor):
        return fused_module().join(*ctx.saved_tensors, list(grads), ctx.step), None, None


class Round(torch.autograd.Function):
    """Rounds to whole numbers, halves up; the gradient passes."""

    @staticmethod
    def forward(ctx, x: Tensor) -> Tensor:
        return torch.floor(x + 0.5)

    @staticmethod
    def backward(ctx, g: Tensor) -> Tensor:
        return g


def split_codes(q: Tensor, counts: list[int], step: float) -> tuple[Tensor, ...]:
    """q [N,C,H,W] as whole codes of 0..255 over `step`, in parts of counts[i] channels, in fp32.

    The gradient is zero where a code was clamped.
    """
    if q.device.type == "cpu" and fused_module() is not None:
        return _Split.apply(q, counts, step)
    codes = Round.apply((q.float() * step).clamp(0.0, 255.0)) / step
    return torch.split(codes, counts, 1)


def plain(logits: Tensor, v: Tensor) -> Tensor:
    """The same with PyTorch's operations, on any device."""
    e = logits.exp()
    padded = F.pad(v, (RADIUS,) * 4)
    h, w = v.shape[-2:]
    out = torch.zeros_like(v)
    for k in range(TAPS):
        dy, dx = divmod(k, SIDE)
        out = out + e[:, k:k + 1] * padded[:, :, dy:dy + h, dx:dx + w]
    return out


def kernel_filter(logits: Tensor, v: Tensor) -> Tensor:
    """logits [N,25,H,W] (at most about 60), v [N,C,H,W] -> [N,C,H,W]."""
    if logits.device.type == "cpu" and fused_module() is not None:
        return _Fused.apply(logits, v)
    return plain(logits, v)
