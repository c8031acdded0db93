"""Half-float ZIP EXR files and PNG pictures, written to a temporary name and renamed."""

from __future__ import annotations

import os
import struct
import zlib

import numpy as np

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


def _replace(path: str, write) -> None:
    temporary = f"{path}.tmp{os.getpid()}"
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        if os.path.exists(temporary):
            os.remove(temporary)


def write_exr(path: str, rgb: np.ndarray, bits: int = 10) -> None:
    """rgb: (h, w, 3) as channels R, G, B."""
    import OpenEXR
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    pixels = np.ascontiguousarray(round_mantissa(rgb, bits))

    def write(name: str) -> None:
        with OpenEXR.File(header, {"RGB": pixels}) as f:
            f.write(name)

    _replace(path, write)


def read_exr(path: str) -> np.ndarray:
    """R, G, B (or the one channel three times) of an EXR file as float32 (h, w, 3)."""
    import OpenEXR
    with OpenEXR.File(path, separate_channels=True) as f:
        c = f.channels()
        names = ["R", "G", "B"] if "R" in c else [sorted(c)[0]] * 3
        return np.stack([np.asarray(c[n].pixels, np.float32) for n in names], -1)


def write_png(path: str, rgb: np.ndarray) -> None:
    """rgb: uint8 (h, w, 3)."""
    h, w, _ = rgb.shape
    rows = np.concatenate([np.zeros((h, 1), np.uint8), rgb.reshape(h, w * 3)], 1).tobytes()

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    data = (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", w, h, 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(rows, 6)) + chunk(b"IEND", b""))

    def write(name: str) -> None:
        with open(name, "wb") as f:
            f.write(data)

    _replace(path, write)


def tonemap(rgb: np.ndarray, white: float | None = None) -> np.ndarray:
    """Linear radiance to 8-bit sRGB; white: radiance shown at 0.8 (default: 97th percentile)."""
    rgb = np.nan_to_num(rgb, nan=0.0, posinf=HALF_MAX, neginf=0.0)
    if white is None:
        white = float(np.percentile(rgb.max(-1), 97))
    x = np.clip(rgb * (0.8 / max(white, 1e-6)), 0, 1)
    s = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return (s * 255 + 0.5).astype(np.uint8)
