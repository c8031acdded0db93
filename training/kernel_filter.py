"""The 5x5 kernel filter of family K as one differentiable operation.

    out[c](p) = sum over the 5x5 taps k, row by row, of exp(logits[k](p)) * v[c](p + k)

with zeros outside.

A fused C++ operation on the CPU where a compiler is found (about 12 times faster), plain PyTorch
elsewhere. Set LULL_FUSED=0 to force the latter.
"""
from __future__ import annotations

import functools
import os
import shutil
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
        return load("lull_kernel_filter", [str(SOURCE)], verbose=False,
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
