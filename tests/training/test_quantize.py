"""The quantiser: its files, its accuracy, its errors. Pictures of one test share one EXR folder."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from export import quantize
from export.accuracy import Sample, compare, ssim
from export.calibrate import Kind, frame_of, network_inputs, read_picture, synthetic_frames
from export.pixels import Frame, srgb_forward
from export.quantize import integer_tensors, write_integer
from export.quantizer import Options, Quantizer, channel_range
from export.reference import NARROW_MAX, load_model
from export.synthetic import noisy, scene
from export.tza import Reader, write_weights
from training import metrics
from training.errors import DATA, OUTPUT, STATE, USAGE
from training.imageio import write_exr, write_image

ROOT = Path(__file__).resolve().parent.parent.parent
GOLDEN = ROOT / "tests" / "golden"
SHIPPED = [ROOT / "weights" / f"rt_hdr{features}_w16.tza" for features in ("_alb_nrm", "")]
LAYERS = {"color": ("R", "G", "B"), "albedo": ("albedo.R", "albedo.G", "albedo.B"),
          "normal": ("normal.X", "normal.Y", "normal.Z")}


@pytest.fixture(scope="module")
def pictures(tmp_path_factory) -> Path:
    """a.exr with layers, b.hdr.exr with b.alb.exr and b.nrm.exr, plain.exr with color only."""
    folder = tmp_path_factory.mktemp("pictures")
    images = noisy(64, 7, 4)
    write_exr(folder / "a.exr", np.concatenate([images[f] for f in LAYERS], -1),
              sum(LAYERS.values(), ()))
    for feature, short in zip(LAYERS, ("hdr", "alb", "nrm")):
        write_image(folder / f"b.{short}.exr", images[feature])
    write_image(folder / "plain.exr", images["color"])
    return folder


def fp16(name: str) -> Path:
    return GOLDEN / name / "weights.tza"


@pytest.mark.parametrize("name,extra", [
    ("unet_9_mixed", ["--calib", "a.exr", "b.hdr.exr"]),
    ("unet_3_eights", ["--calib", "plain.exr", "--wide"]),
    ("unet_6_wide", ["--calib", "a.exr", "--ldr", "--wide", "dec_conv1a", "dec_conv2b"]),
    ("unet_large_9_mixed", ["--calib", "a.exr", "--ranges", "mse"]),
    ("unet_large_3_wide", ["--calib", "plain.exr", "--srgb", "--nearest", "--equalize", "0"]),
    ("unet_3_narrow", ["--calib", "plain.exr", "--lightmap-dir", "--ranges", "percentile"]),
])
def test_any_topology(name, extra, pictures, work, capsys, monkeypatch):
    """The file loads (its loader checks pairs and sums) and does what the original does."""
    monkeypatch.chdir(pictures)
    out = work / "out.tza"
    quantize.main([str(fp16(name)), str(out), *extra, "--report"])
    text = capsys.readouterr().out
    exact, made = load_model(fp16(name)), load_model(out)
    assert [x.layer.name in text for x in made.layers] == [True] * len(made.layers)
    kind = Kind.of(exact.inputs, "hdr", "color")
    other = noisy(48, 99, 4)
    x = frame_of({f: other[f] for f in kind.features}, kind).network_input()
    wanted, got = exact.run(x).clip(max=32767 * made.output_scale), made.run(x)
    noise, signal = ((got - wanted) ** 2).mean(), (wanted**2).mean()
    snr = 10 * np.log10(signal / noise)
    assert snr > 26, f"{snr} dB"


def test_same_bytes_again_and_without_torch(pictures, work):
    """Deterministic, and numpy is enough: torch is made impossible to import."""
    code = ("import sys; sys.modules['torch'] = None; sys.path.insert(0, {root!r})\n"
            "from export import quantize; quantize.main(sys.argv[1:])")
    files = []
    for name in ("one.tza", "two.tza"):
        done = subprocess.run([sys.executable, "-c", code.format(root=str(ROOT)),
                               str(fp16("unet_9_tall")), str(work / name), "--calib",
                               str(pictures / "a.exr"), "--report"], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        files.append((work / name).read_bytes())
    assert files[0] == files[1]
    assert sorted(f.name for f in work.iterdir()) == ["one.tza", "two.tza"], "leftovers"
    tensors = Reader(work / "one.tza")
    assert {str(a.dtype) for a in tensors.values()} == {"int8", "int32", "float32"}


def model_with(work: Path, name: str, change) -> str:
    tensors = {k: np.array(v, np.float32) for k, v in Reader(fp16("unet_9_tall")).items()}
    change(tensors)
    write_weights(work / f"{name}.tza", tensors)
    return str(work / f"{name}.tza")


def double(name):
    def change(t):
        t[name] = np.concatenate((t[name], t[name]))
    return change


def test_bad_inputs(pictures, work, fails):
    good, a, plain = str(fp16("unet_9_tall")), str(pictures / "a.exr"), str(pictures / "plain.exr")
    integer = str(GOLDEN / "int_unet_9_mixed" / "weights.tza")
    (work / "text.tza").write_text("not a model, but long enough to be one")
    (work / "text.exr").write_text("not a picture")
    for args, code, word in (
            ([str(work / "none.tza"), "o.tza"], STATE, "none.tza"),
            ([str(work / "text.tza"), "o.tza"], STATE, "text.tza"),
            ([integer, "o.tza"], STATE, "integer model already"),
            ([model_with(work, "a", lambda t: t.pop("dec_conv2b.bias")), "o"], STATE, "dec_conv2b"),
            ([model_with(work, "b", double("dec_conv0.bias")), "o.tza"], STATE, "dec_conv0"),
            ([good, "o.tza", "--wide", "enc_conv1"], USAGE, "pools"),
            ([good, "o.tza", "--wide", "enc_conv9"], USAGE, "enc_conv9"),
            ([good, "o.tza", "--albedo"], USAGE, "9 input channels"),
            ([good, "o.tza", "--calib", str(work / "none.exr")], DATA, "none.exr"),
            ([good, "o.tza", "--calib", str(work / "text.exr")], DATA, "text.exr"),
            ([good, "o.tza", "--calib", plain], DATA, "no albedo"),
            ([good, "o.tza", "--calib", a, "--headroom", "0"], USAGE, "--headroom"),
            ([good, "o.tza", "--calib", a, "--test", f"{a}={ROOT}"], DATA, ""),
            ([good, str(work / "text.tza" / "o.tza"), "--calib", a], OUTPUT, "o.tza")):
        got, message = fails(quantize.main, args)
        assert got == code and word in message, (args, got, message)
    assert not list(work.glob("o.tza")), "no output after an error"


def test_nan_weights(work, fails):
    import struct
    path = model_with(work, "nan", lambda t: None)
    data = bytearray(Path(path).read_bytes())
    data[64:66] = struct.pack("<H", 0x7E00)
    Path(path).write_bytes(data)
    code, message = fails(quantize.main, [path, "o.tza"])
    assert code == STATE and "finite" in message


def test_pictures_and_kinds(pictures):
    kind = Kind.of(9, "hdr", "color")
    a, b = read_picture(pictures / "a.exr", kind), read_picture(pictures / "b.hdr.exr", kind)
    assert all((a[f] == b[f]).all() for f in LAYERS)
    assert Kind.of(3, "ldr", "normal") == Kind(("normal",), "ldr")
    inputs = network_inputs([frame_of(a, kind)] * 3)
    assert [x.shape for x in inputs] == [(64, 64, 9)] * 3
    large = Frame({"color": np.ones((900, 1100, 3), np.float32)})
    assert network_inputs([large])[0].shape == (512, 512, 3), "large pictures are cut"


def test_codes_of_pngs_are_those_of_features(pictures, work):
    """As oidnDenoise and training take them: sRGB but for --srgb, normals as n*0.5+0.5."""
    images = read_picture(pictures / "a.exr", Kind.of(9, "hdr", "color"))
    images["color"] = np.clip(images["color"], 0, 1)
    write_image(work / "a.ldr.png", srgb_forward(images["color"]))
    write_image(work / "a.alb.png", srgb_forward(images["albedo"]))
    write_image(work / "a.nrm.png", images["normal"] * 0.5 + 0.5)
    for content, color in ("ldr", images["color"]), ("srgb", srgb_forward(images["color"])):
        got = read_picture(work / "a.ldr.png", Kind.of(9, content, "color"))
        for feature, want in (images | {"color": color}).items():
            assert np.abs(got[feature] - want).max() < 0.02, (content, feature)
    lone = read_picture(work / "a.nrm.png", Kind.of(3, "ldr", "normal"))
    assert lone["normal"].min() < -0.9


@pytest.mark.parametrize("content", ("hdr", "ldr", "srgb", "lightmap-hdr", "lightmap-dir"))
def test_synthetic_pictures_use_the_range(content):
    for frame in synthetic_frames(Kind.of(9, content, "color")):
        x = frame.network_input()
        assert x.min() >= 0 and x.max() <= 1.25 and (x.std((0, 1)) > 0.02).all()


def test_ranges():
    values = np.concatenate([np.linspace(0, 1, 20000), [2.0]])
    assert channel_range(values, "max", 0) == 2
    assert channel_range(values, "percentile", 99.9) < 1.01
    assert channel_range(np.concatenate([values] * 20 + [[3.0]]), "mse", 0) < 2.6
    assert channel_range(np.zeros(5), "max", 0) == 0


def deepest_error(model, made):
    """Largest difference of a layer's codes from the dequantised layer's exact output, in codes."""
    worst = 0.0
    q = made
    for layer in q.model.layers:
        name, maps = layer.layer.name, q.codes[0]
        unit = layer.scale.astype(np.float64)  # output codes per accumulator unit
        up = 2 if layer.layer.up else 1
        h = maps[layer.layer.source].shape[0] * up
        plain = np.zeros((h, maps[layer.layer.source].shape[1] * up, layer.outputs))
        from export.convolve import pooled, taps_3x3, taps_phases
        for part in layer.parts():
            x = maps[part.name][..., part.channels].astype(np.float64)
            x = x * 2.0**-layer.shift if part.wide else x
            (taps_phases if part.up else taps_3x3)(plain, x, part.weight, 0)
        wanted = np.clip((plain + layer.bias) * unit, 0, layer.out_max)
        wanted = pooled(wanted) if layer.layer.pool else wanted
        slack = 0.5 + (0.5 * unit if layer.shift else 0) + 1e-3
        worst = max(worst, float((abs(maps[name] - wanted) / slack).max()))
    return worst


def test_codes_are_the_dequantised_graph_rounded():
    """Each layer, done in double precision on dequantised weights, is within half a code."""
    model = load_model(fp16("unet_9_mixed"))
    frame = frame_of(noisy(64, 3, 2), Kind.of(9, "hdr", "color"))
    made = Quantizer(model, network_inputs([frame]), Options(samples=2000))
    made.run()
    assert deepest_error(model, made) <= 1
    assert {x.shift > 0 for x in made.model.layers} == {False, True}
    assert all(c[n].max() <= made.tops.get(n, NARROW_MAX) for c in made.codes for n in c)


def test_bias_correction_and_rounding_by_effect_help():
    model = load_model(fp16("unet_9_mixed"))
    kind = Kind.of(9, "hdr", "color")
    inputs = network_inputs([frame_of(noisy(64, 3, 2), kind)])
    x = network_inputs([frame_of(noisy(64, 4, 2), kind)])[0]
    wanted = model.run(x)

    def error(**options):
        made = Quantizer(model, inputs, Options(samples=4000, **options)).run()
        return float(((made.run(x) - wanted) ** 2).mean())

    assert error() < 0.7 * error(refine=False, correct_bias=False)


def test_albedo_and_normals_are_narrow_unless_asked_for(tmp_path):
    """Rounded to 8 bits they change little, and the layers that read them work on bytes."""
    model = load_model(fp16("unet_9_mixed"))
    frame = frame_of(noisy(64, 3, 2), Kind.of(9, "hdr", "color"))
    inputs, errors = network_inputs([frame]), []
    for wide_aux in (False, True):
        made = Quantizer(model, inputs, Options(samples=4000, wide_aux=wide_aux)).run()
        write_integer(tmp_path / "model.tza", integer_tensors(made))
        again = load_model(tmp_path / "model.tza")
        assert again.aux == (0 if wide_aux else 6)
        assert (again.run(inputs[0]) == made.run(inputs[0])).all()
        errors.append(float(((again.run(inputs[0]) - model.run(inputs[0])) ** 2).mean()))
    assert errors[0] < 1.5 * errors[1]


def test_errors_below_zero_do_not_move_biases():
    """Inputs that came out too small on the left, where the output is far below 0 either way; on
    the right all is well. Evening out the mean error before the ReLU would darken the right."""
    model = load_model(fp16("unet_9_mixed"))
    inputs = network_inputs([frame_of(noisy(32, 3, 2), Kind.of(9, "hdr", "color"))])
    q = Quantizer(model, inputs, Options(samples=2000))
    q.run()
    layer = model.net.layers[1]
    weight, bias = (model.tensors[f"{layer.name}.{kind}"] for kind in ("weight", "bias"))
    weight[:], bias[:] = -1, 1
    source, codes = q.floats[0][layer.source], q.codes[0][layer.source]
    source[:], codes[:] = 0, 0
    half = source.shape[1] // 2
    codes[:, :half] = 100
    source[:, :half] = 200 * q.steps[layer.source]
    q.steps[layer.name][:] = 1 / 64
    out = q._layer(layer).run(q.codes[0]) * q.steps[layer.name]
    assert not out[:, :half // 2 - 1].any() and abs(out[:, half // 2 + 1:] - 1).max() < 1 / 32


@pytest.mark.parametrize("channels", (3, 1))
def test_a_dead_network_can_be_quantised(channels):
    """Weights of zero, biases below zero: no division by zero, scales within the format."""
    tensors = {k: np.array(v, np.float32) for k, v in Reader(fp16("unet_3_eights")).items()}
    for name, tensor in tensors.items():
        if name.startswith("enc_conv5" if channels == 3 else "enc"):
            tensor[:] = 0 if name.endswith("weight") else -1
    model = load_model(fp16("unet_3_eights"))
    model.tensors.update(tensors)
    frame = frame_of({"color": noisy(32, 1, 1)["color"]}, Kind.of(3, "hdr", "color"))
    made = Quantizer(model, network_inputs([frame]), Options(samples=500)).run()
    x = network_inputs([frame])[0]
    assert abs(made.run(x) - model.run(x)).max() < 0.05
    assert all((x.scale < 0.5).all() for x in made.layers)


# ---- The shipped weights ------------------------------------------------------------------------

@pytest.fixture(scope="module", params=SHIPPED, ids=lambda path: path.stem)
def shipped(request, int8_of):
    out = int8_of(request.param.stem)
    return load_model(request.param), load_model(out), out


def test_loss_of_shipped_weights(shipped):
    """At most 0.1 dB and 0.002 SSIM, on a rendered picture and on a synthetic one."""
    exact, made, _ = shipped
    kind = Kind.of(exact.inputs, "hdr", "color")
    demo = frame_of(read_picture(ROOT / "demo" / "house_0004spp.exr", kind), kind)
    reference = read_picture(ROOT / "demo" / "house_ref.exr", Kind.of(3, "hdr", "color"))["color"]
    other = frame_of({f: noisy(96, 777, 4)[f] for f in kind.features}, kind)
    for sample in (Sample("house", demo, reference),
                   Sample("synthetic", other, scene(96, 777)["color"].astype(np.float32))):
        s = compare(exact, made, sample)
        assert s.psnr_loss <= 0.1 and s.ssim_loss <= 0.002 and s.psnr > 45, s


def test_gradient_has_no_bands(shipped):
    """A smooth ramp comes out as smooth as from fp32: many codes, small steps, no plateaus."""
    exact, made, _ = shipped
    h, w = 48, 512
    ramp = np.geomspace(0.1, 0.6, w, dtype=np.float32)[None, :, None].repeat(h, 0).repeat(3, 2)
    images = {"color": ramp, "albedo": np.full((h, w, 3), 0.5, np.float32),
              "normal": np.tile(np.array([0, 0, 1], np.float32), (h, w, 1))}
    kind = Kind.of(exact.inputs, "hdr", "color")
    frame = Frame({f: images[f] for f in kind.features}, scale=1.0)
    wanted, got = (m.run(frame.network_input())[h // 2, 32:-32] for m in (exact, made))
    distinct = [len(np.unique(got[:, c])) for c in range(3)]
    assert min(distinct) > 0.95 * len(got), distinct
    stored = np.rint(np.clip(got, 0, 1) * 65535).astype(np.uint16)  # at 16 bits, as in a PNG
    assert min(len(np.unique(stored[:, c])) for c in range(3)) > 0.95 * len(got)
    wobble = (got - wanted) - (got - wanted).mean(0)
    assert abs(wobble).max() < 2.0**-10 and abs(np.diff(wobble, axis=0)).max() < 2.0**-12
    narrow = quantise_again(exact, wide=())  # what the wide tensor is for
    rough = narrow.run(frame.network_input())[h // 2, 32:-32] - wanted
    assert rough.std(0).max() > 3 * wobble.std(0).max()


def quantise_again(exact, **options):
    kind = Kind.of(exact.inputs, "hdr", "color")
    inputs = [x[:96, :96] for x in network_inputs(synthetic_frames(kind))]
    return Quantizer(exact, inputs, Options(**options)).run()


def test_ssim_is_the_toolkits():
    rng = np.random.default_rng(0)
    a = rng.uniform(0, 1, (40, 50, 3)).astype(np.float32)
    b = np.clip(a + rng.normal(0, 0.1, a.shape), 0, 1).astype(np.float32)
    assert abs(ssim(a, b) - metrics.ssim(a, b)) < 1e-5
