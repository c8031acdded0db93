"""The fused operations of csrc/, compiled on first use where a C++ compiler is found.

Set LULL_FUSED=0 to do without: then, and on other devices than the CPU, plain PyTorch serves.
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

try:
    import fcntl
except ImportError:  # not there on Windows
    fcntl = None

MODULE = "lull_fused"
FLAGS = ["-O3", "-march=native", "-ffast-math", "-fno-finite-math-only", "-fopenmp"]
SOURCES = Path(__file__).resolve().parent / "csrc"


@functools.cache
def module():
    """The compiled operations, or None where they cannot be built."""
    if os.environ.get("LULL_FUSED") == "0" or not (shutil.which("c++") or shutil.which("g++")):
        return None
    try:
        return _load(_cache_folder())
    except (RuntimeError, OSError, ImportError) as e:
        print(f"the fused operations could not be built, PyTorch's operations serve: "
              f"{str(e).splitlines()[0]}")
        return None


def usable(*tensors: torch.Tensor, gradients: bool = False) -> bool:
    """Whether operations that have gradients of their inputs, or none, serve for these."""
    return (all(t.device.type == "cpu" and (gradients or not t.requires_grad) for t in tensors)
            and module() is not None)


def _cache_folder() -> Path:
    """One for all checkouts with this source, by what the result depends on."""
    cpu = re.search("flags.*", Path("/proc/cpuinfo").read_text()) if sys.platform == "linux" else ""
    text = f"{torch.__version__} {sys.version} {platform.machine()} {cpu and cpu[0]} {FLAGS}"
    source = b"".join(path.read_bytes() for path in sorted(SOURCES.iterdir()))
    key = zlib.crc32(source + text.encode())
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "lull" / f"fused_{key:08x}"


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
                module = load(MODULE, [str(SOURCES / "fused.cpp")], extra_cflags=FLAGS,
                              build_directory=tmp, verbose=False)
                os.replace(Path(tmp) / library.name, library)
            return module
    spec = importlib.util.spec_from_file_location(MODULE, library)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
