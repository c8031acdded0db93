"""Models that smooth along their result, and the same without: export.bilateral, program, numpy."""
import subprocess

import numpy as np
import pytest

from export import bilateral, kernel
from export.graph import ModelError
from export.pixels import Frame
from export.quantize import write_tensors
from export.synthetic import noisy
from export.tza import Reader
from tests.training.test_reference_core import GOLDEN, run
from training.imageio import write_pfm

SMOOTHS = GOLDEN / "kernel" / "weights.tza"


def test_there_and_back(work):
    plain, again = work / "plain.tza", work / "again.tza"
    bilateral.main(["--off", str(SMOOTHS), str(plain)])
    assert kernel.BILATERAL not in Reader(plain) and kernel.BILATERAL in Reader(SMOOTHS)
    bilateral.main([str(plain), str(again)])
    assert again.read_bytes() == SMOOTHS.read_bytes()


@pytest.mark.parametrize("option", ([], ["--smooth"], ["--off"]))
@pytest.mark.parametrize("width,height,features", (
    (1500, 23, ("color", "albedo", "normal")), (70, 150, ("color", "albedo")),
    (33, 40, ("color", "normal")), (21, 3, ("color",)),
    (9, 17, ("color", "albedo")), (1, 1, ("color", "albedo", "normal"))))
def test_program_and_reference_agree(width, height, features, option, build, work):
    weights = work / "weights.tza"
    bilateral.main([*option, str(SMOOTHS), str(weights)])
    images = {f: v[:height, :width] for f, v in noisy(max(width, 70), 5, 2).items()
              if f in features}
    images["color"] = images["color"].copy()
    images["color"][::13, 5::37] *= 300  # so few that they are fireflies
    wanted = kernel.run_frame(kernel.load(weights), Frame(images, "hdr"))
    for more in ([], ["--inplace"], ["--maxmem", "3"], ["--inplace", "--maxmem", "3"],
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
    write_tensors(path, dict(Reader(SMOOTHS)) | {kernel.BILATERAL: np.full(1, 3, np.float32)})
    with pytest.raises(ModelError, match=kernel.BILATERAL):
        kernel.load(path)
    write_pfm(work / "color.pfm", noisy(16, 1, 1)["color"])
    done = subprocess.run([build / "bin" / "oidnDenoise", "--hdr", "color.pfm", "-w", path, "-o",
                           "out.pfm"], cwd=work, capture_output=True, text=True)
    assert done.returncode != 0 and "weights.tza" in done.stderr
