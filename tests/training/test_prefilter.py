"""Family P: a prefilter by itself, before a K model, and in its file."""
from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from export import export, kernel, pixels, quantize_kernel, smooth
from export.dequantize import float_tensors
from export.tza import Reader, Writer
from tests.training.test_kernel_train import QUICK, RAW
from tests.training.test_train import losses
from tests.training.tools import core_and_infer, in_both
from training import infer, nets, prefilter, train
from training.data import Augment, Batches, from_raw
from training.imageio import read_image, write_pfm
from training.kernel_integer import IntegerKernel
from training.result import Result, load_model
from training.scan import scan

GOLDEN = Path(__file__).resolve().parent.parent / "golden" / "kernel" / "prefilter.tza"
ALBEDO = ["alb", "--raw", "-t", "train", *QUICK, "-m", "prefilter:4,4,4,8,8,4,4"]


@pytest.fixture(scope="module")
def tiny(raw, tmp_path_factory) -> str:
    """A prefilter, trained a little and quantised."""
    results = tmp_path_factory.mktemp("prefilter")
    train.main([*ALBEDO, "-D", str(raw), "-R", str(results), "-r", "p", "-e", "2"])
    export.main(["-R", str(results), "-r", "p", "--int8", "-o", str(results / "p.tza")])
    return str(results / "p.tza")


def test_it_learns_to_filter_albedo(raw, work, capsys):
    train.main([*ALBEDO, "-D", str(raw), "-v", "valid", "-r", "p", "-e", "60",
                "--max_lr", "1e-2"])
    loss = losses(capsys.readouterr().out)
    assert np.mean(loss[-10:]) < np.mean(loss[:10]) - 0.05
    infer.main(["-r", "p", "-D", str(raw), "-i", "valid"])
    assert "psnr_avg" in capsys.readouterr().out


def test_the_whole_way(raw, work, tiny, build):
    """A K model behind it: trained, exported with it, the same in the core and in PyTorch; the
    prefilter itself stays as it was."""
    train.main([*RAW, "-D", str(raw), "-r", "k", "-e", "3", "--prefilter", tiny])
    export.main(["-r", "k", "--int8", "-o", "k.tza"])
    joined, alone = kernel.load("k.tza"), kernel.int_prefilter(Reader(tiny), tiny)
    for a, b in zip(joined.prefilter.layers, alone.layers, strict=True):
        assert np.array_equal(a.weight, b.weight) and np.array_equal(a.bias, b.bias)
    model = load_model(Result("results", "k"))[0]
    assert model.frozen and not any(k.startswith("pre_") for k in model.state_dict())
    infer.main(["-r", "k", "-D", str(raw), "-i", "valid"])
    core, ours = core_and_infer(build, raw, "k.tza")
    assert np.abs(core - ours).mean() < 0.05 * ours.mean()


def test_a_joined_file_is_rounded_anew_with_its_prefilter(raw, work):
    assert quantize_kernel.main([str(GOLDEN), "again.tza", "--data", str(raw / "train"),
                                 "--count", "2", "--prefilter", str(GOLDEN)]) == 0
    again, before = kernel.load("again.tza"), kernel.load(GOLDEN)
    assert all(np.array_equal(a.weight, b.weight) for a, b in
               zip(again.prefilter.layers, before.prefilter.layers, strict=True))
    assert again.bilateral == before.bilateral


@pytest.mark.parametrize("height, width", [(37, 45), (16, 33), (21, 19), (5, 3)])
def test_integers_in_pytorch_equal_the_reference(height, width):
    model = kernel.load(GOLDEN)
    images, want, got = in_both(model, height, width)
    assert np.median(np.abs(got - want)) < 1e-3  # codes of the second input that round otherwise
    assert IntegerKernel(model, "linear").integer_model().prefilter is not None
    model.prefilter = None
    other = kernel.run_frame(model, pixels.Frame(images, "hdr", 1.0))
    assert np.median(np.abs(other - want)) > 5e-3


def half_steady() -> dict[str, np.ndarray]:
    """A wide picture whose light becomes steady from left to right, behind noisy albedo of single
    lines."""
    rng = np.random.default_rng(3)
    noise = rng.normal(size=(19, 1500, 3)) * np.linspace(1, -0.5, 1500).clip(0)[:, None]
    albedo = np.repeat(rng.random((19, 1, 3), np.float32) * 0.8 + 0.1, 1500, 1)
    albedo[:, ::7] *= 0.8
    color = (albedo + 0.02) * np.exp(noise) * np.float32(0.7)
    return {"color": color.astype(np.float32), "albedo": albedo.astype(np.float32),
            "normal": np.broadcast_to(np.float32([0, 0, 1]), color.shape).copy()}


def test_the_albedo_stays_where_light_is_steady(build, work):
    """The prefilter's part falls from all to nothing, in PyTorch as in numpy; and the core gives
    the bytes of numpy."""
    program = build / "bin" / "oidnDenoise"
    if not program.exists():
        pytest.skip("optional: the programs are not built")
    images = half_steady()
    codes = kernel.encode(images["color"], images["albedo"], images["normal"], False)
    share = smooth.unsteady(codes)[..., 0]
    assert (share[:, :200] == 1).all() and (share[:, -300:] == 0).all()
    assert len(np.unique(share)) > 100  # and between them all there is
    ours = prefilter.unsteady(torch.from_numpy(codes[None, None, ..., 1].astype(np.float32)))
    np.testing.assert_allclose(ours[0, 0].numpy(), share, atol=1e-6)
    model = kernel.load(GOLDEN)
    filtered = kernel.prefiltered(model.prefilter, codes, images["albedo"])
    assert np.array_equal(filtered[:, -300:], images["albedo"][:, -300:])
    assert np.abs(filtered - images["albedo"])[:, :200].mean() > 0.02
    arguments = []
    for name, option in (("color", "--hdr"), ("albedo", "--alb"), ("normal", "--nrm")):
        write_pfm(Path(f"{name}.pfm"), images[name])
        arguments += [option, f"{name}.pfm"]
    want = kernel.run_frame(model, pixels.Frame(images, "hdr", 1.0))
    for more in ([], ["--maxmem", "4"], ["--threads", "3"]):
        subprocess.run([program, "-w", GOLDEN, "-o", "out.pfm", "--is", "1", *arguments, *more],
                       check=True, capture_output=True)
        assert np.array_equal(read_image(Path("out.pfm")), want)


@pytest.mark.parametrize("name, change", [
    ("pre_head.bias", lambda v: v[:24]), ("pre_enc0.weight", lambda v: v[:, :3]),
    ("pre_dec0.skip.weight", None), ("pre_head.weight", lambda v: v[:24]),
    ("pre_enc1a.bias", lambda v: np.full_like(v, 2**31 - 1))])
def test_broken_prefilters_are_refused(name, change, build, work):
    tensors = dict(Reader(GOLDEN))
    tensors[name] = change and np.ascontiguousarray(change(tensors[name]))
    with Writer(work / "broken.tza") as w:
        for key, value in tensors.items():
            if value is not None:
                w.write(key, value.astype(tensors[key].dtype))
    with pytest.raises(ValueError):
        kernel.load(work / "broken.tza")
    done = subprocess.run([build / "bin" / "lullInfo", work / "broken.tza"], capture_output=True,
                          text=True)
    assert done.returncode != 0 and "broken.tza" in done.stderr


def test_means_are_those_of_the_reference():
    rng = np.random.default_rng(3)
    codes = rng.integers(100, 256, (9, 7, 25)).astype(np.uint8)
    albedo = rng.random((9, 7, 3), np.float32)
    q, a = (torch.from_numpy(v.transpose(2, 0, 1)[None].astype(np.float32))
            for v in (codes, albedo))
    got = prefilter.means(q / 16, a, torch.ones_like(a[:, :1]))[0].numpy().transpose(1, 2, 0)
    np.testing.assert_allclose(got, kernel.feature_means(codes, albedo, 0), rtol=1e-5)


def test_without_albedo_nothing_changes():
    tensors = float_tensors(Reader(GOLDEN), "golden")
    with_it, without = nets.from_tensors(tensors), nets.from_tensors(
        nets.without_prefilter(tensors))
    x = torch.rand(1, 12, 32, 48)
    x[:, 9:12] = torch.tensor([1.0, 0.0, 0.0]).view(1, 3, 1, 1)
    with torch.no_grad():
        assert not torch.equal(with_it(x), without(x))
        x[:, 3:6] = x[:, 9:10] = 0
        assert torch.equal(with_it(x), without(x))


def test_tiles_of_albedo(raw):
    """Black is white, features of the target stay, and --minify makes several pixels one."""
    pictures = from_raw(scan(raw / "train", ["alb"], ["alb"]), ["alb"], "alb", "linear")
    pictures[0].inputs[0][:4] = 0
    for augment in (Augment(), Augment(texture=1.0), Augment(minify=1.0)):
        x, y = Batches(pictures, ["alb"], "alb", "linear", 50, 16, 1, augment, family="P")[0]
        assert x.shape == y.shape == (50, 3, 16, 16) and float(x.max()) <= 1
        inside = (y > 0).any(1)
        assert bool((x > 0).any(1)[inside].all())
    assert not torch.equal(x, y)


def test_what_it_refuses(raw, work, fails):
    code, text = fails(train.main, ["hdr", "alb", *ALBEDO[1:], "-D", str(raw)])
    assert code == 2 and "family P takes alb" in text
    code, text = fails(train.main, [*RAW, "-D", str(raw), "--prefilter", "weights.pt"])
    assert code == 2 and "weights.pt: not an integer model" in text
    code, text = fails(train.main, ["hdr", "--raw", "-t", "train", "-m", "w8", "-D", str(raw),
                                    "--prefilter", str(GOLDEN)])
    assert code == 2 and "family K" in text
