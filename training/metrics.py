"""Image metrics on display values (tone-mapped sRGB in [0,1], [H,W,C]), peak 1."""
from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch

from training import color
from training.errors import DATA, DEPENDENCY, ToolError
from training.loss import TAPS, msssim_value, ssim_value


def require_numbers(image: np.ndarray, name: str | Path) -> None:
    """ToolError that names the image, if it has NaNs."""
    if bad := int(np.isnan(image).sum()):
        raise ToolError(f"{name}: {bad} values are no numbers", DATA)


def to_display(image: np.ndarray, feature: str, exposure: float = 1.0) -> np.ndarray:
    """What a viewer sees of a feature: [H,W,C] -> [0,1]. nrm and sh1 are expected in [-1,1]."""
    image = np.asarray(image, np.float32)
    if feature == "hdr":
        return color.display(image, exposure)
    if feature in ("nrm", "sh1"):
        return color.srgb_forward(np.clip(image * 0.5 + 0.5, 0.0, 1.0) ** 6)
    if feature == "z":
        return color.srgb_forward(np.clip(color.tonemap(image * exposure), 0.0, 1.0))
    if feature == "srgb":
        return np.clip(image, 0.0, 1.0)
    return color.srgb_forward(np.clip(image, 0.0, 1.0))


def _batch(image: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1), np.float32))[None]


def mse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.mean((a.astype(np.float64) - b.astype(np.float64)) ** 2))


def decibels(error: float) -> float:
    """PSNR of a mean squared error."""
    return 10 * math.log10(1 / error) if error > 0 else math.inf


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    return decibels(mse(a, b))


def ssim(a: np.ndarray, b: np.ndarray) -> float:
    return float(ssim_value(_batch(a), _batch(b)))


def msssim(a: np.ndarray, b: np.ndarray) -> float:
    return float(msssim_value(_batch(a), _batch(b)))


def flip(a: np.ndarray, b: np.ndarray) -> float:
    """Mean LDR-FLIP of a against the reference b, at 67 pixels per degree (lower is better)."""
    try:
        import flip_evaluator
    except ImportError as e:
        raise ToolError("the metric flip needs the package flip-evaluator", DEPENDENCY) from e

    def rgb(x):
        return np.ascontiguousarray(np.repeat(x, 3, -1) if x.shape[-1] == 1 else x, np.float32)

    return float(flip_evaluator.evaluate(rgb(b), rgb(a), "LDR", inputsRGB=True)[1])


METRICS = {"psnr": psnr, "mse": mse, "ssim": ssim, "msssim": msssim, "flip": flip}


def measure(image: np.ndarray, reference: np.ndarray, names: list[str],
            what: str = "image") -> dict[str, float]:
    """Metrics by name of two display images of one size; `what`: the image's name in errors."""
    for name, values in ((what, image), (f"reference of {what}", reference)):
        require_numbers(values, name)
    height, width = image.shape[:2]
    if min(height, width) < TAPS and {"ssim", "msssim"} & set(names):
        raise ToolError(f"{what}: {width}x{height} pixels, SSIM needs {TAPS}x{TAPS} (--metric "
                        "chooses others)", DATA)
    return {n: METRICS[n](image, reference) for n in names}


def limited(values: dict[str, float]) -> dict[str, float]:
    """Metrics of which means can be taken: equal pictures have 100 dB, not infinitely many."""
    return {n: min(v, 100.0) for n, v in values.items()}


def to_codes(image: np.ndarray, feature: str, exposure: float = 1.0) -> np.ndarray:
    """What a PNG of a feature holds, in [0,1]: what a viewer sees, but of normals n/2 + 1/2."""
    if feature == "nrm":
        return np.clip(np.asarray(image, np.float32) * 0.5 + 0.5, 0.0, 1.0)
    return to_display(image, feature, exposure)
