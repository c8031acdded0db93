"""Grain of albedo and normals: what counts as it, and the same in numpy, PyTorch and the core."""
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from export import grain, kernel, pixels
from export.quantize import write_tensors
from export.quantize_kernel import tensors_of
from tests.training.test_reference_core import run
from tests.training.tools import in_both
from training import kernel_model, nets
from training.grain import without_grain

GOLDEN = Path(__file__).resolve().parent.parent / "golden" / "kernel" / "weights.tza"
INSIDE = np.s_[16:-16, 16:-16]  # where windows see no border
SIZES = ((64, 80), (37, 45), (8, 8), (9, 7), (1, 30), (30, 1), (1, 1))


def noisy_light(height: int, width: int, noise: int = 110) -> np.ndarray:
    """Codes [H,W] of the light, which differ by up to `noise`."""
    codes = np.random.default_rng(6).integers(100, 101 + noise, (384, 384)).astype(np.uint8)
    return codes[:height, :width]


def without(albedo: np.ndarray | None, normal: np.ndarray | None, noise: int = 110) -> tuple:
    """The reference's, of features [H,W,3], the albedo without black pixels."""
    one = np.ones_like(normal if albedo is None else albedo)
    codes = kernel.encode(one, albedo, normal, False)
    codes[..., 1] = noisy_light(*one.shape[:2], noise)
    return grain.without_grain(albedo, normal, codes)


def cleaned(albedo: np.ndarray, noise: int = 110) -> np.ndarray:
    return without(albedo, None, noise)[0]


def planes(albedo: np.ndarray | None, normal: np.ndarray | None) -> torch.Tensor:
    """Those that a model gets, [1,12,H,W]."""
    x = torch.zeros(1, 12, *(normal if albedo is None else albedo).shape[:2])
    for at, flag, v in ((3, 9, albedo), (6, 10, None if normal is None else normal * 0.5 + 0.5)):
        if v is not None:
            x[:, at:at + 3] = torch.from_numpy(v.transpose(2, 0, 1).astype(np.float32))
            x[:, flag] = 1
    return x


def of_planes(x: torch.Tensor, noise: int = 110) -> torch.Tensor:
    light = torch.from_numpy(noisy_light(*x.shape[2:], noise)).to(x.dtype)
    return without_grain(x, light.expand(len(x), 1, -1, -1))


def in_pytorch(albedo: np.ndarray, noise: int = 110) -> np.ndarray:
    """`cleaned` in PyTorch."""
    return of_planes(planes(albedo, None), noise)[0, 3:6].numpy().transpose(1, 2, 0)


def salt(height: int, width: int, seed: int = 1, share: float = 0.5) -> np.ndarray:
    """Albedo of single bright and dark pixels, [H,W,3]."""
    bright = np.random.default_rng(seed).random((height, width, 1)) < share
    return np.where(bright, np.float32([0.9, 0.8, 0.7]), np.float32([0.1, 0.2, 0.05]))


def tilted(mask: np.ndarray) -> np.ndarray:
    """Normals [H,W,3] that are up in these pixels and 0, as before fog, in others."""
    return np.where(mask, np.float32([0.1, 0.2, 0.97]), np.float32(0))


def half_grainy(height: int, width: int) -> np.ndarray:
    """Albedo [H,W,3] whose grain fades from all to none at a third of the width; then lines."""
    rng = np.random.default_rng(3)
    a = np.repeat(rng.random((height, 1, 3), np.float32) * 0.5 + 0.3, width, 1)
    fade = np.clip(2 - np.arange(width) / width * 6, 0, 1)[:, None]
    a *= 1 - 0.9 * fade * (rng.random((height, width, 1)) < 0.4)
    a[:, width // 2::7] *= 0.8
    return a.astype(np.float32)


# ---- What it does --------------------------------------------------------------------------------

@pytest.mark.parametrize("share", [0.15, 0.5, 0.85])
def test_white_noise_becomes_its_mean(share):
    albedo = salt(128, 128, share=share)
    out = cleaned(albedo)
    assert (out[INSIDE].std((0, 1)) < albedo[INSIDE].std((0, 1)) / 5).all()
    np.testing.assert_allclose(out.mean((0, 1)), albedo.mean((0, 1)), atol=0.02)


def test_the_mean_is_that_of_the_neighbourhood():
    """Grain with a tint that changes across the picture keeps the tint."""
    tint = np.ones((1, 256, 3), np.float32)
    tint[..., 2] = np.linspace(0.1, 1, 256)
    albedo, want = salt(96, 256) * tint, salt(96, 256).mean((0, 1)) * tint
    off, before = (np.abs(v - want)[INSIDE].mean((0, 1)) for v in (cleaned(albedo), albedo))
    assert (off < before / 5).all() and off[2] < 0.03


def squares(side: int) -> np.ndarray:
    y, x = np.mgrid[:96, :96] // side
    return np.where(((x + y) % 2)[..., None], np.float32([0.9, 0.8, 0.2]), np.float32(0.1))


def lines() -> np.ndarray:
    a = np.full((96, 96, 3), 0.8, np.float32)
    a[:, ::7], a[5::13] = 0.1, (0.1, 0.3, 0.5)
    return a


def smooth_diagonals() -> np.ndarray:
    """Antialiased lines of one and a half pixels, each ten."""
    y, x = np.mgrid[:96, :96]
    apart = np.abs((x + y) / np.sqrt(2) % 10 - 5)
    return (0.1 + 0.7 * np.clip(1.25 - apart, 0, 1)[..., None] * np.ones(3)).astype(np.float32)


def edges() -> np.ndarray:
    y, x = np.mgrid[:96, :96]
    a = np.where((x > 41)[..., None], np.float32([0.9, 0.1, 0.1]), np.float32(0.2))
    a[(y > 50) & (x < 30)] = 0.95
    a[x + 2 * y > 220] = 0.02, 0.5, 0.03
    return a


def gradients() -> np.ndarray:
    y, x = np.mgrid[:96, :96] / 96
    return np.stack((x, 1 - y, (x * y) ** 2), -1).astype(np.float32) * 0.98 + 0.01


def weak_noise() -> np.ndarray:
    noise = np.random.default_rng(2).normal(0, 2 / 255, (96, 96, 1))
    return (np.float32([0.3, 0.5, 0.7]) + noise).astype(np.float32)


@pytest.mark.parametrize("albedo", [
    np.full((96, 96, 3), 0.37, np.float32), gradients(), squares(4), squares(7), lines(),
    smooth_diagonals(), edges(), weak_noise()],
    ids=["constant", "gradients", "squares4", "squares7", "lines", "diagonals", "edges", "weak"])
def test_what_pixels_resolve_stays(albedo):
    assert np.array_equal(cleaned(albedo), albedo)
    assert np.array_equal(in_pytorch(albedo), albedo)


def test_grain_beside_a_texture_leaves_the_texture_alone():
    albedo = np.concatenate((salt(96, 96), squares(4), lines()), 1)
    out = cleaned(albedo)
    assert np.array_equal(out[:, 96 + 24:], albedo[:, 96 + 24:])
    assert out[INSIDE][:, :56].std() < albedo[INSIDE][:, :56].std() / 3


def test_what_varies_much_more_than_the_light_is_texture():
    """Of many samples, where the light has little noise: neither features have much."""
    albedo, normal = salt(96, 96), tilted(salt(96, 96, 2)[..., :1] > 0.5)
    for noise in (0, 6):
        out = without(albedo, normal, noise)
        assert np.array_equal(out[0], albedo) and np.array_equal(out[1], normal)
    some, all_of_it = (np.abs(cleaned(albedo, n) - albedo)[INSIDE].mean() for n in (71, 110))
    assert 0.2 * all_of_it < some < 0.8 * all_of_it


def test_normals_lose_grain_and_keep_edges():
    grainy = tilted(salt(96, 96)[..., :1] > 0.5)
    sharp = np.repeat(tilted(squares(7)[..., :1] > 0.5), 2, 1)
    _, out = without(None, np.concatenate((grainy, sharp), 1))
    assert out[INSIDE][:, :56].std(axis=(0, 1)).max() < grainy[INSIDE].std((0, 1)).max() / 5
    np.testing.assert_allclose(out[INSIDE][:, :56].mean((0, 1)), grainy.mean((0, 1)), atol=0.03)
    assert np.array_equal(out[:, 96 + 24:], sharp[:, 24:])


def test_weak_grain_of_normals_goes_and_none_of_rounding():
    """As of 4 samples behind fog, which the regression on normals would take for shading."""
    noise = np.random.default_rng(4).normal(0, 0.05, (96, 96, 3))
    normal = (np.float32([0.1, 0.2, 0.8]) + noise).astype(np.float32)
    _, out = without(None, normal)
    assert out[INSIDE].std((0, 1)).max() < normal.std((0, 1)).max() / 4
    normal = (np.float32([0.1, 0.2, 0.8]) + noise / 10).astype(np.float32)
    assert np.array_equal(without(None, normal)[1], normal)


def test_what_is_before_grainy_normals_is_no_texture():
    """Fog, which gives some pixels its own albedo and no normal, in light of little noise."""
    here = salt(96, 96)[..., :1] > 0.5
    albedo = np.where(here, np.float32([0.9, 0.8, 0.7]), np.float32(0.1))
    even = np.broadcast_to(np.float32([0, 0.6, 0.8]), albedo.shape)
    (kept, same), (gone, _) = (without(albedo, n, 50) for n in (even, tilted(here)))
    assert np.array_equal(same, even) and np.array_equal(kept, albedo)
    assert gone[INSIDE].std((0, 1)).max() < albedo.std((0, 1)).max() / 4


# ---- The same everywhere -------------------------------------------------------------------------

@pytest.mark.parametrize("height, width", SIZES)
def test_pytorch_equals_numpy(height, width):
    rng = np.random.default_rng(height * 100 + width)
    for albedo in (rng.random((height, width, 3), np.float32), salt(height, width, 4),
                   half_grainy(height, width), np.full((height, width, 3), 0.5, np.float32)):
        np.testing.assert_allclose(in_pytorch(albedo), cleaned(albedo), atol=2e-6)


@pytest.mark.parametrize("height, width", SIZES)
def test_normals_in_pytorch_equal_numpy(height, width):
    rng = np.random.default_rng(height)
    for normal in (rng.normal(0, 0.5, (height, width, 3)), half_grainy(height, width) * 2 - 1,
                   tilted(salt(height, width)[..., :1] > 0.5)):
        normal = np.clip(normal, -1, 1).astype(np.float32)
        for albedo in (None, half_grainy(height, width)):
            got = of_planes(planes(albedo, normal))[0].numpy().transpose(1, 2, 0)
            want = without(albedo, normal)
            np.testing.assert_allclose(got[..., 6:9] * 2 - 1, want[1], atol=4e-6)
            if albedo is not None:
                np.testing.assert_allclose(got[..., 3:6], want[0], atol=2e-6)


def test_all_degrees_of_grain_are_compared():
    """That what is compared here has shares of nothing, all and between."""
    albedo = half_grainy(64, 320)
    codes = kernel.encode(albedo, albedo, None, False)[..., 3:6]
    products = np.concatenate((grain.products(codes), grain.light_steps(noisy_light(64, 320))))
    sums = grain.cell_sums(products, grain.SIDE)
    cells = grain.cell_grain(sums, 1, grain.OF_ALBEDO_LEAST)
    assert (cells[0] == 0).any() and (cells[0] == 1).any() and len(np.unique(cells[0])) > 10
    np.testing.assert_allclose(in_pytorch(albedo), cleaned(albedo), atol=2e-6)


def test_what_has_no_albedo_is_left_alone_and_counts_for_nothing():
    """In a batch of pictures with and without, one of them smaller and padded with zeros.
    (Behind the centre of its last cell values would go on, not stay: here there is no such pixel.)
    """
    albedo = [salt(40, 48, 1), salt(40, 48, 2), half_grainy(27, 35)]
    batch = torch.zeros(3, 12, 40, 48)
    for k, a in enumerate(albedo):
        batch[k, 3:6, :a.shape[0], :a.shape[1]] = torch.from_numpy(a.transpose(2, 0, 1).copy())
    batch[0, 9], batch[2, 9, :27, :35] = 1, 1
    batch[:, 6:9] = torch.rand(3, 3, 40, 48)
    out = of_planes(batch)
    assert torch.equal(out[1], batch[1]) and torch.equal(out[:, 6:], batch[:, 6:])
    assert (out[2, 3:6, 27:] == 0).all() and (out[2, 3:6, :, 35:] == 0).all()
    for k in (0, 2):
        h, w = albedo[k].shape[:2]
        np.testing.assert_allclose(out[k, 3:6, :h, :w].numpy().transpose(1, 2, 0),
                                   cleaned(albedo[k]), atol=2e-6)


def test_half_precision_around_it_changes_nothing():
    x = planes(half_grainy(32, 96), half_grainy(32, 96) - 0.5)
    with torch.autocast("cpu", torch.bfloat16):
        got = of_planes(x)
    assert got.dtype == torch.float32 and torch.equal(got, of_planes(x))


@pytest.mark.parametrize("height, width", [(37, 45), (16, 33), (21, 19), (11, 9)])
def test_integers_in_pytorch_equal_the_reference(height, width, monkeypatch):
    model = kernel.load(GOLDEN)
    images, want, got = in_both(model, height, width)
    assert np.abs(got - want).mean() < 2e-3 and np.median(np.abs(got - want)) < 1e-5
    monkeypatch.setattr(kernel, "without_grain", lambda albedo, normal, codes: (albedo, normal))
    other = kernel.run_frame(model, pixels.Frame(images, "hdr", 1.0))
    assert np.median(np.abs(other - want)) > 5e-3


@pytest.mark.parametrize("bilateral", [0, *kernel.LAST_STEPS])
def test_models_that_ask_for_it_see_the_albedo_without_grain(bilateral, monkeypatch):
    """One without the rule that gets it clean sees what one with it sees; not so the guide, which
    is that of the albedo as it is where there are no normals (here those are smooth)."""
    torch.manual_seed(1)
    model = nets.build("k12", 0).eval()
    model.bilateral = bilateral
    x = torch.rand(1, 12, 64, 64) * 0.5
    x[:, 9:11], x[:, 11] = 1, 0
    albedo = salt(64, 64)
    x[:, 3:6] = torch.from_numpy(albedo.transpose(2, 0, 1).copy())
    x[:, 6:9] = torch.linspace(0.2, 0.8, 64)
    x[:, :3] = torch.rand(1, 1, 64, 64)
    light = kernel_model.encode(kernel_model.from_codes(model.transfer, x[:, :3]), x, x.dtype)
    clean = without_grain(x, (light[:, 1:2] * 255).round())
    assert not torch.equal(clean, x)
    with torch.no_grad():
        seen = model(x)
        x[:, 10] = 0
        alone = model(x)
        monkeypatch.setattr("training.kernel_model.without_grain", lambda x, light: x)
        assert torch.equal(seen, model(clean)) == (
            bilateral in (kernel.ALL_STEPS, kernel.CLEAN_AND_SMOOTH))
        clean[:, 10] = 0
        assert not torch.equal(alone, model(clean))


@pytest.mark.parametrize("features", [("albedo", "normal"), ("albedo",), ("normal",)])
@pytest.mark.parametrize("steps", [kernel.ALL_STEPS, kernel.CLEAN_AND_SMOOTH])
@pytest.mark.parametrize("height, width", [(19, 1500), (90, 300), (300, 90)])
def test_the_program_gives_the_bytes_of_numpy(height, width, features, steps, build, work):
    rng = np.random.default_rng(5)
    albedo = half_grainy(height, width)
    images = {"color": albedo * rng.gamma(1, 1, (height, width, 1)).astype(np.float32),
              "albedo": albedo, "normal": half_grainy(height, width)[:, ::-1] * 2 - 1}
    images = {f: v for f, v in images.items() if f == "color" or f in features}
    model = kernel.load(GOLDEN)
    model.bilateral = steps
    write_tensors("weights.tza", tensors_of(model))
    want, clean = (kernel.run_frame(model, pixels.Frame(images, "hdr", 1.0, clean_aux=c))
                   for c in (False, True))
    assert not np.array_equal(want, clean)
    for more in ([], ["--maxmem", "4"], ["--threads", "3"], ["--inplace"], ["--clean_aux"],
                 ["--clean_aux", "--inplace"]):
        got = run(build, work, images, "weights.tza", "--hdr", "--is", "1", *more)
        expected = clean if "--clean_aux" in more else want
        assert (got.view(np.uint32) == expected.view(np.uint32)).all(), more


def test_features_without_noise_keep_all_they_have(monkeypatch):
    albedo = half_grainy(40, 60)
    images = {"color": albedo * np.random.default_rng(1).gamma(1, 1, (40, 60, 1)).astype("f4"),
              "albedo": albedo, "normal": tilted(salt(40, 60)[..., :1] > 0.5)}
    model = kernel.load(GOLDEN)
    clean, noisy = (kernel.run_frame(model, pixels.Frame(images, "hdr", 1.0, clean_aux=c))
                    for c in (True, False))
    monkeypatch.setattr(kernel, "without_grain", lambda albedo, normal, codes: (albedo, normal))
    assert np.array_equal(clean, kernel.run_frame(model, pixels.Frame(images, "hdr", 1.0)))
    assert not np.array_equal(clean, noisy)


def test_gradients_pass_to_features():
    x = torch.rand(1, 12, 32, 32)
    x[:, 9:11], x[:, 11] = 1, 0
    x.requires_grad_()
    model = nets.build("k12", 0)
    kernel_model.run(model.trunk, "pu", x).sum().backward()
    assert x.grad[:, 3:6].abs().sum() > 0 and x.grad[:, 6:9].abs().sum() > 0
