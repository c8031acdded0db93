"""The filter of family K (docs/kernel-prediction.md, section Filter), differentiable by the heads.

One fused C++ operation on the CPU where it can be compiled, a chain of PyTorch's elsewhere, with
Triton's kernels in it on GPUs.
"""
from __future__ import annotations

import functools
import importlib.util
import os
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import Tensor

from export.kernel import LAST_STEPS
from export.smooth import (ABOVE, BALANCE_EPS, BESIDE, CALM, CALM_ALONE, CALM_SPARKS, CELL, FAR,
                           FAR_SPARKS_SQUARED, GUIDE_GAIN, LEAST_NOISE, LESS_OF_CODES, MORE_SHARE,
                           MOST_GAIN, MOST_LACKING, MOST_SHARE, NEAR, NOISE_EPS,
                           NOISE_GAIN, NOISE_SHARE, NOISY, RESULT_GAIN, RUN, RUNS_BESIDE,
                           SHARE_PER_CODE, SHARE_PER_CODE_ALONE, SPARK, SPARKS_LEAST,
                           SPARKS_SQUARED, SPARK_CODES, WIDTH_MIN, WIDTH_PER_CODE)
from training import fused, regression
from training.calm import calm_share, details_of, ramp
from training.cells import BAND, between, cell_means
from training.edges import averaged, ragged

SIDE, RADIUS, TAPS = 5, 2, 25
LEVELS = 5
EPS = 0.02                        # added to the albedo that divides
RADIANCE_MAX = 65504.0
STEP = 16.0                       # codes per unit of a logit
CONFIDENCE, BLEND = -255.0 / STEP, -8.0  # added to these logits
PARTS = [TAPS, 1, 1]              # channels of a head: logits, confidence, blend;
FULL_PARTS = [*PARTS, TAPS]       # at full resolution also the logits of the albedo's kernel
LEAST_SLOPE = 0.03                # of a blend weight by its logit, in gradients
CONSTANTS = [STEP, EPS, RADIANCE_MAX, CONFIDENCE, BLEND, float(NOISE_GAIN), float(NOISE_EPS),
             LEAST_SLOPE]


class Round(torch.autograd.Function):
    """Rounds to whole numbers, halves up; the gradient passes."""

    @staticmethod
    def forward(ctx, x: Tensor) -> Tensor:
        return torch.floor(x + 0.5)

    @staticmethod
    def backward(ctx, g: Tensor) -> Tensor:
        return g


class Clamp(torch.autograd.Function):
    """Clamps to [low, high]. Beyond them the gradient passes only if following it leads back: with
    none at all a channel that once left them would stay there."""

    @staticmethod
    def forward(ctx, x: Tensor, low: float, high: float) -> Tensor:
        ctx.save_for_backward(x)
        ctx.range = low, high
        return x.clamp(low, high)

    @staticmethod
    def backward(ctx, g: Tensor):
        x, = ctx.saved_tensors
        low, high = ctx.range
        away = ((x < low) & (g > 0)) | ((x > high) & (g < 0))
        return g.masked_fill(away, 0.0), None, None


class Blend(torch.autograd.Function):
    """Logistic function whose gradient is that of a slope of at least LEAST_SLOPE: at the ends of
    its range, where levels begin that have not learnt yet, there is none to come back by."""

    @staticmethod
    def forward(ctx, x: Tensor) -> Tensor:
        beta = torch.sigmoid(x)
        ctx.save_for_backward(beta)
        return beta

    @staticmethod
    def backward(ctx, g: Tensor) -> Tensor:
        beta, = ctx.saved_tensors
        return g * (beta * (1 - beta)).clamp(min=LEAST_SLOPE)


class Fused(torch.autograd.Function):
    """`plain` in C++; no gradients of the images."""

    @staticmethod
    def forward(ctx, radiance: Tensor, albedo: Tensor, has_albedo: Tensor, whole: bool,
                *heads: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        heads = [q.contiguous(memory_format=torch.channels_last) for q in heads]
        images = [planar(t) for t in (radiance, albedo, has_albedo)]
        out, tape, last = fused.module().filter(heads, *images, CONSTANTS, whole)
        ctx.save_for_backward(*images, tape, *heads)
        ctx.whole = whole
        smooth, noise = last.split((3, 1), 1)
        ctx.mark_non_differentiable(smooth, noise)
        return out, smooth, noise

    @staticmethod
    def backward(ctx, g: Tensor, *_):
        *rest, = ctx.saved_tensors
        images, tape, heads = rest[:3], rest[3], rest[4:]
        grads = fused.module().filter_backward(heads, *images, tape, planar(g), CONSTANTS,
                                               ctx.whole)
        return None, None, None, None, *grads


def planar(x: Tensor) -> Tensor:
    """Images whose planes may be some of a larger tensor's. (Of sides of one pixel `contiguous`
    keeps any strides.)"""
    is_planar = x.stride()[1:] == (x.shape[2] * x.shape[3], x.shape[3], 1)
    return x if is_planar else x.clone(memory_format=torch.contiguous_format)


def apply_filter(heads: list[Tensor], radiance: Tensor, albedo: Tensor,
                 has_albedo: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Filtered radiance [N,3,H,W] from the heads by level, the radiance (exposed), the albedo, and
    where there is one (0 or 1, [N,1,H,W]). And, for `smooth_result` and without gradients, the
    divisor [N,3,H,W] and the noise codes [N,1,H,W]."""
    images = radiance, albedo, has_albedo
    if fused.usable(*images):
        return Fused.apply(*images, True, *heads)
    return plain(heads, *images)


def plain(heads: list[Tensor], radiance: Tensor, albedo: Tensor, has_albedo: Tensor,
          whole: bool = True) -> tuple[Tensor, Tensor, Tensor]:
    """The same with PyTorch's operations, on any device. A factor common to all weights cancels, so
    logits are taken as they are where the integer engine subtracts their largest.

    whole: logits are rounded to codes."""
    parts = [torch.split(q, PARTS if level else FULL_PARTS, 1) for level, q in enumerate(heads)]
    smooth = divisor(parts[0][3], albedo, has_albedo, whole)
    i = first = radiance.clamp(0.0, RADIANCE_MAX) / smooth
    filtered = []
    for level in range(LEVELS):
        c = torch.exp(logits_of(parts[level][1].to(radiance.dtype), whole) + CONFIDENCE)
        v = torch.cat((c, c * i), 1)
        s = weighted_sums(parts[level][0], v, whole)
        filtered.append(s[:, 1:] / s[:, :1])
        if level + 1 < LEVELS:
            pooled = F.avg_pool2d(v, 2, ceil_mode=True)
            i = pooled[:, 1:] / pooled[:, :1]
    out = filtered[-1]
    for level in range(LEVELS - 2, -1, -1):
        beta = Blend.apply(logits_of(parts[level][2].to(radiance.dtype), whole) + BLEND)
        f = filtered[level]
        out = f + beta * (upsample(out)[..., :f.shape[-2], :f.shape[-1]] - f)
    with torch.no_grad():
        noise = noise_codes(first, filtered[0])
    return out * smooth, smooth.detach(), noise


def divisor(q: Tensor, albedo: Tensor, has_albedo: Tensor, whole: bool) -> Tensor:
    """Filtered albedo + EPS, [N,3,H,W], from the head of its kernel; 1 without albedo."""
    s = weighted_sums(q, torch.cat((torch.ones_like(has_albedo), albedo), 1), whole)
    smooth = s[:, 1:] / s[:, :1]
    return smooth * has_albedo + (1.0 - EPS) * (1.0 - has_albedo) + EPS


def smooth_result(out: Tensor, smooth: Tensor, noise: Tensor, radiance: Tensor, codes: Tensor,
                  albedo: Tensor, normal: Tensor, head: Tensor, bilateral: int) -> Tensor:
    """The result of apply_filter after the last steps, [N,3,H,W]; gradients pass by `out`, and by
    the kernel of the albedo in `head`, which filters the normal, too.

    codes: the network's input, whole numbers of 0..255, [N,12,H,W], and albedo: [N,3,H,W], both
    with their grain; normal: without, 0 where there is none, [N,3,H,W]; head: that of level 0;
    bilateral: a value of export.kernel.BILATERAL.
    """
    steps = LAST_STEPS[bilateral]
    radiance = radiance.clamp(0.0, RADIANCE_MAX)
    v = smoothed(out / smooth, noise, guide_of(codes), steps.corrects)
    if steps.regresses:
        s = weighted_sums(head[:, -TAPS:], torch.cat((torch.ones_like(noise), normal), 1), True)
        features = regression.features_of(s[:, 1:] / s[:, :1], smooth)
        v = regression.regressed(v, smooth, features, radiance)
    if steps.corrects:  # but not what is clipped
        v = torch.where(codes[:, 11:12] > 0, v, corrected(v, smooth, noise, radiance))
    is_alone = codes[:, 9:11, :1, :1].amax(1, keepdim=True) == 0
    raggedness = ragged(details_of(radiance), albedo, codes[:, 9:10, :1, :1])
    v = averaged(v * smooth, raggedness.to(v.dtype))
    even = radiance / torch.where(codes[:, 9:10] > 0, albedo + EPS, 1.0)
    return mixed(v, noise, radiance, is_alone, calm_share(details_of(even)))


def moved(v: Tensor, offsets: Sequence[tuple[int, int]]) -> list[Tensor]:
    """v(p + k) for each offset k, (x, y), or the nearest pixel inside; v [N,C,H,W]."""
    h, w = v.shape[-2:]
    x, y = (max(abs(k[i]) for k in offsets) for i in (0, 1))
    padded = F.pad(v, (x, x, y, y), mode="replicate")
    return [padded[..., y + j:y + j + h, x + i:x + i + w] for i, j in offsets]


def summed(v: Tensor) -> Tensor:
    return (v[:, :1] + v[:, 1:2]) + v[:, 2:]


def codes_of(v: Tensor) -> Tensor:
    return torch.floor(v + 0.5).clamp(max=255.0)


def noise_codes(first: Tensor, filtered: Tensor) -> Tensor:
    """export.smooth.noise_codes of tensors [N,3,H,W], the demodulated input and its 5x5 means."""
    apart = summed((first - filtered).abs())
    return codes_of(float(NOISE_GAIN) * (apart / (summed(filtered) + float(NOISE_EPS))))


def guide_of(codes: Tensor) -> Tensor:
    """export.smooth.guide_of of tensors [N,12,H,W]: [N,2,H,W]."""
    r, g, b, x, y, z, _, has_normal = codes[:, 3:11].split(1, 1)
    normal = (2 * x - y - z + 510) / 8, 7 * (y - z + 255) / 32
    guide = torch.where(has_normal > 0, torch.cat(normal, 1), torch.cat((r / 2, (g + b) / 4), 1))
    return guide.floor()


def smoothed(out: Tensor, noise: Tensor, guide: Tensor, is_far: bool) -> Tensor:
    """export.smooth.smoothed of tensors [N,3,H,W]."""
    offsets, own, widest = FAR if is_far else NEAR
    if on_gpu(out):
        constants = WIDTH_PER_CODE, WIDTH_MIN, widest, RESULT_GAIN, GUIDE_GAIN, EPS, own
        return gpu_kernels().Smoothed.apply(out, noise, guide, offsets, *map(float, constants))
    width = sum(moved(noise, [(-1, 0), (0, 0), (1, 0)])) * float(WIDTH_PER_CODE)
    width = width.clamp(float(WIDTH_MIN), float(widest))
    gain = (float(RESULT_GAIN) / width) / (out + EPS)
    weights, total = torch.full_like(out[:, :1], float(own)), torch.zeros_like(out)
    for there, guided in zip(moved(out, offsets), moved(guide, offsets)):
        change = there - out
        apart = (guided - guide).square().sum(1, keepdim=True)
        t = summed((change * gain).square()) + float(GUIDE_GAIN) * apart
        w = (1.0 - t).clamp(min=0.0).square()
        weights = weights + w
        total = total + w * change
    return out + total / weights


def _lacking(q: Tensor, sums: Tensor, sparks_squared: float) -> Tensor:
    """export.smooth._lacking of q [N,1,H,W] and sums [N,4,H,W]."""
    _, squares, base, lit = sums.split(1, 1)
    share = (1.0 - squares / (q.square() + 1e-6)).clamp(min=0.0)
    most = float(SPARKS_LEAST) + float(sparks_squared) * lit.square()
    gain = share * torch.minimum(q, most) / (base + 32.0)
    return gain.clamp(-float(MOST_GAIN), float(MOST_GAIN))


def corrected(out: Tensor, smooth: Tensor, noise: Tensor, radiance: Tensor) -> Tensor:
    """export.smooth.corrected of tensors [N,3,H,W], sums in PyTorch's order."""
    v = summed(out * smooth)
    level = v + float(BALANCE_EPS)
    q = (summed(radiance) - v) / level
    q = torch.minimum(q, (2.0 * float(MOST_LACKING) - q).clamp(min=0.0))
    share = (noise * float(NOISE_SHARE)).clamp(max=1.0)
    lit = (q - float(SPARK)).clamp(0.0, 1.0)
    sums = torch.cat((q, q.square(), v / level * share, lit), 1)
    near, far = sums_around(cell_means(sums, CELL) * CELL**2)
    expected = _lacking(far[:, :1], far, FAR_SPARKS_SQUARED)
    own = _lacking(near[:, :1] - expected * near[:, 2:3], near, SPARKS_SQUARED)
    gain = (expected + own).clamp(-float(MOST_GAIN), float(MOST_GAIN))
    return out + out * (between(gain, out.shape, CELL) * share)


def mixed(result: Tensor, noise: Tensor, radiance: Tensor, is_alone: Tensor,
          calm: Tensor) -> Tensor:
    """export.smooth.mixed of tensors [N,C,H,W]; is_alone and calm: [N,1,1,1]."""
    calm = torch.where(is_alone, ramp(calm, CALM_ALONE), ramp(calm, CALM))
    most = float(MOST_SHARE) + float(MORE_SHARE) * is_alone * calm
    per_code = torch.where(is_alone, float(SHARE_PER_CODE_ALONE), float(SHARE_PER_CODE))
    side, around = (1, RUN), 2 * RUNS_BESIDE + 1
    runs = torch.cat((torch.ones_like(noise), noise), 1)
    runs = F.avg_pool2d(F.pad(runs, (0, -noise.shape[-1] % RUN)), side)
    runs = runs * (runs[:, 1:] >= float(NOISY) * runs[:, :1])
    runs = F.avg_pool2d(runs, (1, around), 1, (0, RUNS_BESIDE)) * around
    mean = runs[:, 1:] / runs[:, :1].clamp(min=1e-6) * (1.0 - float(LESS_OF_CODES) * calm)
    share = (1.0 - (mean - float(LEAST_NOISE)) * per_code).clamp(min=0.0).minimum(most)
    v = summed(result)
    q = (summed(radiance) - v) / (v + float(BALANCE_EPS))
    own = (1.0 - ramp(noise, SPARK_CODES)).maximum(calm * (1.0 - ramp(q, CALM_SPARKS)))
    return result + between(share, noise.shape, side) * own * (radiance - result)


def sums_around(v: Tensor) -> tuple[Tensor, Tensor]:
    """export.smooth.sums_around of a tensor [N,C,H,W]."""
    rows, columns = ABOVE + 2, 2 * BESIDE + 1
    wide = F.pad(v, (BESIDE, BESIDE, ABOVE, 1))
    return (F.avg_pool2d(v, (3, 5), 1, (1, 2)) * 15,
            F.avg_pool2d(wide, (rows, columns), 1) * (rows * columns))


def logits_of(q: Tensor, whole: bool = True) -> Tensor:
    """Heads as whole codes of 0..255 over STEP."""
    codes = Clamp.apply(q * STEP, 0.0, 255.0)
    return (Round.apply(codes) if whole else codes) / STEP


@functools.cache
def gpu_kernels():
    """kernel_triton, where there is Triton: it comes along with PyTorch for GPUs."""
    if os.environ.get("LULL_FUSED") == "0" or not importlib.util.find_spec("triton"):
        return None
    return importlib.import_module("training.kernel_triton")


def on_gpu(x: Tensor) -> bool:
    return x.device.type == "cuda" and x.dtype == torch.float32 and gpu_kernels() is not None


def weighted_sums(q: Tensor, v: Tensor, whole: bool) -> Tensor:
    """kernel_filter by a head's 25 channels q [N,25,H,W]."""
    if on_gpu(v):
        return gpu_kernels().WeightedSums.apply(q, v, whole)
    around = F.pad(v, [RADIUS] * 4)
    rows = q.shape[-2] if torch.is_grad_enabled() else BAND
    return torch.cat([kernel_filter(
        logits_of(q[..., y:y + rows, :].to(v.dtype), whole),
        around[..., y:y + rows + 2 * RADIUS, :]) for y in range(0, q.shape[-2], rows)], -2)


def kernel_filter(logits: Tensor, around: Tensor) -> Tensor:
    """out[c](p) = sum over the 5x5 taps k, row by row, of exp(logits[k](p)) * v[c](p + k); logits
    [N,25,H,W] (at most about 60), around: v with RADIUS pixels more on each side."""
    n, _, h, w = logits.shape
    out = around.new_zeros(n, around.shape[1], h, w)
    for k, weight in enumerate(logits.exp().split(1, 1)):
        y, x = divmod(k, SIDE)
        out = out.addcmul(weight, around[..., y:y + h, x:x + w])
    return out


def upsample(x: Tensor) -> Tensor:
    """Bilinear by 2, edges repeated: 9/16, 3/16, 3/16, 1/16 of the nearest pixels."""
    return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
