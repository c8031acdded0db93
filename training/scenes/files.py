"""Half-float ZIP EXR files with rounded mantissas, and pictures for contact sheets."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from training.errors import OUTPUT, ToolError
from training.imageio import replacing

HALF_MAX = 65504.0


def round_mantissa(a: np.ndarray, bits: int) -> np.ndarray:
    """float32 -> float16 with the mantissa rounded to so many bits (10 = all): smaller files."""
    h = np.clip(a, -HALF_MAX, HALF_MAX).astype(np.float16)
    if bits >= 10:
        return h
    drop = 10 - bits
    u = h.view(np.uint16).astype(np.uint32)
    u = (u + (1 << (drop - 1)) - 1 + ((u >> drop) & 1)) & (0xFFFF << drop & 0xFFFF)
    out = u.astype(np.uint16).view(np.float16)
    return np.where(np.isfinite(out), out, h)


def write_exr(path: str | Path, rgb: np.ndarray, bits: int = 10) -> None:
    """rgb: (h, w, 3) as channels R, G, B; bits: of the mantissa."""
    import OpenEXR
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    pixels = np.ascontiguousarray(round_mantissa(rgb, bits))
    with replacing(Path(path)) as tmp, OpenEXR.File(header, {"RGB": pixels}) as f:
        try:
            f.write(str(tmp))
        except RuntimeError as err:
            raise ToolError(f"{path}: cannot write ({str(err).splitlines()[0]})", OUTPUT) from err


def tonemap(rgb: np.ndarray, white: float | None = None) -> np.ndarray:
    """Linear radiance to sRGB in [0, 1]; white: radiance shown at 0.8 (97th percentile)."""
    rgb = np.nan_to_num(rgb, nan=0.0, posinf=HALF_MAX, neginf=0.0)
    if white is None:
        white = float(np.percentile(rgb.max(-1), 97))
    x = np.clip(rgb * (0.8 / max(white, 1e-6)), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
