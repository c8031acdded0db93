"""Two parts of kernel_filter as Triton kernels, for GPUs: the weighted sums of the filter, and the
smoothing along its result. Each is one pass over memory and one back, in place of a hundred."""
from __future__ import annotations

import functools

import torch
import triton
import triton.language as tl
from torch import Tensor

from training.kernel_filter import SIDE, STEP

BLOCK = 128  # pixels of a program
TOP_CODE = 255.0


@triton.jit
def code_of(q, whole: tl.constexpr, top: tl.constexpr, step: tl.constexpr):
    code = tl.minimum(tl.maximum(q.to(tl.float32) * step, 0.0), top)
    return tl.floor(code + 0.5) if whole else code


@triton.jit
def weighed(s0, s1, s2, s3, logit, value, plane, there, whole: tl.constexpr, top: tl.constexpr,
            step: tl.constexpr):
    """Sums of four planes with the value at a pointer, by the weight of the logit at another."""
    e = tl.exp(code_of(tl.load(logit, there, 0.0), whole, top, step) / step)
    return (s0 + e * tl.load(value, there, 0.0), s1 + e * tl.load(value + plane, there, 0.0),
            s2 + e * tl.load(value + 2 * plane, there, 0.0),
            s3 + e * tl.load(value + 3 * plane, there, 0.0))


@triton.jit
def store(to, s0, s1, s2, s3, plane, inside):
    tl.store(to, s0, inside)
    tl.store(to + plane, s1, inside)
    tl.store(to + 2 * plane, s2, inside)
    tl.store(to + 3 * plane, s3, inside)


@triton.jit
def sum_forward(q, v, out, height, width, qn, qc, qy, qx, whole: tl.constexpr,
                block: tl.constexpr, side: tl.constexpr, top: tl.constexpr, step: tl.constexpr):
    image = tl.program_id(1).to(tl.int64)
    p = tl.program_id(0) * block + tl.arange(0, block)
    y, x = p // width, p % width
    inside, plane = p < height * width, height * width
    logits = q + image * qn + y * qy + x * qx
    values = v + image * 4 * plane
    s0 = tl.zeros([block], tl.float32)
    s1, s2, s3 = s0, s0, s0
    for k in range(side * side):
        ty, tx = y + (k // side - side // 2), x + (k % side - side // 2)
        there = inside & (ty >= 0) & (ty < height) & (tx >= 0) & (tx < width)
        s0, s1, s2, s3 = weighed(s0, s1, s2, s3, logits + k * qc, values + ty * width + tx, plane,
                                 there, whole, top, step)
    store(out + image * 4 * plane + p, s0, s1, s2, s3, plane, inside)


@triton.jit
def sum_backward(q, v, g, dq, dv, height, width, qn, qc, qy, qx, dn, dc, dy, dx,
                 whole: tl.constexpr, block: tl.constexpr, side: tl.constexpr, top: tl.constexpr,
                 step: tl.constexpr):
    image = tl.program_id(1).to(tl.int64)
    p = tl.program_id(0) * block + tl.arange(0, block)
    y, x = p // width, p % width
    inside, plane = p < height * width, height * width
    logits = q + image * qn
    values, gradients = v + image * 4 * plane, g + image * 4 * plane
    g0 = tl.load(gradients + p, inside, 0.0)
    g1 = tl.load(gradients + plane + p, inside, 0.0)
    g2 = tl.load(gradients + 2 * plane + p, inside, 0.0)
    g3 = tl.load(gradients + 3 * plane + p, inside, 0.0)
    s0 = tl.zeros([block], tl.float32)
    s1, s2, s3 = s0, s0, s0
    for k in range(side * side):
        away_y, away_x = k // side - side // 2, k % side - side // 2
        # The logit of this pixel's tap k, by what it weighs.
        ty, tx = y + away_y, x + away_x
        there = inside & (ty >= 0) & (ty < height) & (tx >= 0) & (tx < width)
        tap = values + ty * width + tx
        along = g0 * tl.load(tap, there, 0.0) + g1 * tl.load(tap + plane, there, 0.0)
        along += g2 * tl.load(tap + 2 * plane, there, 0.0)
        along += g3 * tl.load(tap + 3 * plane, there, 0.0)
        logit = tl.load(logits + y * qy + x * qx + k * qc, inside, 0.0)
        along *= tl.exp(code_of(logit, whole, top, step) / step)
        at = logit.to(tl.float32) * step  # beyond the codes only the way back is followed
        lost = ((at < 0.0) & (along > 0.0)) | ((at > top) & (along < 0.0))
        to = dq + image * dn + y * dy + x * dx + k * dc
        tl.store(to, tl.where(lost, 0.0, along).to(dq.dtype.element_ty), inside)
        # The value of this pixel, which is tap k of another one.
        fy, fx = y - away_y, x - away_x
        there = inside & (fy >= 0) & (fy < height) & (fx >= 0) & (fx < width)
        s0, s1, s2, s3 = weighed(s0, s1, s2, s3, logits + fy * qy + fx * qx + k * qc,
                                 gradients + fy * width + fx, plane, there, whole, top, step)
    store(dv + image * 4 * plane + p, s0, s1, s2, s3, plane, inside)


def launched(kernel, image: Tensor, *rest, **constants) -> None:
    """Runs a kernel on blocks of the pixels of images, of which the first one [N,C,H,W] tells."""
    n, _, h, w = image.shape
    kernel[(-(-h * w // BLOCK), n)](image, *rest, block=BLOCK, **constants)


def of_sums(whole: bool) -> dict:
    return {"whole": whole, "side": SIDE, "top": TOP_CODE, "step": STEP}


class WeightedSums(torch.autograd.Function):
    """kernel_filter.weighted_sums: q [N,25,H,W], v [N,4,H,W] in fp32 -> [N,4,H,W]."""

    @staticmethod
    def forward(ctx, q: Tensor, v: Tensor, whole: bool) -> Tensor:
        v = v.contiguous()
        out = torch.empty_like(v)
        launched(sum_forward, q, v, out, *v.shape[2:], *q.stride(), **of_sums(whole))
        ctx.save_for_backward(q, v)
        ctx.whole = whole
        return out

    @staticmethod
    def backward(ctx, g: Tensor):
        q, v = ctx.saved_tensors
        dq = torch.empty_like(q, memory_format=torch.channels_last)
        dv = torch.empty_like(v)
        launched(sum_backward, q, v, g.contiguous(), dq, dv, *v.shape[2:], *q.stride(),
                 *dq.stride(), **of_sums(ctx.whole))
        return dq, dv, None


@triton.jit
def shared(v, guide, noise, p, y, x, inside, height, width, per_code, narrowest, widest,
           result_gain, eps):
    """What all neighbours of a pixel meet: its values, its guide, the gains of their changes."""
    plane, row = height * width, y * width
    n = tl.load(noise + p, inside, 0.0)
    n += tl.load(noise + row + tl.maximum(x - 1, 0), inside, 0.0)
    n += tl.load(noise + row + tl.minimum(x + 1, width - 1), inside, 0.0)
    wide = tl.minimum(tl.maximum(n * per_code, narrowest), widest)
    gain = result_gain / wide
    v0 = tl.load(v + p, inside, 0.0)
    v1 = tl.load(v + plane + p, inside, 0.0)
    v2 = tl.load(v + 2 * plane + p, inside, 0.0)
    return (v0, v1, v2, tl.load(guide + p, inside, 0.0), tl.load(guide + plane + p, inside, 0.0),
            gain / (v0 + eps), gain / (v1 + eps), gain / (v2 + eps))


@triton.jit
def neighbour(offsets, k, y, x, height, width):
    """Where the k-th neighbour is, or the nearest pixel inside."""
    tx = tl.minimum(tl.maximum(x + tl.load(offsets + 2 * k), 0), width - 1)
    ty = tl.minimum(tl.maximum(y + tl.load(offsets + 2 * k + 1), 0), height - 1)
    return ty * width + tx


@triton.jit
def change(v, guide, at, inside, plane, v0, v1, v2, a, b, n0, n1, n2, guide_gain):
    """What the pixel `at` has more of, and the root of its weight."""
    c0 = tl.load(v + at, inside, 0.0) - v0
    c1 = tl.load(v + plane + at, inside, 0.0) - v1
    c2 = tl.load(v + 2 * plane + at, inside, 0.0) - v2
    da = tl.load(guide + at, inside, 0.0) - a
    db = tl.load(guide + plane + at, inside, 0.0) - b
    t = c0 * n0 * c0 * n0 + c1 * n1 * c1 * n1 + c2 * n2 * c2 * n2
    return c0, c1, c2, tl.maximum(1.0 - t - guide_gain * (da * da + db * db), 0.0)


@triton.jit
def smooth_forward(v, guide, noise, out, offsets, height, width, per_code, narrowest, widest,
                   result_gain, guide_gain, eps, own, count: tl.constexpr, block: tl.constexpr):
    image = tl.program_id(1).to(tl.int64)
    p = tl.program_id(0) * block + tl.arange(0, block)
    y, x = p // width, p % width
    inside, plane = p < height * width, height * width
    v, out, guide, noise = (v + image * 3 * plane, out + image * 3 * plane,
                            guide + image * 2 * plane, noise + image * plane)
    v0, v1, v2, a, b, n0, n1, n2 = shared(v, guide, noise, p, y, x, inside, height, width,
                                          per_code, narrowest, widest, result_gain, eps)
    weights = tl.zeros([block], tl.float32) + own
    t0 = tl.zeros([block], tl.float32)
    t1, t2 = t0, t0
    for k in range(count):
        at = neighbour(offsets, k, y, x, height, width)
        c0, c1, c2, left = change(v, guide, at, inside, plane, v0, v1, v2, a, b, n0, n1, n2,
                                  guide_gain)
        w = left * left
        weights += w
        t0 += w * c0
        t1 += w * c1
        t2 += w * c2
    tl.store(out + p, v0 + t0 / weights, inside)
    tl.store(out + plane + p, v1 + t1 / weights, inside)
    tl.store(out + 2 * plane + p, v2 + t2 / weights, inside)


@triton.jit
def smooth_backward(v, guide, noise, out, offsets, height, width, per_code, narrowest, widest,
                    result_gain, guide_gain, eps, own, g, dv, count: tl.constexpr,
                    block: tl.constexpr):
    image = tl.program_id(1).to(tl.int64)
    p = tl.program_id(0) * block + tl.arange(0, block)
    y, x = p // width, p % width
    inside, plane = p < height * width, height * width
    v, out, g, dv = (v + image * 3 * plane, out + image * 3 * plane, g + image * 3 * plane,
                     dv + image * 3 * plane)
    guide, noise = guide + image * 2 * plane, noise + image * plane
    v0, v1, v2, a, b, n0, n1, n2 = shared(v, guide, noise, p, y, x, inside, height, width,
                                          per_code, narrowest, widest, result_gain, eps)
    weights = tl.zeros([block], tl.float32) + own
    for k in range(count):
        at = neighbour(offsets, k, y, x, height, width)
        c0, c1, c2, left = change(v, guide, at, inside, plane, v0, v1, v2, a, b, n0, n1, n2,
                                  guide_gain)
        weights += left * left
    # out = v + total / weights
    g0 = tl.load(g + p, inside, 0.0)
    g1 = tl.load(g + plane + p, inside, 0.0)
    g2 = tl.load(g + 2 * plane + p, inside, 0.0)
    m0 = tl.load(out + p, inside, 0.0) - v0
    m1 = tl.load(out + plane + p, inside, 0.0) - v1
    m2 = tl.load(out + 2 * plane + p, inside, 0.0) - v2
    by_weights = -(g0 * m0 + g1 * m1 + g2 * m2) / weights
    h0, h1, h2 = g0 / weights, g1 / weights, g2 / weights
    s0, s1, s2 = g0, g1, g2
    for k in range(count):
        at = neighbour(offsets, k, y, x, height, width)
        c0, c1, c2, left = change(v, guide, at, inside, plane, v0, v1, v2, a, b, n0, n1, n2,
                                  guide_gain)
        w = left * left
        by_t = -2.0 * left * (by_weights + h0 * c0 + h1 * c1 + h2 * c2)
        d0 = w * h0 + 2.0 * by_t * c0 * n0 * n0
        d1 = w * h1 + 2.0 * by_t * c1 * n1 * n1
        d2 = w * h2 + 2.0 * by_t * c2 * n2 * n2
        tl.atomic_add(dv + at, d0, inside)
        tl.atomic_add(dv + plane + at, d1, inside)
        tl.atomic_add(dv + 2 * plane + at, d2, inside)
        s0 -= d0 + 2.0 * by_t * c0 * c0 * n0 * n0 / (v0 + eps)
        s1 -= d1 + 2.0 * by_t * c1 * c1 * n1 * n1 / (v1 + eps)
        s2 -= d2 + 2.0 * by_t * c2 * c2 * n2 * n2 / (v2 + eps)
    tl.atomic_add(dv + p, s0, inside)
    tl.atomic_add(dv + plane + p, s1, inside)
    tl.atomic_add(dv + 2 * plane + p, s2, inside)


@functools.cache
def offsets_on(device: torch.device, offsets: tuple[tuple[int, int], ...]) -> Tensor:
    return torch.tensor(offsets, dtype=torch.int32, device=device)


class Smoothed(torch.autograd.Function):
    """kernel_filter.smoothed: v [N,3,H,W], noise [N,1,H,W], guide [N,2,H,W], all in fp32; its
    constants are offsets, and WIDTH_PER_CODE, WIDTH_MIN, the widest, RESULT_GAIN, GUIDE_GAIN, EPS
    and the pixel's own weight.
    """

    @staticmethod
    def forward(ctx, v: Tensor, noise: Tensor, guide: Tensor, offsets: tuple[tuple[int, int], ...],
                *constants: float) -> Tensor:
        images = [t.contiguous() for t in (v, guide, noise)]
        out = torch.empty_like(images[0])
        ctx.rest = offsets_on(v.device, offsets), *v.shape[2:], *constants
        ctx.count = len(offsets)
        launched(smooth_forward, *images, out, *ctx.rest, count=ctx.count)
        ctx.save_for_backward(*images, out)
        return out

    @staticmethod
    def backward(ctx, g: Tensor):
        saved = ctx.saved_tensors
        dv = torch.zeros_like(saved[0])
        launched(smooth_backward, *saved, *ctx.rest, g.contiguous(), dv, count=ctx.count)
        return dv, *[None] * len(ctx.rest)
