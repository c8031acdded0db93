"""The slow operations of family K, differentiable: the 5x5 kernel filter

    out[c](p) = sum over the 5x5 taps k, row by row, of exp(logits[k](p)) * v[c](p + k)

with zeros outside, and the split of a head's channels into planar tensors of whole codes.

Fused C++ operations on the CPU where a compiler is found (about 12 times faster), plain PyTorch
elsewhere. Set LULL_FUSED=0 to force the latter.
"""
from __future__ import annotations

import functools
import importlib.util
import os
import platform
import re
import shutil
import sys
import tempfile
import zlib
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

try:
    import fcntl
except ImportError:  # not there on Windows
    fcntl = None

SIDE, RADIUS, TAPS = 5, 2, 25
MODULE = "lull_kernel_filter"
FLAGS = ["-O3", "-march=native", "-ffast-math", "-fopenmp"]
SOURCE = Path(__file__).resolve().parent / "csrc" / "kernel_filter.cpp"


@functools.cache
def fused_module():
    """The compiled operation, or None where it cannot be built."""
    if os.environ.get("LULL_FUSED") == "0" or not (shutil.which("c++") or shutil.which("g++")):
        return None
    try:
        return _load(_cache_folder())
    except (RuntimeError, OSError, ImportError) as e:
        print(f"the fused kernel filter could not be built, PyTorch's operations serve: {e}")
        return None


def _cache_folder() -> Path:
    """One for all checkouts with this source, by what the result depends on."""
    cpu = re.search("flags.*", Path("/proc/cpuinfo").read_text()) if sys.platform == "linux" else ""
    text = f"{torch.__version__} {sys.version} {platform.machine()} {cpu and cpu[0]} {FLAGS}"
    key = zlib.crc32(SOURCE.read_bytes() + text.encode())
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "lull" / f"kernel_filter_{key:08x}"


def _load(folder: Path):
    """The module of a cache folder, compiled first if there is none. One process does it while
    others wait; a lock of PyTorch's own would stay behind if that process were killed."""
    library = folder / f"{MODULE}.so"
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "lock", "wb") as lock:
        if fcntl:
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not library.exists():
            from torch.utils.cpp_extension import load
            with tempfile.TemporaryDirectory(dir=folder) as tmp:
                module = load(MODULE, [str(SOURCE)], verbose=False, extra_cflags=FLAGS,
                              build_directory=tmp)
                os.replace(Path(tmp) / library.name, library)
            return module
    spec = importlib.util.spec_from_file_location(MODULE, library)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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
