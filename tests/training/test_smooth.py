"""The last steps of family K's filter: smoothing along the result, what it lacks, and mixing."""
from __future__ import annotations

import numpy as np
import pytest
import torch

from export import smooth as last
from tests.training.test_kernel import picture, tensor
from training import kernel_filter


def noise_of(out: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Noise codes where the result is what the 5x5 means are, and all pixels are as sure."""
    return last.noise_codes(np.concatenate((np.ones_like(out[..., :1]), first), -1), out)


def smoothed(out: np.ndarray, first: np.ndarray, codes: np.ndarray,
             is_far: bool = False) -> np.ndarray:
    return last.smoothed(out, noise_of(out, first), last.guide_of(codes), is_far)


def inputs(albedo: np.ndarray | None, normal: np.ndarray | None) -> np.ndarray:
    """The network's codes with these [H,W,3], zeros in the channels of the radiance."""
    shape = (normal if albedo is None else albedo).shape[:2]
    codes = np.zeros((*shape, 12), np.uint8)
    for at, flag, v in ((3, 9, albedo), (6, 10, normal)):
        if v is not None:
            codes[..., at:at + 3], codes[..., flag] = v, 255
    return codes


def noisy(height: int, width: int) -> list[np.ndarray]:
    """Result and input of the smoothing, and codes with normals: two surfaces with noise left in
    the result, of 3 %, and much more in the input."""
    rng = np.random.default_rng(5)
    right = (np.arange(width) >= width // 2)[None, :, None]
    level = np.where(right, [0.2, 0.5, 3], [1, 0.1, 0])
    out = level * (1 + 0.03 * rng.normal(size=(height, width, 3)))
    first = out * np.exp(0.2 * rng.normal(size=out.shape))
    normal = rng.integers(120, 136, out.shape) - right * [30, 0, 0]
    return [*(v.astype(np.float32) for v in (out, first)), inputs(None, normal)]


@pytest.mark.parametrize("is_far", [False, True])
@pytest.mark.parametrize("height, width", [(32, 48), (5, 3), (1, 1), (17, 9)])
def test_smoothing_of_torch_equals_the_reference(height, width, is_far):
    images = noisy(height, width)
    expected = smoothed(*images, is_far)
    out, first, codes = (tensor(v.astype(np.float32)) for v in images)
    noise = kernel_filter.noise_codes(first, out)
    got = picture(kernel_filter.smoothed(out, noise, kernel_filter.guide_of(codes), is_far))
    np.testing.assert_allclose(got, expected, rtol=1e-5)
    assert expected.dtype == np.float32
    if width > 40:
        left = np.s_[:, :width // 2, 0]
        assert expected[left].std() < 0.5 * images[0][left].std()


@pytest.mark.parametrize("is_far", [False, True])
def test_smoothing_is_its_definition(is_far):
    """Pixel by pixel in double precision, of few pixels: most of the others lie outside."""
    images = noisy(7, 18)
    out, first = (v.astype(float) for v in images[:2])
    x, y, z = np.moveaxis(images[2][..., 6:9].astype(int), -1, 0)
    guide = np.stack(((2 * x - y - z + 510) // 8, 7 * (y - z + 255) // 32), -1)
    codes = 384 * np.abs(first - out).sum(-1) / (out.sum(-1) + 0.06)
    codes = np.minimum(np.floor(codes + 0.5), 255)
    expected = np.empty_like(out)
    far = 2, 4, 6, 12
    columns = [(s * k, 0) for k in (far if is_far else (2, 6)) for s in (-1, 1)]
    rows = [(0, s * k) for k in (far if is_far else (2,)) for s in (-1, 1)]
    for y, x in np.ndindex(7, 18):
        v = sum(codes[y, min(max(x + k, 0), 17)] for k in (-1, 0, 1)) / 384
        gain = 0.5 / min(max(v, 0.001), 0.67 if is_far else 0.6) / (out[y, x] + 0.02)
        weights, total = 2.5 if is_far else 1.0, np.zeros(3)
        for dx, dy in columns + rows:
            q = min(max(y + dy, 0), 6), min(max(x + dx, 0), 17)
            change, d = out[q] - out[y, x], guide[q] - guide[y, x]
            t = ((change * gain)**2).sum() + 0.012288 * (d**2).sum()
            weights += max(1 - t, 0)**2
            total += max(1 - t, 0)**2 * change
        expected[y, x] = out[y, x] + total / weights
    np.testing.assert_allclose(smoothed(*images, is_far), expected, rtol=1e-5)


def test_smoothing_leaves_what_is_even_or_clean():
    out, first, codes = noisy(16, 40)
    even = np.full_like(out, 0.37)
    assert np.array_equal(smoothed(even, first, codes), even)
    changed = smoothed(out, first, codes)
    assert not np.array_equal(changed, out)
    assert (changed >= out.min((0, 1)) * (1 - 1e-6)).all()
    assert (changed <= out.max((0, 1)) * (1 + 1e-6)).all()
    ramp = np.broadcast_to(np.linspace(0.5, 1.5, 64, dtype=np.float32)[None, :, None], (16, 64, 3))
    flat = inputs(None, np.full(ramp.shape, 128, np.uint8))
    np.testing.assert_allclose(smoothed(ramp, ramp, flat), ramp, rtol=1e-3)


@pytest.mark.parametrize("edge", ["albedo", "normal"])
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_smoothing_stops_at_edges(edge, channel):
    """A step of 8 % in the result, which the noise would hide, stays where the normals have one, or
    without them the albedo; without it the sides mix."""
    right = np.broadcast_to(np.arange(32)[None, :, None] >= 16, (16, 32, 3))
    out = np.where(right, np.float32(1.08), np.float32(1))
    first, feature = out * np.float32(1.3), np.full(out.shape, 128, np.uint8)
    codes = (feature, None) if edge == "albedo" else (None, feature)
    mixed = smoothed(out, first, inputs(*codes))
    assert (mixed[:, 15] > out[:, 15]).all() and (mixed[:, 16] < out[:, 16]).all()
    feature[:, 16:, channel] += 50
    assert np.array_equal(smoothed(out, first, inputs(*codes)), out)


def test_normals_go_before_albedo():
    codes = inputs(np.full((2, 3, 3), 200, np.uint8), np.full((2, 3, 3), [255, 0, 128], np.uint8))
    assert (last.guide_of(codes) == [(510 - 128 + 510) // 8, 7 * (255 - 128) // 32]).all()
    codes[..., 10] = 0
    assert (last.guide_of(codes) == 100).all()
    codes[..., 3:6] = 0
    assert (last.guide_of(codes) == 0).all()


def lacking(height: int, width: int, share: float) -> list[np.ndarray]:
    """Result, divisor and exposed radiance of a picture whose result has `share` of the light, and
    whose samples are either found or not."""
    rng = np.random.default_rng(6)
    light = np.linspace(0.5, 2, width)[None, :, None] * np.array([1, 0.7, 0.4])
    light = np.broadcast_to(light, (height, width, 3))
    smooth = np.broadcast_to(np.array([0.8, 0.5, 0.3]), light.shape)
    found = (rng.random((height, width, 1)) < 0.25) * 4.0
    return [v.astype(np.float32) for v in (share * light, smooth, light * smooth * found)]


def corrected(out: np.ndarray, smooth: np.ndarray, radiance: np.ndarray) -> np.ndarray:
    noise = noise_of(out, radiance / smooth)
    return last.corrected(out, smooth, noise, radiance)


@pytest.mark.parametrize("share", [0.7, 0.9, 1.2])
def test_light_that_is_missing_comes_back(share):
    out, smooth, radiance = lacking(160, 200, share)
    error = corrected(out, smooth, radiance) / (out / np.float32(share)) - 1
    assert np.abs(error).mean() < 0.5 * abs(share - 1)
    assert abs(error.mean()) < 0.3 * abs(share - 1)


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_little_light_that_is_missing_everywhere_comes_back(share):
    """Too little for the cells beside one to tell it from chance."""
    out, smooth, radiance = lacking(300, 400, share)
    error = corrected(out, smooth, radiance) / (out / np.float32(share)) - 1
    assert abs(error.mean()) < 0.15 * abs(share - 1)


def test_chance_changes_little():
    out, smooth, radiance = lacking(160, 200, 1.0)
    change = corrected(out, smooth, radiance) / out - 1
    assert 0 < np.abs(change).max() < 0.12 and np.abs(change).mean() < 0.02


@pytest.mark.parametrize("sparks, most", [(1, 0), (2, 0.1), (3, 0.2)])
def test_single_sparks_are_chance(sparks, most):
    """However bright: a filter that left them out was right."""
    out, smooth, _ = lacking(160, 200, 1.0)
    radiance = out * smooth
    radiance[80, 100:100 + sparks] = 60000
    noise = np.full((*out.shape[:2], 1), 255, np.uint8)
    change = last.corrected(out, smooth, noise, radiance) / out - 1
    assert 0 <= change.min() and change.max() <= most + 1e-6


@pytest.mark.parametrize("one_in, least, most", [(500, 0, 0.04), (40, 0.3, 0.5)])
def test_few_sparks_are_fireflies(one_in, least, most):
    """Bright ones, whose light in the mean is that of the picture either way."""
    out, smooth, _ = lacking(160, 200, 1.0)
    rng = np.random.default_rng(7)
    hot = rng.random((160, 200, 1)) < 1 / one_in
    radiance = out * smooth * np.where(hot, np.float32(one_in / 2), np.float32(1))
    noise = np.full((*out.shape[:2], 1), 255, np.uint8)
    gain = np.mean(last.corrected(out, smooth, noise, radiance) / out - 1)
    assert least <= gain <= most


def test_pixels_without_noise_stay():
    out, smooth, radiance = lacking(64, 80, 0.8)
    even = np.s_[:, 30:50]
    radiance[even] = out[even] * smooth[even]
    got = corrected(out, smooth, radiance)
    assert np.array_equal(got[even], out[even])
    assert (got[:, :20] > out[:, :20]).all()


def test_nothing_to_correct_is_the_same_to_the_bit():
    out, smooth, _ = lacking(33, 47, 1.0)
    assert np.array_equal(corrected(out, smooth, out * smooth), out)


@pytest.mark.parametrize("height, width", [(48, 80), (5, 3), (1, 1), (33, 130)])
def test_correction_of_torch_equals_the_reference(height, width):
    images = lacking(height, width, 0.8)
    out, smooth, radiance = (tensor(v) for v in images)
    noise = kernel_filter.noise_codes(radiance / smooth, out)
    got = picture(kernel_filter.corrected(out, smooth, noise, radiance))
    np.testing.assert_allclose(got, corrected(*images), rtol=2e-5)


def at_pixels(cells: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Values of cells [h,w] bilinear between their centres, pixel by pixel, in double precision."""
    values = np.empty(shape)
    for y, x in np.ndindex(shape):
        fy, fx = (y + 8.5) / 16, (x + 8.5) / 16
        rows, columns = ([min(max(int(f) + k, 0), n - 1) for k in (-1, 0)]
                         for f, n in zip((fy, fx), cells.shape, strict=True))
        a, b = ((1 - fx % 1) * cells[j, columns[0]] + fx % 1 * cells[j, columns[1]] for j in rows)
        values[y, x] = (1 - fy % 1) * a + fy % 1 * b
    return values


def test_correction_is_its_definition():
    """Cell by cell in double precision."""
    out, smooth, radiance = lacking(140, 250, 0.8)
    noise = noise_of(out, radiance / smooth)[..., 0].astype(float)
    v = (out.astype(float) * smooth).sum(-1)
    q, share = (radiance.sum(-1) - v) / (v + 0.15), np.minimum(noise / 20, 1)
    cells = np.zeros((4, 4 + 9 + 1, 6 + 16 + 6))
    for y, x in np.ndindex(v.shape):
        cells[:, y // 16 + 4, x // 16 + 6] += (q[y, x], q[y, x]**2,
                                               v[y, x] / (v[y, x] + 0.15) * share[y, x],
                                               min(max(q[y, x] - 2, 0), 1))

    def lacks(a, b, c, n, sparks):
        share_sure = max(1 - b / (a * a + 1e-6), 0)
        return min(max(share_sure * min(a, 20 + sparks * n * n) / (c + 32), -0.5), 0.5)

    gain = np.empty((9, 16))
    for j, i in np.ndindex(9, 16):
        wide = lacks(*cells[:, j:j + 6, i:i + 13].sum((1, 2)), 0.1)
        a, b, c, n = cells[:, j + 3:j + 6, i + 4:i + 9].sum((1, 2))
        gain[j, i] = min(max(wide + lacks(a - wide * c, b, c, n, 0.3), -0.5), 0.5)
    expected = out * (1 + at_pixels(gain, v.shape) * share)[..., None]
    np.testing.assert_allclose(last.corrected(out, smooth, noise[..., None], radiance), expected,
                               rtol=1e-5)


def textured(height: int, width: int, noise: float) -> list[np.ndarray]:
    """A result that lost a texture, noise codes of about `noise`, and the radiance."""
    rng = np.random.default_rng(8)
    out = np.linspace(0.5, 1, 3 * height * width).reshape(height, width, 3)
    codes = np.clip(noise * rng.uniform(0.5, 1.5, (height, width, 1)), 0, 255)
    radiance = out * (1 + codes / 384 * rng.normal(size=out.shape))
    return [out.astype(np.float32), codes.astype(np.uint8), radiance.astype(np.float32)]


ALONE = [False, True]
CALM = np.array([0, 0.16, 0.21, 1], np.float32)


@pytest.mark.parametrize("height, width", [(48, 80), (5, 3), (1, 1), (3, 330)])
@pytest.mark.parametrize("noise", [0.5, 8, 16])
@pytest.mark.parametrize("calm", CALM)
@pytest.mark.parametrize("is_alone", ALONE)
def test_mixing_of_torch_equals_the_reference(height, width, noise, calm, is_alone):
    images = textured(height, width, noise)
    images[1][:, width // 2:] //= 2
    images[1][0, ::5] = 90
    images_of_torch = (tensor(v.astype(np.float32)) for v in images)
    got = picture(kernel_filter.mixed(*images_of_torch, torch.full((1, 1, 1, 1), is_alone),
                                      torch.full((1, 1, 1, 1), float(calm))))
    expected = last.mixed(*images, is_alone, calm)
    assert expected.dtype == np.float32
    np.testing.assert_allclose(got, expected, rtol=3e-6)


@pytest.mark.parametrize("is_alone, calm, code, share", [
    (False, 0, 0, 0.5), (False, 0, 6, 0.5), (False, 0, 8, 0.25), (False, 0, 10, 0),
    (True, 0, 2, 0.5), (True, 0, 14, 0.25), (True, 0, 18, 0), (True, 0, 255, 0),
    (False, 0.14, 8, 0.25), (False, 0.18, 16, 0.0), (False, 0.18, 12.8, 0.25),
    (True, 0.17, 14, 0.25), (True, 0.21, 22.4, 0.25),
    (False, 1, 24, 0.5), (False, 1, 32, 0.25), (True, 0.25, 40, 0.5), (True, 0.21, 12, 0.6),
    (True, 1, 20, 0.7), (True, 1, 56, 0.25)])
def test_share_of_the_input_falls_with_the_noise(is_alone, calm, code, share):
    """A code counts a fourth in a calm frame; between, code 12.8 counts 8."""
    out = np.zeros((4, 200, 3), np.float32)
    codes = np.full((4, 200, 1), int(code), np.uint8)
    codes[:, ::5] += np.uint8(np.rint(5 * (code - int(code))))
    got = last.mixed(out, codes, np.full_like(out, 1e-3), is_alone, np.float32(calm))
    np.testing.assert_allclose(got[:, 80:120].mean(), share * 1e-3, atol=2e-5)
    got = last.mixed(out, codes, np.full_like(out, 1e-3), is_alone, np.float32(calm), True)
    clean = share if is_alone else min(share, 0.25)
    np.testing.assert_allclose(got[:, 80:120].mean(), clean * 1e-3, atol=2e-5)


def test_runs_without_noise_do_not_hide_that_of_others():
    """A sky beside a wall: the wall's noise counts in full, at 10 and within the sky's windows."""
    out, noise = np.zeros((4, 320, 3), np.float32), np.zeros((4, 320, 1), np.uint8)
    noise[:, :80] = 10
    got = last.mixed(out, noise, np.ones_like(out), False, CALM[0])
    assert got[:, :130].max() < 1e-6 and np.allclose(got[:, 160:], 0.5)


def test_sparks_stay_out():
    """In a picture of little noise, half of which comes back."""
    out, noise = np.zeros((4, 160, 3), np.float32), np.full((4, 160, 1), 2, np.uint8)
    noise[2, 80], noise[2, 90] = 255, 96
    got = last.mixed(out, noise, np.ones_like(out), False, CALM[0])
    assert got[2, 80].max() == 0 and (got[0] > 0.45).all()
    np.testing.assert_allclose(got[2, 90] / got[2, 91], 0.5, atol=0.01)


@pytest.mark.parametrize("times, share", [(3, 0.5), (9, 0.375), (13, 0), (60000, 0)])
def test_faint_sparks_of_calm_frames_stay(times, share):
    """They may be a lamp of one pixel: by how much brighter than the result, 0.15 apart."""
    out, noise = np.full((4, 160, 3), 0.2, np.float32), np.full((4, 160, 1), 2, np.uint8)
    radiance = out.copy()
    noise[2, 80], radiance[2, 80] = 255, 0.2 + 0.25 * times
    got = last.mixed(out, noise, radiance, False, CALM[-1])
    np.testing.assert_allclose((got - out)[2, 80] / (radiance - out)[2, 80], share, atol=1e-4)


@pytest.mark.parametrize("is_alone", ALONE)
@pytest.mark.parametrize("calm", CALM)
def test_mixing_is_its_definition(is_alone, calm):
    """Run by run in double precision."""
    out, noise, radiance = textured(3, 250, 11)
    noise[:, 160:] //= 20  # a mean below 1
    noise[1, ::7], radiance[1, ::21] = 90, 20
    expected = np.empty_like(out)
    part = min(max((calm - (0.17 if is_alone else 0.14)) / 0.08, 0), 1)
    most = 0.5 + is_alone * 0.2 * part
    for y in range(3):
        runs = [noise[y, x:x + 16, 0].astype(float) for x in range(0, 250, 16)]
        share = []
        for i in range(len(runs)):
            codes = [c for r in runs[max(i - 4, 0):i + 5] if r.mean() >= 1 for c in r]
            mean = np.mean(codes or [0]) * (1 - 0.75 * part)
            share.append(min(max(1 - (mean - 2) / (16 if is_alone else 8), 0), most))
        for x in range(250):
            at = min(max((x - 7.5) / 16, 0), len(runs) - 1)
            i = min(int(at), len(runs) - 2)
            s = share[i] + (at - i) * (share[i + 1] - share[i])
            v = out[y, x].sum()
            beyond = (radiance[y, x].sum() - v) / (v + 0.15)
            s *= max(min(max(2 - noise[y, x, 0] / 64, 0), 1),
                     part * min(max((12 - beyond) / 4, 0), 1))
            expected[y, x] = out[y, x] + s * (radiance[y, x] - out[y, x])
    assert 0 < np.ptp(expected - out)
    got = last.mixed(out, noise, radiance, is_alone, calm)
    np.testing.assert_allclose(got, expected, rtol=2e-6)
