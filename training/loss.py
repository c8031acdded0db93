"""Losses between network output and target, both in transfer space, [N,C,H,W].

All are functions of (a, b) -> scalar; a is the output, b the target. SSIM terms run in fp32.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import torch
import torch.nn.functional as F
from torch import Tensor

from training import color, fused
from training.pointwise import L1Grad

STANDARD_WEIGHTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)  # MS-SSIM exponents, Wang 2003
RT_WEIGHTS = (0.2,) * 5
TAPS, SIGMA, K1, K2 = 11, 1.5, 0.01, 0.03
BLUR_BY_MATRIX = 256  # sides of tiles whose Gaussian means are products of matrices
Loss = Callable[[Tensor, Tensor], Tensor]  # of outputs and targets

LEAST_MSE = 1e-6  # of what counts as exact: 60 dB
LEAST_NOISE, USUAL_NOISE = 0.005, 0.05  # mean differences of codes of input and target


def distance(a: Tensor, b: Tensor) -> Tensor:
    """Mean absolute difference of each pair of images, [N,C,H,W] -> [N,1,1,1]."""
    return (a - b).abs().mean((1, 2, 3), keepdim=True)


def balance(x: Tensor, y: Tensor, power: float) -> Tensor:
    """Factors [N,1,1,1] of outputs and targets y, [N,C,H,W], for losses that are proportional to
    both: a tile whose input x was close to its target would not count beside noisy ones."""
    noise = distance(x[:, :y.shape[1]], y)
    return ((noise + LEAST_NOISE) / USUAL_NOISE) ** -power


def l1(a: Tensor, b: Tensor) -> Tensor:
    return (a - b).abs().mean()


def l2(a: Tensor, b: Tensor) -> Tensor:
    return ((a - b) ** 2).mean()


def mape(a: Tensor, b: Tensor) -> Tensor:
    return ((a - b).abs() / (b.abs() + 0.01)).mean()


def smape(a: Tensor, b: Tensor) -> Tensor:
    return ((a - b).abs() / (a.abs() + b.abs() + 0.01)).mean()


def grad(a: Tensor, b: Tensor) -> Tensor:
    """Mean absolute difference of forward differences along x and y."""
    d = a - b
    dx, dy = d[..., :, 1:] - d[..., :, :-1], d[..., 1:, :] - d[..., :-1, :]
    return (dx.abs().sum() + dy.abs().sum()) / (dx.numel() + dy.numel())


def l1_grad(a: Tensor, b: Tensor) -> Tensor:
    """Half l1, half grad."""
    if fused.usable(a, gradients=True) and fused.usable(b) and a.dtype == b.dtype:
        return L1Grad.apply(a, b)
    return 0.5 * l1(a, b) + 0.5 * grad(a, b)


def _window(like: Tensor) -> Tensor:
    x = torch.arange(TAPS, dtype=torch.float32, device=like.device) - TAPS // 2
    w = torch.exp(-(x**2) / (2 * SIGMA**2))
    return w / w.sum()


def _blur(maps: Tensor) -> Tensor:
    """Gaussian means of [N,C,H,W] where the window fits, [N,C,H-10,W-10]. Tiles are multiplied with
    the matrices of the window, 20 times as fast as convolutions of single channels on a CPU."""
    w = _window(maps)
    if max(maps.shape[-2:]) > BLUR_BY_MATRIX:
        flat = maps.flatten(0, 1).unsqueeze(1)
        flat = F.conv2d(F.conv2d(flat, w.view(1, 1, -1, 1)), w.view(1, 1, 1, -1))
        return flat.view(*maps.shape[:2], *flat.shape[-2:])

    def matrix(size: int) -> Tensor:  # [size, size - TAPS + 1]
        band = maps.new_zeros(size - TAPS + 1, size + 1)
        band[:, :TAPS] = w  # rows one longer than the matrix: each moves on by one
        return band.flatten()[:(size - TAPS + 1) * size].view(-1, size).T

    height, width = maps.shape[-2:]
    return matrix(height).T @ (maps @ matrix(width))


def _ssim_parts(a: Tensor, b: Tensor, peak: float) -> tuple[Tensor, Tensor]:
    """Mean SSIM and mean contrast-structure term per image and channel, [N,C]; no padding."""
    n, c = a.shape[:2]
    with torch.autocast(a.device.type, enabled=False):  # variances are small differences
        maps = _blur(torch.cat((a, b, a * a + b * b, a * b), 1))
    mu_a, mu_b, squares, ab = maps.view(n, 4, c, *maps.shape[-2:]).unbind(1)
    c1, c2 = (K1 * peak) ** 2, (K2 * peak) ** 2
    cs = (2 * (ab - mu_a * mu_b) + c2) / (squares - mu_a**2 - mu_b**2 + c2)
    lum = (2 * mu_a * mu_b + c1) / (mu_a**2 + mu_b**2 + c1)
    return (lum * cs).mean((-2, -1)), cs.mean((-2, -1))


def ssim_value(a: Tensor, b: Tensor, peak: float = 1.0) -> Tensor:
    """Mean SSIM of [N,C,H,W]; both sides at least 11 pixels."""
    if min(a.shape[-2:]) < TAPS:
        raise ValueError(f"SSIM needs images of at least {TAPS}x{TAPS} pixels")
    return _ssim_parts(a.float(), b.float(), peak)[0].mean()


def msssim_scales(height: int, width: int, scales: int = 5) -> int:
    """Scales of MS-SSIM that fit an image: `scales`, or fewer if the window outgrows the last ones.

    All 5 need a smaller side above 160 as in Open Image Denoise; each scale less halves that.
    """
    while scales > 1 and min(height, width) <= (TAPS - 1) << (scales - 1):
        scales -= 1
    return scales


def msssim_value(a: Tensor, b: Tensor, weights=STANDARD_WEIGHTS, peak: float = 1.0) -> Tensor:
    """Mean MS-SSIM of [N,C,H,W]. Images too small for all scales use the finest ones that fit, with
    exponents that keep their sum."""
    a, b = a.float(), b.float()
    scales = msssim_scales(*a.shape[-2:], scales=len(weights))
    used = weights[:scales]
    factor = sum(weights) / sum(used)
    result = 1.0
    for i, weight in enumerate(used):
        full, cs = _ssim_parts(a, b, peak)
        term = full if i == scales - 1 else cs
        result = result * term.clamp(min=1e-6) ** (weight * factor)
        if i < scales - 1:
            a, b = F.avg_pool2d(a, 2), F.avg_pool2d(b, 2)
    return result.mean()


def log_mse(a: Tensor, b: Tensor, transfer: str, ssim_weight: float = 0.0) -> Tensor:
    """Mean over the images of ln(1 + mse / LEAST_MSE) / 2: what a mean of PSNRs measures, so that
    every image counts alike, however noisy, and its pixels by their expectation.

    mse: of the values that a screen shows, and of a and b themselves, for what is brighter than its
    white. transfer: that of a and b. ssim_weight: of what SSIM of the values on screen lacks to 1;
    with 1 a tenth of a decibel in the mean of PSNRs counts as much as .0115 in that of SSIMs.
    """
    def shown(x: Tensor) -> Tensor:
        if transfer in ("srgb", "linear"):
            return x
        return color.display(color.TRANSFERS[transfer].inverse(x))

    a, b = a.float(), b.float()
    shown_a, shown_b = shown(a), shown(b)
    mse = (shown_a - shown_b).square().mean((1, 2, 3)) + (a - b).square().mean((1, 2, 3))
    loss = 0.5 * torch.log1p(mse / LEAST_MSE).mean()
    return loss + ssim_weight * (1.0 - ssim_value(shown_a, shown_b)) if ssim_weight else loss


@dataclass(frozen=True)
class Parameters:
    """What some of the losses depend on."""
    weights: tuple[float, ...] = STANDARD_WEIGHTS  # exponents of MS-SSIM's scales, finest first
    transfer: str = "pu"                           # that of the images
    ssim_weight: float = 1.0                       # that of log_mse_ssim


def _msssim(a: Tensor, b: Tensor, p: Parameters) -> Tensor:
    return 1.0 - msssim_value(a, b, p.weights)


LOSSES: dict[str, Callable[[Tensor, Tensor, Parameters], Tensor]] = {
    "l1": lambda a, b, p: l1(a, b),
    "mape": lambda a, b, p: mape(a, b),
    "smape": lambda a, b, p: smape(a, b),
    "l2": lambda a, b, p: l2(a, b),
    "ssim": lambda a, b, p: 1.0 - ssim_value(a, b),
    "msssim": _msssim,
    "l1_msssim": lambda a, b, p: 0.16 * l1(a, b) + 0.84 * _msssim(a, b, p),
    "l1_grad": lambda a, b, p: l1_grad(a, b),
    "log_mse": lambda a, b, p: log_mse(a, b, p.transfer),
    "log_mse_ssim": lambda a, b, p: log_mse(a, b, p.transfer, p.ssim_weight),
}


def make_loss(name: str, msssim_weights=None, transfer: str = "pu",
              ssim_weight: float = 1.0) -> Loss:
    """The loss called `name`; msssim_weights: None: the usual ones; others: as in Parameters."""
    if name not in LOSSES:
        raise ValueError(f"unknown loss '{name}' (known: {', '.join(LOSSES)})")
    return partial(LOSSES[name], p=Parameters(tuple(msssim_weights or STANDARD_WEIGHTS), transfer,
                                              ssim_weight))


def loss_of_settings(settings) -> Loss:
    """The loss that the settings of a training ask for."""
    return make_loss(settings.loss, settings.msssim_weights, settings.transfer,
                     settings.ssim_weight)
