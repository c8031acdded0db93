"""How far an integer model is from its fp32 original: by layer, and by picture on a display."""
from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from export.pixels import Frame
from export.quantizer import Quantizer
from export.reference import FloatModel, IntModel, denoise
from training import color

TAPS, SIGMA, C1, C2 = 11, 1.5, 0.01**2, 0.03**2  # SSIM


@dataclass(frozen=True)
class Sample:
    """A picture to test on; `reference` [H,W,3] if there is a clean one."""

    name: str
    frame: Frame
    reference: np.ndarray | None = None


def psnr(a: np.ndarray, b: np.ndarray) -> float:
    error = float(((a.astype(np.float64) - b) ** 2).mean())
    return 10 * math.log10(1 / error) if error else math.inf


def through_window(x: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """[H,W,C] -> [H-n+1,W-n+1,C]: sums over n x n pixels, weighted by n taps down and across."""
    h, w = x.shape[0] - len(taps) + 1, x.shape[1] - len(taps) + 1
    rows = sum(t * x[k:k + h] for k, t in enumerate(taps))
    return sum(t * rows[:, k:k + w] for k, t in enumerate(taps))


def _blurred(x: np.ndarray) -> np.ndarray:
    """Gaussian window over [H,W,C] without padding."""
    t = np.arange(TAPS) - TAPS // 2
    w = np.exp(-(t**2) / (2 * SIGMA**2))
    return through_window(x, w / w.sum())


def ssim(a: np.ndarray, b: np.ndarray) -> float:
    """Mean SSIM over pixels and channels, peak 1; nan for pictures smaller than its window."""
    if min(a.shape[:2]) < TAPS:
        return math.nan
    a, b = a.astype(np.float64), b.astype(np.float64)
    mean_a, mean_b = _blurred(a), _blurred(b)
    var_a, var_b = _blurred(a * a) - mean_a**2, _blurred(b * b) - mean_b**2
    both = _blurred(a * b) - mean_a * mean_b
    return float(((2 * mean_a * mean_b + C1) * (2 * both + C2)
                  / ((mean_a**2 + mean_b**2 + C1) * (var_a + var_b + C2))).mean())


def flip(a: np.ndarray, b: np.ndarray) -> float:
    """Mean LDR-FLIP of a against b; nan without the package flip-evaluator."""
    try:
        import flip_evaluator
    except ImportError:
        return math.nan
    a, b = (np.ascontiguousarray(x, np.float32) for x in (a, b))
    return float(flip_evaluator.evaluate(b, a, "LDR", inputsRGB=True)[1])


def displayed(image: np.ndarray, frame: Frame, exposure: float) -> np.ndarray:
    """[0,1]: tone-mapped sRGB for HDR content, sRGB for linear content, codes as they are else."""
    rule = frame.rule()
    if rule.is_hdr:
        return color.display(image, exposure)
    if rule.is_signed:
        return np.clip(image * 0.5 + 0.5, 0, 1)
    return color.srgb_forward(np.clip(image, 0, 1)) if frame.content == "ldr" else image


def layer_table(q: Quantizer) -> list[str]:
    """A line per tensor: how well it is represented on the calibration pictures."""
    lines = ["tensor         SNR dB   saturated  never active  step of accumulator / of output"]
    for layer, made in zip(q.net.layers, q.model.layers, strict=True):
        name = layer.name
        signal = noise = 0.0
        full, count, alive = 0, 0, np.zeros(made.outputs, bool)
        for floats, codes in zip(q.floats, q.codes, strict=True):
            wanted, got = floats[name].astype(np.float64), codes[name]
            signal += (wanted**2).sum()
            noise += ((got * q.steps[name] - wanted) ** 2).sum()
            full, count = full + int((got == made.out_max).sum()), count + got.size
            alive |= (got > 0).any((0, 1))
        snr = 10 * math.log10(signal / noise) if signal and noise else math.inf
        lines.append(f"{name:<12} {snr:8.1f}   {100 * full / count:7.4f} %  "
                     f"{made.outputs - int(alive.sum()):4d} of {made.outputs:<4d}   "
                     f"{made.scale.min():.2e} to {made.scale.max():.2e}")
    return lines


@dataclass(frozen=True)
class Scores:
    """Of one picture: int8 against fp32, then the loss against the reference (nan without one)."""

    name: str
    psnr: float
    ssim: float
    flip: float
    psnr_loss: float = math.nan
    ssim_loss: float = math.nan
    flip_loss: float = math.nan


def compare(exact: FloatModel, model: IntModel, sample: Sample) -> Scores:
    wanted, got = denoise(exact, sample.frame), denoise(model, sample.frame)
    truth = wanted if sample.reference is None else sample.reference
    exposure = color.autoexposure(truth) if sample.frame.rule().is_hdr else 1.0
    a, b = (displayed(x, sample.frame, exposure) for x in (wanted, got))
    scores = (psnr(b, a), ssim(b, a), flip(b, a))
    if sample.reference is None:
        return Scores(sample.name, *scores)
    t = displayed(sample.reference, sample.frame, exposure)
    return Scores(sample.name, *scores, psnr(a, t) - psnr(b, t), ssim(a, t) - ssim(b, t),
                  flip(b, t) - flip(a, t))


def sample_table(rows: Iterable[Scores]) -> list[str]:
    """A line per picture and one for the means; losses are positive where int8 is worse."""
    lines = ["picture                            int8 against fp32           "
             "loss against the reference",
             "                                   PSNR     SSIM    FLIP       PSNR     SSIM    FLIP"]
    all_rows = list(rows)

    def line(s: Sequence[float], name: str) -> str:
        text = [f"{v:{w}}" if not math.isnan(v) else "-".rjust(int(w.split(".")[0].strip("+")))
                for v, w in zip(s, ("8.2f", "9.5f", "8.4f", "+11.3f", "+9.5f", "+8.4f"))]
        return f"{name[:30]:<30} " + "".join(text)

    values = np.array([(s.psnr, s.ssim, s.flip, s.psnr_loss, s.ssim_loss, s.flip_loss)
                       for s in all_rows])
    lines += [line(v, s.name) for v, s in zip(values, all_rows)]
    means = [float(np.mean(c[~np.isnan(c)])) if (~np.isnan(c)).any() else math.nan
             for c in values.T]
    return lines + [line(means, f"mean of {len(all_rows)}")]
