"""Models of family K for an albedo or normals alone: trained, exported, the same in numpy and C."""
from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from export import bilateral, export, kernel, pixels, quantize_kernel
from export.quantize_kernel import tensors_of, write_tensors
from tests.training.test_kernel_train import QUICK
from training import infer, kernel_model, train
from training.augment import Augment
from training.data import Batches, Picture
from training.imageio import read_image, write_image
from training.kernel_integer import IntegerKernel
from training.settings import parse

ROOT = Path(__file__).resolve().parent.parent.parent
SMALL = ROOT / "tests" / "golden" / "kernel" / "weights.tza"
KINDS = {"alb": "albedo", "nrm": "normal"}


@pytest.fixture(scope="module")
def model() -> kernel.IntTrunk:
    """A small model that says that it is for these."""
    made = kernel.load(SMALL)
    made.bilateral = kernel.ALONE
    return made


def noise(kind: str, height: int, width: int) -> np.ndarray:
    rng = np.random.default_rng(5)
    image = rng.random((height, width, 3), np.float32) ** 2
    return image * 2 - 1 if kind == "nrm" else image


def program(build: Path, *args, expect: int = 0) -> str:
    path = build / "bin" / "oidnDenoise"
    if not path.exists():
        pytest.skip("optional: the programs are not built")
    run = subprocess.run([path, *map(str, args)], capture_output=True, text=True)
    assert run.returncode == expect, run.stderr
    return run.stderr


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("more", [[], ["--threads", "2", "--maxmem", "0"], ["--inplace"]])
def test_the_library_equals_numpy(build, work, model, kind, more):
    """To the bit; odd numbers of pixels, values out of range and NaN among them."""
    image = noise(kind, 53, 71)
    image[3:5, 7:9] = [[[np.nan, 2, -3]]]
    write_tensors(Path("m.tza"), tensors_of(model))
    write_image(Path("in.pfm"), image)
    program(build, "-d", "cpu", f"--{kind}", "in.pfm", "-o", "out.pfm", "-w", "m.tza", *more)
    want = kernel.run_frame(model, pixels.Frame({KINDS[kind]: image}, "ldr"))
    assert np.array_equal(read_image(Path("out.pfm")), want)
    assert np.abs(want - np.nan_to_num(image)).max() > 0.01


def test_encoded_albedo(build, work, model):
    """The network sees linear codes of it, twice."""
    image = noise("alb", 32, 48)
    write_tensors(Path("m.tza"), tensors_of(model))
    write_image(Path("in.pfm"), image)
    program(build, "-d", "cpu", "--alb", "in.pfm", "--srgb", "-o", "out.pfm", "-w", "m.tza")
    want = kernel.run_frame(model, pixels.Frame({"albedo": image}, "srgb"))
    assert np.array_equal(read_image(Path("out.pfm")), want)


def test_other_images_are_refused(build, work, model):
    write_tensors(Path("m.tza"), tensors_of(model))
    write_image(Path("in.pfm"), noise("alb", 32, 48))
    for images in (["--hdr", "in.pfm"], ["--hdr", "in.pfm", "--alb", "in.pfm"]):
        text = program(build, "-d", "cpu", *images, "-o", "x.pfm", "-w", "m.tza", expect=2)
        assert "for an albedo or normals alone" in text and not Path("x.pfm").exists()
    with pytest.raises(kernel.ModelError, match="alone"):
        kernel.run_frame(model, pixels.Frame({"color": noise("alb", 32, 48)}))


@pytest.mark.parametrize("kind", KINDS)
def test_pytorch_sees_the_codes_of_the_library(model, kind):
    """Whole codes, so that no rounding differs."""
    rng = np.random.default_rng(7)
    codes = rng.integers(0, 256, (32, 48, 3)).astype(np.float32) / 255
    image = codes * 2 - 1 if kind == "nrm" else codes
    x = torch.from_numpy(kernel_model.planes(codes, [kind]).transpose(2, 0, 1).copy())[None]
    net = IntegerKernel(model, "linear").eval()
    with torch.no_grad():
        got = net(x)[0].numpy().transpose(1, 2, 0)
    want = kernel.run_frame(model, pixels.Frame({KINDS[kind]: image}, "ldr"))
    want = want / 2 + 0.5 if kind == "nrm" else want
    assert np.abs(got - want).mean() < 2e-3  # logarithms may round to another code
    flags = x[0, 9:, 0, 0]
    assert flags.tolist() == [0, 1, 1] and not x[0, 3:6].any() and torch.equal(x[0, 6:9], x[0, :3])


@pytest.mark.parametrize("kind", KINDS)
def test_trained_and_exported(raw, work, build, fails, capsys, kind):
    train.main([kind, "--raw", "-t", "train", *QUICK, "-D", str(raw), "-v", "valid", "-r", "k",
                "-e", "20", "--max_lr", "5e-3", "--valid_epochs", "20", "--collage", "0.2",
                "--texture", "0.2", "--minify", "0.2", "--defocus", "0.2"])
    infer.main(["-r", "k", "-D", str(raw), "-i", "valid"])
    export.main(["-r", "k", "--int8", "-o", "k.tza"])
    model = kernel.load("k.tza")
    assert model.is_alone
    stem = raw / "valid/scene0/view0_0004spp"
    write_image(Path("in.pfm"), read_image(Path(f"{stem}.{kind}.exr")))
    program(build, f"--{kind}", "in.pfm", "-o", "c.pfm", "-w", "k.tza")
    a = read_image(Path("c.pfm"))
    b = read_image(Path(f"infer/valid/scene0/view0_0004spp.k.{kind}.exr"))
    assert np.abs(a - b).mean() < 0.01
    code, message = fails(bilateral.main, ["k.tza", "x.tza"])
    assert code == 4 and "no such steps" in message
    code, message = fails(quantize_kernel.main, ["k.tza", "x.tza", "--data", str(raw / "train")])
    assert code == 4 and "in colour" in message


def test_values_stay_in_range():
    """Augmentations that albedo takes, too; textures are not for normals."""
    y = np.linspace(0, 1, 64 * 64 * 3, dtype=np.float16).reshape(64, 64, 3)
    pictures = [Picture("p", [y, 1 - y], [1.0, 2.0], y)] * 2
    every = Augment(collage=1.0, texture=1.0, zoom=1.0, minify=1.0, blur=1.0, defocus=1.0,
                    fireflies=1.0, hits=1.0)
    for kind in KINDS:
        batches = Batches(pictures, [kind], kind, "linear", 8, 32, 3, every, family="K")
        for step in range(3):
            x, target = batches[step]
            assert 0 <= x.min() and x.max() <= 1 and 0 <= target.min() and target.max() <= 1
    assert "texture" not in batches.on and "fireflies" not in batches.on


def test_codes_are_linear():
    s = parse("train", ["alb", "--net", "kernel5", "-x", "srgb"])
    assert s.transfer == "linear" and s.main_feature == "alb"
