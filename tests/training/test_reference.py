"""The numpy reference: exact sums, golden vectors, pixels, and what its loader refuses."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from export import denoise as command
from export import golden_int, pixels
from export.convolve import taps_3x3, taps_phases
from export.graph import Layer
from export.pixels import Frame
from export.reference import (
    NARROW_MAX,
    WIDE_MAX,
    IntLayer,
    ModelError,
    denoise,
    int_model,
    load_model,
)
from export.tza import Reader, Writer
from training import color
from training.errors import DATA, STATE, USAGE
from training.imageio import read_image, write_exr

GOLDEN = Path(__file__).resolve().parent.parent / "golden"
MIXED = GOLDEN / "int_unet_9_mixed" / "weights.tza"


def sums_by_hand(x, w, first, rows, up):
    """Sums in Python integers, straight from docs/arithmetic.md."""
    h, width = x.shape[0] * (2 if up else 1), x.shape[1] * (2 if up else 1)
    o = len(w) // (4 if up else 1)
    out = np.zeros((rows, width, o), object)
    for y in range(first, first + rows):
        for i in range(width):
            phase = 2 * (y & 1) + (i & 1) if up else 0
            top, left = ((y + 1) // 2 - 1, (i + 1) // 2 - 1) if up else (y - 1, i - 1)
            for dy in range(w.shape[2]):
                for dx in range(w.shape[3]):
                    sy, sx = top + dy, left + dx
                    if 0 <= sy < x.shape[0] and 0 <= sx < x.shape[1]:
                        for c in range(x.shape[2]):
                            for n in range(o):
                                out[y - first, i, n] += (int(x[sy, sx, c])
                                                         * int(w[phase * o + n, c, dy, dx]))
    assert h >= first + rows
    return out


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.integers(1, 3), st.booleans(), st.booleans())
def test_sums_are_exact(seed, channels, up, wide):
    rng = np.random.default_rng(seed)
    top = WIDE_MAX if wide else NARROW_MAX
    x = rng.choice((0, 1, top - 1, top), (4, 2, channels)).astype(np.uint16)
    w = rng.integers(-127, 128, (8, channels, 2, 2) if up else (2, channels, 3, 3))
    w = w.astype(np.int8)
    first, rows = (2, 4) if up else (1, 2)
    out = np.zeros((rows, 4 if up else 2, 2))
    (taps_phases if up else taps_3x3)(out, x, w, first)
    assert (out.astype(np.int64) == sums_by_hand(x, w, first, rows, up)).all()


@settings(max_examples=200)
@given(st.integers(0, WIDE_MAX), st.integers(-127, 127), st.integers(0, NARROW_MAX),
       st.integers(-127, 127), st.integers(-2**30, 2**30), st.floats(0, 0.5, width=32,
       exclude_max=True), st.integers(0, 15), st.sampled_from((NARROW_MAX, WIDE_MAX)))
def test_a_layer_is_the_formula(wide, w, narrow, v, bias, scale, shift, top):
    """One pixel of a layer with a wide and a narrow input, in Python integers."""
    def kernel(tap):
        k = np.zeros((1, 1, 3, 3), np.int8)
        k[0, 0, 1, 1] = tap
        return k

    layer = IntLayer(Layer("l", "a", False, "b", False), kernel(w), kernel(v),
                     np.array([bias], np.int32), np.array([scale], np.float32), shift,
                     WIDE_MAX, NARROW_MAX, top)
    maps = {"a": np.full((1, 1, 1), wide, np.uint16), "b": np.full((1, 1, 1), narrow, np.uint8)}
    a = ((wide * w + ((1 << shift) >> 1)) >> shift) + bias + narrow * v
    multiplier = math.floor(float(np.float32(scale)) * 2**31 + 0.5)
    assert layer.run(maps)[0, 0, 0] == min(max((a * multiplier + 2**30) >> 31, 0), top)


def test_narrow_channels_of_the_input_are_not_shifted():
    """One pixel of a layer on an input of three wide channels and one narrow one."""
    weight = np.zeros((1, 4, 3, 3), np.int8)
    weight[0, :, 1, 1] = 5, -3, 2, 7
    layer = IntLayer(Layer("l", "input", False, None, False), weight, None,
                     np.array([11], np.int32), np.array([0.25], np.float32), 4,
                     WIDE_MAX, NARROW_MAX, NARROW_MAX, aux=1)
    maps = {"input": np.array([[[1000, 333, 77, 200]]], np.uint16)}
    a = ((1000 * 5 - 333 * 3 + 77 * 2 + 8) >> 4) + 11 + 200 * 7
    assert layer.run(maps)[0, 0, 0] == min((a * 2**29 + 2**30) >> 31, NARROW_MAX)
    assert [part.wide for part in layer.parts()] == [True, False]


def test_golden_integer_models():
    assert len(golden_int.CASES) >= 8
    assert golden_int.check(GOLDEN) == []


@pytest.mark.parametrize("name", ("unet_9_mixed", "unet_large_3_wide"))
def test_golden_float_models(name):
    h, w, cin, cout = map(int, (GOLDEN / name / "shape.txt").read_text().split())
    x = np.fromfile(GOLDEN / name / "input.f32", "<f4").reshape(h, w, cin)
    y = np.fromfile(GOLDEN / name / "output.f32", "<f4").reshape(h, w, cout)
    assert abs(load_model(GOLDEN / name / "weights.tza").run(x) - y).max() < 2e-5


# ---- Loader -------------------------------------------------------------------------------------

def model_tensors():
    return {k: np.array(v) for k, v in Reader(MIXED).items()}


def put(name, value, at=0):
    def change(t):
        t[name].flat[at] = value
    return change


def unsafe(t):
    t["enc_conv1.weight"][0, :2, 0, 0] = 65


def huge_sums(t):
    t["dec_conv1a.bias"][:] = 2**31 - 1


def narrow_aux(channels):
    return np.array([32767] * 3 + [255] * (channels - 3), np.int32)


# What may be wrong with a model: a change to its tensors, and a word of the error.
BREAKS = [
    (lambda t: t.pop("enc_conv2.scale"), "enc_conv2.scale"),
    (lambda t: t.pop("dec_conv0.bias"), "dec_conv0.bias"),
    (lambda t: t.pop("dec_conv1a.skip.weight"), "dec_conv1a.skip.weight"),
    (lambda t: t.pop("output.scale"), "output.scale"),
    (lambda t: t.update({"enc_conv2.bias": t["enc_conv2.bias"].astype(np.float32)}),
     "enc_conv2.bias"),
    (lambda t: t.update({"dec_conv4a.weight": t["dec_conv4a.weight"][:-1]}), "dec_conv4a.weight"),
    (put("enc_conv1.weight", -128), "-128"),
    (unsafe, "pair-safe"),
    (put("enc_conv3.scale", 0.5), "enc_conv3.scale"),
    (put("enc_conv3.scale", np.nan), "enc_conv3.scale"),
    (put("enc_conv3.scale", -0.1), "enc_conv3.scale"),
    (put("dec_conv1a.shift", 16), "dec_conv1a.shift"),
    (huge_sums, "32 bits"),
    (put("input.scale", -1.0), "input.scale"),
    (put("output.scale", np.inf), "output.scale"),
    (lambda t: t.update({"input.max": np.full(9, 32767, np.int32)}), "input.max"),
    (lambda t: t.update({"input.max": np.full(9, 255, np.int32)}), "input.max"),
    (lambda t: t.update({"input.max": narrow_aux(6)}), "input.max"),
    (lambda t: t.update({"input.max": narrow_aux(9).astype(np.float32)}), "input.max"),
    (lambda t: t.update({"input.max": narrow_aux(9)}), "pair-safe"),
    (lambda t: t.update({"dec_conv1a.max": np.array([254], np.int32)}), "dec_conv1a.max"),
    (lambda t: t.update({"dec_conv1a.max": np.array([32767, 1], np.int32)}), "dec_conv1a.max"),
    (lambda t: t.update({"enc_conv1.max": np.array([32767], np.int32)}), "enc_conv1.max"),
    (lambda t: t.update({"enc_conv1.max": np.array([8191], np.int32)}), "enc_conv1.max"),
]


@pytest.mark.parametrize("change,word", BREAKS)
def test_broken_models_are_refused(change, word):
    tensors = model_tensors()
    int_model(tensors, "x.tza")  # is fine before
    change(tensors)
    with pytest.raises(ModelError, match="x.tza") as caught:
        int_model(tensors, "x.tza")
    assert word in str(caught.value) and "\n" not in str(caught.value)


def test_pair_safety_does_not_bind_wide_inputs():
    tensors = model_tensors()
    tensors["enc_conv0.weight"][:, :2] = 127
    int_model(tensors, "x.tza")


def test_other_files_are_refused(tmp_path):
    (tmp_path / "empty.tza").write_bytes(b"")
    with Writer(tmp_path / "other.tza") as w:
        w.write("some.weight", np.zeros((1, 1, 3, 3), np.int8))
    for name in ("empty.tza", "other.tza", "missing.tza"):
        with pytest.raises(ValueError, match=name):
            load_model(tmp_path / name)


# ---- Pixels -------------------------------------------------------------------------------------

@pytest.mark.parametrize("name,transfer", [("hdr", "pu"), ("ldr", "srgb"), ("lightmap-hdr", "log")])
def test_transfer_functions_are_near_the_formulas(name, transfer):
    content, exact = pixels.CONTENTS[name], color.TRANSFERS[transfer]
    y = np.geomspace(1e-9, 65504, 20001).astype(np.float32)
    x = content.forward(y)
    assert x.dtype == np.float32
    wanted = exact.forward(y.astype(np.float64))
    assert (abs(x - wanted) <= 5e-7 * np.maximum(wanted, 1)).all()
    back = content.inverse(x)
    assert (abs(back - exact.inverse(x.astype(np.float64))) <= 3e-6 * back + 1e-12).all()


def test_exposure_is_the_toolkits():
    rng = np.random.default_rng(0)
    image = rng.gamma(0.5, 2.0, (50, 37, 3)).astype(np.float32)
    image[0, 0], image[3, 3], image[5, 5] = np.nan, -1, 1e-20
    assert abs(pixels.autoexposure(image) / color.autoexposure(image) - 1) < 1e-5
    assert pixels.autoexposure(np.zeros((4, 4, 3))) == 1
    assert pixels.autoexposure(np.full((4, 4, 3), np.inf)) == 0


def picture(h, w, channels=3):
    rng = np.random.default_rng([h, w])
    return {"color": rng.gamma(1, 1, (h, w, channels)).astype(np.float32),
            "albedo": rng.uniform(0, 1, (h, w, 3)).astype(np.float32),
            "normal": rng.uniform(-1, 1, (h, w, 3)).astype(np.float32)}


@pytest.mark.parametrize("h,w", [(1, 1), (17, 33), (16, 16)])
def test_pictures_of_any_size(h, w):
    model = load_model(MIXED)
    image = denoise(model, Frame(picture(h, w)))
    assert image.shape == (h, w, 3) and np.isfinite(image).all() and (image >= 0).all()
    large = picture(h, w)
    padded = {k: np.pad(v, ((0, -h % 16), (0, -w % 16), (0, 0))) for k, v in large.items()}
    padded["normal"][h:], padded["normal"][:, w:] = -1, -1  # the code of padding is 0
    frame = Frame(padded, scale=float(Frame(large).input_scale()))
    assert (denoise(model, frame)[:h, :w] == image).all()


def test_nonsense_pixels_and_few_channels():
    model = load_model(MIXED)
    images = picture(16, 32)
    for v, values in zip(images.values(), ((np.nan, np.inf, -5), (np.nan, 7, -7), (np.nan, 9, -9))):
        v[0, :3] = np.array(values)[:, None]
    image = denoise(model, Frame(images))
    assert np.isfinite(image).all() and (image >= 0).all()
    ldr = denoise(model, Frame(picture(16, 32), "ldr"))
    assert ldr.max() <= 1
    grey = denoise(model, Frame(picture(16, 16, 1)), 1)
    three = denoise(model, Frame(picture(16, 16, 1)))
    assert grey.shape == (16, 16, 1) and np.allclose(grey[..., 0], three.mean(-1), rtol=1e-5)


def test_command(work, fails):
    images = picture(20, 24)
    write_exr(work / "in.hdr.exr", images["color"])
    write_exr(work / "in.alb.exr", images["albedo"])
    write_exr(work / "in.nrm.exr", images["normal"])
    command.main([str(MIXED), "in.hdr.exr", "out.exr", "--scale", "0.5"])
    command.main([str(MIXED), "in.hdr.exr", "out.pfm", "--scale", "0.5"])
    wanted = denoise(load_model(MIXED), Frame(images, scale=0.5))
    for name in ("out.exr", "out.pfm"):
        assert (read_image(work / name) == wanted).all()
    for args, code, word in ((["none.tza", "in.hdr.exr", "o.exr"], STATE, "none.tza"),
                             ([str(MIXED), "none.exr", "o.exr"], DATA, "none.exr"),
                             ([str(MIXED), "in.hdr.exr", "o.txt"], USAGE, "o.txt"),
                             ([str(MIXED), "in.hdr.exr", "o.exr", "--scale", "nan"], USAGE,
                              "--scale")):
        got, message = fails(command.main, args)
        assert got == code and word in message


def test_an_image_of_infinities_is_black():
    images = picture(16, 16)
    images["color"][:] = np.inf
    assert (denoise(load_model(MIXED), Frame(images)) == 0).all()
