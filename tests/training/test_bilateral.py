"""Models that smooth along their result, and the same without: export.bilateral, program, numpy."""
import subprocess

import numpy as np
import pytest
import torch

from export import bilateral, kernel
from export.graph import ModelError
from export.pixels import Frame
from export.quantize import write_tensors
from export.synthetic import noisy
from export.tza import Reader
from tests.training.test_kernel_train import RAW, TINY
from tests.training.test_reference_core import GOLDEN, run
from training import export, nets, train
from training.imageio import write_pfm
from training.kernel_integer import IntegerKernel
from training.result import Result, load_model

SMOOTHS = GOLDEN / "kernel" / "weights.tza"


def bands(width: int, height: int) -> dict[str, np.ndarray]:
    """A noisy picture of any shape: bands of a square one, side by side."""
    square = noisy(max(height, min(width, 190), 70), 5, 2)
    rows = range(0, len(square["color"]) - height + 1, height)
    return {f: np.hstack([v[y:y + height] for y in rows])[:, :width] for f, v in square.items()}


def test_there_and_back(work):
    plain, again = work / "plain.tza", work / "again.tza"
    bilateral.main(["--off", str(SMOOTHS), str(plain)])
    assert kernel.BILATERAL not in Reader(plain) and kernel.BILATERAL in Reader(SMOOTHS)
    bilateral.main([str(plain), str(again)])
    assert again.read_bytes() == SMOOTHS.read_bytes()


@pytest.mark.parametrize("option", ([], ["--correct"], ["--smooth"], ["--clean"], ["--off"]))
@pytest.mark.parametrize("width,height,features", (
    (1500, 23, ("color", "albedo", "normal")), (70, 150, ("color", "albedo")),
    (33, 40, ("color", "normal")), (21, 3, ("color",)),
    (9, 17, ("color", "albedo")), (1, 1, ("color", "albedo", "normal"))))
def test_program_and_reference_agree(width, height, features, option, build, work):
    weights = work / "weights.tza"
    bilateral.main([*option, str(SMOOTHS), str(weights)])
    images = {f: v for f, v in bands(width, height).items() if f in features}
    assert images["color"].shape == (height, width, 3)
    images["color"] = images["color"].copy()
    images["color"][::13, 5::37] *= 300  # so few that they are fireflies
    wanted = kernel.run_frame(kernel.load(weights), Frame(images, "hdr"))
    for more in ([], ["--inplace"], ["--maxmem", "5"], ["--inplace", "--maxmem", "5"],
                 ["--threads", "3"]):
        got = run(build, work, images, weights, "--hdr", *more)
        assert (got.view(np.uint32) == wanted.view(np.uint32)).all(), more


def test_it_changes_the_picture():
    images, model = noisy(48, 5, 2), kernel.load(SMOOTHS)
    with_it = kernel.run_frame(model, Frame(images, "hdr"))
    model.bilateral = 0
    without = kernel.run_frame(model, Frame(images, "hdr"))
    assert (with_it != without).mean() > 0.5


def test_other_values_are_refused(build, work):
    path = work / "weights.tza"
    write_tensors(path, dict(Reader(SMOOTHS)) | {kernel.BILATERAL: np.full(1, 6, np.float32)})
    with pytest.raises(ModelError, match=kernel.BILATERAL):
        kernel.load(path)
    write_pfm(work / "color.pfm", noisy(16, 1, 1)["color"])
    done = subprocess.run([build / "bin" / "oidnDenoise", "--hdr", "color.pfm", "-w", path, "-o",
                           "out.pfm"], cwd=work, capture_output=True, text=True)
    assert done.returncode != 0 and "weights.tza" in done.stderr


@pytest.mark.parametrize("value", sorted(kernel.LAST_STEPS))
def test_gradients_pass_through_the_last_steps(value):
    """What is trained is then what evaluation computes, and its gradients are not the filter's."""
    torch.manual_seed(3)
    model = nets.build(TINY, 0)
    model.bilateral, model.learns_last_steps = value, True
    x, g = torch.rand(2, 12, 32, 48), torch.randn(2, 3, 32, 48)
    x[:, 9:11], x[:, 11] = 1, 0
    assert torch.equal(model(x), model.eval()(x))
    with_it = torch.autograd.grad((model.train()(x) * g).sum(), model.head0.bias)[0]
    model.bilateral = 0
    without = torch.autograd.grad((model(x) * g).sum(), model.head0.bias)[0]
    assert with_it.isfinite().all() and not torch.allclose(with_it, without, rtol=0.02)


def test_integers_are_trained_through_the_last_steps():
    """What trains and judges the integer model computes what it will."""
    torch.manual_seed(3)
    net = IntegerKernel(kernel.load(SMOOTHS), "linear").float()
    x = torch.rand(1, 12, 32, 48)
    x[:, 9:11], x[:, 11] = 1, 0
    assert net.bilateral and torch.equal(net.train()(x), net.eval()(x))
    net.train()(x).sum().backward()
    assert net.layers[-1].bias.grad.isfinite().all()


def test_trained_through_the_last_steps(raw, work, fails):
    args = [*RAW, "-D", str(raw), "-e", "2", "--bilateral", "2"]
    train.main([*args, "-r", "k"])
    assert load_model(Result("results", "k"))[0].bilateral == kernel.SMOOTH
    export.main(["-r", "k", "--int8", "-o", "k.tza"])
    assert kernel.load("k.tza").bilateral == kernel.SMOOTH
    code, message = fails(train.main, [*args, "-r", "u", "-m", "unet:" + ",".join(["4"] * 15)])
    assert code == 2 and "--bilateral" in message
