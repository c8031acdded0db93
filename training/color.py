"""Colour: transfer functions, auto-exposure, tone mapping. Works on numpy arrays and torch tensors.

Constants are those of Open Image Denoise (its weights files only mean something with them): the PU
curve is the PU2 fit of Aydin 2008, normalised to 1 at the largest half float. Works without torch
on numpy arrays.
"""
from __future__ import annotations

from dataclasses import dataclass
from collections.abc import Callable

import numpy as np

HDR_MAX = 65504.0
LUMINANCE = (0.212671, 0.715160, 0.072169)
KEY, EPS, BIN = 0.18, 1e-8, 16  # auto-exposure: middle grey, darkest bin that counts, bin side

PU_A, PU_B, PU_C, PU_D = 1.41283765e03, 1.64593172, 4.31384981e-01, -2.94139609e-03
PU_E, PU_F, PU_G = 1.92653254e-01, 6.26026094e-03, 9.98620152e-01
PU_Y0, PU_Y1, PU_X0, PU_X1 = 1.57945760e-06, 3.22087631e-02, 2.23151711e-03, 3.70974749e-01
PU_MAX = PU_E * float(np.log(HDR_MAX + PU_F)) + PU_G
LOG_MAX = float(np.log(HDR_MAX + 1.0))


def _lib(x):
    """The array library of x: torch and numpy agree on the names used below."""
    if type(x).__module__.partition(".")[0] != "torch":
        return np
    import torch
    return torch


def linear(y):
    return y


def srgb_forward(y):
    m = _lib(y)
    return m.where(y <= 0.0031308, 12.92 * y, 1.055 * m.clip(y, 1e-9, None) ** (1 / 2.4) - 0.055)


def srgb_inverse(x):
    m = _lib(x)
    return m.where(x <= 0.04045, x / 12.92, ((m.clip(x, 0.0, None) + 0.055) / 1.055) ** 2.4)


def pu_forward(y):
    m = _lib(y)
    p = m.clip(y, PU_Y0, PU_Y1)
    mid = PU_B * p**PU_C + PU_D
    high = PU_E * m.log(m.clip(y, PU_Y1, None) + PU_F) + PU_G
    low = PU_A * m.clip(y, None, PU_Y0)
    return m.where(y <= PU_Y0, low, m.where(y <= PU_Y1, mid, high)) / PU_MAX


def pu_inverse(x):
    m = _lib(x)
    x = x * PU_MAX
    mid = (m.clip((x - PU_D) / PU_B, 1e-12, None)) ** (1 / PU_C)
    high = m.exp((m.clip(x, PU_X1, None) - PU_G) / PU_E) - PU_F
    return m.where(x <= PU_X0, x / PU_A, m.where(x <= PU_X1, mid, high))


def log_forward(y):
    return _lib(y).log1p(y) / LOG_MAX


def log_inverse(x):
    return _lib(x).expm1(x * LOG_MAX)


@dataclass(frozen=True)
class Transfer:
    """A transfer function: `forward` radiance -> network code, `inverse` back."""

    name: str
    forward: Callable
    inverse: Callable


TRANSFERS = {t.name: t for t in (
    Transfer("linear", linear, linear),
    Transfer("srgb", srgb_forward, srgb_inverse),
    Transfer("pu", pu_forward, pu_inverse),
    Transfer("log", log_forward, log_inverse),
)}


class HalfTable:
    """A transfer function and its inverse on half floats, as tables over all their codes. A sign
    does not count: renders have zeros of either."""

    def __init__(self, transfer: str):
        t = TRANSFERS[transfer]
        code = np.arange(0x3C01, dtype=np.uint16).view(np.float16).astype(np.float64)  # [0,1]
        self.to_radiance = t.inverse(code).astype(np.float32)
        value = np.arange(0x7C00, dtype=np.uint16).view(np.float16).astype(np.float64)  # finite
        self.to_code = np.clip(t.forward(value), 0.0, 1.0).astype(np.float32)

    def decode(self, code: np.ndarray) -> np.ndarray:
        """Radiance of half float codes in [0,1]."""
        index = np.ascontiguousarray(code).view(np.uint16) & 0x7FFF
        return np.take(self.to_radiance, index, mode="clip")

    def encode(self, radiance: np.ndarray) -> np.ndarray:
        """Codes of finite radiance >= 0."""
        half = np.minimum(radiance, np.float32(HDR_MAX)).astype(np.float16)
        return np.take(self.to_code, half.view(np.uint16) & 0x7FFF, mode="clip")


def luminance(image: np.ndarray) -> np.ndarray:
    """[H,W,3] -> [H,W]"""
    return image @ np.asarray(LUMINANCE, image.dtype)


def autoexposure(image: np.ndarray) -> float:
    """Scale that brings [H,W,3] radiance to middle grey: 0.18 / geometric mean of bin luminances.

    Bins are at most 16x16 pixels; bins not above 1e-8 do not count; 1.0 if none counts.
    """
    image = np.clip(np.nan_to_num(np.asarray(image, np.float64), posinf=np.finfo(np.float32).max),
                    0.0, None)
    lum = luminance(image)
    h, w = lum.shape
    if h == 0 or w == 0:
        return 1.0
    nh, nw = -(-h // BIN), -(-w // BIN)
    rows, cols = np.arange(nh) * h // nh, np.arange(nw) * w // nw
    sums = np.add.reduceat(np.add.reduceat(lum, rows, 0), cols, 1)
    area = np.outer(np.diff(np.append(rows, h)), np.diff(np.append(cols, w)))
    mean = sums / area
    mean = mean[mean > EPS]
    return float(KEY / np.exp2(np.log2(mean).mean())) if mean.size else 1.0


def _hable(x):
    a, b, c, d, e, f = 0.22, 0.30, 0.10, 0.20, 0.01, 0.30
    return (x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f


def tonemap(image):
    """Exposed radiance -> display-linear [0,1] (Hable's curve with 0.18 -> 0.18, white 11.2)."""
    m = _lib(image)  # white long before the squares of radiance overflow
    return m.clip(_hable(m.clip(image, 0.0, 1e6) * 1.758141) / _hable(11.2), 0.0, 1.0)


def display(image, exposure: float = 1.0):
    """Radiance -> sRGB [0,1] as metrics and previews see it; arrays in single precision."""
    if _lib(image) is np:
        image, exposure = np.asarray(image, np.float32), np.float32(exposure)
    with np.errstate(over="ignore"):  # white in any case
        exposed = image * exposure
    return srgb_forward(tonemap(exposed))
