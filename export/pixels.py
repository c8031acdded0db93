"""Pixels of the reference: what happens to images before and after the network, to the bit.

Single precision throughout, each operation rounded by itself (docs/arithmetic.md, "Pixels"). Values
below the smallest normal number, 2^-126, count as 0 wherever they could arise.
"""
from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

F = np.float32
MAX = np.finfo(F).max
TINY = np.finfo(F).tiny  # 2^-126
BIN = 16
FEATURES = ("color", "albedo", "normal")


# ---- Elementary functions: [...] float32 -> float32 ----------------------------------------------

def _flush(v: np.ndarray) -> np.ndarray:
    """Below 2^-126, negative and NaN to 0."""
    return np.where(v >= TINY, v, F(0))


def _flush_result(v: np.ndarray) -> np.ndarray:
    """Results at or below 2^-126, where rounding and underflow could come in either order, to 0."""
    return np.where(v > TINY, v, F(0))


def mantissa(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, e) of x = m 2^e, m in [sqrt(1/2), sqrt(2)); x normal."""
    bits = x.view(np.int32)
    exponent = (bits - np.int32(0x3F3504F3)) >> 23
    return (bits - (exponent << 23)).view(F), exponent.astype(F)


def _log2_parts(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(whole, part): their sum is log2(x), part in [-0.5, 0.5]; x normal."""
    m, whole = mantissa(x)
    s = (m - F(1)) / (m + F(1))
    w = s * s
    p = ((F(0.431737901252) * w + F(0.576714309537)) * (w * w)
         + (F(0.961798848299) * w + F(2.88539007979)))
    return whole, s * p


def _nearest(t: np.ndarray) -> np.ndarray:
    return (t + F(12582912)) - F(12582912)


def _exp2m1(r: np.ndarray) -> np.ndarray:
    """2^r - 1 for |r| a little over 0.5 at most."""
    s = r * r
    p = ((F(0.000154035123298) * r + F(0.00133908498473)) * s
         + (F(0.00961823792896) * r + F(0.0555035721998)))
    return (p * s + (F(0.240226497895) * r + F(0.693147187971))) * r


def _power_of_two(n: np.ndarray) -> np.ndarray:
    return ((n.astype(np.int32) + 127) << 23).view(F)


def _scaled(v: np.ndarray, n: np.ndarray) -> np.ndarray:
    """v * 2^n in two steps."""
    n = n.astype(np.int32)
    half = n >> 1
    with np.errstate(over="ignore"):
        return v * _power_of_two(half) * _power_of_two(n - half)


def _reduced(high: float, low: float, log: tuple[np.ndarray, np.ndarray]):
    """(n, r): n + r = (high + low) * (whole + part), n whole."""
    whole, part = log
    high, low = F(high), F(low)
    n = _nearest((high + low) * (whole + part))
    return n, (high * whole - n) + (low * whole + (high + low) * part)


def _power(z: np.ndarray, high: float, low: float) -> np.ndarray:
    n, r = _reduced(high, low, _log2_parts(z))
    return _scaled(F(1) + _exp2m1(r), n)


def log2(x: np.ndarray) -> np.ndarray:
    whole, part = _log2_parts(np.maximum(x, TINY))
    return whole + part


def exp2(x: np.ndarray) -> np.ndarray:
    t = np.clip(x, F(-127), F(129))
    n = _nearest(t)
    return np.where(x < -126, F(0), _scaled(F(1) + _exp2m1(t - n), n))


# ---- Transfer functions --------------------------------------------------------------------------

PU_Y0, PU_Y1 = F(1.57945760e-06), F(3.22087631e-02)
PU_X0, PU_X1, PU_F = F(7.1178066430e-04), F(1.1832876033e-01), F(6.26026094e-03)
_hex = float.fromhex


def srgb_forward(y: np.ndarray) -> np.ndarray:
    v = _flush(y)
    power = _power(np.maximum(v, TINY), _hex("0x1.aaap-2"), _hex("0x1.555556p-15"))
    return np.where(v > F(0.0031308), F(1.055) * power - F(0.055), F(12.92) * v)


def srgb_inverse(x: np.ndarray) -> np.ndarray:
    v = np.minimum(_flush(x), F(2.0**54))
    power = _power((v + F(0.055)) * (F(1) / F(1.055)), _hex("0x1.332p+1"), _hex("0x1.333334p-11"))
    return _flush_result(np.where(v > F(0.04045), power, v * (F(1) / F(12.92))))


def pu_forward(y: np.ndarray) -> np.ndarray:
    v = _flush(y)
    upper, above = v > PU_Y1, v > PU_Y0
    whole, part = _log2_parts(np.where(above, np.where(upper, v + PU_F, v), PU_Y0))
    n, r = _reduced(_hex("0x1.b9ap-2"), _hex("0x1.cfc058p-14"), (whole, part))
    middle = ((F(0.52499815834241) * (F(1) + _exp2m1(r))) * _power_of_two(n)
              - F(0.00093820874307323))
    high = F(0.042593936086398) * (whole + part) + F(0.31852702898491)
    low = F(450.6488059461) * np.minimum(v, PU_Y0)
    return np.where(above, np.where(upper, high, middle), low)


def pu_inverse(x: np.ndarray) -> np.ndarray:
    k_high, k_low = F(_hex("0x1.77ap+4")), F(_hex("0x1.f62c8p-11"))
    g_high, g_low = F(_hex("0x1.de8p+2")), F(_hex("0x1.b3c2c6p-10"))
    v = np.minimum(_flush(x), F(6))
    upper = v > PU_X1
    head = (v.view(np.uint32) & np.uint32(0xFFFFF000)).view(F)
    tail = v - head
    n_high = _nearest((k_high + k_low) * v - (g_high + g_low))
    r_high = ((k_high * head - n_high) - g_high) + ((k_high * tail + k_low * v) - g_low)
    log = _log2_parts(F(1.9047685865362) * v + F(0.0017870705414195))
    n_middle, r_middle = _reduced(_hex("0x1.28ap+1"), _hex("0x1.7fe206p-11"), log)
    y = (_scaled(F(1) + _exp2m1(np.where(upper, r_high, r_middle)),
                 np.where(upper, n_high, n_middle)) - np.where(upper, PU_F, F(0)))
    return _flush_result(np.where(v > PU_X0, y, F(0.0022190228550602) * v))


def log_forward(y: np.ndarray) -> np.ndarray:
    v = _flush(y)
    u = F(1) + v
    lost = v - (u - F(1))
    whole, part = _log2_parts(u)
    return _flush_result(F(0.062502666475519) * (whole + part)
                         + (lost * F(0.090172286966568)) / u)


def log_inverse(x: np.ndarray) -> np.ndarray:
    v = np.minimum(_flush(x), F(8.0625))
    small = F(0.000682588611) * v
    n = _nearest(F(16) * v - small)
    part = _exp2m1((F(16) * v - n) - small)
    n = n.astype(np.int32)
    half = n >> 1
    rest = n - half
    y = part * _power_of_two(half) + (_power_of_two(half) - _power_of_two(-rest))
    with np.errstate(over="ignore"):
        y = y * _power_of_two(rest)
    return _flush_result(np.where(v > F(2.0**-30), y, F(11.089881754588) * v))


# ---- Images --------------------------------------------------------------------------------------

@dataclass(frozen=True)
class Content:
    """How the main image is read and written."""

    forward: Callable[[np.ndarray], np.ndarray]
    inverse: Callable[[np.ndarray], np.ndarray]
    is_hdr: bool
    is_signed: bool


CONTENTS = {
    "hdr": Content(pu_forward, pu_inverse, True, False),
    "ldr": Content(srgb_forward, srgb_inverse, False, False),
    "srgb": Content(_flush, _flush, False, False),
    "lightmap-hdr": Content(log_forward, log_inverse, True, False),
    "lightmap-dir": Content(_flush, _flush, False, True),
}


def sanitize(v: np.ndarray, scale: float, low: float, high: float) -> np.ndarray:
    """v * scale within [low, high]; NaN and what is at most 2^-126 in magnitude to 0."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        v = np.where(np.abs(v) >= TINY, v, F(0)) * F(scale)
        v = np.where(np.abs(v) > TINY, v, F(0))
    return np.clip(v, F(low), F(high))


def three_channels(image: np.ndarray) -> np.ndarray:
    """[H,W] or [H,W,1..3] -> [H,W,3]: grey is (x,x,x), two channels are (x,y,y)."""
    image = np.asarray(image, F)
    image = image[..., None] if image.ndim == 2 else image
    return image[..., [0, min(1, image.shape[2] - 1), min(2, image.shape[2] - 1)]]


def _kahan(values: np.ndarray) -> np.float32:
    total = lost = F(0)
    for v in values:
        corrected = v - lost
        following = total + corrected
        lost = (following - total) - corrected
        total = following
    return total


def autoexposure(color: np.ndarray) -> np.float32:
    """0.18 / 2^(mean log2 luminance of the bins above 1e-8); 1 if none, 0 if that is infinite."""
    color = sanitize(three_channels(color), 1.0, 0.0, MAX)
    h, w, _ = color.shape
    rows, columns = -(-h // BIN), -(-w // BIN)
    sums, count = [], 0
    with np.errstate(over="ignore"):
        lum = ((F(0.212671) * color[..., 0] + F(0.715160) * color[..., 1])
               + F(0.072169) * color[..., 2])
        for i in range(rows):
            logs = []
            for j in range(columns):
                y0, y1 = i * h // rows, (i + 1) * h // rows
                x0, x1 = j * w // columns, (j + 1) * w // columns
                column = np.zeros(BIN, F)
                for y in range(y0, y1):
                    column[:x1 - x0] += lum[y, x0:x1]
                for step in (8, 4, 2, 1):
                    column[:step] += column[step:2 * step]
                mean = column[0] / F((x1 - x0) * (y1 - y0))
                if np.isinf(mean):
                    return F(0)
                if mean > F(1e-8):
                    logs.append(log2(mean[None])[0])
            count += len(logs)
            sums.append(_kahan(logs))
    return F(0.18) / exp2((_kahan(sums) / F(count))[None])[0] if count else F(1)


@dataclass(frozen=True)
class Frame:
    """Images of one frame by feature (FEATURES), and how they are to be read."""

    images: Mapping[str, np.ndarray]
    content: str = "hdr"
    scale: float | None = None  # None: auto-exposure for HDR content, else 1
    clean_aux: bool = False     # albedo and normals have no noise

    def rule(self) -> Content:
        lone_normal = set(self.images) == {"normal"}
        return CONTENTS["lightmap-dir" if lone_normal else self.content]

    def input_scale(self) -> np.float32:
        if self.scale is not None:
            return F(self.scale)
        return autoexposure(self.images["color"]) if self.rule().is_hdr else F(1)

    def network_input(self) -> np.ndarray:
        """[H,W,3 per feature] network values, not padded yet."""
        planes = []
        for feature in (f for f in FEATURES if f in self.images):
            rule, main = self.rule(), not planes
            signed = rule.is_signed if main else feature == "normal"
            v = sanitize(three_channels(self.images[feature]),
                         self.input_scale() if main else 1.0, -1.0 if signed else 0.0,
                         MAX if main and rule.is_hdr else 1.0)
            if signed:
                v = v * F(0.5) + F(0.5)
            planes.append(rule.forward(v) if main else v)
        return np.concatenate(planes, -1)

    def finished(self, values: np.ndarray, channels: int = 3) -> np.ndarray:
        """Network output [H,W,3] to image values [H,W,channels]."""
        return self.stored(self.rule().inverse(sanitize(values, 1.0, 0.0, MAX)), channels)

    def stored(self, v: np.ndarray, channels: int) -> np.ndarray:
        """What is left once values are in the image's transfer: channels, sign, range, scale."""
        rule, scale = self.rule(), self.input_scale()
        if channels == 1:
            v = ((v[..., 0] + v[..., 1]) + v[..., 2])[..., None] / F(3)
        if rule.is_signed:
            v = np.maximum(v * F(2) - F(1), F(-1))
        if not rule.is_hdr:
            v = np.minimum(v, F(1))
        with np.errstate(over="ignore", invalid="ignore"):
            return (v * (F(1) / scale if scale != 0 else F(0)))[..., :channels]
