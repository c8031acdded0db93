"""Start Mitsuba: variant, LLVM library, thread count. Call load() before any other use of it."""

from __future__ import annotations

import ctypes
import glob
import os
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from training.errors import DEPENDENCY, USAGE, ToolError

VARIANTS = ("llvm_ad_rgb", "cuda_ad_rgb", "scalar_rgb")
_LLVM_PLACES = (
    "/usr/lib/*/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib64/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
    "/opt/homebrew/opt/llvm/lib/libLLVM*.dylib",
)
OLDEST_LLVM = 17  # older ones end the process at `fmaximum`, which Dr.Jit uses on x86


def _llvm_rank(path: str) -> tuple[int, int]:
    """Sort key: highest major version first, the full file name before its aliases."""
    digits = [int(x) for x in "".join(c if c.isdigit() else " " for c in
                                      os.path.basename(path)).split()]
    major = max([d for d in digits if d < 100], default=0)
    return (-major, len(path))


def find_llvm() -> str | None:
    """Path of the newest LLVM shared library, or None; raises ToolError if all are too old."""
    found = [p for place in _LLVM_PLACES for p in glob.glob(place) if os.path.isfile(p)]
    found = [p for p in found if _llvm_rank(p)[0]]  # of a known version
    if not found:
        return None
    newest = min(found, key=_llvm_rank)
    if -_llvm_rank(newest)[0] < OLDEST_LLVM:
        raise ToolError(f"{newest}: too old, Mitsuba needs LLVM {OLDEST_LLVM} or newer (Debian: "
                        "libllvm19; DRJIT_LIBLLVM_PATH names a library)", DEPENDENCY)
    return newest


@contextmanager
def reading() -> Iterator[None]:
    """For what reads image files: with a single thread Mitsuba 3.9 waits for ever for the pool that
    decodes EXR, so that it has two until the block ends."""
    import drjit as dr
    count = dr.thread_count()
    dr.set_thread_count(max(count, 2))
    try:
        yield
    finally:
        dr.set_thread_count(count)


def load(variant: str = "llvm_ad_rgb", threads: int = 0) -> ModuleType:
    """Import Mitsuba with a variant and return its module; raises ToolError.

    threads: Dr.Jit worker threads, 0 = all cores. With 1, Bitmap.write of Mitsuba 3.9 never
    returns, so images are written by files.py, and read within reading().
    """
    if variant not in VARIANTS:
        raise ToolError(f"--variant: {variant!r} is none of {', '.join(VARIANTS)}", USAGE)
    if variant.startswith("llvm"):
        path = os.environ.get("DRJIT_LIBLLVM_PATH") or find_llvm()
        if path:  # without one Dr.Jit looks in places of its own
            try:
                ctypes.CDLL(path)
            except OSError as err:
                raise ToolError(f"--variant {variant}: DRJIT_LIBLLVM_PATH: {err}",
                                DEPENDENCY) from None
            os.environ["DRJIT_LIBLLVM_PATH"] = path
    try:
        import mitsuba as mi
    except ImportError as err:
        raise ToolError(f"Mitsuba 3 is not installed (pip install mitsuba): {err}",
                        DEPENDENCY) from None
    try:
        mi.set_variant(variant)
        if variant.startswith("llvm"):
            import drjit as dr
            if threads:
                dr.set_thread_count(threads)
            dr.eval(mi.Float([0.0]) + 1.0)
    except Exception as err:
        hint = ""
        if variant.startswith("llvm"):
            hint = " (is LLVM installed? set DRJIT_LIBLLVM_PATH to its shared library)"
        raise ToolError(f"--variant {variant} does not start: {str(err).splitlines()[0]}{hint}",
                        DEPENDENCY) from None
    mi.set_log_level(mi.LogLevel.Error)
    return mi
