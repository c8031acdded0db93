"""Albedo as it counts: black pixels, lamps, sparks; in numpy, PyTorch and the program."""
from __future__ import annotations

import numpy as np
import pytest

from export import kernel, pixels
from export.albedo import ALBEDO_MOST, EMPTY_ALBEDO, counted_albedo
from tests.training.test_reference_core import GOLDEN, run
from training import kernel_model
from training.features import clean, encode

WEIGHTS = GOLDEN / "kernel" / "weights.tza"


def test_black_albedo():
    """White where it is a lamp's, EMPTY_ALBEDO where runs of four pixels show nothing."""
    albedo, light = np.full((2, 10, 3), 0.5, np.float32), np.ones((2, 10, 3), np.float32)
    albedo[0, [0, 3, 4, 5, 9]] = albedo[1] = 0
    light[0, [3, 5]] = light[1] = 0
    light[1, 8] = (0, 0, 1e-3)
    albedo[1, 2] = (0, 0, 0.2)
    found = counted_albedo(albedo, light)
    none, empty = 1, EMPTY_ALBEDO
    expected = albedo.copy()
    expected[0, [0, 3, 4, 5, 9]] = none  # a run with light: columns 0 and 4; 9 has it itself
    expected[1, [0, 1, 3, 4, 5, 6, 7]], expected[1, 8:] = empty, none
    assert np.array_equal(found, expected)
    light[0, 4] = 0
    expected[0, [4, 5]] = empty
    assert np.array_equal(counted_albedo(albedo, light), expected)
    expected[expected == empty] = none
    assert np.array_equal(counted_albedo(albedo, light, is_clean=True), expected)
    seen = kernel_model.planes(np.concatenate([light, albedo], -1), ["hdr", "alb"])[..., 3:6]
    assert np.array_equal(seen, counted_albedo(albedo, light))


def test_lamps_are_dimmed_and_sparks_have_no_more_than_the_others_of_their_run():
    albedo = np.full((2, 10, 3), 0.5, np.float32)
    albedo[0, 1] = 9, 1.2, 0.9         # 9/4, and others have 1.5 together
    albedo[0, 4:8, 0] = 12, 32, 64, 3  # 3, 8, 16, 1; others have 25, 20, 12, 27
    albedo[0, 9] = 7                   # the last run has two pixels
    albedo[1, :4], albedo[1, 4:8] = 64, 4
    expected = albedo.copy()
    expected[0, 1], expected[0, 4:8, 0], expected[0, 9] = (1.5, 1, 0.9), (3, 8, 12, 1), 1
    expected[1, :4], expected[1, 4:8] = 16, 1
    light = np.ones_like(albedo)
    for is_clean in (False, True):
        assert np.array_equal(counted_albedo(albedo, light, is_clean), expected)


def test_only_kernel_prediction_sees_lamps():
    albedo = np.float32([[[0.5, 3, 99], [np.nan, np.inf, -1]]])
    seen = clean(albedo, "alb")
    assert np.array_equal(seen, [[[0.5, 3, ALBEDO_MOST], [0, ALBEDO_MOST, 0]]])
    light = np.ones_like(albedo)
    assert encode({"hdr": light, "alb": seen}, "hdr", "pu").max() <= 1
    assert encode({"alb": seen}, "alb", "linear", most=float(ALBEDO_MOST)).max() <= 1
    codes = encode({"hdr": light, "alb": seen}, "hdr", "pu", most=float(ALBEDO_MOST))
    assert codes[0, 0, 4] == 3 and codes[0, 0, 5] == ALBEDO_MOST
    assert np.array_equal(kernel_model.planes(codes, ["hdr", "alb"])[..., 3:6],
                          counted_albedo(seen, light))


def lamps(height: int, width: int) -> dict[str, np.ndarray]:
    """A picture with lamps, sparks, black pixels and what is no number."""
    rng = np.random.default_rng(width)
    albedo = rng.random((height, width, 3), np.float32)
    y, x = np.mgrid[:height, :width]
    albedo[(y // 5 + x // 7) % 5 == 0] *= 20
    albedo[rng.random((height, width)) < 0.05] *= 60
    albedo[rng.random((height, width)) < 0.05] = 0
    for v in (np.nan, np.inf, -np.inf, -3, 1e30):
        albedo[rng.integers(height), rng.integers(width), rng.integers(3)] = v
    color = rng.gamma(1, 1, (height, width, 3)) * np.clip(np.nan_to_num(albedo), 0, 50)
    normal = rng.normal(0, 1, (height, width, 3)).clip(-1, 1)
    return {"color": color.astype(np.float32), "albedo": albedo,
            "normal": normal.astype(np.float32)}


@pytest.mark.parametrize("features", [("color", "albedo"), ("color", "albedo", "normal")])
@pytest.mark.parametrize("height, width", [(23, 1501), (90, 131), (3, 2), (1, 1)])
def test_the_program_gives_the_bytes_of_numpy(height, width, features, build, work):
    images = {f: v for f, v in lamps(height, width).items() if f in features}
    model = kernel.load(WEIGHTS)
    want, exact = (kernel.run_frame(model, pixels.Frame(images, "hdr", clean_aux=c))
                   for c in (False, True))
    for more in ([], ["--inplace"], ["--maxmem", "4"], ["--threads", "3"], ["--clean_aux"]):
        got = run(build, work, images, WEIGHTS, "--hdr", *more)
        expected = exact if "--clean_aux" in more else want
        assert (got.view(np.uint32) == expected.view(np.uint32)).all(), more
